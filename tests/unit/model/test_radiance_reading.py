"""Scene files: geometry, calls of other files, and refusals of bad input in one line."""

import random
import time

import numpy as np
import pytest

from drcmitsuba.model.notes import Notes
from drcmitsuba.model.polygon import area_vector
from drcmitsuba.model.radiance import bodies, read
from drcmitsuba.model.radiance.context import Budget, Context
from drcmitsuba.model.radiance.definitions import Definitions
from drcmitsuba.model.radiance.reading import read_file
from drcmitsuba.model.radiance.surfaces import SurfacesByModifier
from drcmitsuba.runtime.errors import InputError
from tests import SHARED, skips

M = "void plastic m 0 0 5 .5 .5 .5 0 0\n"
TRIANGLE = "m polygon t 0 0 9 0 0 0 1 0 0 0 1 0\n"


def quads_of(text, folder):
    (folder / "x.rad").write_text(M + text)
    (layer,) = read([folder / "x.rad"]).layers
    return layer.quads


def area(quads):
    """Sum of areas, and sum of normal times area."""
    vectors = np.array([area_vector(quad) for quad in quads])
    return np.linalg.norm(vectors, axis=1).sum(), vectors.sum(axis=0)


def flux(quads, centre):
    """Volume that the fronts enclose, negative where they face inward."""
    vectors = np.array([area_vector(quad) for quad in quads])
    middle = quads[:, :3].mean(axis=1)
    return np.einsum("qx,qx->", vectors, middle - centre) / 3


@pytest.mark.parametrize(
    ("corners", "expected", "most"),
    [
        ("0 0 0 1 0 0 0 1 0", 0.5, 1),
        ("0 0 0 2 0 0 2 1 0 0 1 0", 2, 1),
        ("0 0 0 2 0 0 1 1 0 0 1 0", 1.5, 2),
        ("0 0 0 1 0 0 2 0 0 2 2 0 0 2 0", 4, 3),
        ("0 0 0 3 0 0 3 1 0 1 1 0 1 2 0 0 2 0", 4, 4),
        ("0 0 0 3 0 0 3 3 0 2 3 0 2 1 0 1 1 0 1 3 0 0 3 0", 7, 6),
        ("0 0 0 3 0 0 3 3 0 0 3 0 0 0 0 1 1 0 1 2 0 2 2 0 2 1 0 1 1 0", 8, 8),
    ],
)
def test_polygons_keep_area_and_front(corners, expected, most, tmp_path):
    quads = quads_of(f"m polygon p 0 0 {len(corners.split())} {corners}\n", tmp_path)
    total, vector = area(quads)
    np.testing.assert_allclose([total, *vector], [expected, 0, 0, expected], atol=1e-12)
    assert len(quads) <= most


@pytest.mark.parametrize(
    "flat",
    [
        "9 0 0 0 1 0 0 2 0 0",
        "9 1 1 1 1 1 1 1 1 1",
        "12 0 0 0 1 0 0 1 0 0 0 0 0",
        "15 0 0 0 1 0 0 2 0 0 1 0 0 0 0 0",
    ],
)
def test_a_polygon_without_area_is_left_out_with_a_note(flat, tmp_path):
    """`oconv` warns and goes on; it was refused."""
    (tmp_path / "x.rad").write_text(f"{M}{TRIANGLE}m polygon line 0 0 {flat}\n")
    model = read([tmp_path / "x.rad"])
    assert len(model.layers[0].quads) == 1
    [note] = model.notes
    assert note.startswith("Polygons without area are left out: ")
    assert "line 3: line" in note
    (tmp_path / "y.rad").write_text("!xform -t 1 0 0 x.rad\n")
    assert "line 3: line" in read([tmp_path / "y.rad"]).notes[0]


def test_many_polygons_are_cut_as_each_alone(tmp_path):
    rng = np.random.default_rng(5)
    shapes = [
        [[0, 0], [1, 0], [0, 1]],
        [[0, 0], [1, 0], [1, 1], [0, 1]],
        [[0, 0], [3, 0], [3, 1], [1, 1], [1, 2], [0, 2]],
        [[0, 0], [2, 0], [1, 1], [0, 3]],
    ]
    text, areas = "", []
    for i in range(200):
        flat = np.array(shapes[rng.integers(4)], float)
        axes, _ = np.linalg.qr(rng.standard_normal((3, 3)))
        corners = np.column_stack([flat, np.zeros(len(flat))]) @ axes + rng.uniform(-9, 9, 3)
        numbers = " ".join(f"{v:.15g}" for v in corners.ravel())
        text += f"m polygon p{i} 0 0 {corners.size} {numbers}\n"
        areas.append(area_vector(corners))
    (tmp_path / "x.rad").write_text(M + text)
    (layer,) = read([tmp_path / "x.rad"]).layers
    sums = np.zeros((200, 3))
    np.add.at(sums, layer.polygon, [area_vector(quad) for quad in layer.quads])
    np.testing.assert_allclose(sums, areas, atol=1e-9)
    assert layer.place(int(np.flatnonzero(layer.polygon == 7)[0])) == "x.rad, line 9: p7"


def test_bodies_have_their_area_and_front_to_what_is_stated(tmp_path):
    n, around = bodies.AROUND, np.sin(np.pi / bodies.AROUND) / (np.pi / bodies.AROUND)
    disk = np.sin(2 * np.pi / n) / (2 * np.pi / n)
    axis = np.array([1, 2, 2])
    cases = {
        "cylinder c 0 0 7 0 0 0 1 2 2 .5": (3 * np.pi * around, [0, 0, 0]),
        "ring r 0 0 8 1 1 1 1 2 2 2 .5": (3.75 * np.pi * disk, 3.75 * np.pi * disk * axis / 3),
        "ring r 0 0 8 1 1 1 -1 -2 -2 0 1": (np.pi * disk, -np.pi * disk * axis / 3),
        "cone c 0 0 8 0 0 0 0 0 3 1 0": (np.pi * np.sqrt(10), [0, 0, np.pi * disk]),
        "cup c 0 0 8 0 0 0 0 0 3 0 1": (np.pi * np.sqrt(10), [0, 0, np.pi * disk]),
        "sphere s 0 0 4 1 2 3 .5": (np.pi, [0, 0, 0]),
    }
    for text, (wanted, vector) in cases.items():
        total, sums = area(quads_of(f"m {text}\n", tmp_path))
        assert 0.9964 < total / wanted < 1 + 1e-9, text
        np.testing.assert_allclose(sums, vector, atol=1e-9)


@pytest.mark.parametrize(
    ("outward", "inward"),
    [
        ("sphere b 0 0 4 0 0 0 1", "bubble b 0 0 4 0 0 0 1"),
        ("sphere b 0 0 4 0 0 0 1", "sphere b 0 0 4 0 0 0 -1"),
        ("cylinder b 0 0 7 0 0 -1 0 0 1 1", "tube b 0 0 7 0 0 -1 0 0 1 1"),
        ("tube b 0 0 7 0 0 -1 0 0 1 -1", "cylinder b 0 0 7 0 0 -1 0 0 1 -1"),
        ("cone b 0 0 8 0 0 -1 0 0 1 1 2", "cup b 0 0 8 0 0 -1 0 0 1 1 2"),
        ("cone b 0 0 8 0 0 1 0 0 -1 2 0", "cone b 0 0 8 0 0 1 0 0 -1 -2 -0"),
    ],
)
def test_inverted_bodies_face_inward(outward, inward, tmp_path):
    out, inn = (quads_of(f"m {text}\n", tmp_path) for text in (outward, inward))
    assert flux(out, 0) > 0
    assert flux(inn, 0) == pytest.approx(-flux(out, 0))


def test_a_closed_tube_leaves_no_gap(tmp_path):
    text = (
        "m cylinder c 0 0 7 1 2 3 2 4 5 .3\nm ring a 0 0 8 1 2 3 -1 -2 -2 0 .3\n"
        "m ring b 0 0 8 2 4 5 1 2 2 0 .3\n"
    )
    np.testing.assert_allclose(area(quads_of(text, tmp_path))[1], 0, atol=1e-12)


def test_modifiers_of_one_file_serve_in_the_next_and_later_ones_change_nothing(tmp_path):
    (tmp_path / "a.rad").write_text(M)
    (tmp_path / "b.rad").write_text(TRIANGLE + "void plastic m 0 0 5 .1 .1 .1 0 0\n" + TRIANGLE)
    first, second = read([tmp_path / "a.rad", tmp_path / "b.rad"]).layers
    assert (first.name, first.material.reflectance) == ("m", 0.5)
    assert (second.name, second.material.reflectance) == ("m (2)", 0.1)


def test_names_may_have_spaces_and_any_letters(tmp_path):
    text = (
        "\ufeffvoid plastic 'Weiße Wand' 0 0 5 .5 .5 .5 0 0\r\n# ☼\r\n"
        '"Weiße Wand" polygon "p #1" 0 0 9 0 0 0 1 0 0 0 1 0\r\n'
    )
    (tmp_path / "x.rad").write_text(text, encoding="utf-8", newline="")
    (layer,) = read([tmp_path / "x.rad"]).layers
    assert (layer.name, layer.places) == ("Weiße Wand", ("x.rad, line 3: p #1",))
    (tmp_path / "x.rad").write_bytes(text[1:].replace("☼", "").encode("latin-1"))
    assert read([tmp_path / "x.rad"]).layers[0].name == "Weiße Wand"


P = "m polygon p 0 0 "
BAD = {
    "no corners": (P + "0\n", "0 numbers"),
    "no third coordinate": (P + "10 0 0 0 1 0 0 0 1 0 5\n", "10 numbers"),
    "broken off": (P + "9 0 0 0 1\n", "ends after 4 of 9 numbers"),
    "broken off early": ("m polygon p 0\n", "ends before its counts"),
    "only a word": ("m\n", "the file ends within it"),
    "no count": ("m polygon p x 0 0\n", "'x' as the number of strings"),
    "negative count": ("m polygon p 0 0 -9 0\n", "'-9' as the number of numbers"),
    "endless count": ("m polygon p 0 0 999999999 0\n", "999999999 numbers"),
    "a word for a number": (P + "9 0 0 0 1 0 0 0 1 z\n", "'z' among its numbers"),
    "underscore": (P + "9 0 0 0 1_0 0 0 0 1 0\n", "'1_0' among its numbers"),
    "comment inside": (P + "9 0 0 0 # hi\n 1 0 0 0 1 0\n", "'#' among its numbers"),
    "not a number": (P + "9 0 0 0 1 0 0 0 nan 0\n", "not finite"),
    "huge": (P + "9 0 0 0 1e300 0 0 0 1e300 0\n", "too large"),
    "endless": (P + "9 0 0 0 1e999 0 0 0 1 0\n", "not finite"),
    "not planar": (P + "12 0 0 0 1 0 0 1 1 .3 0 1 0\n", "polygon 'p': not planar"),
    "crossing": (P + "12 0 0 0 1 0 0 0 1 0 2 1 0\n", "crosses itself"),
    "unknown kind": ("m prism q 0 0 0\n", "prism 'q': no kind of primitive"),
    "unknown modifier": ("n polygon q 0 0 9 0 0 0 1 0 0 0 1 0\n", "'n' is not defined"),
    "surface as modifier": (TRIANGLE + TRIANGLE.replace("m", "t", 1), "'t' is not defined"),
    "sphere": ("m sphere s 0 0 3 0 0 0\n", "give 4"),
    "point": ("m sphere s 0 0 4 0 0 0 0\n", "no area"),
    "huge sphere": ("m sphere s 0 0 4 0 0 0 1e13\n", "too large"),
    "needle": ("m cylinder c 0 0 7 0 0 0 0 0 0 1\n", "no area"),
    "two signs": ("m cone c 0 0 8 0 0 0 0 0 1 1 -1\n", "different sign"),
    "thin ring": ("m ring r 0 0 8 0 0 0 0 0 1 1 1\n", "no area"),
    "mesh": ("m mesh a 1 a.rtm 0 0\n", "give the OBJ file"),
    "octree": ("m instance a 1 a.oct 0 0\n", ".rad files that it was made from"),
    "shell": ("!rm -rf /\n", "'rm' in 'rm -rf /'"),
    "second command": ("!genbox m b 1 1 1; rm x\n", "';' in"),
    "redirection": ("!genbox m b 1 1 1 > x\n", "'>' in"),
    "substitution": ("!genbox m $(whoami) 1 1 1\n", "'$' in"),
    "backticks": ("!genbox m `id` 1 1 1\n", "'`' in"),
    "substitution in quotes": ('!genbox m "$HOME" 1 1 1\n', "in 'genbox"),
    "path of a program": ("!/bin/genbox m b 1 1 1\n", "'/bin/genbox' in"),
    "pipe to another": ("!genbox m b 1 1 1 | tee x\n", "'tee' in"),
    "empty pipe": ("!genbox m b 1 1 1 |\n", "'' in"),
    "an empty word": ("!xform ''\n", "no file ''"),
    "no command": ("!\n", "'' in ''"),
    "no file": ("!xform -t 1 0 0\n", "xform: no file"),
    "no cat": ("!cat\n", "cat: no file"),
    "missing file": ("!xform gone.rad\n", "no file 'gone.rad'"),
    "a folder": ("!xform ..\n", "no file '..'"),
    "options behind": ("!genbox m b 1 1 1 | xform -t 1 0 0 -n a\n", "-n behind -t 1 0 0"),
    "unknown option": ("!genbox m b 1 1 1 | xform -q 2\n", "-q behind"),
    "no scale": ("!genbox m b 1 1 1 | xform -s 0\n", "-s 0"),
    "few numbers": ("!genbox m b 1 1 1 | xform -t 1 0\n", "-t 1 0"),
    "endless array": ("!genbox m b 1 1 1 | xform -a 1000000000 -t 1 0 0\n", "-a 1000000000"),
    "nested arrays": ("!genbox m b 1 1 1 | xform -a 99999 -a 99999 -t 1 0 0\n", "copies"),
    "many quads": ("!genbox m b 1 1 1 | xform -a 999 -a 999 -t 1 0 0\n", "1000000 surfaces"),
    "far away": ("!genbox m b 1 1 1 | xform -s 1e9 -i 9 -s 1e9\n", "not finite"),
    "argument file": ("!xform -f gone -t 1 0 0 x.rad\n", "-f gone, no such file"),
    "box": ("!genbox m b 1 1\n", "4 words behind genbox"),
    "flat box": ("!genbox m b 1 0 1\n", "m b 1 0 1"),
    "rounding": ("!genbox m b 1 1 1 -r .1 -n 4\n", "the option -n"),
    "prism of a file": ("!genprism m p a.txt\n", "no number of corners"),
    "prism of two": ("!genprism m p 2 0 0 1 1\n", "2 corners"),
    "function file": ("!genrev m r t t 4 -f a.cal\n", "the option -f"),
    "unknown name": ("!genrev m r u t 4\n", "the unknown name 'u'"),
    "segments": ("!genrev m r t t 1e9\n", "'1e9' for a count"),
    "cells": ("!gensurf m s s t 0 999 999\n", "998001 cells"),
    "radius": ("!genworm m w t 0 0 t-.5 4\n", "a radius below 0"),
    "slats": ("!genblinds m b .05 3 1.6 0 30\n", "'0' for a count"),
    "too many slats": ("!genblinds m b .05 3 1.6 5000 30 -r .025\n", "5000 slats of 60 pieces"),
    "curvature": ("!genblinds m b .05 3 1.6 2 30 -r .02\n", "below half of the depth"),
    "both ways": ("!genblinds m b .05 3 1.6 2 30 -r 1 +r 1\n", "-r with +r"),
    "no value": ("!genworm m w 1/t 0 0 1 4\n", "without a value"),
    "recursion": ("!genrev m r 'f(t)' t 4 -e 'f(x)=f(x)+1'\n", "call themselves"),
    "parentheses": (f"!genrev m r '{'(' * 999}t' t 4\n", "parentheses deep"),
    "long command": ("!xform " + "x" * 100_001 + "\n", "an endless line"),
    "zero byte": ("void\0plastic\n", "byte 0x00"),
    "UTF-16": ("m".encode("utf-16").decode("latin-1") + "\0", "byte 0x00"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line_that_names_file_line_and_remedy(case, tmp_path):
    text, complaint = BAD[case]
    (tmp_path / "x.rad").write_bytes((M + text).encode("latin-1"))
    with pytest.raises(InputError) as error:
        read([tmp_path / "x.rad"])
    message = str(error.value)
    assert complaint in message
    assert "x.rad: line " in message
    assert "\n" not in message


def test_files_are_looked_for_beside_their_callers_and_in_the_present_folder(tmp_path, monkeypatch):
    for folder in ("scene/parts", "here"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "scene" / "room.rad").write_text(M + "!xform parts/wall.rad\n")
    (tmp_path / "scene" / "parts" / "wall.rad").write_text("!xform beside.rad\n!cat away.rad\n")
    (tmp_path / "scene" / "beside.rad").write_text(TRIANGLE)
    with pytest.raises(InputError, match=r"wall\.rad: line 2: file: no file 'away\.rad'"):
        read([tmp_path / "scene" / "room.rad"])
    (tmp_path / "here" / "away.rad").write_text(TRIANGLE)
    monkeypatch.chdir(tmp_path / "here")
    (layer,) = read([tmp_path / "scene" / "room.rad"]).layers
    assert layer.places == ("beside.rad, line 1: t", "away.rad, line 1: t")


def test_curved_and_smoothed_surfaces_leave_a_note(tmp_path):
    text = (
        "!genrev m r t 1 2 -s\n!gensurf m s s t 0 1 1 -s\n"
        "m texfunc Phong 4 rev_dx rev_dy rev_dz rev.cal 0 4 0 0 0 1\n"
    )
    (tmp_path / "x.rad").write_text(M + text + TRIANGLE.replace("m", "Phong", 1))
    assert read([tmp_path / "x.rad"]).notes == (
        "Facets are flat where textures round them.",
        "Curved bodies are facets, 48 around, and up to 0.4 % smaller in area.",
    )


def test_a_circle_of_files_is_named(tmp_path):
    (tmp_path / "a.rad").write_text("!xform b.rad\n")
    (tmp_path / "b.rad").write_text("!cat ./a.rad\n")
    with pytest.raises(InputError, match=r"a circle: a\.rad → b\.rad → a\.rad"):
        read([tmp_path / "a.rad"])


def test_files_call_each_other_to_a_bounded_depth(tmp_path):
    for i in range(20):
        (tmp_path / f"{i}.rad").write_text(f"!xform {i + 1}.rad\n")
    with pytest.raises(InputError, match="17 files deep"):
        read([tmp_path / "0.rad"])


def test_files_that_multiply_end_soon(tmp_path):
    for i in range(12):
        (tmp_path / f"{i}.rad").write_text(f"!xform {i + 1}.rad\n" * 30)
    (tmp_path / "12.rad").write_text("")
    few = Context(Definitions(), SurfacesByModifier(Notes()), Budget(files=100), Notes())
    with pytest.raises(InputError, match="more than 20000 files"):
        read_file(tmp_path / "0.rad", few)


def test_a_chain_of_modifiers_is_bounded(tmp_path):
    mixes = "".join("void mixfunc m 4 m m x f.cal 0 0\n" for _ in range(63))
    (tmp_path / "x.rad").write_text(M + mixes + TRIANGLE)
    (tmp_path / "y.rad").write_text("!xform -a 3 -t 1 0 0 x.rad\n")
    assert len(read([tmp_path / "y.rad"], means=True).layers[0].quads) == 3
    (tmp_path / "x.rad").write_text(M + 2 * mixes)
    with pytest.raises(InputError, match="a chain of 65 modifiers"):
        read([tmp_path / "x.rad"])


SAMPLE = (
    M + "void glass g 0 0 3 .9 .9 .9\nvoid brightfunc b 2 .5 . 0 0\n"
    "b trans d 0 0 7 .5 .5 .5 0 0 .5 0\n"
    "g polygon w 0 0 12 0 0 0 1 0 0 1 0 1 0 0 1\nd cup c 0 0 8 0 0 0 0 0 1 .2 .4\n"
    "!genbox m b 1 2 3 -b .1 | xform -a 3 -t 1 0 0 -i 2 -rz 20\n"
    "!genrev m r 'sin(t)' 'if(t-.5,1,t^2)' 3 -e 'f(x)=x;g=2'\ninherit alias h d\n"
    "h sphere s 0 0 4 0 0 0 1\n"
)  # fmt: skip


def test_damaged_files_are_read_or_refused_in_one_line(tmp_path):
    draw, file, sample = random.Random(7), tmp_path / "x.rad", SAMPLE.encode()
    pieces = [b" ", b"\n", b"0", b"-1", b"9", b"(", b"!", b"#", b'"', b"'", b"\xff", b"1e99", b"m "]
    messages, read_well, end = [], 0, time.monotonic() + 2
    while time.monotonic() < end:
        damaged = bytearray(sample)
        for _ in range(draw.randint(1, 3)):
            at = draw.randrange(len(damaged))
            piece = draw.choice([bytes([draw.randrange(256)]), *pieces])
            damaged[at : at + draw.randint(0, 3)] = piece
        file.write_bytes(damaged)
        try:
            read([file])
            read_well += 1
        except InputError as error:
            messages.append(str(error))
    assert read_well > 0
    assert not [message for message in messages if "\n" in message]


SCENES = SHARED / "data" / "scenes"
has_scenes = skips.needs(SCENES)


@has_scenes
def test_a_published_room_has_the_areas_of_its_plan():
    names = ["materials", "Ceiling", "ExteriorWalls", "Floor", "InteriorWall", "Glazing"]
    model = read([SCENES / "subramaniam_room" / f"{name}.rad" for name in names])
    areas = {layer.name: area(layer.quads) for layer in model.layers}
    assert {layer.name for layer in model.layers if layer.role == "pane"} == {"Glazing"}
    assert areas["Floor"][1][2] == pytest.approx(6.096**2)
    assert areas["Ceiling"][0] == pytest.approx(6.096**2)
    assert areas["Glazing"][1][1] == pytest.approx(6.096 * (2.4384 - 0.9144))
    opening = 6.096 * (2.4384 - 0.9144)
    south = 2 * 0.178262 * (6.096 + 2.4384 - 0.9144)
    walls = 4 * 6.096 * 3.048 - opening + south
    assert areas["InteriorWall"][0] == pytest.approx(walls)


@has_scenes
@pytest.mark.parametrize("means", [False, True])
def test_every_scene_of_radiances_own_tests_is_read_or_refused_in_one_line(means):
    folder = SCENES / "radiance_renders"
    loaded, messages = set(), []
    for file in sorted(folder.glob("*.rad")):
        try:
            read([folder / "basic.mat", folder / "patterns.mat", file], means=means)
            loaded.add(file.stem)
        except InputError as error:
            messages.append(str(error))
    assert not [message for message in messages if "\n" in message or ": " not in message]
    assert len(loaded) >= (15 if not means else 17)
