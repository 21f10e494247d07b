"""Answers of films to suns and sky, by the outgoing cells of their BSDFs.

Where f is the same all over an outgoing cell, it is so all over an incident one. The disk of a sun
lies in a few of these; its shares in them, found by many directions, give an answer that serves all
replicates. The suns of a year are many more than the incident cells that they meet: sums over
outgoing cells are made for these. Other BSDFs are averaged over directions on the disk and in the
outgoing cell, drawn anew in every replicate, and so are the answers to the sky.
"""

from __future__ import annotations

from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches, patch_index
from drcmitsuba_plugins.sampling import TO_UNIT, from_disk, random_bits, sample_disk
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.runtime.flat_arrays import (
    add_at,
    first_of_rows,
    flat,
    flat_indices,
    marked,
    row_and_column,
)
from drcmitsuba.runtime.launch_size import SHADOW_RAYS
from drcmitsuba.runtime.random_streams import even_numbers, even_steps
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.films.orientation import Mount
from drcmitsuba.transport.light.products import by_replicate
from drcmitsuba.transport.panes.patches import OFFSET, PanePatches
from drcmitsuba.transport.rays.shadow_rays import straight, sun_numbers

DISK_POINTS = 4096
"""Number of directions on a sun's disk that tell its shares in incident cells: for suns of 0.53°
on a tree of 32² cells, answers err by 0.05 % (RMS). All replicates have this error alike."""
RIM_POINTS = 64
"""Number of points on the rim of a sun's disk that tell whether cells cut it."""
SAMPLES = 16
"""Directions on a sun's disk, and in an outgoing cell, that f is averaged over in a replicate."""


class DiskParts(NamedTuple):
    """Parts of the suns' disks that lie in one incident cell each, sorted by sun."""

    first: mi.UInt32
    """First part of every sun, and last their number."""
    cell: mi.UInt32
    """Index of each part's cell among those that any part lies in."""
    share: mi.Float
    """Share of the part in the light that the disk sends to the pane."""
    d: mi.Float
    """A direction to each of these cells in the pane's frame, three numbers each."""


class EvenAnswer(NamedTuple):
    """Answer of a film to suns, by the incident cells that their disks lie in.

    f(sun → outgoing cell) = Σ share · f(incident cell → outgoing cell) over the parts of the disk.
    """

    f: mi.TensorXf
    """f [1/sr], shape (row, incident cell)."""
    parts: DiskParts
    """Parts of the disks, in cells that are columns of `f`."""

    @classmethod
    def of(cls, mount: Mount, suns: np.ndarray, diameter: float) -> EvenAnswer:
        """Cut the disks of suns by the incident cells of a film, and tabulate f.

        Parameters
        ----------
        suns : np.ndarray, shape (sun, 3)
            Unit vectors.
        diameter : float
            Angle across a sun [deg].
        """
        if not len(suns):
            none = DiskParts(dr.zeros(mi.UInt32, 1), mi.UInt32(), mi.Float(), mi.Float())
            return cls(dr.zeros(mi.TensorXf, (mount.rows, 0)), none)
        parts = disk_parts(mount, suns, diameter)
        cells = dr.width(parts.d) // 3
        row, column = row_and_column(dr.arange(mi.UInt32, mount.rows * cells), cells)
        si = mount.interaction(mount.outgoing(row, mi.Point2f(0.5)))
        d = dr.gather(mi.Vector3f, parts.d, column)
        f = mount.bsdf.eval(mount.context, si, d)[0] / dr.maximum(dr.abs(d.z), 1e-30)
        dr.eval(f)
        return cls(mi.TensorXf(f, (mount.rows, cells)), parts)

    def to_suns(self, values: mi.TensorXf) -> mi.TensorXf:
        """Values by sun from values by incident cell, shapes (row, cell) and (row, sun)."""
        rows, suns = values.shape[0], dr.width(self.parts.first) - 1
        out = dr.empty(mi.Float, rows * suns)
        for start in range(0, rows * suns, SHADOW_RAYS):
            lane = dr.arange(mi.UInt32, min(SHADOW_RAYS, rows * suns - start))
            pair = lane + dr.opaque(mi.UInt32, start)
            row, sun = row_and_column(pair, suns)
            begin = row * dr.opaque(mi.UInt32, values.shape[1])
            dr.scatter(out, _of_parts(self.parts, values.array, begin, sun), pair)
            dr.eval(out)
        return mi.TensorXf(out, (rows, suns))


@symbolic
def _of_parts(parts: DiskParts, values: mi.Float, begin: mi.UInt32, sun: mi.UInt32) -> mi.Float:
    """Sum of share · value over the parts of the suns' disks."""
    at, total = dr.gather(mi.UInt32, parts.first, sun), mi.Float(0)
    end = dr.gather(mi.UInt32, parts.first, sun + 1)
    while dr.hint(at < end, exclude=[parts, values, begin, sun, end]):
        cell = dr.gather(mi.UInt32, parts.cell, at)
        total += dr.gather(mi.Float, parts.share, at) * dr.gather(mi.Float, values, begin + cell)
        at += 1
    return total


class SunCells(NamedTuple):
    """Light of suns on an exposed film, by the incident cells of its BSDF.

    Light that a receiver gets from an outgoing cell is f · D; the sum over outgoing cells is made
    for every incident cell, and only then told by sun.
    """

    f: mi.TensorXf
    """f [1/sr], shape (outgoing cell, incident cell)."""
    answer: EvenAnswer
    shone: mi.Float
    """D [sr] of the film, flat (replicate, lit sun)."""

    def gathered(self, weights: mi.TensorXf) -> mi.TensorXf:
        """Sums by incident cell from weights by outgoing cell, shapes (row, cell)."""
        return weights @ self.f

    def sent(self, values: mi.TensorXf) -> mi.TensorXf:
        """Light by sun from what is `gathered`.

        Shapes (replicate · row, incident cell) and (replicate · row, lit sun).
        """
        out = self.answer.to_suns(values)
        rows, suns = out.shape
        if not rows:  # no path met a pane that reflects
            return out
        row, sun = row_and_column(dr.arange(mi.UInt32, rows * suns), suns)
        replicate, _ = row_and_column(row, rows * suns // dr.width(self.shone))
        at = replicate * dr.opaque(mi.UInt32, suns) + sun
        return mi.TensorXf(out.array * dr.gather(mi.Float, self.shone, at), out.shape)


class SunRadiance(NamedTuple):
    """Light of suns on an exposed film whose answer is not even, as `SunCells`."""

    radiance: mi.TensorXf
    """Radiance of the film's cells, shape (replicate · outgoing cell, lit sun)."""
    replicates: int

    def gathered(self, weights: mi.TensorXf) -> mi.TensorXf:
        """Give the weights themselves."""
        return weights

    def sent(self, values: mi.TensorXf) -> mi.TensorXf:
        """Light by sun, shape (replicate · row, lit sun)."""
        return by_replicate(values, self.radiance, self.replicates)


def disk_parts(mount: Mount, suns: np.ndarray, diameter: float) -> DiskParts:
    """Cut the disks of suns, unit vectors (sun, 3), by the incident cells of a film."""
    points = np.where(_are_cut(mount, suns, diameter), DISK_POINTS, 1)
    of_lane = flat_indices(np.repeat(np.arange(len(suns)), points))

    def at(lane: mi.UInt32) -> tuple[mi.UInt32, mi.Vector3f, mi.UInt32]:
        """Sun, direction and incident cell."""
        uv = (mi.Float((lane * mi.UInt32(step)) >> 8) * TO_UNIT for step in even_steps(2))
        on_disk = mi.warp.square_to_uniform_disk_concentric(mi.Point2f(*uv))
        sun = dr.gather(mi.UInt32, of_lane, lane)
        return sun, *_on_disks(mount, suns, diameter, sun, on_disk)

    lane = dr.arange(mi.UInt32, dr.width(of_lane))
    sun, d, number = at(lane)
    light = mi.Float64(dr.select((d.z < 0) | (not mount.exposed), dr.abs(d.z), 0))
    dr.eval(sun, number, light)
    _, place, cells = _numbered(number, 2 * mount.bsdf.out_cells)
    cell = dr.gather(mi.UInt32, place, number)
    key = sun * dr.opaque(mi.UInt32, cells) + cell
    known, place, parts = _numbered(key, cells * len(suns))
    shares, some = dr.zeros(mi.Float64, parts), dr.full(mi.UInt32, dr.width(lane), cells)
    add_at(shares, light, dr.gather(mi.UInt32, place, key))
    dr.scatter_reduce(dr.ReduceOp.Min, some, lane, cell)
    dr.eval(shares, some)
    of_sun, of_part = row_and_column(known, cells)
    whole = dr.zeros(mi.Float64, len(suns))
    add_at(whole, shares, of_sun)
    of_disk = dr.gather(mi.Float64, whole, of_sun)
    share = mi.Float(dr.select(of_disk > 0, shares / of_disk, 0))
    _, d, _ = at(some)
    dr.eval(of_part, share)
    return DiskParts(first_of_rows(of_sun, len(suns)), of_part, share, dr.ravel(d))


def _numbered(key: mi.UInt32, many: int) -> tuple[mi.UInt32, mi.UInt32, int]:
    """Different keys, of `many`, in rising order; the place of every key in them; their number."""
    known, place = marked(many, key), dr.zeros(mi.UInt32, many)
    count = dr.width(known)
    dr.scatter(place, dr.arange(mi.UInt32, count), known)
    dr.eval(place)
    return known, place, count


def _on_disks(
    mount: Mount, suns: np.ndarray, diameter: float, sun: mi.UInt32, at: mi.Point2f
) -> tuple[mi.Vector3f, mi.UInt32]:
    """Directions to points of the unit disk on suns, in the pane's frame; their incident cells."""
    d = mount.turn.to_local(from_disk(dr.gather(mi.Vector3f, flat(suns), sun), diameter, at))
    return d, mount.bsdf.out_cell(d) + dr.select(d.z > 0, mi.UInt32(mount.bsdf.out_cells), 0)


def _are_cut(mount: Mount, suns: np.ndarray, diameter: float) -> np.ndarray:
    """Whether the rims of suns' disks lie in several incident cells, shape (sun,)."""
    sun, index = row_and_column(dr.arange(mi.UInt32, len(suns) * RIM_POINTS), RIM_POINTS)
    angle = mi.Float(index) * (2 * dr.pi / RIM_POINTS)
    _, cell = _on_disks(mount, suns, diameter, sun, mi.Point2f(dr.cos(angle), dr.sin(angle)))
    dr.eval(cell)
    cut = dr.zeros(mi.Bool, len(suns))
    dr.scatter(cut, True, sun, cell != dr.gather(mi.UInt32, cell, sun * RIM_POINTS))
    return np.array(cut)


def sampled_answer(mount: Mount, suns: np.ndarray, diameter: float, seed: int) -> mi.Float:
    """Estimate f [1/sr] from suns into any outgoing cells; arguments as for `EvenAnswer.of`.

    The answer is flat, (row, sun).
    """
    out = dr.zeros(mi.Float, mount.rows * len(suns))
    directions, ctx = flat(suns), mount.context
    places = mi.UInt32(sun_numbers(suns))
    for start in range(0, dr.width(out), SHADOW_RAYS):
        lane = dr.arange(mi.UInt32, min(SHADOW_RAYS, dr.width(out) - start))
        pair = lane + dr.opaque(mi.UInt32, start)
        row, sun = row_and_column(pair, len(suns))
        centre = dr.gather(mi.Vector3f, directions, sun)
        place = dr.gather(mi.UInt32, places, sun)
        total, cosines = mi.Float(0), mi.Float(0)
        for i in range(SAMPLES):
            index = dr.full(mi.UInt32, i, dr.width(lane))
            d = sample_disk(centre, diameter, even_numbers(index, row, seed, 0, place))
            uv = even_numbers(index, row, seed, 1, place)
            si, wo = mount.interaction(mount.outgoing(row, uv)), mount.turn.to_local(d)
            counts = (wo.z < 0) | (not mount.exposed)
            total += dr.select(counts, mount.bsdf.eval(ctx, si, wo)[0], 0)
            cosines += dr.select(counts, dr.abs(wo.z), 0)
        dr.scatter(out, dr.select(cosines > 0, total / cosines, 0), pair)
        dr.eval(out)
    return out


def sky_answer(
    scene: Scene, patches: PanePatches, mount: Mount, patch: int, subdivision: int, samples: int,
    seed: int,
) -> mi.Float:  # fmt: skip
    """Estimate the radiance of a film's cells per unit radiance of ground and sky patches.

    Parameters
    ----------
    patch : int
        Patch of the film that light arrives at.
    subdivision : int
        Reinhart's factor MF of the sky.
    samples : int
        Number of directions for every outgoing cell, drawn from the BSDF.

    Returns
    -------
    mi.Float, flat (row, bin)
    """
    bins, each = len(Patches(subdivision)), dr.opaque(mi.UInt32, samples)
    out = dr.zeros(mi.Float64, mount.rows * bins)  # of many samples in one bin
    block = max(1, SHADOW_RAYS // samples)
    for start in range(0, mount.rows, block):
        lane = dr.arange(mi.UInt32, min(block, mount.rows - start) * samples)
        row, index = row_and_column(lane, samples)
        row += dr.opaque(mi.UInt32, start)
        d, weight = _from_sky(scene, patches, mount, patch, row, index, each, seed)
        index = row * bins + patch_index(d, subdivision)
        add_at(out, mi.Float64(weight / mi.Float(each)), index, weight > 0)
        dr.eval(out)
    return mi.Float(out)


def _from_sky(
    scene: Scene, patches: PanePatches, mount: Mount, patch: int, row: mi.UInt32,
    index: mi.UInt32, samples: mi.UInt32, seed: int,
) -> tuple[mi.Vector3f, mi.Float]:  # fmt: skip
    """Directions to the sky whose light leaves a patch in the rows' cells, and weights."""
    si = mount.interaction(mount.outgoing(row, even_numbers(index, row, seed, 1)))
    lobe, a, b = (
        mi.Float(v >> 8) * TO_UNIT
        for v in (*random_bits(row, seed, index), random_bits(row, seed + 1, index)[0])
    )
    lobe = (mi.Float(index) + lobe) / mi.Float(samples)  # spread evenly over the lobes
    bs, value = mount.bsdf.sample(mount.context, si, lobe, even_numbers(index, row, seed, 0))
    d, weight = mount.turn.to_world(bs.wo), value[0]
    wanted = scene.effects.shines(d)
    if mount.exposed:
        return d, dr.select((bs.wo.z < 0) & wanted, weight, 0)
    p = patches.at(dr.full(mi.UInt32, patch, dr.width(row)), a, b)
    p += dr.select(bs.wo.z > 0, OFFSET, -OFFSET) * mount.turn.n
    return d, weight * straight(scene, mi.Point3f(p), d, (weight > 0) & wanted)
