"""Plugins `tensor_tree` and `klems`: values, sampling, peak, energy, mounting, gradients."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins import bsdf_file, energy, peak
from drcmitsuba_plugins.klems_basis import BASES
from drcmitsuba_plugins.tensor import TensorTree, to_square
from scipy.stats import chi2 as chi2_law

from drcmitsuba.bsdf.merge import merge
from drcmitsuba.runtime import backend
from tests import SHARED

SHARED = SHARED / "data" / "bsdf"
RADIANCE, IMPORTANCE = mi.TransportMode.Radiance, mi.TransportMode.Importance

HEAD = """<?xml version="1.0"?><WindowElement><Optical><Layer><DataDefinition>
<IncidentDataStructure>{kind}</IncidentDataStructure></DataDefinition>"""
BLOCK = """<WavelengthData><Wavelength>{wavelength}</Wavelength><WavelengthDataBlock>
<WavelengthDataDirection>{direction}</WavelengthDataDirection>
<ColumnAngleBasis>{basis}</ColumnAngleBasis><RowAngleBasis>{basis}</RowAngleBasis>
<ScatteringData>{data}</ScatteringData></WavelengthDataBlock></WavelengthData>"""
NAMES = {
    "tb": "Transmission Front",
    "tf": "Transmission Back",
    "rb": "Reflection Front",
    "rf": "Reflection Back",
}


def xml(kind, components, basis="LBNL/Shirley-Chiu", wavelength="Visible"):
    blocks = [
        BLOCK.format(direction=NAMES[n], data=data, basis=basis, wavelength=wavelength)
        for n, data in components.items()
    ]
    return HEAD.format(kind=kind) + "".join(blocks) + "</Layer></Optical></WindowElement>"


def random_tree(rng, rank, depth=3, albedo=0.4, holes=0.3):
    """Text of a random tree: some nodes end early, some leaves are dark, values span decades."""

    def node(level):
        if level == depth or (level and rng.random() < 0.6):
            dark = rng.random() < holes
            return "{%.6g}" % (0 if dark else rng.random() ** 4 * albedo)
        return "{" + "".join(node(level + 1) for _ in range(1 << rank)) + "}"

    return node(0)


def random_matrix(rng, basis, albedo=0.4):
    n = len(BASES[basis])
    values = rng.random((n, n)) ** 4 * albedo / np.pi
    values[rng.random((n, n)) < 0.3] = 0
    return " ".join(f"{v:.6g}" for v in values.ravel())


def write(folder, kind, missing=(), seed=1, **options):
    """File with random components."""
    rng = np.random.default_rng(seed)
    names = [n for n in NAMES if n not in missing]
    path = folder / f"{kind.replace('/', '_').replace(' ', '_')}{seed}{''.join(missing)}.xml"
    if kind.startswith("Tensor"):
        rank = int(kind[-1])
        depth = 3 if rank == 3 else 2
        data = {n: random_tree(rng, rank, depth, **options) for n in names}
        path.write_text(xml(kind, data))
    else:
        path.write_text(xml("Columns", {n: random_matrix(rng, kind) for n in names}, kind))
    return path


@pytest.fixture(autouse=True, scope="module")
def _first_variant():
    backend.select()


KINDS = ["TensorTree4", "TensorTree3", "LBNL/Klems Full", "LBNL/Klems Half", "LBNL/Klems Quarter"]


def load(path, **parameters):
    kind = "klems" if bsdf_file.read(path).kind == "Klems" else "tensor_tree"
    return mi.load_dict({"type": kind, "filename": str(path), **parameters})


def vector(theta, phi):
    t, p = np.radians(theta), np.radians(phi)
    return np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)


def as_vector(d):
    d = np.broadcast_to(d, np.shape(d)).reshape(-1, 3)
    return mi.Vector3f(*(mi.Float(np.ascontiguousarray(d[:, i], np.float32)) for i in range(3)))


def interaction(wi, count=1):
    """Point on a flat pane whose local frame is the file's: x right, y up, z into the room."""
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.n = mi.Normal3f(0, -1, 0)
    si.sh_frame = mi.Frame3f(mi.Vector3f(1, 0, 0), mi.Vector3f(0, 0, 1), mi.Vector3f(0, -1, 0))
    si.wi = as_vector(wi)
    return si


def draw(bsdf, wi, mode, count, seed=1):
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, count)
    return bsdf.sample(
        mi.BSDFContext(mode), interaction(wi, count), sampler.next_1d(), sampler.next_2d()
    )


def random_directions(count, seed=0):
    d = np.random.default_rng(seed).normal(size=(count, 3))
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


# Values


@pytest.mark.parametrize("mode", [RADIANCE, IMPORTANCE], ids=["radiance", "importance"])
@pytest.mark.parametrize("missing", [(), ("tb",), ("tf", "rf")], ids=["all", "no tb", "tb rb"])
@pytest.mark.parametrize("kind", KINDS)
def test_eval_is_the_files_value_times_the_cosine(tmp_path, kind, missing, mode):
    path = write(tmp_path, kind, missing)
    file, bsdf = bsdf_file.read(path), load(path, straight_through="off")
    wi, wo = random_directions(20_000), random_directions(20_000, 1)
    value = bsdf.eval(mi.BSDFContext(mode), interaction(wi, len(wi)), as_vector(wo))[0].numpy()
    incident, outgoing = (wo, wi) if mode == RADIANCE else (wi, wo)
    expected = file.query(incident, outgoing) * np.abs(wo[:, 2])
    # Directions that single precision puts into the neighbouring cell: a few in 10⁴.
    off = ~np.isclose(value, expected, rtol=1e-4, atol=1e-7)
    assert off.mean() < 1e-3
    assert (expected > 0).mean() > 0.2


def test_a_lambertian_tree_is_a_diffuser(tmp_path):
    path = tmp_path / "even.xml"
    t, r = 0.3, 0.4
    data = {n: "{%r}" % ((t if n[0] == "t" else r) / np.pi) for n in NAMES}
    path.write_text(xml("TensorTree4", data))
    ours, plain = (
        load(path),
        mi.load_dict({"type": "diffuser", "transmittance": t, "reflectance_front": r}),
    )
    wi, wo = random_directions(1000), random_directions(1000, 1)
    for mode in (RADIANCE, IMPORTANCE):
        si, ctx = interaction(wi, len(wi)), mi.BSDFContext(mode)
        for a, b in zip(
            ours.eval_pdf(ctx, si, as_vector(wo)), plain.eval_pdf(ctx, si, as_vector(wo)),
            strict=True,
        ):  # fmt: skip
            np.testing.assert_allclose(np.array(a).ravel(), np.array(b).ravel(), rtol=1e-5)
    assert not ours.has_view


# Sampling


def chi_square(bsdf, wi, mode, count=200_000, seed=1, grid=12, inner=96):
    """p-value of samples counted in squares of the outgoing disk against the density."""
    bs, weight = draw(bsdf, wi, mode, count, seed)
    assert np.isfinite(weight[0].numpy()).all()
    kept = bs.pdf.numpy() > 0
    wo = np.array(bs.wo).T[kept]
    s = np.clip((np.array(to_square(wo[:, 0], wo[:, 1])) * grid).astype(int), 0, grid - 1)
    cell = (s[0] * grid + s[1]) + grid**2 * (wo[:, 2] < 0)
    seen = np.bincount(cell, minlength=2 * grid**2).astype(float)
    n = grid * inner
    lane = dr.arange(mi.UInt32, n * n)
    point = (mi.Point2f(mi.Float(lane // n), mi.Float(lane % n)) + 0.5) / n
    disk = mi.warp.square_to_uniform_disk_concentric(point)
    z = dr.safe_sqrt(1 - dr.squared_norm(disk))
    expected = []
    for side in (1, -1):
        d = mi.Vector3f(disk.x, disk.y, side * z)
        pdf = bsdf.pdf(mi.BSDFContext(mode), interaction(wi, n * n), d) / z
        mean = pdf.numpy().reshape(grid, inner, grid, inner).mean(axis=(1, 3), dtype=float)
        expected.append(mean.ravel() * np.pi / grid**2)
    expected = np.concatenate(expected)
    assert expected.sum() == pytest.approx(1, abs=0.01)  # the points cut through cells
    expected *= kept.sum() / expected.sum()
    few = expected < 20
    seen = np.append(seen[~few], seen[few].sum())
    expected = np.append(expected[~few], expected[few].sum())
    seen, expected = seen[expected > 0], expected[expected > 0]
    # What the points miss where they cut through a cell counts as an error of the expectation.
    variance = expected + (0.01 * expected) ** 2
    return chi2_law.sf(((seen - expected) ** 2 / variance).sum(), len(seen) - 1)


INCIDENCES = [(0.5, 0), (30, 100), (60, 200), (80, 45), (89, 300)]


@pytest.mark.parametrize("mode", [RADIANCE, IMPORTANCE], ids=["radiance", "importance"])
@pytest.mark.parametrize("kind", KINDS[:3])
def test_samples_follow_their_density(tmp_path, kind, mode):
    bsdf = load(write(tmp_path, kind), straight_through="off")
    worst = min(
        chi_square(bsdf, vector(*angles) * [1, 1, side], mode)
        for angles in INCIDENCES
        for side in (1, -1)
    )
    assert worst > 1 - (1 - 1e-3) ** (1 / (2 * len(INCIDENCES)))


def test_the_test_of_samples_would_notice_a_wrong_density(tmp_path):
    a, b = (load(write(tmp_path, "TensorTree4", seed=s), straight_through="off") for s in (1, 2))

    class Mixed:
        sample, pdf = a.sample, b.pdf

    assert chi_square(Mixed, vector(30, 100), RADIANCE) < 1e-6


@pytest.mark.parametrize("mode", [RADIANCE, IMPORTANCE], ids=["radiance", "importance"])
@pytest.mark.parametrize("kind", KINDS)
def test_weights_are_eval_over_density_and_hardly_vary(tmp_path, kind, mode):
    bsdf = load(write(tmp_path, kind), straight_through="off")
    for angles in INCIDENCES:
        for side in (1, -1):
            wi = vector(*angles) * [1, 1, side]
            bs, weight = draw(bsdf, wi, mode, 20_000)
            weight = weight[0].numpy().astype(float)
            value, pdf = bsdf.eval_pdf(mi.BSDFContext(mode), interaction(wi, 20_000), bs.wo)
            value, pdf = value[0].numpy(), pdf.numpy()
            off = ~np.isclose(pdf, bs.pdf.numpy(), rtol=1e-3)
            off |= ~np.isclose(weight * pdf, value, rtol=1e-3, atol=1e-7)
            assert off.mean() < 1e-3
            spread = (weight**2).mean() / weight.mean() ** 2
            if kind == "TensorTree3" and mode == RADIANCE:
                assert spread < 1.3
            else:
                assert spread < 1 + 1e-4  # exactly in proportion to f cos θ


@pytest.mark.parametrize("kind", KINDS)
def test_the_mean_weight_is_the_albedo(tmp_path, kind):
    path = write(tmp_path, kind)
    file, bsdf = bsdf_file.read(path), load(path, straight_through="off")
    for side in (1, -1):
        wi = vector(40, 70) * [1, 1, side]
        _, weight = draw(bsdf, wi, IMPORTANCE, 100_000)
        t, r = file.hemispherical(wi)
        assert weight[0].numpy().mean() == pytest.approx(float(t[0] + r[0]), rel=0.005)


# The straight-through peak


def peaked(folder, kind="TensorTree4"):
    """File that lets T = 0.5 straight through and scatters 0.2 evenly."""
    path = folder / f"peaked{kind[-4:].strip()}.xml"
    even = 0.2 / np.pi
    if kind == "TensorTree4":
        n = 8
        s = np.indices((n,) * 4).reshape(4, -1)
        grid = np.full((n,) * 4, even)
        straight = (s[0] == s[2]) & (s[1] == s[3])
        grid.reshape(-1)[straight] += 0.5 * n * n / np.pi
        data = "{" + " ".join(f"{v:.8g}" for v in grid.ravel()) + "}"
        path.write_text(xml(kind, {"tb": data}))
    else:
        basis = BASES[kind]
        matrix = np.full((len(basis),) * 2, even)
        matrix += np.diag(0.5 / basis.projected_solid_angle)
        path.write_text(xml("Columns", {"tb": " ".join(f"{v:.8g}" for v in matrix.ravel())}, kind))
    return path


@pytest.mark.parametrize("kind", ["TensorTree4", "LBNL/Klems Full"])
def test_a_straight_through_peak_becomes_a_view(tmp_path, kind):
    path = peaked(tmp_path, kind)
    bsdf = load(path)
    assert bsdf.has_view
    assert mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null)
    w = np.concatenate([vector(35, 60)[None], -vector(70, 10)[None], random_directions(50)])
    tau = bsdf.eval_null_transmission(interaction(w, len(w)))[0].numpy()
    np.testing.assert_allclose(tau, 0.5, rtol=1e-5)
    value = bsdf.eval(mi.BSDFContext(), interaction(w, len(w)), as_vector(-w))[0].numpy()
    np.testing.assert_allclose(value, 0.2 / np.pi * np.abs(w[:, 2]), rtol=1e-4)
    bs, weight = draw(bsdf, vector(35, 60), RADIANCE, 100_000)
    straight = (bs.sampled_type.numpy() & int(+mi.BSDFFlags.Null)) > 0
    assert straight.mean() == pytest.approx(0.5 / 0.7, abs=0.01)
    np.testing.assert_allclose(weight[0].numpy(), 0.7, rtol=1e-4)
    back = np.array(bs.wo)[:, straight]
    np.testing.assert_allclose(back, -np.tile(vector(35, 60)[:, None], back.shape[1]), atol=1e-6)


def test_the_peak_can_be_left_in_the_bsdf(tmp_path):
    bsdf = load(peaked(tmp_path), straight_through="off")
    assert not bsdf.has_view
    assert not mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null)
    _, weight = draw(bsdf, vector(35, 60), RADIANCE, 1000)
    np.testing.assert_allclose(weight[0].numpy(), 0.7, rtol=1e-4)


def test_splitting_a_peak_keeps_the_energy(tmp_path):
    for kind in ("TensorTree4", "LBNL/Klems Full"):
        component = bsdf_file.read(peaked(tmp_path, kind)).components["tb"]
        part = peak.split(component)
        np.testing.assert_allclose(part.rest.albedos() + part.through, component.albedos())
        assert part.share == pytest.approx(0.5 / 0.7)
    even = TensorTree.constant(0.1)
    assert peak.split(even).share == 0


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
def test_wrong_parameters_are_told(tmp_path, parameters, message):
    path = write(tmp_path, "TensorTree4")
    with pytest.raises(RuntimeError, match=message):
        mi.load_dict({"type": "tensor_tree", "filename": str(path), **parameters})


def test_the_plugin_of_the_other_kind_is_named(tmp_path):
    tree, matrix = write(tmp_path, "TensorTree4"), write(tmp_path, "LBNL/Klems Quarter")
    with pytest.raises(RuntimeError, match="use the plugin tensor_tree"):
        mi.load_dict({"type": "klems", "filename": str(tree)})
    with pytest.raises(RuntimeError, match="use the plugin klems"):
        mi.load_dict({"type": "tensor_tree", "filename": str(matrix)})


# Files found in the wild


def test_clear_glass_as_klems_is_the_glazing_of_its_transmittance():
    path = SHARED / "subramaniam_clear_klems.xml"
    if not path.is_file():
        pytest.skip("the BSDF files of other projects are not part of this one")
    file, bsdf = bsdf_file.read(path), load(path)
    cosines = np.linspace(0, 1, 1025)
    along = np.stack([np.sqrt(1 - cosines**2), 0 * cosines, cosines], axis=-1)
    table, _ = file.hemispherical(along)
    glass = mi.load_dict({"type": "glazing", "transmittance": mi.TensorXf(table)})
    w = random_directions(20_000)
    ours, theirs = (
        b.eval_null_transmission(interaction(w, len(w)))[0].numpy() for b in (bsdf, glass)
    )
    # The glazing interpolates where one ring of patches ends and the next begins.
    assert np.isclose(ours, theirs, rtol=1e-4).mean() > 0.98
    assert ours.mean() == pytest.approx(theirs.mean(), rel=1e-3)
    rest = bsdf.eval(mi.BSDFContext(), interaction(w, len(w)), as_vector(-w))[0].numpy()
    np.testing.assert_allclose(rest, 0, atol=1e-6)


PHYSICAL = [
    "bsdfviewer_blinds_20deg_t45", "honeybee_diffuse50_klems", "honeybee_tensortree",
    "ignis_simple_tensor_d2_trans", "ignis_simple_tensor_front_refl",
    "ignis_simple_tensor_spot_trans", "subramaniam_blindsT3", "subramaniam_clear_klems",
    "subramaniam_ven45_klems",
]  # fmt: skip
TWENTY = [(t, (37 * k) % 360) for k, t in enumerate(np.linspace(0.5, 89, 20))]


@pytest.mark.slow
@pytest.mark.parametrize("name", PHYSICAL)
def test_files_are_sampled_well(name):
    path = SHARED / f"{name}.xml"
    if not path.is_file():
        pytest.skip("the BSDF files of other projects are not part of this one")
    bsdf = load(path, straight_through="off")
    worst_spread, worst_p, tests = 1.0, 1.0, 0
    for mode in (RADIANCE, IMPORTANCE):
        for angles in TWENTY:
            for side in (1, -1):
                wi = vector(*angles) * [1, 1, side]
                weight = draw(bsdf, wi, mode, 20_000)[1][0].numpy().astype(float)
                if weight.sum() == 0:
                    continue
                worst_spread = max(worst_spread, (weight**2).mean() / weight.mean() ** 2)
                worst_p, tests = (
                    min(worst_p, chi_square(bsdf, wi, mode, 100_000, inner=300)),
                    tests + 1,
                )
    print(f"{name}: E[w²]/E[w]² ≤ {worst_spread:.4f}; χ²: least p {worst_p:.3g} of {tests}")
    assert worst_spread < 1.3
    assert worst_p > 1 - (1 - 1e-3) ** (1 / tests)


# What a review found


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
        found = (part.rest.albedos() + part.through)[live]
        np.testing.assert_allclose(found, tree.albedos()[live])
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
