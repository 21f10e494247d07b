"""A year with lamellae at one tilt: illuminance in all states of the façade, as a search rates it.

The smooth twin of the shade's rule closes groups a little in every hour with direct sun, so all
states are simulated for all of these hours, not only for those in which they may occur.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba.annual import simulation
from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import State
from drcmitsuba.design.facade_groups import FacadeGroups
from drcmitsuba.design.measure import Aim, interval_of_aim
from drcmitsuba.metrics import Interval, accumulate, illuminance
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.evaluate_metrics import draw_shade, evaluate_metrics
from drcmitsuba.metrics.facade_states import sun_group
from drcmitsuba.plan import plan
from drcmitsuba.runtime.progress import Progress, part
from drcmitsuba.schema import by_luminance, luminance
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.transport.elements.state_illuminances import Illuminances


class SimulatedTilt(NamedTuple):
    """A year with the lamellae at one tilt: E [lx], and the 95 % interval of the aim [%].

    Where there is no direct sun, no group closes by the rule, and E of every state is that of the
    groups as their schedules have them.
    """

    E: Illuminances
    aim: Interval


def simulated_tilt(
    case: Case, daylight: Daylight, groups: FacadeGroups | None, aim: Aim, progress: Progress
) -> SimulatedTilt:
    """Simulate the year of a case, which has `groups` of panes, None where nothing closes."""
    last = 1.0 if groups is None else 0.6

    @contextmanager
    def stage(name: str) -> Iterator[Progress]:
        yield part(progress, 0, last) if name == "open façade" else part(progress, last, 1)

    needed = None if groups is None else partial(_needed, case, daylight, groups)
    run = replace(Run.of(case, plan(case, daylight).of_any_facade), stage=stage)
    coefficients, direct, *_ = simulation.simulate(case, daylight, run, needed=needed)
    judged = evaluate_metrics(case, daylight, coefficients, direct)
    year = by_luminance(judged.illuminance)
    is_open, sun = (year[name].values.astype(np.float32) for name in ("total_open", "direct_sun"))
    if groups is None:
        E = Illuminances(*map(_tensor, (is_open, is_open, sun)))
    else:
        hours = _hours(case, daylight, groups, direct)
        states = _in_states(groups, hours, is_open, coefficients, daylight.sky)
        count = len(groups.rule.groups)
        by_group = _by_group(sun, sun_group(direct), count) if count > 1 else ()
        first, closed, *others = map(_tensor, states)
        E = Illuminances(first, closed, _tensor(sun), (*others,), by_group)
    return SimulatedTilt(E, interval_of_aim(judged.metrics, aim))


def _in_states(
    groups: FacadeGroups, hours: np.ndarray, is_open: np.ndarray, coefficients: Coefficients,
    sky: xr.Dataset,
) -> np.ndarray:  # fmt: skip
    """E (state, time, sensor) [lx], from that of the open state and C of the others.

    `hours` (state, time) are those of which C of each state holds the suns.
    """
    E = np.stack([is_open] * len(groups.states))
    for i, state in enumerate(groups.states):
        if i and hours[i].any():
            C, some = coefficients.others[state], sky.isel(time=hours[i])
            by_source = illuminance.by_channel(accumulate.by_source, C, some).map(luminance)
            E[i, hours[i]] = by_source["total"].values
    scheduled = E[groups.by_schedule, np.arange(len(is_open))]
    E[1:] = np.where(hours[1:, :, None], E[1:], scheduled)
    return E


def _by_group(sun: np.ndarray, group: np.ndarray, count: int) -> tuple[mi.TensorXf, ...]:
    """E (time, sensor) [lx] by the straight sun that comes by each group of panes."""
    return tuple(_tensor(np.where(group == g, sun, 0)) for g in range(count))


def _needed(
    case: Case, daylight: Daylight, groups: FacadeGroups, direct: xr.Dataset
) -> dict[State, np.ndarray]:
    """Mask (time,) of each state but the open one, for `simulation.simulate`."""
    hours = _hours(case, daylight, groups, direct)
    return dict(zip(groups.states[1:], hours[1:], strict=True))


def _hours(case: Case, daylight: Daylight, groups: FacadeGroups, direct: xr.Dataset) -> np.ndarray:
    """Mask (state, time): a sensor has direct sun or a group may close, or a schedule asks."""
    rule = groups.rule
    told = rule.groups.attributes() | rule.schedule.attributes()
    drawn = draw_shade(case, daylight.step_hours, direct, told).closures.others
    may_close = np.asarray((luminance(direct["direct_sun"]).values > 0).any(axis=1))
    for state, hours in drawn.items():
        if np.array(rule.groups.indices(state))[rule.by_rule].any():
            may_close = may_close | hours
    return groups.hours(may_close)


def _tensor(values: np.ndarray) -> Any:
    return mi.TensorXf(np.ascontiguousarray(values, np.float32))
