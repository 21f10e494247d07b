"""How fast this machine is beside the one that units of work were measured on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from time import perf_counter

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.plan.forecast.scout import bare
from drcmitsuba.scene.geometry import box

RAYS = 1 << 19
NUMBERS = 1 << 18
TIMES, LIMIT = 9, 0.12
"""Repetitions, of which the fastest counts, for others may use the machine as well; seconds after
which there are no more of them."""

RAYS_PER_SECOND = 41e6
NUMBERS_PER_SECOND = 21.8e6
"""Closest hits in a box, and numbers sorted, on the reference: 2 cores with AVX-512, LLVM 19."""


@dataclass(frozen=True)
class Speed:
    """Speed of a machine, relative to the reference.

    Parameters
    ----------
    rays : float
        Of kernels.
    host : float
        Of NumPy and Python in one thread.
    """

    rays: float = 1.0
    host: float = 1.0


REFERENCE = Speed()


@lru_cache(maxsize=1)
def speed() -> Speed:
    """Measure this machine, which takes 0.3 s at most once kernels are compiled."""
    walls = bare(np.array(box(np.zeros(3), np.ones(3))))
    lane = dr.arange(mi.UInt32, RAYS)
    random = mi.PCG32(RAYS)
    z, turn = 2 * random.next_float32() - 1, dr.two_pi * random.next_float32()
    level = dr.safe_sqrt(1 - z * z)
    s, c = dr.sincos(turn)
    d = mi.Vector3f(level * c, level * s, z)
    p = mi.Point3f(*(0.1 + 0.8 * random.next_float32() for _ in range(3)))
    dr.eval(lane, d, p)
    dr.sync_thread()

    def rays() -> None:
        dr.eval(walls.ray_intersect_preliminary(mi.Ray3f(p, d), coherent=False).t)
        dr.sync_thread()

    numbers = np.random.default_rng(0).random(NUMBERS)
    rays()  # compiles, or loads what was compiled before
    return Speed(
        RAYS / _fastest(rays) / RAYS_PER_SECOND,
        NUMBERS / _fastest(lambda: np.sort(numbers)) / NUMBERS_PER_SECOND,
    )


def _fastest(work: Callable[[], object]) -> float:
    """Seconds of the fastest of some runs."""
    taken: list[float] = []
    while len(taken) < TIMES and sum(taken) < LIMIT:
        start = perf_counter()
        work()
        taken.append(perf_counter() - start)
    return min(taken)
