"""One evaluation, from a case to numbers, files and pictures.

case     ─ daylight ──────────► Daylight: L[time, bin], suns
         ─ plan ──────────────► Plan: enabled effects; forecast: what they will cost
         ─ simulate(open) ────► C[sensor, bin] of the open state
C · L    ─ direct_sun ────────► direct sun[time, sensor], once: ASE, and hours that may close
         ─ simulate(others) ──► C of the suns of these hours; all states: Coefficients
C · L    ─ illuminance ───────► E[time, sensor], the shade applied     illuminance.nc
E, C     ─ evaluate_metrics ──► draws, metrics with their intervals    metrics.json
         ─ toward_target ─────► more rounds of C, E and metrics, where a target asks for them
all      ─ Result.save ───────► coefficients.zarr, sky.zarr, plan.json, pictures
A `Run` accompanies all steps: seed, enabled effects, stages with their seconds, rays.
"""

from __future__ import annotations

import re
import resource
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from drcmitsuba.annual import simulation
from drcmitsuba.annual.adaptive_sampling import SamplingOutcome, toward_target
from drcmitsuba.annual.attributes import settings as settings_of_case
from drcmitsuba.annual.run import Run
from drcmitsuba.blocks.block_folder import BlockFolder
from drcmitsuba.case.case import Case
from drcmitsuba.case.reading import load_case
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.evaluate_metrics import EvaluatedMetrics, evaluate_metrics
from drcmitsuba.plan import Plan, notes, photon_notes, plan
from drcmitsuba.plan.forecast import Forecast, forecast
from drcmitsuba.runtime import backend, storage
from drcmitsuba.runtime.background import beside
from drcmitsuba.runtime.progress import Progress, Stage, part, silent
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS, EnabledEffects
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.daylight import Daylight, daylight, luminances, save_luminances

if TYPE_CHECKING:
    from drcmitsuba.report.document import Report


@dataclass(frozen=True, repr=False)
class Result:
    """Numbers of an evaluation; shows itself in Jupyter.

    Parameters
    ----------
    metrics : dict
        Content of `metrics.json`.
    illuminance : xr.Dataset
        E[time, sensor] as on disk [lx].
    by_state : Coefficients
        C of all states of the façade [sr].
    daylight : Daylight
        Sky and suns, from which L follows.
    plan : dict
        Content of `plan.json`.
    enabled_effects : EnabledEffects
        Effects that were simulated.
    """

    case: Case
    metrics: dict[str, Any]
    illuminance: xr.Dataset
    by_state: Coefficients
    daylight: Daylight
    plan: dict[str, Any]
    enabled_effects: EnabledEffects = ALL_EFFECTS

    @cached_property
    def coefficients(self) -> xr.Dataset:
        """C[state, sensor, bin] as on disk [sr]."""
        return self.by_state.joined()

    @property
    def sky(self) -> xr.Dataset:
        """L[time, bin] as on disk [cd/m²]; large where many time stamps have their own suns."""
        L = luminances(self.daylight)
        channels = self.illuminance.get("channel")
        return L if channels is None else L.assign(L=L["L"].expand_dims(channel=channels))

    def save(self, folder: str | Path, stage: Stage = silent) -> Result:
        """Write all results and plots to a folder, each file whole or not at all.

        Parameters
        ----------
        folder : str or Path
        stage : callable, optional

        Returns
        -------
        Result
            The same result, with the seconds and bytes of writing in `metrics` and `plan`.
        """
        folder = Path(folder)
        start = time.perf_counter()
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("metrics.json", "plan.json"):  # without them, arrays are no result
            (folder / name).unlink(missing_ok=True)
        E, C = self.illuminance, self.by_state
        with stage("writing") as done:
            with beside(
                lambda: storage.save_netcdf(E, folder / "illuminance.nc"),
                lambda: storage.save_zarr(C.parts(), folder / "coefficients.zarr", along="state"),
                lambda: save_luminances(self.daylight, folder / "sky.zarr", E.get("channel")),
            ):
                pictures = self._save_pictures(folder, part(done, 0.0, 0.9))
            elapsed = round(time.perf_counter() - start, 3)
            seconds = self.metrics["seconds"] | {"writing": elapsed}
            metrics = self.metrics | {"seconds": seconds, "peak_memory_bytes": peak_memory()}
            storage.save_json(metrics, folder / "metrics.json")
            data = ("illuminance.nc", "coefficients.zarr", "sky.zarr", "metrics.json")
            disk = sum(_bytes(folder / name) for name in (*data, *pictures))
            cost = _with_actual(self.plan["cost"], metrics, {"disk_bytes": disk})
            saved = replace(self, metrics=metrics, plan=self.plan | {"cost": cost})
            storage.save_json(saved.plan, folder / "plan.json")
        return saved

    def report(self) -> Report:
        """Report of this result, which shows itself in Jupyter and has `save(path)`.

        Returns
        -------
        Report
            Verdicts on standards, plans, months, hours: one page of HTML.
        """
        from drcmitsuba.report.document import Facade, Report

        return Report([Facade.of_result(self, self.metrics, self.plan)])

    def _save_pictures(self, folder: Path, progress: Progress) -> list[str]:
        """Draw the plots, remove those of an earlier evaluation, and return the file names."""
        drawn = {}
        if self.enabled_effects.pictures:
            from drcmitsuba.report import figures, plots

            drawn = figures.pictures(self.case, self.illuminance, self.metrics)
            for i, (name, figure) in enumerate(drawn.items(), start=1):
                plots.save(figure, folder / name)
                progress(i / len(drawn))
        for old in [*folder.glob("*_plan.png"), folder / "monthly.png"]:
            if old.name not in drawn:
                old.unlink(missing_ok=True)
        return list(drawn)

    def __repr__(self) -> str:
        E = self.illuminance
        numbers = ", ".join(f"{name} {_text(self.metrics[name])}" for name in ("sDA", "ASE"))
        size = f"{E.sizes['time']} time stamps × {E.sizes['sensor']} sensors"
        return f"<Result of {self.case.name!r}: {numbers}; {size}>"

    def _repr_html_(self) -> str:
        """Table of the metrics with their 95 % intervals, and the months as a picture."""
        from html import escape

        from drcmitsuba.report import figures, plots

        figure = figures.monthly(self.case, self.illuminance, self.metrics)
        rows = "".join(
            f"<tr><th>{name.replace('_', ' ')}</th><td>{_text(self.metrics[name])}</td></tr>"
            for name in ("sDA", "ASE", "shade_closed")
        )
        remarks = "".join(f"<p>{escape(n)}</p>" for n in self.metrics["settings"]["notes"])
        image = plots.html_image(figure, "metrics by month")
        head = f"<caption>{escape(self.case.name)}, 95 % intervals</caption>"
        return f"<table>{head}{rows}</table>{image}{remarks}"


def _text(number: Mapping[str, float]) -> str:
    """Write a metric and its interval [%]."""
    return f"{number['value']:.1f} % ({number['low']:.1f} … {number['high']:.1f})"


def _bytes(path: Path) -> int:
    """Size of a file, or of all files in a folder."""
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())


def _with_actual(
    cost: Mapping[str, Any], metrics: Mapping[str, Any], more: Mapping[str, Any]
) -> dict[str, Any]:
    """Entry `cost` of a plan, with the actual cost beside the forecast; `more`: rays, bytes."""
    actual = {
        **cost.get("actual", {}),
        "seconds": round(sum(metrics["seconds"].values()), 3),
        "memory_bytes": metrics["peak_memory_bytes"],
        **more,
    }
    reason = f"took {actual['seconds']:.3g} s"
    if "forecast" in cost:
        reason = f"forecast {cost['forecast']['seconds']:.2g} s; {reason}"
    if "rays" in actual:
        reason += f" and {sum(actual['rays'].values())} rays"
    return {**cost, "actual": actual, "reason": reason}


def peak_memory() -> int:
    """Largest memory that the process has held [bytes].

    On Linux `getrusage` also counts the memory of the parent at the start of the process, so the
    process' own status is read there.
    """
    status = Path("/proc/self/status")
    if status.is_file():
        line = re.search(r"^VmHWM:\s*(\d+) kB$", status.read_text(), re.MULTILINE)
        if line is not None:
            return 1024 * int(line[1])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def evaluate(
    case: Case | str | Path, stage: Stage = silent, known: xr.Dataset | None = None,
    blocks: BlockFolder | str | Path | None = None,
) -> Result:  # fmt: skip
    """Evaluate a case: L, C, E and the metrics of its period.

    Parameters
    ----------
    case : Case, str or Path
        Case, TOML file, or name of a shipped case.
    stage : callable, optional
        Function that shows the stages of the work, as the command line does.
    known : xr.Dataset, optional
        C of this case for another weather, as on disk [sr]; its bins are not computed again.
    blocks : BlockFolder, str or Path, optional
        Folder that keeps C for further runs: a path is a cache, in which all suns are simulated in
        all states, so that no other weather, threshold or schedule traces them again.

    Returns
    -------
    Result

    Raises
    ------
    InputError
        The weather, the period, a material, a sensor or the cache is unfit.
    BackendError
        No fit LLVM or GPU.
    """
    if not isinstance(case, Case):
        case = load_case(case)
    backend.select()
    blocks = BlockFolder.cache(blocks) if isinstance(blocks, str | Path) else blocks
    run = replace(Run.of(case), stage=stage, blocks=blocks)
    with run.timed("sky"):
        sensor_points(case)  # refuses unfit sensors before the work begins
        remarks = notes(case)  # reads the films' files, which may be unfit
        light = daylight(case.with_dark_hours() if run.shares_blocks else case)
        planned = plan(case, light)
        run = replace(run, enabled_effects=planned.scope)
        is_kept = known is not None or simulation.is_kept(planned.simulated, light, run)
    expected = None
    if not is_kept:  # known coefficients cost nothing
        with run.timed("forecast"):
            expected = forecast(planned)
    by_state = None if known is None else Coefficients.of(known)
    coefficients, direct = simulation.simulate(case, light, run, by_state)
    with run.timed("accumulation and metrics"):
        evaluated = evaluate_metrics(case, light, coefficients, direct)
    outcome = None
    if case.accuracy.target is not None:
        coefficients, evaluated, outcome = toward_target(
            planned.simulated, light, coefficients, evaluated, run
        )
    if blocks is not None:
        remarks += blocks.notes
        if blocks.is_shared:
            blocks.prune()
    return summed_up(planned, coefficients, evaluated, run, remarks, outcome, expected)


def summed_up(
    planned: Plan, coefficients: Coefficients, evaluated: EvaluatedMetrics, run: Run,
    remarks: list[str], outcome: SamplingOutcome | None = None, expected: Forecast | None = None,
) -> Result:  # fmt: skip
    """Put the parts of an evaluation together, with settings, notes and cost.

    `remarks` are the notes on films and shade; a case with a target has an `outcome`.
    """
    case, light = planned.facts.case, planned.facts.light
    settings = settings_of_case(case, light)
    metrics = {
        **evaluated.metrics,
        "settings": {
            **settings,
            "variant": backend.select(),
            "notes": [
                *light.notes, *remarks, *planned.notes(), *photon_notes(coefficients.attrs)
            ],
        },
        **({} if outcome is None else {"accuracy": asdict(outcome)}),
        "seconds": dict(run.seconds),
        "peak_memory_bytes": peak_memory(),
    }  # fmt: skip
    effects = planned.to_dict(coefficients.attrs)
    if expected is None:
        effects["cost"] = {"on": True, "reason": "no forecast"}
    else:
        effects = expected.beside(effects)
    rays = {"rays": dict(run.ray_counter)} if run.ray_counter else {}
    effects = effects | {"cost": _with_actual(effects["cost"], metrics, rays)}
    E = evaluated.illuminance
    return Result(case, metrics, E, coefficients, light, effects, run.enabled_effects)
