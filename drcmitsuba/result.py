"""One evaluation from case to numbers, files and pictures."""

from __future__ import annotations

import re
import resource
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from drcmitsuba import backend, scene, schema
from drcmitsuba.case import Case
from drcmitsuba.judgement import Judgement, judge
from drcmitsuba.light import Daylight, daylight, luminances, save_luminances
from drcmitsuba.plan import notes, photon_notes, plan
from drcmitsuba.progress import Stage, silent, timed
from drcmitsuba.rounds import Reached, toward_target
from drcmitsuba.simulation import coefficients


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
    """

    case: Case
    metrics: dict[str, Any]
    illuminance: xr.Dataset
    coefficients: xr.Dataset
    light: Daylight
    plan: dict[str, Any]

    @property
    def sky(self) -> xr.Dataset:
        """L[time, bin] as on disk; large where many time stamps have suns of their own."""
        L = luminances(self.light)
        channels = self.coefficients.get("channel")
        return L if channels is None else L.assign(L=L["L"].expand_dims(channel=channels))

    def save(self, folder: str | Path, stage: Stage = silent) -> None:
        """Write all results and plots to a folder, each file whole or not at all."""
        from drcmitsuba import plots, report  # matplotlib is only loaded where plots are drawn

        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        start = time.perf_counter()
        with stage("writing") as done:
            schema.save_netcdf(self.illuminance, folder / "illuminance.nc")
            done(0.2)
            schema.save_zarr(self.coefficients, folder / "coefficients.zarr")
            done(0.5)
            save_luminances(self.light, folder / "sky.zarr", self.coefficients.get("channel"))
            schema.save_json(self.plan, folder / "plan.json")
            done(0.6)
            figures = report.pictures(self.case, self.illuminance, self.metrics)
            for name, figure in figures.items():
                plots.save(figure, folder / name)
            for old in folder.glob("undecided_*_plan.png"):  # drawn only where there are any
                if old.name not in figures:
                    old.unlink()
            self.metrics["seconds"]["writing"] = round(time.perf_counter() - start, 3)
            self.metrics["peak_memory_bytes"] = peak_memory()
            schema.save_json(self.metrics, folder / "metrics.json")

    def _repr_png_(self) -> bytes:
        from io import BytesIO

        from drcmitsuba import plots

        buffer = BytesIO()
        plots.write(plots.monthly(self.metrics, title=self.case.name), buffer, dpi=100)
        return buffer.getvalue()


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
        scene.sensor_points(case)  # what is wrong with the sensors is told before the work begins
        told = notes(case)  # reads the films' files, which may be unfit
        light = daylight(case)
    found = coefficients(case, light, stage, seconds, known)
    with timed(stage, "accumulation and metrics", seconds):
        now = judge(case, light, found)
    reached = None
    if case.accuracy.target is not None:
        found, now, reached = toward_target(case, light, found, now, stage, seconds)
    return summed_up(case, light, found, now, seconds, told, reached)


def summed_up(
    case: Case, light: Daylight, found: xr.Dataset, now: Judgement, seconds: dict[str, float],
    told: list[str], reached: Reached | None = None,
) -> Result:  # fmt: skip
    """Put the parts of an evaluation together, settings and plan with them.

    Parameters
    ----------
    case : Case
    light : Daylight
    found : xr.Dataset
        C of both states.
    now : Judgement
    seconds : dict
    told : list of str
        Notes on the films.
    reached : Reached, optional
        How far a target was reached.
    """
    E, numbers = now.illuminance, now.metrics
    closed = int(E["shade_closed"].sum())
    suns = int((light.sky["sun_bin"].values != "").sum())
    effects = plan(case, suns, closed, E.sizes["time"], found.attrs)
    missing = [e["reason"] for e in effects.values() if e.get("missing")]
    numbers["settings"] = {
        "case": case.source,
        "variant": backend.select(),
        "weather_source": light.source,
        "notes": [*light.notes, *told, *photon_notes(found.attrs), *missing],
        **case.model_dump(mode="json", exclude_none=True),
    }
    if reached is not None:
        numbers["accuracy"] = asdict(reached)
    numbers["seconds"] = seconds
    numbers["peak_memory_bytes"] = peak_memory()
    return Result(case, numbers, E, found, light, effects)
