"""States that the façade takes in a year, and their light: from the direct sun on the open one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
import xarray as xr

from drcmitsuba.annual.hours_in_any_weather import hours_in_any_weather
from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, VARYING, GroupStates, State
from drcmitsuba.metrics import illuminance
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.evaluate_metrics import draw_shade
from drcmitsuba.metrics.facade_states import FacadeStates
from drcmitsuba.metrics.intervals import ShadeDraws
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress, part
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.luminances import sources


class SimulatedYear(NamedTuple):
    """C of all states of a case, and what decided on them: the last arguments of the metrics."""

    coefficients: Coefficients
    """C [sr]."""
    direct: xr.Dataset
    """Direct sun of the case's time stamps by `illuminance.direct_sun` [lx]."""
    shade: ShadeDraws | None
    """States that may occur by this direct sun; None where something else decided."""
    daylight: Daylight
    """Daylight without the year where C cannot tell E of all its hours."""


class TakenStates(NamedTuple):
    """States that the façade may take at time stamps of a daylight."""

    daylight: Daylight
    direct: xr.Dataset
    shade: ShadeDraws | None
    hours: dict[State, np.ndarray]
    """Mask (time,) of the time stamps that may take each state but the open one."""

    def of_case(self) -> tuple[xr.Dataset, ShadeDraws | None]:
        """Direct sun and draws of the case's own time stamps."""
        if self.daylight.year is None:
            return self.direct, self.shade
        rows = self.daylight.rows
        return self.direct.isel(time=rows), None if self.shade is None else self.shade.at(rows)


class StateSource(Protocol):
    """Where light in a state of the façade comes from: traced anew, or recombined."""

    def state(self, state: State, labels: np.ndarray | None, progress: Progress) -> xr.Dataset:
        """C [sr] of a state of the case's groups for all suns, or for some by their labels."""

    def year(self, daylight: Daylight, indices: np.ndarray, progress: Progress) -> xr.Dataset:
        """`illuminance` [lx] by each replicate with the groups in the states (time, group)."""


def simulated_year(
    source: StateSource, case: Case, daylight: Daylight, run: Run, marked: Mapping[str, Any],
    needed: Callable[[xr.Dataset], dict[State, np.ndarray]] | None = None,
) -> SimulatedYear:  # fmt: skip
    """Get the open state from a source, and the states that the façade then may take.

    Parameters
    ----------
    case : Case
        Case as it is simulated.
    marked : mapping
        Attributes of C, with the groups and their rule.
    needed : callable, optional
        Turns direct sun into a mask (time,) of the hours for each state but the open one, where
        these are not the hours in which the rule and the schedules may ask for it.
    daylight, run
        As for `simulation.simulate`.
    """
    with run.timed("open façade") as done:
        C = source.state(OPEN, None, done)
    coefficients = Coefficients(C.assign_attrs(marked))
    if not marked["has_shade"]:
        direct = illuminance.direct_sun(coefficients, daylight.sky)
        return SimulatedYear(coefficients, direct, None, daylight)
    taken = taken_states(case, daylight, coefficients, needed)
    daylight = taken.daylight
    groups, every = GroupStates.of_attributes(marked), daylight.every
    if run.enabled_effects.every_shade and VARYING not in taken.hours:
        taken.hours[groups.label(groups.last)] = np.ones(every.sky.sizes["time"], bool)
    states_of = {state: hours for state, hours in taken.hours.items() if hours.any()}
    others = dict[State, xr.Dataset]()
    if VARYING in states_of:
        indices = FacadeStates.of(marked, taken.direct).of_group
        with run.timed("groups of panes") as done:
            others[VARYING] = source.year(daylight, indices, done)
    elif states_of:
        with run.timed("shaded façade") as done:
            for i, (state, hours) in enumerate(states_of.items()):
                share = part(done, i / len(states_of), (i + 1) / len(states_of))
                some = sources(every.sky.isel(time=hours))
                others[state] = source.state(state, some, share)
    run.forget_paths()
    return SimulatedYear(Coefficients(coefficients.open, others), *taken.of_case(), daylight)


def taken_states(
    case: Case, daylight: Daylight, coefficients: Coefficients,
    needed: Callable[[xr.Dataset], dict[State, np.ndarray]] | None = None,
) -> TakenStates:  # fmt: skip
    """States that the façade may take in every hour of a daylight; `needed` as for `simulate`.

    Of `coefficients` only the straight light of the open state is looked at.

    Where the states of a year are too many to be simulated one by one, those of the case's own
    time stamps alone are.
    """
    if daylight.year is not None:
        try:
            of_year = taken_states(case, daylight.year, coefficients, needed)
        except InputError:  # too many for any weather
            of_year = None
        if of_year is None or VARYING in of_year.hours:
            return taken_states(case, daylight.alone(), coefficients, needed)
        return of_year._replace(daylight=daylight)
    marked = coefficients.attrs
    direct = illuminance.direct_sun(coefficients, daylight.sky)
    if needed is not None:
        return TakenStates(daylight, direct, None, needed(direct))
    if case.effects.dark_hours == "all":  # another weather may let suns shine that do not here
        hours = hours_in_any_weather(case, daylight, coefficients, marked)
        return TakenStates(daylight, direct, None, hours)
    shade = draw_shade(case, daylight.step_hours, direct, marked)
    return TakenStates(daylight, direct, shade, shade.closures.others)
