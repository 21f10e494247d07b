"""Radiance's `gensurf`: a surface x(s,t), y(s,t), z(s,t) as quadrilaterals and triangles."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from drcmitsuba.model.radiance import expression
from drcmitsuba.model.radiance.text import FileLine, Primitive
from drcmitsuba.model.radiance.usage import Usage, options

MOST_CELLS = 250_000
"""Largest number of cells of the grid."""


def surface(words: Sequence[str], place: FileLine) -> Iterator[Primitive]:
    """`gensurf mat name 'x(s,t)' 'y(s,t)' 'z(s,t)' m n [-e expr] [-s]`, m by n cells."""
    usage = Usage("gensurf mat name x(s,t) y(s,t) z(s,t) m n [-e expr] [-s]", place)
    given = options(words, 7, {"-e": 1, "-s": 0}, usage)
    m, n = (usage.count(word, MOST_CELLS) for word in words[5:7])
    if m * n > MOST_CELLS:
        raise usage.error(f"{m * n} cells, more than {MOST_CELLS}")
    s, t = np.meshgrid(np.arange(m + 1) / m, np.arange(n + 1) / n, indexing="ij")
    try:
        known = expression.definitions(";".join(given.get("-e", [])))
        values = [expression.value(text, {"s": s, "t": t}, known) for text in words[2:5]]
        valid = np.ones(s.shape, bool)
        if "valid" in known:
            parameters = known["valid"][0]
            call = f"valid({','.join('st'[: len(parameters)])})" if parameters else "valid"
            valid = np.asarray(expression.value(call, {"s": s, "t": t}, known) > 0)
    except expression.ExpressionError as error:
        raise usage.error(str(error)) from None
    points = np.stack([np.broadcast_to(v, s.shape) for v in values], axis=-1)
    valid = np.broadcast_to(valid, s.shape) & np.isfinite(points).all(axis=-1)
    for corners in _cells(np.where(valid[..., None], points, 0.0), valid):
        yield usage.polygon(words, corners)


FLAT = 1e-12
"""Two halves of a cell are one quadrilateral where 1 − the cosine between them is at most this."""


def _cells(points: np.ndarray, valid: np.ndarray) -> Iterator[np.ndarray]:
    """Polygons (corner, 3) of the cells between points (m + 1, n + 1, 3).

    A cell that is not flat is cut from (i, j) to (i + 1, j + 1) in every second row of cells along
    s, and along its other diagonal in those between. A cell with one invalid point is a triangle.
    """
    ring = [points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]]
    sound = [valid[:-1, :-1], valid[1:, :-1], valid[1:, 1:], valid[:-1, 1:]]
    corners, real = np.stack(ring, axis=2), np.stack(sound, axis=2)
    m, n = real.shape[:2]
    odd = np.broadcast_to(np.arange(n) % 2 == 1, (m, n)).reshape(-1)
    corners, real = corners.reshape(-1, 4, 3), real.reshape(-1, 4)
    corners[odd], real[odd] = np.roll(corners[odd], -1, axis=1), np.roll(real[odd], -1, axis=1)
    # The diagonal now runs from the first corner to the third.
    halves = [corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]]
    normals = [np.cross(h[:, 1] - h[:, 0], h[:, 2] - h[:, 0]) for h in halves]
    sizes = [np.linalg.norm(normal, axis=1) for normal in normals]
    together = np.einsum("cx,cx->c", *normals)
    flat = together >= (1 - FLAT) * sizes[0] * sizes[1]
    extent = np.ptp(corners, axis=1).max(axis=1) ** 2
    for i in np.flatnonzero(real.sum(axis=1) >= 3):
        if not real[i].all():
            yield corners[i][real[i]]
        elif flat[i] and min(sizes[0][i], sizes[1][i]) > 0:
            yield corners[i]
        else:
            for half, size in zip(halves, sizes, strict=True):
                if size[i] > 1e-9 * extent[i]:
                    yield half[i]
