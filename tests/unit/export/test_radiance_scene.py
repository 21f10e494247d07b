"""Surfaces and materials in Radiance's words, parsed back; names of strangers stay names."""

import shutil
import subprocess

import numpy as np
import pytest

from drcmitsuba.export.primitives import identifier, polygons, twin
from drcmitsuba.export.scene_files import FILMS, MIRRORS, scene_files
from drcmitsuba.export.script import Simulation, script
from drcmitsuba.export.sources import sun_text
from drcmitsuba.model.materials import (
    BsdfMaterial,
    DielectricMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Lambertian,
    MirrorMaterial,
)
from drcmitsuba.scene.geometry import Surface
from drcmitsuba.sky.sun_models import Suns
from tests import ROOT, skips
from tests.unit.export.radiance_text import primitives

PRISM = ROOT / "scenes" / "films" / "prism.xml"
UPRIGHT = np.array([[[0.0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]]])
FLAT = np.array([[[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]])
HOSTILE = [
    "$(touch pwned)", "`touch pwned`", "a; touch pwned", "a\ntouch pwned", "a\n!touch pwned\n",
    "'\"; touch pwned #", "../../etc/passwd", "a b", "Fenêtre", "名", "", "x" * 1000, "void", "-n",
]  # fmt: skip


def made(material, quads=UPRIGHT, file=""):
    (one,) = primitives(twin("m", material, quads, file).text)
    assert (one.modifier, one.name) == ("void", "m")
    return one


def test_diffuse_surfaces_keep_their_colour():
    grey, red = made(Lambertian(0.35)), made(Lambertian((0.7, 0.2, 0.1)))
    assert (grey.kind, grey.numbers) == ("plastic", [0.35, 0.35, 0.35, 0, 0])
    assert (red.kind, red.numbers) == ("plastic", [0.7, 0.2, 0.1, 0, 0])


def test_clear_panes_have_the_numbers_of_their_formula():
    pane = GlazingMaterial(type="glazing", transmittance=0.65, exponent=3.5, reflectance=0.1)
    one = made(pane)
    assert one.kind == "BRTDfunc"
    assert one.words[:9] == ["rho"] * 3 + ["tau"] * 3 + ["0"] * 3
    assert one.numbers == [0] * 9 + [0.65, 3.5, 0.1]


@pytest.mark.parametrize(("t", "r"), [(0.1, 0.4), (0.3, 0.0), (0.0, 0.2), (0.0, 0.0)])
def test_diffusing_panes_have_their_transmittance_and_reflectance(t, r):
    pane = DiffuserMaterial(type="diffuser", transmittance=t, reflectance=r)
    one = made(pane)
    albedo, _, _, shine, _, share, straight = one.numbers
    assert (one.kind, shine, straight) == ("trans", 0, 0)
    np.testing.assert_allclose([albedo * share, albedo * (1 - share)], [t, r], atol=1e-9)
    assert bool(twin("m", pane, UPRIGHT).difference) == (r > 0)


def test_mirrors_are_metal_on_both_sides():
    smooth = MirrorMaterial(type="mirror", reflectance=0.9)
    partly = MirrorMaterial(type="mirror", reflectance=0.9, specular=0.7, roughness=0.1)
    polished = MirrorMaterial(type="mirror", reflectance=0.5, specular=0.1, polished=True)
    assert made(smooth).numbers == [0.9, 0.9, 0.9, 1, 0.0011]
    assert made(polished).numbers == [0.5, 0.5, 0.5, 0.1, 0]
    assert twin("m", polished, UPRIGHT).difference == ""
    assert made(partly).numbers == [0.9, 0.9, 0.9, 0.7, 0.1]
    assert twin("m", smooth, UPRIGHT).difference == ""
    assert "lobe" in twin("m", partly, UPRIGHT).difference


@pytest.mark.parametrize("reflectance", [0.0, 0.9])
def test_a_coated_mirror_reflects_as_much_at_normal_incidence(reflectance):
    mirror = MirrorMaterial(type="mirror", reflectance=reflectance, coating=1.5, specular=0.8)
    colour, _, _, shine, _ = made(mirror).numbers
    fresnel = 0.04
    clear = fresnel + 0.96**2 * reflectance / (1 - fresnel * reflectance)
    assert colour * shine == pytest.approx(0.8 * clear, rel=1e-7)
    assert colour * (1 - shine) == pytest.approx(0.2 * reflectance, abs=1e-8)
    assert "normal" in twin("m", mirror, UPRIGHT).difference


def test_solids_keep_index_and_absorption():
    solid = DielectricMaterial(type="dielectric", ior=1.49, absorption=2.0, roughness=0.1)
    one = made(solid)
    assert one.kind == "dielectric"
    np.testing.assert_allclose(one.numbers, [np.exp(-2)] * 3 + [1.49, 0], rtol=1e-8)
    assert "smooth" in twin("m", solid, FLAT).difference


@pytest.mark.parametrize(
    ("quads", "turn", "up"),
    [
        (UPRIGHT, False, "0 0 1"), (UPRIGHT, True, "0 0 -1"),
        (FLAT, False, "0 1 0"), (FLAT, True, "0 -1 0"),
    ],
)  # fmt: skip
def test_films_stand_as_they_are_mounted(quads, turn, up):
    film = BsdfMaterial(type="bsdf", file=PRISM, straight_through="off", turn=turn)
    one = made(film, quads, "film.xml")
    assert one.kind == "BSDF"
    assert [float(v) for v in one.words[2:5]] == [float(v) for v in up.split()]
    assert one.words[:2] == ["0", '"film.xml"']
    through = film.model_copy(update={"straight_through": "on"})
    assert made(through, quads, "film.xml").kind == "aBSDF"


def test_polygons_come_back_with_their_fronts():
    quads = np.random.default_rng(0).random((50, 4, 3))
    quads[::2, 3] = quads[::2, 2]
    back = primitives("\n".join(polygons("m", Lambertian(0.5), quads)))
    assert [one.name for one in back] == [f"m.{k}" for k in range(50)]
    for one, quad in zip(back, quads, strict=True):
        corners = np.reshape(one.numbers, (-1, 3))
        assert (one.modifier, one.kind) == ("m", "polygon")
        np.testing.assert_allclose(corners, quad[: len(corners)], rtol=1e-8)
        assert len(corners) == len(np.unique(quad, axis=0))


def test_level_and_upright_panes_of_one_film_stand_apart():
    """Radiance takes no light by a pane whose `up` is its normal."""
    film = BsdfMaterial(type="bsdf", file=PRISM, straight_through="off")
    scene = scene_files([Surface("panes", film, np.concatenate([FLAT, UPRIGHT, FLAT + 1]))])
    upright, level = primitives(scene.materials)
    assert (upright.words[2:5], level.words[2:5]) == (["0", "0", "1"], ["0", "1", "0"])
    of_panes = [one.modifier for one in primitives(scene.polygons)]
    assert of_panes == [upright.name, level.name, level.name]
    assert scene.films == {PRISM: "film_1.xml"}


def test_a_flipped_film_shows_its_other_side_and_an_edge_is_left_out():
    film = BsdfMaterial(type="bsdf", file=PRISM, flip=True)
    edge = np.repeat(UPRIGHT[:, :2], 2, axis=1)
    (one,) = primitives("\n".join(polygons("m", film, np.concatenate([UPRIGHT, edge]))))
    np.testing.assert_array_equal(np.reshape(one.numbers, (4, 3)), UPRIGHT[0, ::-1])


@pytest.mark.parametrize("name", HOSTILE)
def test_a_name_is_one_word_of_plain_characters(name):
    word = identifier(name)
    assert word
    assert len(word) <= 40
    assert set(word) <= set("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_.-")


def test_names_of_strangers_are_names_of_their_surfaces_alone():
    surfaces = [Surface(name, Lambertian(0.5), UPRIGHT) for name in HOSTILE]
    scene = scene_files(surfaces)
    materials, shapes = primitives(scene.materials), primitives(scene.polygons)
    names = [one.name for one in materials]
    assert len(set(names)) == len(HOSTILE)
    assert {one.modifier for one in materials} == {"void"}
    assert {one.kind for one in materials} == {"plastic"}
    assert [one.modifier for one in shapes] == names
    assert not {"void", "alias"} & set(names)


@skips.POSIX.mark
@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("suns", [0, 3])
def test_the_script_is_a_script_whatever_the_case_is_called(name, suns, tmp_path):
    settings = Simulation(identifier(name), "open", 25, 50, suns, 1, True, ["a remark"])
    text = script(settings)
    assert text.isascii()
    checked = subprocess.run(["sh", "-n"], input=text.encode(), capture_output=True, check=False)
    assert (checked.returncode, checked.stderr) == (0, b"")
    plain = script(Simulation("room", "open", 25, 50, suns, 1, True, ["a remark"]))
    lines = zip(text.splitlines(), plain.splitlines(), strict=True)
    changed = [line for line, other in lines if line != other]
    assert all(line.startswith("# Illuminance") for line in changed)
    assert ("suns.oct" in text) == (suns > 0)


def test_films_are_numbered_by_their_files_and_what_differs_is_said(tmp_path):
    other = tmp_path / "$(touch pwned) film.xml"
    shutil.copy(PRISM, other)
    films = [BsdfMaterial(type="bsdf", file=file) for file in (PRISM, other, PRISM)]
    mirror = MirrorMaterial(type="mirror", reflectance=0.9)
    scene = scene_files([Surface("s", m, UPRIGHT) for m in (*films, mirror)])
    assert scene.films == {PRISM: "film_1.xml", other: "film_2.xml"}
    used = [one.words for one in primitives(scene.materials)]
    assert [f'"film_{i}.xml"' in words for i, words in zip((1, 2, 1), used[:3], strict=True)]
    assert scene.differences == (FILMS, MIRRORS)


def test_every_sun_has_a_modifier_of_its_own():
    directions = np.array([[0, 0, 1], [0.6, 0, 0.8]])
    labels = ("sun_2015-03-21T10:00", "sun_2015-03-21T11:00")
    made = primitives(sun_text(Suns(labels, directions, 0.533)))
    lights, disks = made[::2], made[1::2]
    assert [one.name for one in lights] == [label.replace(":", "_") for label in labels]
    assert [one.modifier for one in disks] == [one.name for one in lights]
    np.testing.assert_allclose([one.numbers for one in disks], np.c_[directions, [0.533] * 2])
