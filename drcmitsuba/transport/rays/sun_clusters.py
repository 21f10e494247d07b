"""Neighbouring suns, and which points may see which suns through the openings of a room."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.runtime.flat_arrays import flat, flat_indices, row_and_column
from drcmitsuba.runtime.launch_size import SHADOW_RAYS
from drcmitsuba.transport.rays.openings import Cone, Opening, Openings

CLUSTER = 32
"""Number of neighbouring suns that are traced or skipped together."""
WIDEST = np.radians(85)
"""Largest angle from the axis of a cluster that bounds it [rad]: with the radius of a sun, at most
5°, it stays below the 90° up to which the tests hold. Few suns all over the sky spread wider."""
TILE = 128
"""Number of neighbouring suns whose light on cells is gathered together."""


@lru_cache(maxsize=8)  # sensors and cells ask for the same suns
def _clusters(values: bytes) -> np.ndarray:
    """Indices of neighbouring directions, shape (cluster, CLUSTER), padded with −1.

    `values` are the directions in double precision.
    """
    directions = np.frombuffer(values).reshape(-1, 3)

    def sort(index: np.ndarray) -> list[np.ndarray]:
        if len(index) <= CLUSTER:
            return [index]
        axis = int(np.argmax(np.ptp(directions[index], axis=0)))
        half = -(-len(index) // (2 * CLUSTER)) * CLUSTER
        order = index[np.argsort(directions[index, axis], kind="stable")]
        return sort(order[:half]) + sort(order[half:])

    order = np.concatenate(sort(np.arange(len(directions))))  # all clusters but the last are full
    return np.pad(order, (0, -len(order) % CLUSTER), constant_values=-1).reshape(-1, CLUSTER)


def sun_tiles(suns: np.ndarray) -> list[np.ndarray]:
    """Indices of neighbouring suns (sun, 3), `TILE` together."""
    clusters = _clusters(suns.astype(float).tobytes())
    every = (clusters[i : i + TILE // CLUSTER] for i in range(0, len(clusters), TILE // CLUSTER))
    return [tile[tile >= 0] for tile in every]


class SunClusters(NamedTuple):
    """Neighbouring suns, `CLUSTER` together."""

    members: mi.UInt32
    """Indices of the suns, shape (cluster · CLUSTER,); 0 for none."""
    centres: mi.Float
    """Unit vectors to them, four numbers each, of which the last is 0; NaN for none."""
    axis: mi.Float
    """Mean direction of every cluster, three numbers each; 0 beyond `WIDEST`, where no test against
    it excludes the cluster."""
    spread: mi.Float
    """Largest angle from the axis to a sun's centre, at most π / 2 [rad]."""

    @classmethod
    def of(cls, suns: np.ndarray) -> SunClusters:
        """Clusters of unit vectors (sun, 3)."""
        clusters = _clusters(suns.astype(float).tobytes())
        members = suns[np.where(clusters < 0, clusters[:, :1], clusters)]  # bounds stay as they are
        axes = members.mean(axis=1)
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        cosines = np.einsum("gsi,gi->gs", members, axes)
        spread = np.arccos(np.clip(cosines, -1, 1)).max(axis=1)
        wide = ~(spread <= WIDEST)
        axes[wide], spread[wide] = 0, np.pi / 2
        centres = np.zeros((*clusters.shape, 4))
        centres[..., :3] = np.where(clusters[..., None] < 0, np.nan, members)
        return cls(flat_indices(np.maximum(clusters, 0)), flat(centres), flat(axes), flat(spread))

    def candidates(
        self, openings: Openings | None, points: mi.Float, normals: mi.Float, radius: float
    ) -> tuple[mi.UInt32, mi.UInt32]:
        """Receivers and clusters of suns of a `radius` [rad] that may see each other, in pairs."""
        count = dr.width(self.spread)
        entry = dr.arange(mi.UInt32, dr.width(points) // 3 * count)
        row, group = row_and_column(entry, count)
        p, n = dr.gather(mi.Point3f, points, row), dr.gather(mi.Normal3f, normals, row)
        axis = dr.gather(mi.Vector3f, self.axis, group)
        # Single precision errs by far less than a thousandth of a degree.
        spread = dr.gather(mi.Float, self.spread, group) + dr.opaque(mi.Float, radius + 1e-5)
        possible = dr.dot(n, axis) > -dr.sin(spread)
        if openings is not None:
            possible &= openings.passed(row, p, axis, spread)
        chosen = dr.compress(possible)
        row, group = (dr.gather(mi.UInt32, x, chosen) for x in (row, group))
        dr.eval(row, group)
        return row, group

    def cones(self, openings: Openings | None, radius: float) -> list[mi.Float]:
        """Disks of all members of a `radius` [rad] as each opening sees them, packed.

        There are none where points have openings of their own, which see few of the suns.
        """
        if openings is None or openings.counts is not None:
            return []
        every, spread = dr.arange(mi.UInt32, dr.width(self.members)), dr.opaque(mi.Float, radius)
        centre = dr.gather(mi.Vector4f, self.centres, every).xyz
        return [openings.cone(i, centre, spread).packed() for i in range(len(openings.quads))]


def possible_pairs(
    openings: Openings | None, points: mi.Float, normals: mi.Float, suns: np.ndarray,
    diameter: float,
) -> Iterator[mi.UInt32]:  # fmt: skip
    """Yield pairs point · suns + sun that may see each other.

    Parameters
    ----------
    openings : Openings, optional
        Openings that the points look through; None where light may come from everywhere.
    points, normals, suns, diameter
        As for `shadow_rays.sun_deposit`.
    """
    if not len(suns) or (openings is not None and openings.are_none):
        return
    clusters, radius = SunClusters.of(suns), float(np.radians(diameter)) / 2
    rows, groups = clusters.candidates(openings, points, normals, radius)
    cones, wide = clusters.cones(openings, radius), dr.opaque(mi.Float, radius)
    stride, least = dr.opaque(mi.UInt32, len(suns)), dr.opaque(mi.Float, -np.sin(radius))
    block = max(1, SHADOW_RAYS // CLUSTER)
    for start in range(0, dr.width(rows), block):
        first = dr.opaque(mi.UInt32, start)
        lane = dr.arange(mi.UInt32, min(block, dr.width(rows) - start)) + first
        row, group = (dr.gather(mi.UInt32, x, lane) for x in (rows, groups))
        p, n = dr.gather(mi.Point3f, points, row), dr.gather(mi.Normal3f, normals, row)
        elsewhere = mi.Bool(False) if openings is None else openings.are_elsewhere(row)
        looks = [] if openings is None else openings.of_points(row)
        test = _Test(openings, cones, looks, clusters.centres, least, wide, elsewhere, p, n)
        chosen = dr.compress(_holds(test, group * CLUSTER))
        if dr.width(chosen):  # few pairs: lanes of the others would cost as much
            # Gathered from what lies in memory: `row` and `group` would take launches of their own.
            lane = chosen // CLUSTER + first
            row, group = (dr.gather(mi.UInt32, x, lane) for x in (rows, groups))
            sun = dr.gather(mi.UInt32, clusters.members, group * CLUSTER + chosen % CLUSTER)
            pair = row * stride + sun
            dr.eval(pair)
            yield pair


@dataclass(frozen=True)
class _Test:
    """Test whether points may see a member of a cluster."""

    openings: Openings | None
    cones: list[mi.Float]
    """Disks of all members as each opening sees them; empty where points have their own."""
    looks: list[tuple[Opening, mi.Bool]]
    """Openings that the points look through, each with whether there is one."""
    centres: mi.Float
    least: mi.Float
    """Cosine between a normal and a sun's centre below which the whole disk is behind a point."""
    radius: mi.Float
    """Radius of a sun [rad]."""
    elsewhere: mi.Bool
    """Whether the points lie outside the room."""
    p: mi.Point3f
    n: mi.Normal3f

    def __call__(self, member: mi.UInt32) -> mi.Bool:
        """Whether each point may see one member each."""
        centre = dr.gather(mi.Vector4f, self.centres, member).xyz
        above = dr.dot(self.n, centre) > self.least
        if self.openings is None:
            return above
        if self.openings.within is None:
            return above & self.passed(member, centre)
        return above & _passed(self, member, centre, above & ~self.elsewhere)

    def passed(self, member: mi.UInt32, centre: mi.Vector3f) -> mi.Bool:
        """Whether each point may see one member each by an opening of its room."""
        assert self.openings is not None
        passed = mi.Bool(False)
        for i, (opening, there) in enumerate(self.looks):
            if self.cones:
                cone = Cone.unpacked(self.cones[i], member)
            else:
                cone = self.openings.cone(opening, centre, self.radius)
            passed |= there & self.openings.passed_by(opening, self.p, cone)
        return passed


@symbolic
def _passed(test: _Test, member: mi.UInt32, centre: mi.Vector3f, indoors: mi.Bool) -> mi.Bool:
    """Whether points that lie in rooms, and all others, may see one member each."""
    passed = mi.Bool(test.elsewhere)
    if dr.hint(indoors, exclude=[test]):
        passed = test.passed(member, centre)
    return passed


@symbolic
def _holds(test: _Test, first: mi.UInt32) -> mi.Bool:
    """Whether a test holds for all members of clusters, from the `first` on, flat."""
    count = dr.width(first)
    lane, i = dr.arange(mi.UInt32, count), dr.zeros(mi.UInt32, count)
    out = dr.zeros(mi.Bool, count * CLUSTER)
    dr.make_opaque(out)
    while dr.hint(i < CLUSTER, exclude=[test, first, count, lane, out]):
        dr.scatter(out, mi.Bool(True), lane * CLUSTER + i, test(first + i))
        i += 1
    return out
