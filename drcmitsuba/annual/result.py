"""One evaluation, from a case to numbers, files and pictures.

case     ─ daylight ──────────► Daylight: L[time, bin], suns
         ─ plan ──────────────► Plan: enabled effects; forecast: what long work will cost
         ─ simulate(open) ────► C[sensor, bin] of the open state
C · L    ─ direct_sun ────────► direct sun[time, sensor], once: ASE, and hours that may close
         ─ simulate(others) ──► C of the suns of these hours; all states: Coefficients
C · L    ─ illuminance ───────► E[time, sensor], the shade applied     illuminance.nc
E, C     ─ evaluate_metrics ──► draws, metrics with their intervals    metrics.json
E, bands ─ spectral_year ─────► melanopic light and colour, where a case has bands    colour.nc
         ─ toward_target ─────► more rounds of C, E and metrics, where a target asks for them
all      ─ Result.save ───────► coefficients.zarr, sky.zarr, plan.json, pictures
A `Run` accompanies all steps: seed, enabled effects, stages with their seconds, rays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from drcmitsuba.annual import large_result, simulation
from drcmitsuba.annual.adaptive_sampling import SamplingOutcome, toward_target
from drcmitsuba.annual.large_result import LargeResult
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.saved_result import SavedResult, with_record
from drcmitsuba.annual.spectral_year import spectral_year
from drcmitsuba.annual.workers import Workers
from drcmitsuba.blocks.block_folder import BlockFolder
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import VARYING
from drcmitsuba.case.reading import load_case
from drcmitsuba.case.sun import Adaptive
from drcmitsuba.colour.melanopic import melanopic_metrics
from drcmitsuba.controls.space_lights import with_electric_light
from drcmitsuba.metrics.coefficients_by_state import Coefficients, LaterCoefficients
from drcmitsuba.metrics.evaluate_metrics import EvaluatedMetrics, evaluate_metrics
from drcmitsuba.metrics.facade_states import FacadeStates
from drcmitsuba.metrics.spaces import sensors_by_space
from drcmitsuba.plan import Plan, notes, notes_on_sum, plan
from drcmitsuba.plan.forecast import Forecast, forecast, is_short
from drcmitsuba.runtime import backend, storage
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Stage, silent
from drcmitsuba.runtime.threads import one_blas_thread
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS, EnabledEffects
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.sky.daylight import Daylight, daylight_and_year
from drcmitsuba.sky.luminances import luminances, save_luminances, without_year

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from drcmitsuba.report.document import Report


@dataclass(frozen=True, repr=False)
class Result(SavedResult):
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

    Examples
    --------
    >>> import drcmitsuba
    >>> result = drcmitsuba.evaluate("office.toml")
    >>> noon = result.illuminance["total_open"].sel(time="2015-03-20T12:00")
    >>> bool(noon.max() > 100)
    True
    >>> result.coefficients["direct"].dims
    ('state', 'sensor', 'bin')
    >>> saved = result.save("results")
    """

    case: Case
    metrics: dict[str, Any]
    illuminance: xr.Dataset
    by_state: Coefficients
    daylight: Daylight
    plan: dict[str, Any]
    enabled_effects: EnabledEffects = ALL_EFFECTS
    spectral: xr.Dataset | None = None
    """Melanopic light and colour, see `spectral_year`, where the case asks for bands."""

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

    def report(self) -> Report:
        """Report of this result, which shows itself in Jupyter and has `save(path)`.

        Returns
        -------
        Report
            Verdicts on standards, plans, months, hours: one page of HTML.
        """
        from drcmitsuba.report.document import EvaluatedFacade, Report

        return Report([EvaluatedFacade.of_result(self, self.metrics, self.plan)])

    @property
    def described(self) -> xr.Dataset:
        """Array with the time stamps, the sensors and the attributes of E: E itself."""
        return self.illuminance

    def _arrays(self, folder: Path) -> dict[str, Callable[[], None]]:
        E, C, channels = self.illuminance, self.by_state, self.illuminance.get("channel")
        E_file, C_file = folder / "illuminance.nc", folder / "coefficients.zarr"
        of_E = {
            E_file.name: lambda: storage.save_netcdf(E, E_file),
            "sky.zarr": lambda: save_luminances(self.daylight, folder / "sky.zarr", channels),
            **self._spectral(folder / "colour.nc"),
        }
        if isinstance(C, LaterCoefficients) and self.case.output.illuminance != "all":
            return of_E
        return of_E | {
            C_file.name: lambda: storage.save_zarr(C.parts(), C_file, along="state"),
            **self._year(folder / "year.zarr"),  # its E is C times its luminances
        }

    def _year(self, path: Path) -> dict[str, Callable[[], None]]:
        """Function that writes the sky of the year's hours, where these are not all of E's."""
        year = self.daylight.year
        return {} if year is None else {path.name: lambda: storage.save_zarr(year.sky, path)}

    def _spectral(self, path: Path) -> dict[str, Callable[[], None]]:
        """Function that writes melanopic light and colour, where there is any."""
        spectral = self.spectral
        return {} if spectral is None else {path.name: lambda: storage.save_netcdf(spectral, path)}

    def _pictures(self) -> dict[str, Figure]:
        from drcmitsuba.report import figures

        return figures.pictures(self.case, self.illuminance, self.metrics, self.spectral)


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

    Examples
    --------
    >>> import drcmitsuba
    >>> result = drcmitsuba.evaluate("office.toml")
    >>> result.metrics["sDA"]
    {'value': ..., 'low': ..., 'high': ...}
    >>> result.illuminance["total"].dims
    ('time', 'sensor')
    """
    with one_blas_thread():
        return _whole(_BegunEvaluation.of(case, stage, known, blocks), known)


def evaluate_within(
    case: Case | str | Path, stage: Stage = silent, known: xr.Dataset | None = None,
    blocks: BlockFolder | str | Path | None = None, memory: int | None = None,
    workers: Workers | None = None, light: Daylight | None = None,
) -> Result | LargeResult:  # fmt: skip
    """Evaluate a case as `evaluate`, without keeping C and E where they do not fit in memory.

    Parameters
    ----------
    case, stage, known, blocks
        As for `evaluate`.
    memory : int, optional
        Memory that the arrays may take [bytes]; by default three quarters of the machine's.
        `output.illuminance` of the case decides unless it is "auto".
    workers : Workers, optional
        Processes that make the blocks, from `workers.opened`; `blocks` is a folder that all see.
    light : Daylight, optional
        Daylight of the case, with the suns of dark hours where `blocks` is a cache; by default
        computed.

    Returns
    -------
    Result or LargeResult
        The latter where C and E are not kept.

    Raises
    ------
    InputError
        As `evaluate`; metrics alone are asked for beside a target.

    Examples
    --------
    >>> import drcmitsuba
    >>> result = drcmitsuba.evaluate_within("office.toml", memory=8 << 30)
    >>> result.metrics["sDA"]
    {'value': ..., 'low': ..., 'high': ...}
    """
    with one_blas_thread():
        summed = partial(large_result.is_large, memory=memory)
        begun = _BegunEvaluation.of(case, stage, known, blocks, workers, light, summed)
        if known is None and summed(begun.planned):
            case = begun.planned.facts.case
            return large_result.evaluated(
                begun.planned,
                begun.run,
                [*begun.remarks, *case.colour.notes_without_bands],
                begun.expected,
            )
        return _whole(begun, known)


@dataclass(frozen=True)
class _BegunEvaluation:
    """Evaluation before its first ray."""

    planned: Plan
    run: Run
    remarks: list[str]
    """Notes on the films and the shade."""
    expected: Forecast | None
    """Forecast; None where C is known or stored, since it tells of work that is not done, and where
    the work takes only a few times as long as a forecast of it."""

    @classmethod
    def of(
        cls, case: Case | str | Path, stage: Stage, known: xr.Dataset | None,
        blocks: BlockFolder | str | Path | None, workers: Workers | None = None,
        light: Daylight | None = None, summed: Callable[[Plan], bool] = lambda planned: False,
    ) -> _BegunEvaluation:  # fmt: skip
        case = case if isinstance(case, Case) else load_case(case)
        backend.select()
        blocks = BlockFolder.cache(blocks) if isinstance(blocks, str | Path) else blocks
        elsewhere = None
        if workers is not None and not isinstance(case.sun, Adaptive):  # its mesh is one block
            if blocks is None:
                raise InputError("evaluate", "workers", "no folder", "give blocks=…")
            elsewhere = workers.elsewhere(case, blocks, case.accuracy.seed)
        run = replace(Run.of(case), stage=stage, blocks=blocks, elsewhere=elsewhere)
        with run.timed("sky"):
            prepared(case).check()
            remarks = notes(case)  # reads the films' files, which may be unfit
            if light is None:
                light = daylight_and_year(case.with_dark_hours() if run.shares_blocks else case)
            planned = plan(case, light)
            if light.year is not None and not run.shares_blocks and summed(planned):
                planned = plan(case, light := without_year(light))  # verdicts need C and E
            run = replace(run, enabled_effects=planned.scope)
            is_needless = (
                known is not None or is_short(planned)
                or simulation.is_kept(planned.simulated, light, run)  # loads the scene: last
            )  # fmt: skip
        if is_needless:
            return cls(planned, run, remarks, None)
        with run.timed("forecast"):
            return cls(planned, run, remarks, forecast(planned))


def _whole(begun: _BegunEvaluation, known: xr.Dataset | None) -> Result:
    """Evaluate with whole arrays."""
    planned, run = begun.planned, begun.run
    case = planned.facts.case
    by_state = None if known is None else Coefficients.of(known)
    with run.blocks_written_beside():
        coefficients, direct, shade, light = simulation.simulate(
            case, planned.facts.light, run, by_state
        )
        with run.timed("accumulation and metrics"):
            evaluated = evaluate_metrics(case, light, coefficients, direct, shade)
    outcome, is_sum = None, VARYING in coefficients.others
    if case.accuracy.sensor_goal is not None and not is_sum:
        coefficients, evaluated, outcome = toward_target(
            planned.simulated, light, coefficients, evaluated, run
        )
    planned = planned.summed() if is_sum else planned
    remarks, spectral = [*begun.remarks], None
    if is_sum:
        remarks += notes_on_sum(case)
    elif case.colour.wavelengths and planned.effects["colour"].on:
        E = evaluated.illuminance
        taken = FacadeStates.of(coefficients.attrs, E)
        spectral = spectral_year(case, light, E, taken, run)
        numbers = melanopic_metrics(spectral, E, case.colour.melanopic_threshold, light.step_hours)
        evaluated = replace(evaluated, metrics=evaluated.metrics | {"melanopic": numbers})
    result = summed_up(planned, coefficients, evaluated, run, remarks, outcome, begun.expected)
    return replace(result, daylight=light, spectral=spectral)


def summed_up(
    planned: Plan, coefficients: Coefficients, evaluated: EvaluatedMetrics, run: Run,
    remarks: list[str], outcome: SamplingOutcome | None = None, expected: Forecast | None = None,
) -> Result:  # fmt: skip
    """Put the parts of an evaluation together, with settings, notes and cost.

    `remarks` are the notes on films and shade; a case with a target has an `outcome`.
    """
    case, light = planned.facts.case, planned.facts.light
    more = {} if outcome is None else {"accuracy": asdict(outcome)}
    E = evaluated.illuminance
    lit = with_electric_light(
        evaluated.metrics, evaluated.years, sensors_by_space(E), E, light.step_hours
    )
    metrics, effects = with_record(planned, lit | more, coefficients.attrs, run, remarks, expected)
    return Result(case, metrics, E, coefficients, light, effects, run.enabled_effects)
