"""One evaluation from case to numbers, files and pictures."""

from __future__ import annotations

import re
import resource
import sys
import time
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from drcmitsuba.annual.adaptive_sampling import SamplingOutcome, toward_target
from drcmitsuba.annual.simulation import coefficients
from drcmitsuba.case.case import Case
from drcmitsuba.metrics.evaluate_metrics import EvaluatedMetrics, evaluate_metrics
from drcmitsuba.plan import Plan, notes, photon_notes, plan
from drcmitsuba.plan.forecast import Forecast, forecast, told_plan
from drcmitsuba.runtime import backend, storage
from drcmitsuba.runtime.progress import Stage, silent, timed
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS, EnabledEffects
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.daylight import Daylight, daylight, luminances, save_luminances


@dataclass(frozen=True)
class Result:
    """What an evaluation found; shows itself in Jupyter.

    Parameters
    ----------
    case : Case
    metrics : dict
        As in `metrics.json`.
    illuminance, coefficients : xr.Dataset
        E and C as on disk.
    light : Daylight
        What L is made of.
    plan : dict
        As in `plan.json`.
    scope : EnabledEffects
        What was simulated.
    """

    case: Case
    metrics: dict[str, Any]
    illuminance: xr.Dataset
    coefficients: xr.Dataset
    light: Daylight
    plan: dict[str, Any]
    scope: EnabledEffects = ALL_EFFECTS

    @property
    def sky(self) -> xr.Dataset:
        """L[time, bin] as on disk; large where many time stamps have suns of their own."""
        L = luminances(self.light)
        channels = self.coefficients.get("channel")
        return L if channels is None else L.assign(L=L["L"].expand_dims(channel=channels))

    def save(self, folder: str | Path, stage: Stage = silent) -> None:
        """Write all results and plots to a folder, each file whole or not at all."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        start = time.perf_counter()
        with stage("writing") as done:
            storage.save_netcdf(self.illuminance, folder / "illuminance.nc")
            done(0.2)
            storage.save_zarr(self.coefficients, folder / "coefficients.zarr")
            done(0.5)
            save_luminances(self.light, folder / "sky.zarr", self.coefficients.get("channel"))
            storage.save_json(self.plan, folder / "plan.json")
            done(0.6)
            drawn = self._save_pictures(folder)
            self.metrics["seconds"]["writing"] = round(time.perf_counter() - start, 3)
            self.metrics["peak_memory_bytes"] = peak_memory()
            storage.save_json(self.metrics, folder / "metrics.json")
            written = ["illuminance.nc", "coefficients.zarr", "sky.zarr", "metrics.json", *drawn]
            disk = sum(_bytes(folder / name) for name in written)
            _settle(self.plan["cost"], self.metrics, disk)
            storage.save_json(self.plan, folder / "plan.json")  # again: now its cost is known

    def _save_pictures(self, folder: Path) -> list[str]:
        """Draw the plots, and remove those of an earlier evaluation; names of the files."""
        drawn = {}
        if self.scope.pictures:
            from drcmitsuba.report import (  # matplotlib is only loaded where plots are drawn
                figures,
                plots,
            )

            drawn = figures.pictures(self.case, self.illuminance, self.metrics)
            for name, figure in drawn.items():
                plots.save(figure, folder / name)
        for old in [*folder.glob("*_plan.png"), folder / "monthly.png"]:
            if old.name not in drawn:
                old.unlink(missing_ok=True)
        return list(drawn)

    def _repr_png_(self) -> bytes:
        from io import BytesIO

        from drcmitsuba.report import plots

        buffer = BytesIO()
        plots.write(plots.monthly(self.metrics, title=self.case.name), buffer, dpi=100)
        return buffer.getvalue()


def _bytes(path: Path) -> int:
    """Size of a file, or of all files in a folder."""
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())


def _settle(cost: dict[str, Any], numbers: dict[str, Any], disk: int | None = None) -> None:
    """Put what an evaluation took beside its forecast; bytes of its files where it was saved."""
    actual = cost["actual"]
    actual["seconds"] = round(sum(numbers["seconds"].values()), 3)
    actual["memory_bytes"] = numbers["peak_memory_bytes"]
    told = f"took {actual['seconds']:.3g} s"
    if disk is not None:
        actual["disk_bytes"] = disk
    if "forecast" in cost:
        told = f"forecast {cost['forecast']['seconds']:.2g} s; {told}"
    if "rays" in actual:
        told += f" and {sum(actual['rays'].values())} rays"
    cost["reason"] = told


def peak_memory() -> int:
    """Largest memory that the process has held [bytes].

    On Linux, what getrusage tells counts also what the parent held when it started the process.
    """
    status = Path("/proc/self/status")
    if status.is_file():
        found = re.search(r"^VmHWM:\s*(\d+) kB$", status.read_text(), re.MULTILINE)
        if found is not None:
            return 1024 * int(found[1])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def evaluate(case: Case, stage: Stage = silent, known: xr.Dataset | None = None) -> Result:
    """Evaluate a case: L, C, E and the metrics of its period.

    Parameters
    ----------
    case : Case
        From `load_case`.
    stage : callable, optional
        Shows the stages of the work, as the command line does.
    known : xr.Dataset, optional
        Coefficients of this case that were computed for another weather.

    Returns
    -------
    Result

    Raises
    ------
    InputError
        The weather, the period, a material or a sensor is unfit.
    BackendError
        No fit LLVM or GPU.
    """
    backend.select()
    seconds: dict[str, float] = {}
    with timed(stage, "sky", seconds):
        sensor_points(case)  # what is wrong with the sensors is told before the work begins
        told = notes(case)  # reads the films' files, which may be unfit
        light = daylight(case)
        planned = plan(case, light)
    expected = None
    if known is None:  # what is known already costs nothing
        with timed(stage, "forecast", seconds):
            expected = forecast(planned)
    rays: Counter[str] = Counter()
    found = coefficients(case, light, stage, seconds, known, planned.scope, rays)
    with timed(stage, "accumulation and metrics", seconds):
        now = evaluate_metrics(case, light, found)
    reached = None
    if case.accuracy.target is not None:
        found, now, reached = toward_target(
            planned.simulated, light, found, now, stage, seconds, planned.scope, rays
        )
    return summed_up(planned, found, now, seconds, told, reached, rays, expected)


def summed_up(
    planned: Plan, found: xr.Dataset, now: EvaluatedMetrics, seconds: dict[str, float],
    told: list[str], reached: SamplingOutcome | None = None, rays: Counter[str] | None = None,
    expected: Forecast | None = None,
) -> Result:  # fmt: skip
    """Put the parts of an evaluation together, settings and plan with them.

    Parameters
    ----------
    planned : Plan
    found : xr.Dataset
        C of both states.
    now : EvaluatedMetrics
    seconds : dict
    told : list of str
        Notes on the films.
    reached : SamplingOutcome, optional
        How far a target was reached.
    rays : Counter, optional
        Number of rays by kind.
    expected : Forecast, optional
        What it was to cost.
    """
    case, light = planned.facts.case, planned.facts.light
    E, numbers = now.illuminance, now.metrics
    effects = told_plan(planned, expected, found.attrs)
    effects["cost"]["actual"] = {} if rays is None else {"rays": dict(rays)}
    told = [*told, *planned.notes()]
    numbers["settings"] = {
        "case": case.source,
        "variant": backend.select(),
        "weather_source": light.source,
        "notes": [*light.notes, *told, *photon_notes(found.attrs)],
        **case.model_dump(mode="json", exclude_none=True),
    }
    if reached is not None:
        numbers["accuracy"] = asdict(reached)
    numbers["seconds"] = seconds
    numbers["peak_memory_bytes"] = peak_memory()
    _settle(effects["cost"], numbers)
    return Result(case, numbers, E, found, light, effects, planned.scope)
