"""Radiance's generators of boxes, prisms, bodies of revolution, worms, blinds and functional
surfaces.

Each takes the words of its command line and gives primitives, as the program of the same name does;
only the names and the order of the primitives differ.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise, product

import numpy as np
from numpy.typing import ArrayLike

from drcmitsuba.model.radiance import expression
from drcmitsuba.model.radiance.functional import surface
from drcmitsuba.model.radiance.text import FileLine, Primitive
from drcmitsuba.model.radiance.usage import Usage, options

MOST_SEGMENTS = 100_000
"""Largest number of segments of a worm, a body of revolution or all slats of a blind."""
MOST_SLATS = 10_000
"""Largest number of slats."""
SLAT_PIECE = 3.0
"""Arc of a piece of a curved slat [deg]."""


def box(words: Sequence[str], place: FileLine) -> Iterator[Primitive]:
    """`genbox mat name x y z [-r radius | [-i] [-b bevel]]`: a box at the origin."""
    usage = Usage("genbox mat name xsize ysize zsize [-r radius | [-i] [-b bevel]]", place)
    given = options(words, 5, {"-i": 0, "-r": 1, "-b": 1}, usage)
    size = np.array([usage.number(word) for word in words[2:5]])
    if "-r" in given and len(given) > 1:
        raise usage.error(f"{' with '.join(given)}")
    cut = usage.number(given.get("-r", given.get("-b", ["0"]))[0])
    if (size <= 0).any() or not 0 <= 2 * cut < size.min():
        raise usage.error(" ".join(words))
    polygons = [*_faces(size, cut), *(_bevels(size, cut) if "-b" in given and cut > 0 else ())]
    for polygon in polygons:
        yield usage.polygon(words, polygon[::-1] if "-i" in given else polygon)
    if "-r" in given and cut > 0:
        yield from _rounded(words, size, cut, usage)


def _corner(size: np.ndarray, cut: float, face: int, ends: ArrayLike) -> np.ndarray:
    """Corner of the face across an axis, set back from the edges, at one end of each axis."""
    at = np.where(np.equal(ends, 1), size - cut, cut)
    at[face] = size[face] * np.asarray(ends)[face]
    return at


def _outward(corners: Sequence[np.ndarray], size: np.ndarray) -> np.ndarray:
    """Corners in an order that is counter-clockwise from outside."""
    ring = np.array(corners)
    normal = np.cross(ring[1] - ring[0], ring[2] - ring[1])
    return ring if normal @ (ring.mean(axis=0) - size / 2) > 0 else ring[::-1]


def _faces(size: np.ndarray, cut: float) -> Iterator[np.ndarray]:
    """Faces of a box, set back from its edges."""
    for a, end in product(range(3), (0, 1)):
        turn = [np.roll((end, p, q), a) for p, q in ((0, 0), (1, 0), (1, 1), (0, 1))]
        yield _outward([_corner(size, cut, a, ends) for ends in turn], size)


def _bevels(size: np.ndarray, cut: float) -> Iterator[np.ndarray]:
    """Bevels of the edges and corners of a box."""
    for a, p, q in product(range(3), (0, 1), (0, 1)):
        b, c = (a + 1) % 3, (a + 2) % 3
        low, high = (np.roll((end, p, q), a) for end in (0, 1))
        edge = [(b, low), (b, high), (c, high), (c, low)]
        yield _outward([_corner(size, cut, face, ends) for face, ends in edge], size)
    for ends in product((0, 1), repeat=3):
        yield _outward([_corner(size, cut, a, ends) for a in range(3)], size)


def _rounded(
    words: Sequence[str], size: np.ndarray, radius: float, usage: Usage
) -> Iterator[Primitive]:
    """Cylinders along the edges of a box and spheres at its corners."""
    inner = np.array([[radius] * 3, size - radius])
    for signs in product((0, 1), repeat=3):
        at = inner[signs, range(3)]
        yield usage.primitive(words, "sphere", [*at, radius])
        for a in range(3):
            if signs[a] == 0:
                end = at.copy()
                end[a] = inner[1, a]
                yield usage.primitive(words, "cylinder", [*at, *end, radius])


def prism(words: Sequence[str], place: FileLine) -> Iterator[Primitive]:
    """`genprism mat name N x1 y1 … xN yN [-l x y z] [-c] [-e]`: an extruded polygon."""
    usage = Usage("genprism mat name N x1 y1 … xN yN [-l x y z] [-c] [-e]", place)
    if len(words) < 3 or not words[2].isascii() or not words[2].isdigit():
        raise usage.error(" ".join(words[:3]) + ", no number of corners")
    count = int(words[2][:6])
    given = options(words, 3 + 2 * count, {"-l": 3, "-c": 0, "-e": 0}, usage)
    if count < 3:
        raise usage.error(f"{count} corners")
    flat = np.array([usage.number(word) for word in words[3 : 3 + 2 * count]]).reshape(-1, 2)
    bottom = np.concatenate([flat, np.zeros((count, 1))], axis=1)
    top = bottom + [usage.number(word) for word in given.get("-l", ["0", "0", "1"])]
    if "-e" not in given:
        yield usage.polygon(words, bottom)
        yield usage.polygon(words, top[::-1])
    for i in range(count - 1 if "-c" in given else count):
        j = (i + 1) % count
        if (flat[i] == flat[j]).all():
            continue
        side = np.array([bottom[i], top[i], top[j], bottom[j]])
        yield usage.polygon(words, side)


def revolution(words: Sequence[str], place: FileLine) -> Iterator[Primitive]:
    """`genrev mat name 'z(t)' 'r(t)' nseg [-e expr] [-s]`: cones, cylinders and rings about z."""
    usage = Usage("genrev mat name z(t) r(t) nseg [-e expr] [-s]", place)
    given = options(words, 5, {"-e": 1, "-s": 0}, usage)
    z, r = _along(words[2:4], words[4], given.get("-e", []), usage)
    if (r < 0).any():
        raise usage.error("a radius below 0")
    for (z0, z1), (r0, r1) in zip(_pairs(z), _pairs(r), strict=True):
        if z0 == z1 and r0 != r1:
            up = 1.0 if r0 > r1 else -1.0
            yield usage.primitive(words, "ring", [0, 0, z0, 0, 0, up, r0, r1])
        elif z0 != z1 and max(r0, r1) > 0:
            kind = "cone" if z0 < z1 else "cup"
            yield usage.primitive(words, kind, [0, 0, z0, 0, 0, z1, r0, r1])


def worm(words: Sequence[str], place: FileLine) -> Iterator[Primitive]:
    """`genworm mat name 'x(t)' 'y(t)' 'z(t)' 'r(t)' nseg [-e expr]`: cones and spheres."""
    usage = Usage("genworm mat name x(t) y(t) z(t) r(t) nseg [-e expr]", place)
    given = options(words, 7, {"-e": 1}, usage)
    x, y, z, r = _along(words[2:6], words[6], given.get("-e", []), usage)
    if (r < 0).any():
        raise usage.error("a radius below 0")
    at = np.stack([x, y, z], axis=1)
    for centre, radius in zip(at, r, strict=True):
        if radius > 0:
            yield usage.primitive(words, "sphere", [*centre, radius])
    for i in range(len(at) - 1):
        step, slope = at[i + 1] - at[i], r[i] - r[i + 1]
        length = float(np.linalg.norm(step))
        if length <= abs(slope):
            continue  # one sphere lies in the other
        # The cone touches both spheres: it begins and ends beside their centres.
        towards = step * slope / length**2
        narrowed = np.sqrt(1 - (slope / length) ** 2)
        ends = [*(at[i] + r[i] * towards), *(at[i + 1] + r[i + 1] * towards)]
        yield usage.primitive(words, "cone", [*ends, r[i] * narrowed, r[i + 1] * narrowed])


def blinds(words: Sequence[str], place: FileLine) -> Iterator[Primitive]:
    """`genblinds mat name depth width height nslats angle [-r|+r rcurv]`: slats along y.

    Slats stand above each other along z, from the front edge at x = 0 they rise by the angle. One
    of a radius of curvature is cut into pieces of 3° of its arc.
    """
    usage = Usage("genblinds mat name depth width height nslats angle [-r|+r rcurv]", place)
    given = options(words, 7, {"-r": 1, "+r": 1}, usage)
    if "-r" in given and len(given) > 1:
        raise usage.error(f"{' with '.join(given)}")
    depth, width, height = (usage.number(word) for word in words[2:5])
    if min(depth, width, height) <= 0:
        raise usage.error(" ".join(words[2:5]))
    count, angle = usage.count(words[5], MOST_SLATS), np.radians(usage.number(words[6]))
    edge = np.array([[0.0, 0.0], depth * np.array([np.cos(angle), np.sin(angle)])])
    for sign, (radius,) in given.items():
        edge = _bent(edge, angle, -1 if sign == "-r" else 1, usage.number(radius), usage)
    if count * (len(edge) - 1) > MOST_SEGMENTS:
        raise usage.error(f"{count} slats of {len(edge) - 1} pieces")
    for slat in range(count):
        lift = np.array([0.0, height * (slat + 0.5) / count])
        for (x0, z0), (x1, z1) in pairwise(edge + lift):
            corners = [[x0, 0, z0], [x0, width, z0], [x1, width, z1], [x1, 0, z1]]
            yield usage.polygon(words, np.array(corners))


def _bent(edge: np.ndarray, angle: float, sign: int, radius: float, usage: Usage) -> np.ndarray:
    """Points (point, 2) of an arc over a chord (2, 2) at an angle [rad], above it for sign 1."""
    depth = float(np.linalg.norm(edge[1]))
    if not radius >= depth / 2:
        raise usage.error(f"a radius of {radius:g}, below half of the depth")
    arc = 2 * np.arcsin(depth / 2 / radius)
    count = max(1, math.ceil(np.degrees(arc) / SLAT_PIECE - 1e-9))
    slope = angle + sign * (arc / 2 - (np.arange(count) + 0.5) * arc / count)
    steps = 2 * radius * np.sin(arc / count / 2) * np.stack([np.cos(slope), np.sin(slope)], axis=1)
    return np.concatenate([edge[:1], np.cumsum(steps, axis=0)])


def _along(
    functions: Sequence[str], count: str, known: Sequence[str], usage: Usage
) -> list[np.ndarray]:
    """Values of functions of t at the ends of segments, each of shape (segment + 1,)."""
    segments = usage.count(count, MOST_SEGMENTS)
    t = np.arange(segments + 1) / segments
    try:
        definitions = expression.definitions(";".join(known))
        values = [expression.value(text, {"t": t}, definitions) for text in functions]
    except expression.ExpressionError as error:
        raise usage.error(str(error)) from None
    values = [np.broadcast_to(value, t.shape) for value in values]
    if not all(np.isfinite(value).all() for value in values):
        raise usage.error("a function without a value")
    return values


def _pairs(values: np.ndarray) -> Iterator[tuple[float, float]]:
    return zip(values[:-1].tolist(), values[1:].tolist(), strict=True)


GENERATORS: dict[str, Callable[[Sequence[str], FileLine], Iterator[Primitive]]] = {
    "genbox": box, "genprism": prism, "genrev": revolution, "genworm": worm, "gensurf": surface,
    "genblinds": blinds,
}  # fmt: skip
"""Generators by the name of their command; they take the words behind it."""
