"""Forecasts beside what then happens, and what the plan saves, for the shipped cases.

    python -m tests.bench.forecast [CASE …] [--fit] [--skip-forced]

from the repository's root; prints Markdown. Every evaluation has a process of its own, and is made
once before where its kernels had to be compiled. The first table has the forecast's ratio to what
happened, in wall seconds, processor seconds, memory, disk and rays. Processor seconds tell more
where the machine has other work: those of the forecast are the reference machine's, twice the
seconds of kernels. The second has all effects forced on (`[effects]` all "all") beside the plan's
choice. `--fit` fits the units of work, `KERNELS` and `HOST` of `forecast.cost`, by non-negative
least squares to the processor seconds of all these evaluations and of some with one setting of
`[accuracy]` changed; units that the measurements do not tell apart stay near their present values.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from scipy.optimize import nnls

from drcmitsuba.annual.result import evaluate
from drcmitsuba.case.case import Case
from drcmitsuba.case.effects import Effects
from drcmitsuba.case.reading import load_case
from drcmitsuba.case.shading import Shading
from drcmitsuba.case.shipped import shipped_cases
from drcmitsuba.model.materials import DiffuserMaterial, Lambertian
from drcmitsuba.plan import plan
from drcmitsuba.plan.forecast import Forecast, forecast
from drcmitsuba.plan.forecast.cost import HOST, KERNELS
from drcmitsuba.runtime import backend, process
from drcmitsuba.runtime.machine_speed import REFERENCE
from drcmitsuba.sky.daylight import daylight
from tests.bench.__main__ import machine, table
from tests.bench.models import as_model
from tests.hard.test_hard_geometry import house, street
from tests.hard.test_hard_rooms import film_case, slit_case
from tests.model_rooms import l_room, layer, prism

MOST = 3600.0
"""Seconds that an evaluation may take."""
AROUND = ("evaluation", "illuminance", "byte", "picture")
"""Units of work outside of transport."""
NEARNESS = 0.15
"""Weight of the present values in a fit."""
THREADS = 2
"""Number of threads of the reference machine."""
SECONDS = {unit: THREADS * seconds for unit, seconds in KERNELS.items()} | dict(HOST)
"""Processor seconds of a unit of work on the reference machine."""


@cache
def kept() -> tempfile.TemporaryDirectory[str]:
    """Folder of the models' files, kept until the program ends."""
    return tempfile.TemporaryDirectory()


def of_polygons(name: str, case: Case) -> Case:
    """A case as the Radiance files that it exports."""
    folder = Path(kept().name) / name
    folder.mkdir()
    return as_model(case, folder)


def classroom_and_tower() -> Case:
    """The classroom of polygons before a tower, with a shade."""
    case = of_polygons("tower", load_case("classroom/existing"))
    tower = layer(
        "tower", Lambertian(0.4), *prism([(-9, -30), (13, -30), (13, -20), (-9, -20)], 60.0)[2],
        role="context",
    )  # fmt: skip
    shade = DiffuserMaterial(type="diffuser", transmittance=0.05)
    shaded = case.with_tables(
        materials={**case.materials, "shade": shade}, shading=Shading(material="shade")
    )
    shaded._building = replace(case.building, layers=(*case.building.layers, tower))
    return shaded


HARD: dict[str, Callable[[], Case]] = {
    "hard: slit of 1 mm": slit_case,
    "hard: film of 1 cm²": film_case,
    "hard: street": street,
    "hard: house": house,
    "model: an L": lambda: of_polygons("l", l_room()),
    "model: classroom": lambda: of_polygons("classroom", load_case("classroom/existing")),
    "model: classroom and tower": classroom_and_tower,
}
"""Rooms of tests/hard, and models."""
VARIED: tuple[tuple[str, dict[str, Any]], ...] = (
    ("classroom/existing", {"paths": 512}),
    ("classroom/existing", {"cell_sky_rays": 1024}),
    ("classroom/existing", {"sensor_sky_rays": 16384}),
    ("classroom/existing", {"sensor_sun_samples": 32}),
    ("classroom/existing", {"cell_size": 0.2}),
    ("classroom/existing", {"replicates": 16}),
    ("classroom/existing", {"pane_points": 512}),
    ("classroom/o2", {"pane_points": 256}),
    ("classroom/o2", {"film_sky_samples": 2048}),
    ("duct/duct", {"photons": 4096}),
)


class Actual(NamedTuple):
    """An evaluation's times, beside the forecasts for this machine and for the reference."""

    expected: Forecast
    on_reference: Forecast
    seconds: float
    transport: float
    """Processor seconds of transport, and of all else."""
    around: float
    memory: int
    disk: int
    rays: dict[str, int]


@dataclass(frozen=True)
class Evaluation:
    """The job: evaluate a case and save its results."""

    case: Case

    def __call__(self) -> Actual:
        backend.select()
        planned = plan(self.case, daylight(self.case))
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            actual = self._measured(planned)
            kernels = dr.kernel_history([dr.KernelType.JIT])
        if any(not k["cache_hit"] and not k["cache_disk"] for k in kernels):
            dr.flush_malloc_cache()
            actual = self._measured(planned)
        return actual

    def _measured(self, planned: Any) -> Actual:
        processor: dict[str, float] = {}

        @contextmanager
        def stage(name: str) -> Iterator[Any]:
            start = time.process_time()
            yield lambda share: None
            processor[name] = time.process_time() - start

        with tempfile.TemporaryDirectory() as folder:
            result = evaluate(self.case, stage)
            result.save(Path(folder), stage)
            saved = json.loads((Path(folder) / "plan.json").read_text(encoding="utf-8"))
        transport = sum(v for k, v in processor.items() if "façade" in k)
        actual = saved["cost"]["actual"]
        return Actual(
            forecast(planned), forecast(planned, REFERENCE), actual["seconds"], transport,
            sum(processor.values()) - transport - processor.get("forecast", 0.0),
            actual["memory_bytes"], actual["disk_bytes"], actual["rays"],
        )  # fmt: skip


def run(case: Case) -> Actual:
    """Evaluate a case in a process of its own."""
    return process.run(Evaluation(case), time.monotonic() + MOST)


def forced(case: Case) -> Case:
    """The case with all effects on."""
    every = Effects(**dict.fromkeys(Effects.model_fields, "all"))
    return case.model_copy(update={"effects": every})


def varied(name: str, change: dict[str, Any]) -> Case:
    case = load_case(name)
    return case.model_copy(update={"accuracy": case.accuracy.model_copy(update=change)})


def processor_seconds(expected: Forecast) -> float:
    """Processor seconds of a forecast on the reference machine."""
    return sum(amount * SECONDS[unit] for unit, amount in expected.items.items())


def ratio(expected: float, actual: float) -> str:
    return f"{expected / actual:.2f}"


def forecasts(actual: dict[str, Actual]) -> None:
    """Print forecasts beside the actual costs."""
    head = ["case", "forecast s", "took s", "ratio", "CPU s", "ratio", "memory MiB", "ratio",
            "disk MB", "ratio", "million rays", "ratio"]  # fmt: skip
    rows = []
    for name, a in actual.items():
        cpu, rays = a.transport + a.around, sum(a.rays.values())
        rows.append([
            name, f"{a.expected.seconds:.1f}", f"{a.seconds:.1f}",
            ratio(a.expected.seconds, a.seconds), f"{cpu:.1f}",
            ratio(processor_seconds(a.on_reference), cpu), f"{a.memory / 2**20:.0f}",
            ratio(a.expected.memory_bytes, a.memory), f"{a.disk / 1e6:.1f}",
            ratio(a.expected.disk_bytes, a.disk), f"{rays / 1e6:.1f}",
            ratio(sum(a.expected.rays.values()), rays) if rays else "",
        ])  # fmt: skip
    table(head, rows)


def savings(planned: dict[str, Actual]) -> None:
    """Evaluate the cases with everything forced on, and print what the plan spares."""
    head = ["case", "all effects: s", "CPU s", "million rays", "as planned: s", "CPU s",
            "million rays", "CPU seconds spared"]  # fmt: skip
    rows = []
    for name, as_planned in planned.items():
        if name in HARD:
            continue
        everything = run(forced(load_case(name)))
        both = [(one.seconds, one.transport + one.around, sum(one.rays.values()) / 1e6)
                for one in (everything, as_planned)]  # fmt: skip
        rows.append([name, *(f"{v:.1f}" for one in both for v in one),
                     f"{100 * (1 - both[1][1] / both[0][1]):.0f} %"])  # fmt: skip
        print(" ".join(rows[-1]), flush=True)
    print()
    table(head, rows)


def fit(actual: list[Actual]) -> None:
    """Print the units that fit best."""
    for around in (False, True):
        units = [name for name in SECONDS if (name in AROUND) == around]
        now = np.array([SECONDS[unit] for unit in units])
        amounts = np.array([[a.on_reference.items.get(u, 0.0) for u in units] for a in actual])
        took = np.array([a.around if around else a.transport for a in actual])
        relative = amounts * now / took[:, None]
        system = np.vstack([relative, NEARNESS * np.eye(len(units))])
        wanted = np.concatenate([np.ones(len(took)), np.full(len(units), NEARNESS)])
        factors, _ = nnls(system, wanted)
        fitted = relative @ factors
        present = {**KERNELS, **HOST}
        rows = [[u, f"{present[u] * f:.2e}", f"{f:.2f}"]
                for u, f in zip(units, factors, strict=True)]  # fmt: skip
        table(["unit", "seconds", "of the present value"], rows)
        print(f"fitted over measured: {fitted.min():.2f} to {fitted.max():.2f}\n", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="*", help="by default all that are shipped")
    parser.add_argument("--fit", action="store_true", help="fit the units of work")
    parser.add_argument("--skip-forced", action="store_true", help="only the forecasts")
    options = parser.parse_args()
    names = options.cases or [*shipped_cases(), *HARD]
    print(f"{machine()}; {backend.select()}; load {os.getloadavg()[0]:.1f}\n", flush=True)
    planned = {}
    for name in names:
        planned[name] = run(HARD[name]() if name in HARD else load_case(name))
        print(f"{name}: {planned[name].seconds:.1f} s, load {os.getloadavg()[0]:.1f}", flush=True)
    print()
    forecasts(planned)
    if options.fit:
        fit([*planned.values(), *(run(varied(*each)) for each in VARIED)])
    if not options.skip_forced:
        savings(planned)


if __name__ == "__main__":
    from tests.bench import forecast as module  # jobs are pickled by the name of their module

    module.main()
