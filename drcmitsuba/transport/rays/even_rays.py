r"""Cosine-distributed rays, spread evenly, from receivers: those are made that may matter.

A ray of index i from a receiver has the numbers :math:`\{i a_k + s_k\}`, k = 1, 2, with fixed steps
a and shifts s of the receiver. An opening is seen within a rectangle of these numbers. In the order
of :math:`\{i a_k\}`, which all receivers share, the indices whose number k lies between two bounds
follow one another: the shorter of both such runs holds all rays that pass the opening, and few
others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.sampling import random_bits
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.runtime.flat_arrays import flat_indices, row_and_column
from drcmitsuba.runtime.random_streams import even_numbers, even_order, shifted_point
from drcmitsuba.transport.rays.openings import Openings

Starts = Callable[..., Any]
"""Function that gives the points [m] of receivers, by their index, from which rays start at two
uniform numbers each: receivers that are surfaces are seen from all over."""
MOST_OPENINGS = 8
"""Number of openings up to which rays are looked for opening by opening."""
SEGMENTS = 16
"""Number of pieces of an opening's edge between whose ends its image is bounded."""
WIDER = 2e-3
"""Width by which an opening counts as larger on all sides [m]; `Openings.passed` takes less."""
NEAR = 5e-3
"""Distance from an opening's plane within which all rays count [m]."""
BEHIND = -0.7
"""Cosine below which a part of an opening lies so far behind a receiver that all rays count."""
BLOCK = 64
"""Number of lanes that belong to one receiver: lanes past its run are idle."""


class LeavingRays(NamedTuple):
    """Some of the rays."""

    receiver: mi.UInt32
    """Receiver among all receivers."""
    p: mi.Point3f
    d: mi.Vector3f
    active: mi.Bool


@dataclass(frozen=True)
class EvenRays:
    """Rays from some receivers, one after another; their directions are `first_directions`."""

    p: mi.Point3f
    n: mi.Normal3f
    """Positions [m] and normals, shape (receiver,)."""
    shifts: tuple[mi.UInt32, mi.UInt32]
    """Shifts of the even sequence."""
    first: mi.UInt32
    """Number of the first of these receivers."""
    rays: int
    """Number of rays from a receiver."""
    seed: int
    numbers: mi.UInt32
    """Seeds of the receivers' random numbers, shape (receiver,)."""
    starts: Starts | None
    """Where rays start; None where all start at `p`."""

    @classmethod
    def of(
        cls, points: mi.Float, normals: mi.Float, numbers: mi.UInt32, start: int, count: int,
        rays: int, seed: int, starts: Starts | None = None,
    ) -> EvenRays:  # fmt: skip
        """Rays of `count` receivers from the one at `start`; parameters as for `sky_deposit`."""
        first = dr.opaque(mi.UInt32, start)
        at = dr.arange(mi.UInt32, count) + first
        p, n = dr.gather(mi.Point3f, points, at), dr.gather(mi.Normal3f, normals, at)
        own = dr.gather(mi.UInt32, numbers, at)
        shifts = random_bits(own, seed)
        dr.eval(p, n, shifts, own)
        return cls(p, n, shifts, first, rays, seed, own, starts)

    def leaving(
        self, wanted: Callable[[mi.Vector3f], mi.Bool], openings: Openings | None
    ) -> Iterator[LeavingRays]:
        """Yield the rays in wanted directions that may leave a room by its openings."""
        if openings is None:
            rays = self._of(*self._receiver_and_index(self._lanes()))
            yield rays._replace(active=wanted(rays.d))
        elif openings.within is None and (found := self._found(openings)) is not None:
            for opening, some in enumerate(found):
                yield from self._by(opening, some, wanted, openings)
        else:
            lane = self._lanes()
            rays = self._of(*self._receiver_and_index(lane))
            passed = openings.passed(rays.receiver, rays.p, rays.d)
            chosen = dr.compress(wanted(rays.d) & passed)
            if dr.width(chosen):  # few rays leave a room: the others would cost as much
                yield self._of(*self._receiver_and_index(dr.gather(mi.UInt32, lane, chosen)))

    def _found(self, openings: Openings) -> list[Runs] | None:
        """Runs of rays to each opening; None where there would be as many lanes as rays."""
        count = len(openings.quads)
        if count > MOST_OPENINGS or self.rays < BLOCK:
            return None
        found = [runs(openings, i, self.p, self.n, self.shifts, self.rays) for i in range(count)]
        lanes = sum(dr.width(some.receiver) for some in found) * BLOCK
        return found if lanes < dr.width(self.p) * self.rays else None

    def _by(
        self, opening: int, some: Runs, wanted: Callable[[mi.Vector3f], mi.Bool],
        openings: Openings,
    ) -> Iterator[LeavingRays]:  # fmt: skip
        """Yield the rays of runs to an opening, without those that pass an earlier one, too."""
        lane = some.lanes()
        if not dr.width(lane):
            return
        receiver, index, there = some.ray(lane)
        rays = self._of(receiver, index)
        there &= wanted(rays.d) & openings.passed_one(opening, rays.p, rays.d)
        for earlier in range(opening):
            there &= ~openings.passed_one(earlier, rays.p, rays.d)
        chosen = dr.compress(there)
        if dr.width(chosen):
            yield self._of(*some.ray(dr.gather(mi.UInt32, lane, chosen))[:2])

    def _lanes(self) -> mi.UInt32:
        return dr.arange(mi.UInt32, dr.width(self.p) * self.rays)

    def _receiver_and_index(self, lane: mi.UInt32) -> tuple[mi.UInt32, mi.UInt32]:
        return row_and_column(lane, self.rays)

    def _of(self, receiver: mi.UInt32, index: mi.UInt32) -> LeavingRays:
        """Rays by their receiver among these and their index."""
        a, b = (dr.gather(mi.UInt32, shift, receiver) for shift in self.shifts)
        uv = shifted_point(index, (a, b))
        frame = mi.Frame3f(dr.gather(mi.Normal3f, self.n, receiver))
        d = frame.to_world(mi.warp.square_to_cosine_hemisphere(uv))
        if self.starts is None:
            p = dr.gather(mi.Point3f, self.p, receiver)
        else:
            number = dr.gather(mi.UInt32, self.numbers, receiver)
            p = self.starts(receiver + self.first, even_numbers(index, number, self.seed, 1))
        return LeavingRays(receiver + self.first, p, d, mi.Bool(True))


class Runs(NamedTuple):
    """Run of indices of every receiver, in one of two orders."""

    order: mi.UInt32
    """Indices by the first number, then by the second one, shape (2 · rays,)."""
    begin: mi.UInt32
    """Place of the first index in `order`, less than `rays`, shape (receiver,)."""
    count: mi.UInt32
    """Length of the run, which goes on at the order's beginning, shape (receiver,)."""
    second: mi.UInt32
    """First place of the order that is taken: 0 or `rays`, shape (receiver,)."""
    rays: mi.UInt32
    """Number of rays from a receiver."""
    receiver: mi.UInt32
    """Receiver of every `BLOCK` lanes."""
    start: mi.UInt32
    """Place in the run of the first of these lanes."""

    def lanes(self) -> mi.UInt32:
        """Lanes of all runs."""
        return dr.arange(mi.UInt32, BLOCK * dr.width(self.receiver))

    def ray(self, lane: mi.UInt32) -> tuple[mi.UInt32, mi.UInt32, mi.Bool]:
        """Receiver and index of the ray of a lane, and whether there is one."""
        block = lane // BLOCK
        receiver = dr.gather(mi.UInt32, self.receiver, block)
        at = dr.gather(mi.UInt32, self.start, block) + lane % BLOCK
        there = at < dr.gather(mi.UInt32, self.count, receiver)
        at += dr.gather(mi.UInt32, self.begin, receiver)
        at = dr.select(at < self.rays, at, at - self.rays)
        at += dr.gather(mi.UInt32, self.second, receiver)
        return receiver, dr.gather(mi.UInt32, self.order, at, there), there


def runs(
    openings: Openings, opening: int, p: mi.Point3f, n: mi.Normal3f,
    shifts: tuple[mi.UInt32, mi.UInt32], rays: int,
) -> Runs:  # fmt: skip
    """Find the runs that hold all rays through an opening.

    Parameters
    ----------
    opening : int
        Index of the opening.
    p, n : shape (receiver,)
        Positions [m] and normals of the receivers.
    shifts : mi.UInt32, shape (receiver,) each
        Shifts s of the first two numbers, in parts of 2³².
    rays : int
        Number of rays from a receiver.
    """
    bounds = _bounds(openings, opening, p, n)
    dr.eval(bounds)
    orders = [even_order(rays, dimension) for dimension in (0, 1)]
    count, most = dr.width(p), dr.opaque(mi.UInt32, rays)
    begin, length = mi.UInt32(0), mi.UInt32(0)
    second, empty = mi.UInt32(0), bounds[0] > bounds[1]
    for k, (_, key) in enumerate(orders):
        rising = flat_indices(key)
        first, last = (_number(bound) - shifts[k] for bound in bounds[2 * k : 2 * k + 2])
        low, high = _place(rising, first, most), _place(rising, last, most)
        # Numbers from `first` to `last`, going around; bounds that span everything hold all.
        span = dr.select(last >= first, high - low, most - low + high)
        span = dr.select(bounds[2 * k + 1] - bounds[2 * k] > 1 - 1e-6, most, span)
        takes = (span < length) if k else mi.Bool(True)
        begin, length = dr.select(takes, low % most, begin), dr.select(takes, span, length)
        second = dr.select(takes, k * most, second)
    length = dr.select(empty, 0, length)
    dr.eval(begin, length, second)
    blocks = -(-length.numpy().astype(np.int64) // BLOCK) if count else np.zeros(0, np.int64)
    receiver = np.repeat(np.arange(len(blocks)), blocks)
    start = BLOCK * (np.arange(len(receiver)) - np.repeat(np.cumsum(blocks) - blocks, blocks))
    order = flat_indices(np.concatenate([order for order, _ in orders]))
    return Runs(order, begin, length, second, most, flat_indices(receiver), flat_indices(start))


def _number(x: mi.Float) -> mi.UInt32:
    """Part of 2³² of a number in [0, 1]."""
    return mi.UInt32(dr.clip(mi.Float64(x), 0, 1) * (2.0**32 - 1))


@symbolic
def _place(rising: mi.UInt32, number: mi.UInt32, rays: mi.UInt32) -> mi.UInt32:
    """Place of the first of rising numbers that is not below a number; `rays` for none."""
    low, high = dr.zeros(mi.UInt32, dr.width(number)), mi.UInt32(rays)
    while dr.hint(low < high, exclude=[rising, number, rays]):
        middle = (low + high) >> 1
        below = dr.gather(mi.UInt32, rising, middle) < number
        low, high = dr.select(below, middle + 1, low), dr.select(below, high, middle)
    return low


@symbolic
def _bounds(
    openings: Openings, opening: int, p: mi.Point3f, n: mi.Normal3f
) -> tuple[mi.Float, mi.Float, mi.Float, mi.Float]:
    """Least and largest first, then second number of rays to an opening; 1, 0, … for none."""
    corner, normal, along, up, length = openings.axes(opening)
    frame, height = mi.Frame3f(n), dr.dot(p - corner, normal)
    width, tall = length.x + 2 * WIDER, length.y + 2 * WIDER
    start = corner - WIDER * (along + up) - p
    lowest, highest = mi.Point2f(2), mi.Point2f(-1)
    before, widest = mi.Point2f(0), mi.Float(0)
    above, behind, i = mi.Bool(False), mi.Bool(False), mi.UInt32(0)
    many = dr.opaque(mi.UInt32, 4 * SEGMENTS)
    while dr.hint(
        i <= many, exclude=[frame, width, tall, start, along, up, many, normal, corner, length]
    ):
        t = mi.Float(i % SEGMENTS) * (1 / SEGMENTS)
        side = (i // SEGMENTS) % 4
        a = dr.select(side == 0, t, dr.select(side == 1, 1, dr.select(side == 2, 1 - t, 0)))
        b = dr.select(side == 0, 0, dr.select(side == 1, t, dr.select(side == 2, 1, 1 - t)))
        d = frame.to_local(dr.normalize(start + a * width * along + b * tall * up))
        above |= d.z > 0
        behind |= d.z < BEHIND
        flat = dr.select(d.z > 0, 1, dr.rsqrt(dr.maximum(dr.squared_norm(d.xy), 1e-12)))
        at = mi.warp.uniform_disk_to_square_concentric(mi.Point2f(d.x * flat, d.y * flat))
        lowest, highest = dr.minimum(lowest, at), dr.maximum(highest, at)
        widest = dr.select(i > 0, dr.maximum(widest, dr.norm(at - before)), widest)
        before = at
        i += 1
    # Between two points the image stays within half their distance of them.
    lowest, highest = lowest - 0.5 * widest - 1e-4, highest + 0.5 * widest + 1e-4
    every = (dr.abs(height) < NEAR) | (above & behind)
    none = ~every & ((height < 0) | ~above)
    lowest = dr.select(every, 0, dr.maximum(lowest, 0))
    highest = dr.select(every, 1, dr.minimum(highest, 1))
    return (
        dr.select(none, 1, lowest.x), dr.select(none, 0, highest.x),
        dr.select(none, 1, lowest.y), dr.select(none, 0, highest.y),
    )  # fmt: skip


def first_directions(index: mi.UInt32, row: mi.UInt32, seed: int) -> mi.Vector3f:
    """Cosine-distributed directions about +z, spread evenly over the indices of a row."""
    return mi.warp.square_to_cosine_hemisphere(even_numbers(index, row, seed, 0))
