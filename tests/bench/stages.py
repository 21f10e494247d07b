"""Seconds of an evaluation by stage, beside the bare closest hits of Embree.

    python -m tests.bench.stages [CASE ...] [--times 5]

from the repository's root; prints Markdown. A case is evaluated again and again in one process,
without files, after a first run that compiles. Between the runs, 32 million random rays in the box
of the scene are intersected with its surfaces: the ratio of both times is the headline. One more
run waits for every kernel where a stage ends, so that each stage has its own seconds, launches and
rays; the last column is how long bare closest hits of as many rays take.
"""

from __future__ import annotations

import argparse
import importlib
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import wraps
from typing import Any
from unittest import mock

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.annual.result import evaluate
from drcmitsuba.case.case import Case
from drcmitsuba.case.reading import load_case
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.ray_counter import RayCounter
from drcmitsuba.scene import scene
from tests.bench.__main__ import machine, table

RAYS = 1 << 25
"""Number of bare rays."""

STAGES = {
    "weather and sky": ("annual.result:daylight_and_year",),
    "forecast": ("annual.result:forecast",),
    "scene": ("scene.scene:load",),
    "light on panes": ("transport.deposit:Deposit.lit",),
    "photons": ("transport.photons.tracer:PhotonTracer.traced",),
    "gather: sensors to cells": ("transport.interreflection.interior:Gathered.of",),
    "transfer: cells to cells": ("transport.interreflection.interior:solved",),
    "deposit on cells": ("transport.replicate:Replicates.meet",),
    "deposit on sensors": ("transport.replicate:Replicates.sensors",),
    "products": ("transport.replicate:Replicates.interreflected",),
    "illuminance and metrics": ("annual.result:evaluate_metrics",),
}
"""Functions of every stage, where `drcmitsuba` looks them up; a stage within another is its own."""
BETWEEN = "between the stages"


@dataclass
class Spent:
    """Seconds, launches and rays of each stage so far."""

    seconds: Counter[str] = field(default_factory=Counter)
    launches: Counter[str] = field(default_factory=Counter)
    rays: Counter[str] = field(default_factory=Counter)
    running: list[str] = field(default_factory=lambda: [BETWEEN])
    counters: list[RayCounter] = field(default_factory=list)
    since: float = field(default_factory=time.perf_counter)
    counted: int = 0

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Give what a block takes to a stage, except what stages within it take."""
        self.take()
        self.running.append(name)
        try:
            yield
        finally:
            self.take()
            self.running.pop()

    def take(self) -> None:
        """Give everything since the last call to the stage that is running."""
        dr.sync_thread()
        now, name = time.perf_counter(), self.running[-1]
        self.seconds[name] += now - self.since
        self.launches[name] += len(dr.kernel_history())
        dr.kernel_history_clear()
        rays = sum(sum(one.counted().values()) for one in self.counters)
        self.rays[name] += rays - self.counted
        dr.kernel_history_clear()
        self.counted, self.since = rays, time.perf_counter()

    def timed(self, work: Callable, name: str) -> Callable:
        """Make a function whose time belongs to a stage."""

        @wraps(work)
        def of_stage(*args: Any, **kwargs: Any) -> Any:
            with self.stage(name):
                result = work(*args, **kwargs)
                dr.eval(result)
                return result

        return of_stage


def replaced(path: str, name: str, spent: Spent) -> Any:
    """Patch of a function, method or class method at `module:name` by one whose time is told."""
    module, _, attribute = path.partition(":")
    *classes, last = attribute.split(".")
    owner: Any = importlib.import_module(f"drcmitsuba.{module}")
    for each in classes:
        owner = getattr(owner, each)
    work = getattr(owner, last)
    bound = isinstance(vars(owner).get(last), classmethod)
    new = spent.timed(work, name)
    return mock.patch.object(owner, last, staticmethod(new) if bound else new)


def profile(case: Case) -> Spent:
    """Evaluate a case once, stage by stage."""
    spent, begin = Spent(), RayCounter.__init__

    def registered(counter: RayCounter) -> None:
        begin(counter)
        spent.counters.append(counter)

    with ExitStack() as stack:
        stack.enter_context(dr.scoped_set_flag(dr.JitFlag.KernelHistory, True))
        stack.enter_context(mock.patch.object(RayCounter, "__init__", registered))
        for name, paths in STAGES.items():
            for path in paths:
                stack.enter_context(replaced(path, name, spent))
        dr.kernel_history_clear()
        spent.since = time.perf_counter()
        evaluate(case)
        spent.take()
    return spent


def bare(world: scene.Scene) -> float:
    """Seconds of `RAYS` closest hits, from points in the scene's box in all directions."""
    random = mi.PCG32(RAYS)
    ends = world.corners.min(axis=0), world.corners.max(axis=0)
    if world.enclosure is not None:
        ends = np.zeros(3), world.enclosure.size
    low, high = (mi.Point3f(*map(float, corner)) for corner in ends)
    at = mi.Vector3f(*(random.next_float32() for _ in range(3)))
    p = low + (high - low) * at
    d = mi.warp.square_to_uniform_sphere(mi.Point2f(random.next_float32(), random.next_float32()))
    dr.eval(p, d)
    dr.sync_thread()
    start = time.perf_counter()
    met = world.full.ray_intersect_preliminary(mi.Ray3f(p, d), coherent=False)
    dr.eval(met.t, met.prim_index)
    dr.sync_thread()
    return time.perf_counter() - start


def compare(name: str, times: int) -> None:
    """Print the times of a case."""
    case = load_case(name)
    world = scene.load(case)
    evaluate(case)
    bare(world)
    taken = np.empty((times, 2))
    for row in taken:
        start = time.perf_counter()
        evaluate(case)
        row[0] = time.perf_counter() - start
        row[1] = bare(world)
    whole, hits = np.median(taken, axis=0)
    low, high = np.quantile(taken[:, 0] / taken[:, 1], [0, 1])
    print(f"## `{name}`, again in one process, without files\n")
    print(
        f"{whole:.2f} s; {RAYS / 1e6:.1f} M bare closest hits {hits:.2f} s: ratio "
        f"**{whole / hits:.2f}** (medians of {times}; ratios {low:.2f} … {high:.2f})\n"
    )
    spent = profile(case)
    total, rows = sum(spent.seconds.values()), []
    for stage in (*STAGES, BETWEEN):
        seconds, rays = spent.seconds[stage], spent.rays[stage]
        if not seconds:
            continue
        alone = rays / RAYS * hits
        rows.append([
            stage, f"{seconds:.3f}", f"{seconds / total:.0%}", spent.launches[stage],
            f"{rays / 1e6:.2f}", f"{alone:.3f}",
        ])  # fmt: skip
    rays = sum(spent.rays.values())
    rows.append([
        "all", f"{total:.3f}", "100%", sum(spent.launches.values()), f"{rays / 1e6:.2f}",
        f"{rays / RAYS * hits:.3f}",
    ])  # fmt: skip
    head = ["stage", "seconds", "share", "launches", "million rays", "seconds of bare rays"]
    table(head, rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="*", default=["classroom/reference/existing"])
    parser.add_argument("--times", type=int, default=5, help="number of runs of each")
    options = parser.parse_args()
    print(f"{machine()}; {backend.select()}\n", flush=True)
    for name in options.cases:
        compare(name, options.times)


if __name__ == "__main__":
    main()
