"""Plugins `tensor_tree` and `klems`: energy, mounting, channels, gradients, errors."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins import bsdf_file, energy, peak
from drcmitsuba_plugins.klems_basis import BASES
from drcmitsuba_plugins.tensor import TensorTree

from drcmitsuba.bsdf.merge import merge
from drcmitsuba.runtime import backend
from tests.unit.plugins.measured_files import (
    BLOCK,
    IMPORTANCE,
    KINDS,
    NAMES,
    RADIANCE,
    as_vector,
    draw,
    interaction,
    load,
    random_directions,
    vector,
    write,
    xml,
)


@pytest.fixture(autouse=True, scope="module")
def _first_variant():
    backend.select()


# Energy, mounting, channels, gradients, errors


def test_energy_just_above_one_is_scaled_down(tmp_path):
    path = tmp_path / "white.xml"
    path.write_text(xml("TensorTree4", dict.fromkeys(NAMES, "{%r}" % (0.515 / np.pi))))
    bsdf = load(path)
    assert bsdf.largest_albedo == pytest.approx(1.03)
    _, weight = draw(bsdf, vector(20, 0), RADIANCE, 1000)
    np.testing.assert_allclose(weight[0].numpy(), 1, rtol=1e-5)


def test_only_the_incidences_that_send_out_too_much_are_scaled():
    n = 4
    grid = np.full((n,) * 4, 0.5 / np.pi)
    grid[0, 0] = 1.04 / np.pi
    tree = TensorTree.of_grid(grid)
    file = bsdf_file.BsdfFile("test", "", "", "TensorTree4", {"tb": tree})
    scaled, largest = energy.scaled_to_conserve(file)
    albedos = scaled.components["tb"].albedos()
    assert largest == pytest.approx(1.04)
    assert albedos.max() == pytest.approx(1)
    assert np.sort(albedos)[:-1] == pytest.approx(0.5)


def test_energy_far_above_one_is_refused(tmp_path):
    path = tmp_path / "source.xml"
    path.write_text(xml("TensorTree4", {"rf": "{1.0}"}))
    with pytest.raises(RuntimeError, match=r"source\.xml.* 314 % of the light from the room"):
        load(path)


@pytest.mark.parametrize(
    ("mounting", "signs"),
    [({}, (1, 1, 1)), ({"flip": True}, (-1, 1, -1)), ({"turn": True}, (-1, -1, 1))],
    ids=["as it is", "flipped", "upside down"],
)
def test_mounting_turns_the_file(tmp_path, mounting, signs):
    path = write(tmp_path, "TensorTree4")
    file, bsdf = bsdf_file.read(path), load(path, straight_through="off", **mounting)
    wi, wo = random_directions(2000), random_directions(2000, 1)
    value = bsdf.eval(mi.BSDFContext(), interaction(wi, len(wi)), as_vector(wo))[0].numpy()
    expected = file.query(wo * signs, wi * signs) * np.abs(wo[:, 2])
    assert np.isclose(value, expected, rtol=1e-4, atol=1e-7).mean() > 0.998


def test_up_is_the_files_y_axis(tmp_path):
    path = write(tmp_path, "TensorTree4")
    file = bsdf_file.read(path)
    bsdf = load(path, straight_through="off", up=[1.0, 0.0, 0.0])  # the local x of `interaction`
    wi, wo = random_directions(2000), random_directions(2000, 1)
    value = bsdf.eval(mi.BSDFContext(), interaction(wi, len(wi)), as_vector(wo))[0].numpy()

    def seen(d):
        return np.stack([-d[:, 1], d[:, 0], d[:, 2]], axis=-1)

    expected = file.query(seen(wo), seen(wi)) * np.abs(wo[:, 2])
    assert np.isclose(value, expected, rtol=1e-4, atol=1e-7).mean() > 0.998


def test_a_coloured_file_gives_its_channels(tmp_path):
    path = tmp_path / "coloured.xml"
    body = xml("TensorTree4", {"tf": "{0.02}"}).replace("</Layer></Optical></WindowElement>", "")
    for name, value in (("CIE-u", 0.45), ("CIE-v", 0.523)):  # about the red primary of BT.709
        body += BLOCK.format(
            direction=NAMES["tf"], data=f"{{{value:g}}}", basis="LBNL/Shirley-Chiu", wavelength=name
        )
    path.write_text(body + "</Layer></Optical></WindowElement>")
    file = bsdf_file.read(path)
    red, green, blue = (file.of_channel(c).components["tf"].value[0] for c in range(3))
    assert 0.2126 * red + 0.7152 * green + 0.0722 * blue == pytest.approx(0.02, rel=0.01)
    assert red > 0.08
    assert green + blue < 0.002
    assert load(path, channel=0).leaves.numpy()[0] == pytest.approx(red)
    assert load(path).leaves.numpy()[0] == pytest.approx(0.02)

    mix = (0.5, 0.3, 0.1)
    mixed = np.dot(mix, [red, green, blue])
    assert file.mixed(mix).components["tf"].value[0] == pytest.approx(mixed)
    assert load(path, mix=list(mix)).leaves.numpy()[0] == pytest.approx(mixed)
    assert load(path, mix=0.5).leaves.numpy()[0] == pytest.approx(0.5 * 0.02)  # as if grey


def test_a_mix_scales_a_grey_file_and_is_never_negative(tmp_path):
    path = write(tmp_path, "TensorTree4")
    plain, scaled, none = (load(path, mix=m) for m in ([1, 0, 0], [0.2, 0.2, 0.1], [-1, 0, 0]))
    assert load(path).leaves.numpy() == pytest.approx(plain.leaves.numpy(), rel=1e-5)
    assert scaled.leaves.numpy() == pytest.approx(0.5 * plain.leaves.numpy(), rel=1e-5)
    assert none.leaves.numpy().max() <= 0


def test_leaves_are_differentiable(tmp_path):
    path = write(tmp_path, "TensorTree4")
    bsdf = load(path, straight_through="off")
    params = mi.traverse(bsdf)
    key = next(k for k, _ in params if k.endswith("leaves"))
    wi, wo = random_directions(500), random_directions(500, 1)

    def total():
        si = interaction(wi, len(wi))
        return dr.sum(bsdf.eval(mi.BSDFContext(), si, as_vector(wo))[0])

    leaves = mi.Float(params[key])
    dr.enable_grad(leaves)
    params[key] = leaves
    params.update()
    dr.backward(total())
    gradient = dr.grad(leaves).numpy().astype(float)
    assert (gradient != 0).any()
    # f is linear in its leaves.
    np.testing.assert_allclose(float(total()[0]), gradient @ leaves.numpy(), rtol=1e-4)


def test_new_leaves_are_sampled_anew(tmp_path):
    path = tmp_path / "even.xml"
    path.write_text(xml("TensorTree4", {"tb": "{%s}" % (" 0.1" * 16)}))
    bsdf = load(path)
    params = mi.traverse(bsdf)
    key = next(k for k, _ in params if k.endswith("leaves"))
    # Only light from the left and from below, as it looks from the room, comes through.
    params[key] = mi.Float(np.where(np.arange(16) % 4 == 3, 0.2, 0).astype(np.float32))
    params.update()
    bs, weight = draw(bsdf, vector(50, 40), RADIANCE, 5000)
    np.testing.assert_allclose(weight[0].numpy(), 0.2 * np.pi / 4, rtol=1e-4)
    assert (np.array(bs.wo)[:2] < 1e-6).all()


@pytest.mark.parametrize("kind", KINDS[:3])
def test_every_variant_gives_the_same(variant, tmp_path, kind):
    path = write(tmp_path, kind)
    file, bsdf = bsdf_file.read(path), load(path, straight_through="off")
    wi, wo = random_directions(1000), random_directions(1000, 1)
    value = bsdf.eval(mi.BSDFContext(), interaction(wi, len(wi)), as_vector(wo))
    for channel in value:
        expected = file.query(wo, wi) * np.abs(wo[:, 2])
        assert np.isclose(channel.numpy(), expected, rtol=1e-4, atol=1e-7).mean() > 0.998
    _, weight = draw(bsdf, vector(40, 70), RADIANCE, 10_000)
    assert weight[0].numpy().mean() > 0


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"straight_through": "maybe"}, "straight_through: 'maybe'; give auto, on or off"),
        ({"filename": "nowhere.xml"}, "nowhere.xml: file: No such file or directory"),
    ],
)
def test_wrong_parameters_are_refused(tmp_path, parameters, message):
    path = write(tmp_path, "TensorTree4")
    with pytest.raises(RuntimeError, match=message):
        mi.load_dict({"type": "tensor_tree", "filename": str(path), **parameters})


def test_the_plugin_of_the_other_kind_is_named(tmp_path):
    tree, matrix = write(tmp_path, "TensorTree4"), write(tmp_path, "LBNL/Klems Quarter")
    with pytest.raises(RuntimeError, match="use the plugin tensor_tree"):
        mi.load_dict({"type": "klems", "filename": str(tree)})
    with pytest.raises(RuntimeError, match="use the plugin klems"):
        mi.load_dict({"type": "tensor_tree", "filename": str(matrix)})


# Peaks on coarse leaves, reciprocity, grey, masks


def test_an_isotropic_peak_keeps_the_energy_on_coarse_leaves():
    n = 16
    s0, s1, s2 = (np.indices((n,) * 3) + 0.5) / n
    straight = (np.abs(1 - s0 - s1) < 0.5 / n) & (np.abs(s2 - 0.5) < 1 / n)
    fine = TensorTree.of_grid(np.where(straight, 20 * (0.5 + s0), 0.05))
    coarse = merge(fine, percent=70)
    assert len(coarse) < len(fine)
    for tree in (fine, coarse):
        part = peak.split(tree)
        live = slice(0, n // 2)
        albedos = (part.rest.albedos() + part.through)[live]
        np.testing.assert_allclose(albedos, tree.albedos()[live])
        assert part.share > 0.3


@pytest.mark.parametrize("kind", ["TensorTree4", "TensorTree3", "LBNL/Klems Quarter"])
def test_energy_counts_a_transmission_by_reciprocity(tmp_path, kind):
    def file(t, r):
        path = tmp_path / f"{t}{r}.xml"
        if kind.startswith("Tensor"):
            data = {n: "{%r}" % (v / np.pi) for n, v in (("tb", t), ("rf", r))}
            path.write_text(xml(kind, data))
        else:
            count = len(BASES[kind]) ** 2
            data = {n: f"{v / np.pi} " * count for n, v in (("tb", t), ("rf", r))}
            path.write_text(xml("Columns", data, kind))
        return path

    with pytest.raises(RuntimeError, match=r"sends out 180 % of the light from the room"):
        load(file(0.9, 0.9))
    bsdf = load(file(0.6, 0.43))
    assert bsdf.largest_albedo == pytest.approx(1.03, abs=1e-3)
    for side, most in ((1, 1.0), (-1, 0.6)):
        _, weight = draw(bsdf, vector(20, 0) * [1, 1, side], IMPORTANCE, 1000)
        assert weight[0].numpy().max() <= most + 1e-4
        assert weight[0].numpy().max() >= 0.97 * most


def test_a_neutral_coloured_file_is_grey(tmp_path):
    path = tmp_path / "neutral.xml"
    body = xml("TensorTree4", {"tf": "{0.28}"}).replace("</Layer></Optical></WindowElement>", "")
    for name, value in (("CIE-u", 4 / 19), ("CIE-v", 9 / 19)):
        data = "{" + repr(value) + "}"
        body += BLOCK.format(direction=NAMES["tf"], data=data, basis="", wavelength=name)
    path.write_text(body + "</Layer></Optical></WindowElement>")
    file = bsdf_file.read(path)
    for channel in range(3):
        assert file.of_channel(channel).components["tf"].value == pytest.approx(0.28, rel=1e-3)


def test_masks_of_the_caller_stay_as_they_were(tmp_path):
    bsdf = load(write(tmp_path, "TensorTree4"))
    active = mi.Bool([True, True])
    wi = np.array([[0, 0, 1.0], [1.0, 0, 0]])  # one of them in the pane's plane
    bsdf.eval(mi.BSDFContext(), interaction(wi, 2), as_vector(wi), active)
    assert active.numpy().all()
