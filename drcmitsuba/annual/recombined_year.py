"""Any façade of known elements: E of its states, metrics, and C where it is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import xarray as xr

from drcmitsuba.annual.chosen_facade import ChosenFacade
from drcmitsuba.annual.result import Result, summed_up
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.simulated_year import SimulatedYear, simulated_year, taken_states
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, VARYING, State
from drcmitsuba.case.sun import Adaptive, TrueSun
from drcmitsuba.metrics import accumulate, illuminance
from drcmitsuba.metrics.coefficients_by_state import Coefficients, LaterCoefficients
from drcmitsuba.metrics.evaluate_metrics import evaluate_metrics
from drcmitsuba.metrics.facade_states import FacadeStates
from drcmitsuba.metrics.later_arrays import LaterArrays
from drcmitsuba.plan import Plan
from drcmitsuba.runtime.progress import silent
from drcmitsuba.runtime.threads import one_blas_thread
from drcmitsuba.schema import describe
from drcmitsuba.sky.daylight import Daylight

SOURCES = ("total", "sky", "sun")
"""Names of the light that `metrics.accumulate.by_source` tells apart."""
BY_MOST_HOURS = (
    "choice: a sun of this model stands for several hours: direct sun, ASE and MSE are those of "
    "the fill that most of them have; with true suns each hour has its own"
)
"""Note on fills that are chosen by the hour."""
ENDS = ("", "_se")
"""Endings of the names of a quantity and of its standard error."""


def recombined(
    facade: ChosenFacade, planned: Plan, daylight: Daylight, run: Run, remarks: Sequence[str],
    stage: str = "accumulation and metrics",
) -> Result:  # fmt: skip
    """Evaluate a façade of known elements: E, metrics and their intervals, without tracing.

    Parameters
    ----------
    facade : ChosenFacade
        Façade whose `light`, where it is known, is that of the daylight.
    planned : Plan
        Plan of the case whose rules the metrics follow.
    daylight : Daylight
    run : Run
    remarks : sequence of str
        Notes on the films and the shade.
    stage : str
        Name of the only stage, which the run shows.
    """
    case = planned.facts.case
    if not facade.moving.groups:
        case = case.with_tables(shading=None, groups={})
    with one_blas_thread():
        with run.timed(stage):
            year, coefficients = recombined_year(facade, case, daylight, run)
            is_known = "illuminance" in year.coefficients.open
            light = year.daylight.times() if is_known else year.daylight
            evaluated = evaluate_metrics(case, light, year.coefficients, year.direct, year.shade)
        notes = [*remarks, *case.colour.notes_without_bands]
        if facade.sky is not None and not isinstance(case.sun, TrueSun | Adaptive):
            notes.append(BY_MOST_HOURS)
        result = summed_up(planned.summed(always=True), coefficients, evaluated, run, notes)
    E = with_open_state(result.illuminance, facade, year.daylight)
    return replace(result, illuminance=E, daylight=year.daylight)


def recombined_year(
    facade: ChosenFacade, case: Case, daylight: Daylight, run: Run
) -> tuple[SimulatedYear, Coefficients]:
    """E of the states that a façade of known elements takes, and its C, which is made later.

    Parameters
    ----------
    facade : ChosenFacade
        Façade whose `light`, where it is known, is that of the daylight.
    case, daylight, run
        As for `simulated_year`.

    Returns
    -------
    SimulatedYear
        Its `coefficients` hold `illuminance` in place of C in all states, where light is known.
    Coefficients
        C of these states, as from `simulated_year`.
    """
    marked = facade.attributes
    light = facade.light
    if light is None or case.effects.dark_hours == "all":
        year = simulated_year(facade, case, daylight, run, marked)
        return year, year.coefficients
    sun = Coefficients(facade.straight(light.suns).assign_attrs(marked))
    if marked["has_shade"]:
        taken = taken_states(case, daylight, sun)
        daylight, (direct, shade) = taken.daylight, taken.of_case()
    else:
        direct, shade = illuminance.direct_sun(sun, daylight.sky), None
    others = dict[State, xr.Dataset]()
    for state, hours in ({} if shade is None else shade.closures.others).items():
        if state == VARYING:
            others[state] = facade.year(daylight, FacadeStates.of(marked, direct).of_group)
        else:
            others[state] = facade.known(daylight, state, np.flatnonzero(hours))
    opens = None if shade is None else np.flatnonzero(shade.closures.possible[0])
    known = Coefficients(facade.known(daylight, OPEN, opens), others)
    later = LaterCoefficients(marked, partial(_coefficients, facade, case, daylight, run))
    return SimulatedYear(known, direct, shade, daylight), later


def _coefficients(facade: ChosenFacade, case: Case, daylight: Daylight, run: Run) -> Coefficients:
    """C of the states that a façade takes."""
    quiet = replace(run, stage=silent, seconds={})
    with one_blas_thread():  # as an evaluation has it: sums are made in the same order
        return simulated_year(facade, case, daylight, quiet, facade.attributes).coefficients


def with_open_state(E: xr.Dataset, facade: ChosenFacade, daylight: Daylight) -> xr.Dataset:
    """E [lx] with that of all shades open, and of its sources, which are made when asked for.

    Fills that are chosen by the hour stand for what is drawn: they are no shades.
    """
    if facade.sky is not None:
        groups = facade.moving.states
        closed = groups.share_closed(FacadeStates.of(facade.attributes, E).of_group) > 0
        E = E.assign_coords(shade_closed=E["shade_closed"].copy(data=closed))
    elif "total_open" in E:
        return E

    names = [f"{name}_open{end}" for name in SOURCES for end in ENDS]
    arrays = LaterArrays(partial(_open_state, facade, daylight))
    later = arrays.variables(names, E["total"].variable)
    first = ["direct_sun", "direct_sun_se"]  # as `metrics.accumulate.illuminance` has them
    own = {name: E[name].variable for name in E.data_vars if name not in later}
    every = {name: own.pop(name) for name in first} | later | own
    return describe(xr.Dataset(every, E.coords, E.attrs))


def _open_state(facade: ChosenFacade, daylight: Daylight) -> xr.Dataset:
    """E with all shades open, by source [lx], named as `with_open_state` has it."""
    states = facade.moving.drawn_at(daylight.sky["time"])
    rows, row = np.unique(states, axis=0, return_inverse=True)
    order, some = np.argsort(row.ravel(), kind="stable"), []
    with one_blas_thread():
        for k, indices in enumerate(rows):
            sky, C = daylight.sky.isel(time=row.ravel() == k), facade.replicates(indices)
            some.append(illuminance.by_channel(accumulate.by_source, C, sky))
    parts = xr.concat(some, "time").isel(time=np.argsort(order)) if len(some) > 1 else some[0]
    return parts.rename({name + end: f"{name}_open{end}" for name in SOURCES for end in ENDS})
