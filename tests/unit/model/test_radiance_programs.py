"""Commands in scene files against Radiance's own programs, corner by corner."""

from pathlib import Path

import numpy as np
import pytest

from drcmitsuba.model.radiance import read
from drcmitsuba.model.radiance.command import pipeline
from drcmitsuba.model.radiance.generators import GENERATORS
from drcmitsuba.model.radiance.text import Command, FileLine, statements
from tests import radiance, skips

pytestmark = skips.RADIANCE.mark

MATERIAL = "void plastic m 0 0 5 .5 .5 .5 0 0\n"


def words_of(line):
    (words,) = pipeline(Command(line, FileLine(Path("x.rad"), 1)))
    return words


def shapes(primitives):
    """Kinds and numbers; cylinders are cones of two equal radii, polygons begin at any corner."""
    rows = []
    for p in primitives:
        numbers = np.array(p.numbers)
        if p.kind == "polygon":
            ring = numbers.reshape(-1, 3)
            first = np.lexsort(np.round(ring, 5).T[::-1])[0]
            numbers = np.roll(ring, -first, axis=0).ravel()
        elif p.kind in ("cylinder", "tube"):
            ends = sorted([tuple(numbers[:3]), tuple(numbers[3:6])])
            numbers = np.array([*ends[0], *ends[1], numbers[6], numbers[6]])
        if p.kind == "ring":
            numbers[3:6] /= np.linalg.norm(numbers[3:6])
            numbers[6:] = sorted(numbers[6:])
        kind = {"cylinder": "cone", "tube": "cup"}.get(p.kind, p.kind)
        rows.append((kind, tuple(numbers)))
    return sorted(rows, key=lambda row: (row[0], len(row[1]), tuple(np.round(row[1], 5))))


@pytest.mark.parametrize(
    "line",
    [
        "genbox m box 1 2 3",
        "genbox m box 1.5 .25 3 -i",
        "genbox m box 4 5 6 -b .5",
        "genbox m box 4 5 6 -r .5",
        "genbox m box 4 5 6 -i -b .5",
        "genprism m p 4 0 0 2 0 2 1 0 1",
        "genprism m p 3 0 0 2 0 2 1 -l 0 .5 -3 -c",
        "genprism m p 5 0 0 2 0 2 1 1 .5 0 1 -e",
        "genprism m p 10 -.1 -.1 -.1 5.1 3.1 5.1 3.1 -.1 -.1 -.1 1 1 2 1 2 4 1 4 1 1 -l 0 0 .2 -c",
        "genrev m r 'sin(2*PI*t)' '2+cos(2*PI*t)' 12",
        "genrev m r 1 t 3",
        "genrev m r t 'f(1-t)' 5 -e 'f(x)=x*x;g=2' -e 'h=3'",
        "genrev m r 'floor(2*t)/2' '1-.1*t' 7",
        "genworm m w 0 t 't*t' .1 3",
        "genworm m w 'cos(3*t)' t 't*t' '.1*t+.02' 6",
        "genblinds m b .05 3 1.6 20 30",
        "genblinds m b .05 3 1.6 2 -45.5",
        "genblinds m b .05 3 1.6 3 30 -r .1",
        "genblinds m b .08 1 2 2 -20 +r .041",
        "genblinds m b .05 3 1.6 1 0 +r 5",
        "gensurf m s s t 's*t' 2 2",
        "gensurf m s s t 0 3 2",
        "gensurf m s '4*s' '4*t' 'sin(7*s+3*t*t)+cos(5*s*t)' 5 7",
        "gensurf m s 'cos(2*PI*s)*r(t)' 'sin(2*PI*s)*r(t)' '-cos(a(t))' 8 6 "
        "-e 'a(t)=PI*(.1+.8*t);r(t)=sin(a(t))'",
        "gensurf m s s t 's*t^2' 5 5 -e 'valid(s,t)=s+t-.5'",
        "gensurf m s s t 's*t^2' 5 5 -e 'valid(s,t)=(s-.5)^2+(t-.5)^2-.05'",
        "gensurf m s s t 'sqrt(s-.3)' 5 2",
        "gensurf m s s t 'if(s-.5,-2^2*t,2^3^.5*t)' 4 2",
    ],
)
def test_a_generator_gives_what_the_program_gives(line, tmp_path):
    name, *words = words_of(line)
    ours = shapes(GENERATORS[name](words, FileLine(Path("x.rad"), 1)))
    output = radiance.run([name, *words], tmp_path)
    theirs = shapes(statements(output, Path("out.rad")))
    assert [(kind, len(numbers)) for kind, numbers in ours] == [
        (kind, len(numbers)) for kind, numbers in theirs
    ]
    for (_, a), (_, b) in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-6)


SOLID = """m polygon triangle 0 0 9 1 0 0 0 1 0 0 0 1
m polygon slanted 0 0 12 0 0 0 3 1 0 4 3 1 1 2 1
m polygon square 0 0 12 0 0 1 1 0 1 1 1 1 0 1 1
"""


@pytest.mark.parametrize(
    "options",
    [
        "-t 1 2 3",
        "-rx 30 -ry 40 -rz 50",
        "-s 2.5 -t 1 0 0",
        "-t 1 0 0 -s .5",
        "-mx",
        "-mx -my",
        "-my -rz 20",
        "-I -mz",
        "-s -2",
        "-n chair -m m -c -rz 10",
        "-i 3 -rz 25 -t 1 0 0",
        "-i 0 -t 1 0 0 -i 2 -s 2",
        "-rz 90 -a 5 -t 2 0 0 -a 4 -t 0 1.5 0 -i 1 -t 0 0 10",
        "-a 3 -rz 30 -mx -i 2 -t .5 0 0",
        "-t 1 1 0 -a 2 -s 2 -a 2 -ry 15 -a 2 -t 0 0 3",
        "-f moves",
    ],
)
@skips.POSIX.mark
def test_xform_moves_every_corner_as_the_program_does(options, tmp_path):
    (tmp_path / "solid.rad").write_text(SOLID)
    (tmp_path / "moves").write_text("# two copies\n-t 1 0 0\n\n!xform -n k -s 2 -rz 30\n")
    (tmp_path / "ours.rad").write_text(f"{MATERIAL}!xform {options} solid.rad\n")
    output = radiance.run(["xform", *options.split(), "solid.rad"], tmp_path)
    (tmp_path / "theirs.rad").write_bytes(MATERIAL.encode() + output)
    (ours,), (theirs,) = (read([tmp_path / f"{n}.rad"]).layers for n in ("ours", "theirs"))
    assert len(ours.quads) == len(theirs.quads)
    np.testing.assert_allclose(
        in_turn(ours.quads), in_turn(theirs.quads), atol=2e-6 * np.abs(theirs.quads).max()
    )


def in_turn(quads):
    """Quads from their least corner on, sorted; fronts are kept."""
    rows = []
    for quad in quads:
        ring = quad[:3] if (quad[2] == quad[3]).all() else quad
        first = np.lexsort(np.round(ring, 4).T[::-1])[0]
        ring = np.roll(ring, -first, axis=0)
        rows.append(np.concatenate([ring, ring[-1:]])[:4].ravel())
    rows = np.array(rows)
    return rows[np.lexsort(np.round(rows, 4).T[::-1])]


def test_nested_files_and_pipes_are_those_of_xform(tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "leg.rad").write_text(
        "void plastic wood 0 0 5 .4 .4 .4 0 0\n!genbox wood leg .1 .1 .7 | xform -t -.05 -.05 0\n"
    )
    (tmp_path / "parts" / "table.rad").write_text(
        "!xform -a 2 -t 1.4 0 0 -a 2 -t 0 .7 0 leg.rad\n"
        "!genbox wood top 1.6 .9 .03 | xform -t -.1 -.1 .7\n"
    )
    (tmp_path / "room.rad").write_text(
        "# two tables\n!xform -rz 30 -t 2 1 0 \\\n  parts/table.rad\n"
        "!xform -mx -t 6 1 0 parts/table.rad | xform -s 1.1\n!cat flat.rad | cat\n"
    )
    (tmp_path / "flat.rad").write_text("wood polygon 'a b' 0 0 9 9 0 0 9 1 0 9 0 1\n")
    (tmp_path / "all.rad").write_bytes(radiance.run(["xform", "room.rad"], tmp_path))
    (ours,), (theirs,) = (read([tmp_path / f"{n}.rad"]).layers for n in ("room", "all"))
    assert ours.name == theirs.name == "wood"
    assert len(ours.quads) == 2 * (4 * 6 + 6) + 1
    np.testing.assert_allclose(in_turn(ours.quads), in_turn(theirs.quads), atol=1e-6)
    assert "flat.rad, line 1: a b" in ours.places


def test_facets_of_a_moved_body_lie_on_the_body_that_xform_gives(tmp_path):
    body = "m cone c 0 0 8 0 0 0 1 2 3 1 2\nm bubble b 0 0 4 1 2 3 .5\n"
    moves = "-rx 20 -s 1.5 -mx -t 1 2 3"
    (tmp_path / "body.rad").write_text(body)
    (tmp_path / "all.rad").write_text(f"{MATERIAL}!xform {moves} body.rad\n")
    output = radiance.run(["xform", *moves.split(), "body.rad"], tmp_path)
    cone, bubble = (np.array(p.numbers) for p in statements(output, Path("x")))
    (layer,) = read([tmp_path / "all.rad"]).layers
    corners = layer.quads[layer.polygon == 0].reshape(-1, 3)
    axis = cone[3:6] - cone[:3]
    along = (corners - cone[:3]) @ axis / (axis @ axis)
    off = np.linalg.norm(corners - cone[:3] - along[:, None] * axis, axis=1)
    np.testing.assert_allclose(off, cone[6] + along * (cone[7] - cone[6]), atol=1e-6)
    quads = layer.quads[layer.polygon == 1]
    centre = quads[:, :3].mean(axis=1) - bubble[:3]
    normal = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])
    assert (np.einsum("qx,qx->q", centre, normal) < 0).all()
