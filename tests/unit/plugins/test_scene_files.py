"""`sun_disks` and `tregenza_sky` in scenes of other people: XML, texts, files, wrong values."""

import runpy

import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.runtime import backend
from tests import ROOT

SCENES = ROOT / "scenes" / "plugins"
KIND = "llvm" if backend.llvm_version() else "cuda"
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@pytest.fixture(autouse=True)
def _variant():
    backend.select(f"{KIND}_ad_mono")
    yield
    backend.select(f"{KIND}_ad_mono")


def emitters(body):
    return mi.load_string(f'<scene version="3.0.0">{body}</scene>').emitters()


def sun(body):
    return emitters(f'<emitter type="sun_disks">{body}</emitter>')[0]


def directions(emitter):
    return emitter.directions.numpy().reshape(-1, 3)


@pytest.mark.parametrize("colours", ["rgb", "mono", "spectral"])
def test_the_shipped_example_renders_alike_from_xml_and_dict(colours, same):
    mi.set_variant(f"{KIND}_ad_{colours}")
    here, there = (
        np.stack([np.array(mi.render(scene, spp=64, seed=seed)) for seed in range(8)])
        for scene in (
            mi.load_file(str(SCENES / "sun_and_sky.xml")),
            mi.load_dict(runpy.run_path(str(SCENES / "sun_and_sky.py"))["scene"]()),
        )
    )
    grey = LUMINANCE if here.shape[-1] == 3 else np.ones(1)
    here, there = (image @ grey for image in (here, there))
    assert here.shape == (8, 24, 32)
    same(here.mean(axis=(1, 2)), other=there.mean(axis=(1, 2)), within=0.02)
    # The sky above and the sunlit floor at the lower edge, ρ (π L + Σ E) / π with E = L Ω cos θ.
    assert here[:, 0].mean() == pytest.approx(1, rel=0.02)
    cosines = np.array([0.8, 0.5]) / np.linalg.norm([[0.3, -0.5, 0.8], [-0.4, -0.3, 0.5]], axis=1)
    E = np.pi * np.sin(np.radians(0.25)) ** 2 * np.array([6e4, 2e4]) @ cosines
    assert here[:, -1].mean() == pytest.approx(0.4 * (1 + E / np.pi), rel=0.05)


@pytest.mark.parametrize(
    "body",
    [
        '<vector name="direction" x="0" y="1.2" z="1.6"/>',
        '<vector name="direction" value="0, 0.5988, 0.7984"/>',
        '<string name="directions" value="0 0.6 0.8"/>',
        '<string name="directions" value="0, 6, 8;"/>',
    ],
)
def test_one_sun_from_xml(body):
    np.testing.assert_allclose(directions(sun(body)), [[0, 0.6, 0.8]], atol=1e-7)


SUNS = np.array([[0, 0.6, 0.8], [2.0, 0, 0], [0.3, -0.4, 1.2]])


@pytest.mark.parametrize("name", ["suns.npy", "suns.csv", "suns.txt"])
def test_several_suns_from_a_file_beside_the_scene(tmp_path, name):
    if name.endswith(".npy"):
        np.save(tmp_path / name, SUNS)
    else:
        head = "x,y,z\n# towards the suns\n" if name.endswith(".csv") else ""
        separator = "," if name.endswith(".csv") else " "
        lines = [separator.join(map(str, row)) for row in SUNS]
        (tmp_path / name).write_text(head + "\n".join(lines) + "\n")
    scene = tmp_path / "scene.xml"
    scene.write_text(
        f'<scene version="3.0.0"><emitter type="sun_disks"><string name="directions" '
        f'value="{name}"/><string name="radiance" value="1 2 3"/></emitter></scene>'
    )
    made = mi.load_file(str(scene)).emitters()[0]
    exact = SUNS / np.linalg.norm(SUNS, axis=1, keepdims=True)
    np.testing.assert_allclose(directions(made), exact, atol=1e-7)
    assert made.radiance.numpy().tolist() == [1, 2, 3]


def test_one_radiance_serves_for_all_sources():
    text = '<string name="directions" value="0 0 1; 1 0 1"/><float name="radiance" value="7"/>'
    assert sun(text).radiance.numpy().tolist() == [7, 7]
    sky = emitters('<emitter type="tregenza_sky"><float name="radiance" value="3"/></emitter>')[0]
    assert sky.radiance.numpy().tolist() == [3] * 146


def test_spectral_variants_take_the_first_channel_at_all_wavelengths():
    mi.set_variant(f"{KIND}_ad_spectral")
    suns = {"type": "sun_disks", "directions": mi.TensorXf(SUNS)}
    made = mi.load_dict(suns | {"radiance": mi.TensorXf(np.arange(9.0).reshape(3, 3))})
    assert [c.numpy().tolist() for c in made._radiance_of(mi.UInt32([0, 2]))] == [[0, 6]] * 4


def pickled(folder):
    path = folder / "pickled.npy"
    np.save(path, np.array([{"x": 1}], dtype=object), allow_pickle=True)
    return path


BAD_SUNS = [
    ("", "no direction; give direction"),
    (
        '<vector name="direction" x="0" y="0" z="1"/><string name="directions" value="0 0 1"/>',
        "direction and directions; give direction",
    ),
    ('<string name="directions" value="up"/>', "directions: 'up' is no list of numbers"),
    ('<string name="directions" value=""/>', "directions: no number"),
    ('<string name="directions" value="0 0 1; 1 1"/>', r"directions: shape \(5,\)"),
    ('<string name="directions" value="0 0 0; 0 0 1"/>', "directions: number 1 of 2"),
    ('<string name="directions" value="0 0 1; nan 0 1"/>', "directions: number 2 of 2"),
    ('<string name="directions" value="nowhere.csv"/>', "directions: nowhere.csv: no such file"),
    ('<string name="directions" value="{pickled}"/>', "directions: .*pickle"),
    ('<boolean name="directions" value="true"/>', r"directions: shape"),
    ('<rgb name="radiance" value="1 2 3"/><vector name="direction" x="0" y="0" z="1"/>',
     r"radiance: shape \(3,\) for 1 suns"),
    ('<spectrum name="radiance" value="2"/><vector name="direction" x="0" y="0" z="1"/>',
     "radiance: a Spectrum; give a tensor, a text"),
    ('<string name="diameter" value="wide"/><vector name="direction" x="0" y="0" z="1"/>',
     "diameter: 'wide' is no number"),
]  # fmt: skip


@pytest.mark.parametrize(("body", "message"), BAD_SUNS)
def test_what_is_no_sun_gives_one_line(tmp_path, body, message):
    with pytest.raises(Exception, match=f"ValueError: sun_disks: .*{message}"):
        sun(body.replace("{pickled}", str(pickled(tmp_path))))


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ('<string name="radiance" value="1 2 3"/>', r"radiance: shape \(3,\) for the 146 bins"),
        ('<string name="radiance" value="bright"/>', "radiance: 'bright' is no list of numbers"),
        ('<float name="radiance" value="-1"/>', "radiance: -1; give numbers from 0"),
        ('<string name="subdivision" value="two"/>', "subdivision: 'two' is no number"),
        ('<float name="subdivision" value="1.5"/>', "subdivision: 1.5; give a whole number"),
    ],
)
def test_what_is_no_sky_gives_one_line(body, message):
    with pytest.raises(Exception, match=f"ValueError: tregenza_sky: {message}"):
        emitters(f'<emitter type="tregenza_sky">{body}</emitter>')


@pytest.mark.parametrize("plugin", ["klems", "tensor_tree", "glazing", "diffuser", "coated_mirror",
                                    "polished", "redirecting_film"])  # fmt: skip
def test_a_parameter_that_is_missing_is_named_by_the_plugin(plugin):
    with pytest.raises(RuntimeError, match=rf"ValueError: {plugin}: \w+: missing; give"):
        mi.load_dict({"type": plugin})
