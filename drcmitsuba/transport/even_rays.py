"""Cosine-distributed rays, spread evenly, from receivers: those are made that may matter."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
from drcmitsuba_plugins.sampling import random_bits

from drcmitsuba.runtime.flat_arrays import row_and_column
from drcmitsuba.runtime.random_streams import shifted_point
from drcmitsuba.transport.openings import Openings
from drcmitsuba.transport.seen_openings import BLOCK, Runs, runs

MOST_OPENINGS = 8
"""Number of openings up to which rays are looked for opening by opening."""


class Rays(NamedTuple):
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

    @classmethod
    def of(
        cls, points: mi.Float, normals: mi.Float, numbers: mi.UInt32, start: int, count: int,
        rays: int, seed: int,
    ) -> EvenRays:  # fmt: skip
        """Rays of `count` receivers from the one at `start`; parameters as for `sky_deposit`."""
        first = dr.opaque(mi.UInt32, start)
        at = dr.arange(mi.UInt32, count) + first
        p, n = dr.gather(mi.Point3f, points, at), dr.gather(mi.Normal3f, normals, at)
        shifts = random_bits(dr.gather(mi.UInt32, numbers, at), seed)
        dr.eval(p, n, shifts)
        return cls(p, n, shifts, first, rays)

    def leaving(
        self, wanted: Callable[[mi.Vector3f], mi.Bool], openings: Openings | None
    ) -> Iterator[Rays]:
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
    ) -> Iterator[Rays]:  # fmt: skip
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

    def _of(self, receiver: mi.UInt32, index: mi.UInt32) -> Rays:
        """Rays by their receiver among these and their index."""
        a, b = (dr.gather(mi.UInt32, shift, receiver) for shift in self.shifts)
        uv = shifted_point(index, (a, b))
        frame = mi.Frame3f(dr.gather(mi.Normal3f, self.n, receiver))
        d = frame.to_world(mi.warp.square_to_cosine_hemisphere(uv))
        p = dr.gather(mi.Point3f, self.p, receiver)
        return Rays(receiver + self.first, p, d, mi.Bool(True))
