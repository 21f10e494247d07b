"""Planes of mirrors and their axes, and the chains by which light may go from one to another.

Parallel planes share an *axis*, the normal of all of them, and with it the direction of an image;
a *chain* lists the axes of the mirrors from the receiver to the sun. Coplanar faces are one
rectangle, whatever their number.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, product
from math import prod
from typing import NamedTuple

import numpy as np

from drcmitsuba.model.model import areas, count_planes
from drcmitsuba.scene.geometry import normals, reversed_quads

MOST_IN_TURN = 2
"""Largest number of mirrors of a chain."""
MOST_AXES = 12
"""Largest number of axes, those of the largest area."""
MOST_PLANES = 24
"""Largest number of planes of an axis, those of the largest area."""
MOST_CHAINS = 48
"""Largest number of chains: those of one mirror, and those of several that reflect most."""
FAINT = 2e-3
"""Product of reflectances at normal incidence below which mirrors in turn are left out [–]."""
PARALLEL = 2e-4
"""Angle within which planes are parallel [rad]."""
COPLANAR = 1e-3
"""Distance within which parallel planes are one [m]."""


def planes_followed(quads: np.ndarray) -> tuple[int, int]:
    """Numbers of planes of mirrors (quad, 4, 3) in which suns have images, and of those without."""
    axis, axes = axes_of(quads)
    plane, kept = numbered_planes(quads, axis, axes)
    return len(kept), len(np.unique(plane[plane >= 0])) - len(kept) + count_planes(quads[axis < 0])


def chains_left_out(quads: Sequence[np.ndarray], rho: Sequence[float]) -> tuple[int, float]:
    """Number of chains of mirrors that are left out, and what the strongest reflects [–].

    Arguments are those of `MirrorFaces.of`.
    """
    faces = MirrorFaces.of(quads, rho)
    every = [] if faces is None else chains_of(faces.rectangles, faces.strongest)
    kept = strongest_of(every)
    beyond = [reflected for reflected, chain in every if chain not in kept]
    return len(beyond), max(beyond, default=0.0)


class MirrorFaces(NamedTuple):
    """Faces of mirrors by plane and axis."""

    quads: np.ndarray
    """Faces of all mirrors [m], shape (quad, 4, 3)."""
    owner: np.ndarray
    """Mirror of every quad, int, shape (quad,)."""
    axis: np.ndarray
    """Axis of every quad, −1 where its plane is left out, int, shape (quad,)."""
    plane: np.ndarray
    """Plane of every quad, −1 for none, int, shape (quad,)."""
    kept: np.ndarray
    """Planes that are followed, int, shape (plane,)."""
    axes: np.ndarray
    """Unit normals, of either sign, shape (axis, 3)."""
    rectangles: list[np.ndarray]
    """Rectangles around the mirrors of every plane, by axis [m], shape (rectangle, 4, 3) each."""
    strongest: np.ndarray
    """Largest reflectance of an axis at normal incidence [–], shape (axis,)."""

    @classmethod
    def of(cls, by_mirror: Sequence[np.ndarray], rho: Sequence[float]) -> MirrorFaces | None:
        """Sort the faces of mirrors; None where no plane is followed.

        Parameters
        ----------
        by_mirror : sequence of np.ndarray, shape (quad, 4, 3)
            Faces of every mirror [m].
        rho : sequence of float
            Reflectance of every mirror at normal incidence [–].
        """
        quads = np.concatenate(by_mirror).astype(float)
        owner = np.repeat(np.arange(len(by_mirror)), [len(own) for own in by_mirror])
        axis, axes = axes_of(quads)
        plane, kept = numbered_planes(quads, axis, axes)
        if not len(kept):
            return None
        axis = np.where(np.isin(plane, kept), axis, -1)
        used, axis = np.unique(axis, return_inverse=True)
        axis = axis.ravel() - int(used[0] == -1)
        axes = axes[used[used >= 0]]
        every = range(len(axes))
        of_axis = [[quads[plane == p] for p in kept if axis[plane == p][0] == a] for a in every]
        rectangles = [np.concatenate([*map(both_sides, planes)]) for planes in of_axis]
        strongest = np.array([np.asarray(rho)[owner[axis == a]].max() for a in every])
        return cls(quads, owner, axis, plane, kept, axes, rectangles, strongest)


def axes_of(quads: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axis of each quad (quad, 4, 3), −1 beyond `MOST_AXES`, and the axes (axis, 3)."""
    n, area = normals(quads), areas(quads)
    axis, axes = np.full(len(quads), -1), list[np.ndarray]()
    left = (area > 0) & np.isfinite(n).all(axis=1)
    while left.any() and len(axes) < MOST_AXES:
        rounded = np.round(n[left] * np.where(n[left] @ [0.61, 0.77, 0.17] < 0, -1, 1)[:, None], 4)
        _, group = np.unique(rounded, axis=0, return_inverse=True)
        largest = np.bincount(group.ravel(), area[left]).argmax()
        chosen = n[left][np.argmax(group.ravel() == largest)]
        near = left & (np.linalg.norm(np.cross(n, chosen), axis=1) < PARALLEL)
        axis[near], left = len(axes), left & ~near
        axes.append(chosen)
    return axis, np.array(axes).reshape(-1, 3)


def numbered_planes(
    quads: np.ndarray, axis: np.ndarray, axes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Plane of each quad, −1 for none, and the planes that are kept, the largest of each axis."""
    plane, kept, area, count = np.full(len(quads), -1), list[int](), areas(quads), 0
    for a, n in enumerate(axes):
        mine = np.flatnonzero(axis == a)
        offset = quads[mine].mean(axis=1) @ n
        order = np.argsort(offset)
        of = np.empty(len(mine), int)
        of[order] = np.cumsum(np.diff(offset[order], prepend=offset[order[0]]) > COPLANAR)
        plane[mine] = count + of
        largest = np.argsort(-np.bincount(of, area[mine]), kind="stable")[:MOST_PLANES]
        kept += (count + largest).tolist()
        count += int(of.max()) + 1
    return plane, np.array(sorted(kept), int)


def both_sides(quads: np.ndarray) -> np.ndarray:
    """Rectangle around coplanar quads, with its front to either side, shape (2, 4, 3)."""
    n, points = normals(quads[:1])[0], quads.reshape(-1, 3)
    u = quads[0, 1] - quads[0, 0]
    u = u / np.linalg.norm(u)
    v = np.cross(n, u)
    (left, right), (low, high) = (((points @ w).min(), (points @ w).max()) for w in (u, v))
    foot = n * (quads[0, 0] @ n)
    corners = [(left, low), (right, low), (right, high), (left, high)]
    one = np.array([foot + a * u + b * v for a, b in corners])[None]
    return np.concatenate([one, reversed_quads(one)])


def sides_seen(quads: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Rectangles of `both_sides` on the sides of coplanar quads from which their light counts.

    Quads whose `inside` does not count are seen from their back.
    """
    sides = both_sides(quads)
    backs = -normals(quads[~inside])
    kept = [inside.any() or bool((backs @ n > 0).any()) for n in normals(sides)]
    return sides[np.array(kept)]


def leads(one: np.ndarray, two: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Whether light may go along d (direction, 3) from rectangles to the planes of others."""
    may, points = np.zeros(len(d), bool), one[::2].reshape(-1, 3)
    for quad, n in zip(two[::2], normals(two[::2]), strict=True):
        height, along = points @ n - quad[0] @ n, d @ n
        may |= (along > 1e-6) & (height.min() < -COPLANAR)
        may |= (along < -1e-6) & (height.max() > COPLANAR)
    return may


def face_each_other(one: np.ndarray, two: np.ndarray) -> bool:
    """Whether rectangles of one axis and of another one may send light to each other."""
    for q, n in zip(one[::2], normals(one[::2]), strict=True):
        for r, m in zip(two[::2], normals(two[::2]), strict=True):
            apart = abs((r - q[0]) @ n).max() > COPLANAR and abs((q - r[0]) @ m).max() > COPLANAR
            if apart:
                return True
    return False


def chains_of(rectangles: list[np.ndarray], rho: np.ndarray) -> list[tuple[float, tuple[int, ...]]]:
    """Chains of one mirror and of several that face each other, those that reflect most first.

    Each has its product of reflectances at normal incidence [–].
    """
    every = range(len(rectangles))
    faces = {(a, b): face_each_other(rectangles[a], rectangles[b]) for a in every for b in every}
    chains: list[tuple[int, ...]] = [(a,) for a in every]
    for length in range(2, MOST_IN_TURN + 1):
        chains += [
            chain
            for chain in product(every, repeat=length)
            if all(faces[pair] for pair in pairwise(chain)) and prod(rho[a] for a in chain) > FAINT
        ]
    reflect = ((float(prod(rho[a] for a in chain)), chain) for chain in chains)
    return sorted(reflect, key=lambda each: -each[0])


def strongest_of(chains: list[tuple[float, tuple[int, ...]]]) -> tuple[tuple[int, ...], ...]:
    """Chains that are followed, those of few mirrors first: all of one mirror are."""
    order = sorted((chain for _, chain in chains), key=lambda chain: len(chain) > 1)
    return tuple(sorted(order[:MOST_CHAINS], key=len))
