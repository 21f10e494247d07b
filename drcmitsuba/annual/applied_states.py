"""State that the shade takes at each time stamp, by the direct sun alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import xarray as xr

from drcmitsuba.annual.attributes import attributes
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.simulation import transport
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN
from drcmitsuba.metrics import illuminance
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.evaluate_metrics import draw_shade
from drcmitsuba.metrics.facade_states import FacadeStates
from drcmitsuba.metrics.intervals.facade_draws import Closures
from drcmitsuba.sky.daylight import Daylight


class AppliedStates(NamedTuple):
    """State of the façade at every time stamp, and in the draws of the direct sun."""

    taken: FacadeStates
    closures: Closures


def applied_states(case: Case, light: Daylight, run: Run) -> AppliedStates | None:
    """State of the façade at every time stamp: by the rule of the shade, or by schedules.

    The shade closes by direct sun on the sensors: nothing else is simulated.

    Parameters
    ----------
    case : Case
    light : Daylight
    run : Run
        Its effects say whether the shade may close.

    Returns
    -------
    AppliedStates or None
        None where no group of panes may change its state.

    Raises
    ------
    InputError
        A sensor or a schedule is unfit.
    """
    marked = attributes(case, light, run.enabled_effects)
    if not marked["has_shade"]:
        return None
    with run.timed("sun on the sensors") as done:
        C = transport(
            case, OPEN, light.suns, light.sky.attrs["latitude"], progress=done,
            run=replace(run, enabled_effects=run.enabled_effects.only_sun(case.sun)),
        )  # fmt: skip
    direct = illuminance.direct_sun(Coefficients(C.assign_attrs(marked)), light.sky)
    return states_by(direct, case, light, marked)


def states_by(
    direct: xr.Dataset, case: Case, light: Daylight, marked: Mapping[str, Any]
) -> AppliedStates:
    """States by the direct sun on the sensors, from `illuminance.direct_sun` [lx].

    `marked` are the attributes of C, with the groups and their rule.
    """
    closures = draw_shade(case, light.step_hours, direct, marked).closures
    return AppliedStates(FacadeStates.of(marked, direct), closures)
