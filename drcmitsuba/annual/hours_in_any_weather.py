"""Hours at which the façade may take each state under any weather of a place."""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, State
from drcmitsuba.metrics import illuminance
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.evaluate_metrics import draw_shade
from drcmitsuba.metrics.facade_states import ShadeRule, most_states, sunlit
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky.daylight import Daylight

BRIGHTEST = 1.3e5
"""Largest direct normal illuminance of any weather [lx]: that of the sun in space."""


def hours_in_any_weather(
    case: Case, daylight: Daylight, coefficients: Coefficients, marked: dict[str, Any]
) -> dict[State, np.ndarray]:
    """Time stamps (time,) at which the façade may take each state, however bright the sun is.

    Under a brighter sun one shade closes in more hours. Of several groups any may close through
    which the brightest sun comes, each with or without the others.
    """
    radius = math.radians(case.outside.sun_diameter / 2)
    brightest = BRIGHTEST / (math.pi * math.sin(radius) ** 2)  # [cd/m²]
    sky = daylight.sky.assign(sun=xr.full_like(daylight.sky["sun"], brightest))
    direct = illuminance.direct_sun(coefficients, sky)
    rule = ShadeRule.of(marked)
    assert rule is not None
    if len(rule.groups) == 1:
        return draw_shade(case, daylight.step_hours, direct, marked).closures.others
    is_lit = (sunlit(direct, rule) > 0).any(axis=1) | (rule.area == 0)
    may_close = is_lit & rule.by_rule
    taken: dict[State, np.ndarray] = {}
    ways = [(False, True) if may else (False,) for may in np.any(may_close, axis=0)]
    for closes in product(*ways):
        hours = (may_close | ~np.array(closes)).all(axis=1)
        if not hours.any():
            continue
        indices = rule.indices(np.tile(closes, (len(hours), 1)), direct["time"])
        for state in np.unique(indices[hours], axis=0):
            label = rule.groups.label(state)
            if label != OPEN:
                taken[label] = hours & (indices == state).all(axis=1)
        if len(taken) > most_states(rule.groups):
            got = "too many states of the façade for any weather"
            raise InputError(case.source, "groups", got, "evaluate the case with its weather")
    return taken
