"""Many polygons of three or four corners at once, as parallelograms and triangles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drcmitsuba.model.polygon import FLAT, SAME, are_parallelograms, quads_of


def have_area(corners: np.ndarray) -> np.ndarray:
    """Whether polygons (polygon, corner, 3) of three or four corners have an area, bool."""
    diagonals = corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1]
    size = np.linalg.norm(_cross(*diagonals), axis=1) / 2
    return np.asarray(size > SAME * np.ptp(corners, axis=1).max(axis=1) ** 2)


def facet_quads(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cut polygons of three or four corners; those that are no parallelograms need not be planar.

    Polygons without area are left out.

    Parameters
    ----------
    corners : np.ndarray, shape (polygon, 3, 3) or (polygon, 4, 3)
        Corners in turn, counter-clockwise from the front [m].

    Returns
    -------
    quads : np.ndarray, shape (quad, 4, 3)
        Parallelograms, and triangles that repeat their last corner [m].
    polygon : np.ndarray, shape (quad,)
        Polygon that each quad is part of, in increasing order.
    """
    index = np.arange(len(corners))
    if corners.shape[1] == 3:
        quads, polygon = corners[:, [0, 1, 2, 2]], index
    else:
        whole = are_parallelograms(corners)
        first, second = _halves(corners[~whole])
        quads = np.concatenate([corners[whole], first, second])
        polygon = np.concatenate([index[whole], index[~whole], index[~whole]])
        order = np.argsort(polygon, kind="stable")
        quads, polygon = quads[order], polygon[order]
    kept = have_area(quads)
    return quads[kept], polygon[kept]


def polygon_quads(
    corners: np.ndarray, refuse: Callable[[int, str], Exception]
) -> tuple[np.ndarray, np.ndarray]:
    """Cut polygons of one number of corners; those of more than four must be planar.

    Parameters
    ----------
    corners : np.ndarray, shape (polygon, corner, 3)
        Corners in turn, counter-clockwise from the front [m].
    refuse : callable
        Error to raise, from the index of a polygon and what is wrong with it.

    Returns
    -------
    quads : np.ndarray, shape (quad, 4, 3)
        Parallelograms, and triangles that repeat their last corner [m].
    polygon : np.ndarray of int, shape (quad,)
        Polygon that each quad is part of, in increasing order.
    """
    if corners.shape[1] <= 4:
        return facet_quads(corners)
    quads, polygon, left = fans(corners)
    parts, polygons = [quads], [polygon]
    for k in left.tolist():
        try:
            parts.append(quads_of(corners[k]))
        except ValueError as error:
            raise refuse(k, str(error)) from None
        polygons.append(np.full(len(parts[-1]), k))
    polygon = np.concatenate(polygons)
    order = np.argsort(polygon, kind="stable")
    return np.concatenate(parts)[order], polygon[order]


def fans(corners: np.ndarray, starts: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cut those polygons of one number of corners that are planar and seen whole from a corner.

    Parameters
    ----------
    corners : np.ndarray, shape (polygon, corner, 3)
        Three corners or more in turn, counter-clockwise from the front [m].
    starts : int
        Number of corners that are tried, from the first one on; convex polygons are seen whole from
        any.

    Returns
    -------
    quads : np.ndarray, shape (quad, 4, 3)
        Parallelograms, and triangles that repeat their last corner [m].
    polygon : np.ndarray of int, shape (quad,)
        Polygon that each quad is part of.
    left : np.ndarray of int
        Polygons that are not planar, without area, or seen whole from none of these corners.
    """
    n = corners.shape[1]
    spokes = corners[:, 1:] - corners[:, :1]
    normal = _cross(spokes[:, :-1], spokes[:, 1:]).sum(axis=1) / 2
    size = np.linalg.norm(normal, axis=1)
    extent = np.ptp(corners, axis=1).max(axis=1)
    normal /= np.where(size > 0, size, 1)[:, None]
    step = np.abs(corners - np.roll(corners, 1, axis=1)).max(axis=2)
    off = np.abs(np.einsum("pcx,px->pc", spokes, normal)).max(axis=1)
    sound = (size > SAME * extent**2) & (off <= FLAT * extent)
    sound &= (step > SAME * extent[:, None]).all(axis=1)
    whole = sound & are_parallelograms(corners) if n == 4 else np.zeros(len(corners), bool)
    parts, polygons = [corners[whole][:, [0, 1, 2, -1]]], [np.flatnonzero(whole)]
    left = np.flatnonzero(sound & ~whole)
    second = np.arange(2, n)
    at = np.stack([0 * second, second - 1, second, second], axis=1)
    for start in range(1 if n == 3 else min(starts, n)):
        ring = np.roll(corners[left], -start, axis=1)
        seen = _are_seen(ring, normal[left], SAME * extent[left] ** 2)
        parts.append(ring[seen][:, at].reshape(-1, 4, 3))
        polygons.append(np.repeat(left[seen], n - 2))
        left = left[~seen]
    polygon = np.concatenate(polygons)
    return np.concatenate(parts), polygon, np.setdiff1d(np.arange(len(corners)), polygon)


def _are_seen(corners: np.ndarray, normal: np.ndarray, least: np.ndarray) -> np.ndarray:
    """Whether polygons (polygon, corner, 3) are seen whole from their first corner.

    The triangles to it have twice the area `least` (polygon,) or more, and turn by less than 2π.
    """
    spokes = corners[:, 1:] - corners[:, :1]
    across = np.einsum("pcx,px->pc", _cross(spokes[:, :-1], spokes[:, 1:]), normal)
    along = (spokes[:, :-1] * spokes[:, 1:]).sum(axis=2)
    turn = np.arctan2(across, along).sum(axis=1)
    return np.asarray((across > least[:, None]).all(axis=1) & (turn < 2 * np.pi - 1e-6))


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product over the last axis, several times faster than NumPy's."""
    (ax, ay, az), (bx, by, bz) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def _halves(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two triangles of each polygon (polygon, 4, 3), along the diagonal that lies inside."""

    def normal(i: int, j: int, k: int) -> np.ndarray:
        a, b, c = corners[:, i], corners[:, j], corners[:, k]
        return _cross(b - a, c - a)

    inside = (normal(0, 1, 2) * normal(0, 2, 3)).sum(axis=1) >= 0
    turned = np.where(inside[:, None, None], corners, np.roll(corners, -1, axis=1))
    return turned[:, [0, 1, 2, 2]], turned[:, [0, 2, 3, 3]]


def join(quads: np.ndarray, part: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Make one quad of two triangles that follow each other and share a parallelogram's diagonal.

    Files that know only triangles write parallelograms so.

    Parameters
    ----------
    quads : np.ndarray, shape (quad, 4, 3)
        Parallelograms, and triangles that repeat their last corner [m].
    part : np.ndarray of int, shape (quad,), optional
        Part of a mesh that each is of; those of two parts stay apart.

    Returns
    -------
    quads : np.ndarray, shape (quad, 4, 3)
        The same surface in fewer quads [m].
    part : np.ndarray of int, shape (quad,)
        Part that each is of.
    """
    part = np.zeros(len(quads), int) if part is None else part
    pairs = _candidates(quads)
    pairs = pairs[part[pairs] == part[pairs + 1]]
    closing = np.zeros(len(quads), bool)
    closing[pairs + 1] = _parallelogram(quads[pairs], quads[pairs + 1])[1]
    # In a run of triangles that all fit the one before, every second one closes.
    index = np.arange(len(quads))
    start = np.maximum.accumulate(np.where(closing, 0, index))
    closing &= (index - start) % 2 == 1
    opening = np.roll(closing, -1)
    out = quads.copy()
    out[opening] = _parallelogram(quads[opening], quads[closing])[0]
    return out[~closing], part[~closing]


def _candidates(quads: np.ndarray) -> np.ndarray:
    """Index of triangles that may make a parallelogram with the next one.

    With the sums S of their corners, its corner off the shared diagonal is (2 S₁ − S₂) / 3.
    """
    total = quads[:, :3].sum(axis=1)
    apex = (2 * total[:-1] - total[1:]) / 3
    triangle = (quads[:, 2] == quads[:, 3]).all(axis=1)
    near = 1e-5 * np.ptp(quads[:-1], axis=1).max(axis=1)
    off = [np.abs(quads[:-1, k] - apex).max(axis=1) for k in range(3)]
    return np.flatnonzero(triangle[:-1] & triangle[1:] & (np.min(off, axis=0) <= near))


def _parallelogram(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Parallelograms (pair, 4, 3) that pairs of triangles make, and whether they make one."""
    out = np.concatenate([first[:, :3], first[:, :1]], axis=1)
    fits = np.zeros(len(first), bool)
    for i in range(3):
        for j in range(3):
            a, b = first[:, i], first[:, (i + 1) % 3]  # edge of the first triangle
            c, d = second[:, (j + 1) % 3], second[:, j]  # the same edge, run the other way
            quad = np.stack([b, first[:, (i + 2) % 3], a, second[:, (j + 2) % 3]], axis=1)
            meets = (a == c).all(axis=1) & (b == d).all(axis=1) & are_parallelograms(quad)
            start = np.argmin(np.abs(quad - first[:, None, 0]).sum(axis=2), axis=1)
            turn = (start[:, None] + np.arange(4)) % 4
            quad = np.take_along_axis(quad, turn[:, :, None], axis=1)
            out = np.where(meets[:, None, None], quad, out)
            fits |= meets
    return out, fits
