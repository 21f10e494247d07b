"""Speed of this machine relative to the reference machine, where the units were measured."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from timeit import repeat

import drjit as dr
import mitsuba as mi
import numpy as np

RAYS, NUMBERS, TIMES = 1 << 19, 1 << 17, 4
"""Number of rays, of numbers that a loop in Python adds, and of repetitions of both."""
RAYS_PER_SECOND, NUMBERS_PER_SECOND = 24e6, 13e6
"""Closest hits in a box, and numbers added, on the reference machine."""
MACHINE = "2 cores of an AMD EPYC with LLVM 19"


@dataclass(frozen=True)
class Speed:
    """Speed of kernels, and of Python in one thread, relative to the reference."""

    rays: float = 1.0
    host: float = 1.0


@lru_cache(maxsize=1)
def speed() -> Speed:
    """Measure the speed of this machine under its present load, in 0.15 s."""
    walls = mi.load_dict({"type": "scene", "walls": {"type": "cube"}})
    random = mi.PCG32(RAYS)
    d = mi.warp.square_to_uniform_sphere(mi.Point2f(random.next_float32(), random.next_float32()))
    p = mi.Point3f(*(1.6 * random.next_float32() - 0.8 for _ in range(3)))
    dr.eval(d, p)

    def rays() -> None:
        dr.eval(walls.ray_intersect_preliminary(mi.Ray3f(p, d), coherent=False).t)
        dr.sync_thread()

    def numbers() -> None:
        sum(i * 0.5 for i in range(NUMBERS))

    rays()  # compiles the kernel, or loads it from the cache
    seconds = [float(np.mean(repeat(one, number=1, repeat=TIMES))) for one in (rays, numbers)]
    return Speed(RAYS / seconds[0] / RAYS_PER_SECOND, NUMBERS / seconds[1] / NUMBERS_PER_SECOND)
