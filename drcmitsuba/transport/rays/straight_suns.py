"""Coefficients of straight light from suns alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.sampling import random_bits

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.runtime.flat_arrays import flat, repeated, row_and_column
from drcmitsuba.runtime.launch_size import SENSORS, SHADOW_RAYS
from drcmitsuba.runtime.random_streams import REPLICATES, Stream, launch_seed, number_in_replicate
from drcmitsuba.scene.scene import Scene
from drcmitsuba.schema import mean_and_error
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.rays.openings import (
    Openings,
    Within,
    hidden_in_disks,
    in_rooms,
    repeated_within,
    within_at,
    within_of,
)
from drcmitsuba.transport.rays.shadow_rays import (
    RIM,
    one_sun_deposit,
    rim_deposit,
    sun_deposit,
    sun_numbers,
)
from drcmitsuba.transport.rays.sun_clusters import possible_pairs

EDGE_SAMPLES = 8
"""Directions on a sun's disk in each replicate, where the edge of a shadow crosses the disk."""
FEWER = 8
"""Factor by which fewer directions are drawn on a disk whose rim is alike."""
ALIKE = 0.1
"""Relative difference of D around a sun's disk below which no shadow edge is assumed."""


def sensor_numbers(here: slice) -> mi.UInt32:
    """Indices of the sensors of a block."""
    return dr.arange(mi.UInt32, here.stop - here.start) + dr.opaque(mi.UInt32, here.start)


def straight_suns(
    scene: Scene, points: np.ndarray, normals: np.ndarray, suns: Suns, accuracy: Accuracy,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Coefficients of straight light from suns alone.

    Parameters
    ----------
    scene, points, normals, suns, accuracy
        As for `coefficients.compute`.

    Returns
    -------
    mean, error : np.ndarray, shape (sensor, sun)
        Estimate and its standard error [sr]; the errors of all entries are independent.

    Notes
    -----
    Most sensors see all of a sun or nothing. Where `RIM` directions around the disk's edge agree,
    their mean is the result. Where they differ, a shadow's edge crosses the disk, which is then
    estimated with `EDGE_SAMPLES` directions in each replicate; so is a disk that may be seen
    through a slit. Where all of these are lit, or none is, the rim tells of a sliver that they
    miss; its expected share is both counted and stated as an error. A straight edge that takes or
    leaves less than 1.5 % of the disk, or a bar across it of less than a tenth of its width, may go
    unnoticed.
    """
    shape = (len(points), len(suns.labels))
    mean, error = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    reached = scene.effects.enabled_suns(suns)
    if reached.any():
        followed = suns.where(reached)
        for start in range(0, len(points), SENSORS):
            here = slice(start, min(start + SENSORS, len(points)))
            mean[here, reached], error[here, reached] = _straight_suns(
                scene, points[here], normals[here], followed, accuracy, here
            )
    return mean, error


def _straight_suns(
    scene: Scene, points: np.ndarray, normals: np.ndarray, suns: Suns, accuracy: Accuracy,
    here: slice,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """`straight_suns` of some sensors."""
    within = within_of(scene, points, in_rooms(scene, points))
    p, n, places = flat(points), flat(normals), sensor_numbers(here)
    disks = Disks(scene, suns.directions, suns.diameter, accuracy, p, n, places, within)
    rims, edges = disks.rims.mean, disks.rims.edges
    mean, error = rims.numpy(), np.zeros(dr.width(rims), np.float32)
    if dr.width(edges):
        again = disks.edges(EDGE_SAMPLES).numpy().reshape(accuracy.replicates, -1)
        mean[edges.numpy()], error[edges.numpy()] = mean_and_error(again)
    shape = (len(points), len(suns.labels))
    return mean.reshape(shape), error.reshape(shape)


@lru_cache(maxsize=8)
def sliver(samples: int) -> float:
    """Share of a disk that a shadow's edge is expected to leave, of which no direction was drawn.

    A straight edge lies anywhere across the disk, so that the light part of height h, in radii, is
    f = (θ − sin θ) / 2π with cos (θ/2) = 1 − h. The rim tells of it with probability
    p = min(1, RIM · θ / 2π), and no direction does with probability (1 − f)ⁿ:

        f̄ = ∫ f p (1 − f)ⁿ dh / ∫ p (1 − f)ⁿ dh.
    """
    angle = 2 * np.arccos(1 - 2 * (np.arange(10_000) + 0.5) / 10_000)
    f = (angle - np.sin(angle)) / (2 * np.pi)
    told = np.minimum(1, RIM * angle / (2 * np.pi)) * (1 - f) ** samples
    return float((f * told).sum() / told.sum())


class Rims(NamedTuple):
    """D [sr] of `RIM` directions around each disk, flat (sensor, sun)."""

    mean: mi.Float
    least: mi.Float
    most: mi.Float
    """Least and largest D of any direction."""
    edges: mi.UInt32
    """Entries where a shadow's edge crosses the disk."""


@dataclass(frozen=True)
class Disks:
    """The disks of suns as sensors see them: all of a disk or nothing, or a shadow's edge on it."""

    scene: Scene
    suns: np.ndarray
    """Unit vectors, shape (sun, 3)."""
    diameter: float
    """Angle across a sun [deg]."""
    accuracy: Accuracy
    """Seed and number of replicates."""
    p: mi.Float
    n: mi.Float
    """Positions [m] and normals of the sensors, three numbers each."""
    places: mi.UInt32
    """Numbers of the sensors."""
    within: Within
    """Whether the sensors lie in the room."""
    _drawn: dict[int, mi.Float] = field(default_factory=dict, init=False, repr=False)
    """D of `edges`, by the number of directions."""

    @cached_property
    def pairs(self) -> tuple[mi.UInt32, ...]:
        """Pairs sensor · suns + sun that may see each other, in arrays of one launch each."""
        openings = Openings.of(self.scene, self.p, self.within)
        return tuple(possible_pairs(openings, self.p, self.n, self.suns, self.diameter))

    def _pairs_of_replicates(self, count: int) -> Iterator[mi.UInt32]:
        """Yield the pairs of `count` replicates, whose sensors stand one after another."""
        entries = dr.opaque(mi.UInt32, dr.width(self.places) * len(self.suns))
        for pairs in self.pairs:
            step = max(1, SHADOW_RAYS // dr.width(pairs))
            for start in range(0, count, step):
                lane = dr.arange(mi.UInt32, min(step, count - start) * dr.width(pairs))
                replicate, at = row_and_column(lane, dr.width(pairs))
                replicate += dr.opaque(mi.UInt32, start)
                pair = dr.gather(mi.UInt32, pairs, at) + replicate * entries
                dr.eval(pair)
                yield pair

    def by_replicate(self, replicates: range, samples: int) -> mi.TensorXf:
        """D [sr] of the sensors in some replicates, shape (replicate · sensor, sun).

        Replicates draw `samples` directions where a shadow's edge crosses a disk. On other disks,
        whose rim is alike, they draw `FEWER`: a hole or a bar counts as often as it is hit.
        """
        count, sensors, edges = len(replicates), dr.width(self.places), self.rims.edges
        out = sun_deposit(
            self.scene, repeated(self.p, count), repeated(self.n, count), suns=self.suns,
            diameter=self.diameter, samples=max(1, samples // FEWER),
            seed=launch_seed(self.accuracy.seed, Stream.SUN_EDGES),
            numbers=dr.concat([number_in_replicate(self.places, r) for r in replicates]),
            within=repeated_within(self.within, count),
            pairs=self._pairs_of_replicates(count),
        ).array  # fmt: skip
        if dr.width(edges):
            each = dr.opaque(mi.UInt32, sensors * len(self.suns))
            lane = dr.arange(mi.UInt32, count * dr.width(edges))
            replicate, edge = row_and_column(lane, dr.width(edges))
            at = replicate * each + dr.gather(mi.UInt32, edges, edge)
            first = dr.opaque(mi.UInt32, replicates.start * dr.width(edges))
            D = dr.gather(mi.Float, self.edges(samples), lane + first)
            dr.eval(out, D, at)
            dr.scatter(out, D, at)
        return mi.TensorXf(out, (count * sensors, len(self.suns)))

    @cached_property
    def rims(self) -> Rims:
        """Light around the disks, which is looked at once for all replicates."""
        with self.scene.ray_counter.purpose(Stream.SUN_RIMS.name):
            mean, least, most = rim_deposit(
                self.scene, self.p, self.n, suns=self.suns, diameter=self.diameter,
                seed=launch_seed(self.accuracy.seed, Stream.SUN_RIMS), numbers=self.places,
                pairs=self.pairs, within=self.within,
            )  # fmt: skip
        slits = hidden_in_disks(self.scene, self.p, self.suns, self.diameter, self.within)
        edges = dr.compress((most - least > ALIKE * most) | (slits & (most == 0)))
        return Rims(mean, least, most, edges)

    def edges(self, samples: int) -> mi.Float:
        """D [sr] of disks that a shadow's edge crosses, flat (replicate, edge), all replicates."""
        if samples not in self._drawn:
            D = self.drawn(self.rims.edges, range(self.accuracy.replicates), samples)
            dr.eval(D)
            self._drawn[samples] = self._with_doubt(D, samples)
        return self._drawn[samples]

    def _with_doubt(self, D: mi.Float, samples: int) -> mi.Float:
        """Give replicates that agree the error that remains, D [sr] flat (replicate, edge).

        The rim tells that there is light and shadow on such a disk, even if all directions of all
        replicates are lit, or none is: then one replicate, a random one, holds what is expected of
        the other part, `sliver`. The mean is its expectation, and its standard error as large.
        Where all replicates hit a disk equally often, every second one takes a third of a hit from
        the next: directions that are spread evenly agree more often than their error is small.
        """
        edges, count = self.rims.edges, self.accuracy.replicates
        width, least, most = dr.width(edges), mi.Float(dr.inf), mi.Float(0)
        for r in range(count):
            at = dr.arange(mi.UInt32, width) + dr.opaque(mi.UInt32, r * width)
            here = dr.gather(mi.Float, D, at)
            least, most = dr.minimum(least, here), dr.maximum(most, here)
        full = dr.gather(mi.Float, self.rims.most, edges)
        shadow = dr.gather(mi.Float, self.rims.least, edges) < 0.5 * full
        is_dark = (most == 0) & (full > 0)
        is_lit = shadow & (least >= (1 - 0.5 / samples) * full)
        is_alike = (most - least < ALIKE * full / samples) & ~(is_dark | is_lit)
        dr.eval(full, is_dark, is_lit, is_alike)
        replicate, edge = row_and_column(dr.arange(mi.UInt32, count * width), width)
        row, sun = row_and_column(dr.gather(mi.UInt32, edges, edge), len(self.suns))
        place = dr.gather(mi.UInt32, mi.UInt32(sun_numbers(self.suns)), sun)
        seed = launch_seed(self.accuracy.seed, Stream.SUN_RIMS) + RIM
        turn, _ = random_bits(dr.gather(mi.UInt32, self.places, row), seed, place)
        share = dr.opaque(mi.Float, min(1.0, count * sliver(count * samples)))
        share = dr.select(replicate == turn % dr.opaque(mi.UInt32, count), share, 0)
        whole, pairs = dr.gather(mi.Float, full, edge), dr.opaque(mi.UInt32, count // 2 * 2)
        third = dr.select((replicate + turn) & 1 == 0, whole, -whole) / (3 * samples)
        dark, lit, alike = (dr.gather(mi.Bool, x, edge) for x in (is_dark, is_lit, is_alike))
        out = dr.select(dark, share * whole, dr.select(lit, (1 - share) * D, D))
        out += dr.select(alike & (replicate < pairs), third, 0)
        dr.eval(out)
        return out

    def drawn(self, edges: mi.UInt32, replicates: range, samples: int) -> mi.Float:
        """D [sr] of chosen entries by random directions, flat (replicate, entry)."""
        count, entries = len(replicates), dr.width(edges)
        replicate, edge = row_and_column(dr.arange(mi.UInt32, count * entries), entries)
        row, sun = row_and_column(dr.gather(mi.UInt32, edges, edge), len(self.suns))
        # Every entry is a receiver of its own, whose number tells its replicate.
        first = dr.opaque(mi.UInt32, replicates.start)
        number = dr.gather(mi.UInt32, self.places, row) * REPLICATES + replicate + first
        p, n = (dr.ravel(dr.gather(mi.Point3f, x, row)) for x in (self.p, self.n))
        dr.eval(p, n, sun, number)
        return one_sun_deposit(
            self.scene, p, n, sun, suns=self.suns, diameter=self.diameter, samples=samples,
            seed=launch_seed(self.accuracy.seed, Stream.SUN_EDGES), numbers=number,
            within=within_at(self.within, row),
        )  # fmt: skip
