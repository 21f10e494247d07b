"""The reference: illuminance with little noise and no bias, for some hours of the year."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import GroupStates
from drcmitsuba.case.sensors import Sensors
from drcmitsuba.metrics.facade_states import ShadeRule
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.schema import luminance

HOURS, MOST_SENSORS = 200, 600
"""Approximate number of time stamps, and largest number of sensors, of the reference."""
FEWEST_ROUNDS, ROUNDS = 4, 16
"""Smallest number of rounds, and number of rounds that the time is divided into at least."""
ENOUGH = 0.5
"""RMS error of the reference [% of the mean E] below which it stops early."""


def some_hours(times: np.ndarray, about: int = HOURS) -> np.ndarray:
    """Positions of every n-th of `times` (time,), spread over the year and the hours of the day.

    n has no factor in common with the number of time stamps in a day: every hour of the day comes.
    """
    _, of_day = np.unique(times.astype("datetime64[D]"), return_counts=True)
    per_day = int(np.median(of_day))
    wanted = max(len(times) / about, 1.0)
    steps = [n for n in range(1, 2 * per_day + int(wanted)) if np.gcd(n, per_day) == 1]
    step = min(steps, key=lambda n: abs(n - wanted))
    return np.arange((step - 1) // 2, len(times), step)


def some_sensors(case: Case, most: int = MOST_SENSORS) -> np.ndarray:
    """Positions in the grid, x fastest, of all sensors, or of every n-th along x and along y.

    Sensors that are no rectangular grid are taken as one row.
    """
    grid = case.sensors
    count = len(prepared(case).receivers)
    nx, ny = grid.count if isinstance(grid, Sensors) else (count, 1)
    if nx * ny != count:  # some were left out
        nx, ny = count, 1
    step = 1
    while -(-nx // step) * -(-ny // step) > most:
        step += 1
    x, y = (np.arange((min(step, n) - 1) // 2, n, step) for n in (nx, ny))
    return (y[:, None] * nx + x).ravel()


def rule_of(case: Case) -> ShadeRule | None:
    """Rule and schedules by which groups of a case change their state; None without groups."""
    groups = prepared(case).groups.states
    if not any(groups.closable):
        return None
    return ShadeRule.of_case(case, groups)


def number_of(groups: GroupStates, indices: np.ndarray) -> np.ndarray:
    """Number of the state of the façade, 0 for the open one, int, (…), from indices (…, group)."""
    sizes = [len(states) for states in groups.states]
    return np.asarray(indices @ np.cumprod([1, *sizes[:-1]]), np.int64)


def number_of_states(case: Case, illuminance: xr.Dataset) -> np.ndarray:
    """Number of the state of the façade at every time stamp of an evaluation, int, (time,)."""
    if "facade_state" not in illuminance:
        return illuminance["shade_closed"].values.astype(np.int64)
    indices = illuminance["facade_state"].transpose("time", "group").values
    return number_of(prepared(case).groups.states, indices.astype(np.int64))


def illuminances(E: xr.Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`total`, `total_open` and `direct_sun` of an evaluation (time, sensor) [lx]."""
    total, total_open, direct = (
        luminance(E[name]).transpose("time", "sensor").values
        for name in ("total", "total_open", "direct_sun")
    )
    return total, total_open, direct


def spread(rounds: list[np.ndarray]) -> float:
    """RMS of the standard error of E, by rounds of (time, sensor) [% of the mean E]."""
    E = np.stack(rounds)
    return 100 * float(np.sqrt(E.var(axis=0, ddof=1).mean() / len(E)) / E.mean())


@dataclass(frozen=True)
class Reference:
    """Illuminance in independent rounds.

    Parameters
    ----------
    times : np.ndarray of datetime64, shape (time,)
    sensors : np.ndarray of int, shape (sensor,)
        Positions in the case's grid.
    is_open, applied : np.ndarray, shape (round, time, sensor)
        E of the rounds, all groups of panes open, and in their states [lx].
    direct_sun : np.ndarray, shape (time, all sensors)
        Direct sun, all groups open [lx].
    state : np.ndarray of int, shape (time,)
        Number of the state of the façade; 0 is the open one.
    method : str
        How it was made, for the reader of the table.
    """

    times: np.ndarray
    sensors: np.ndarray
    is_open: np.ndarray
    applied: np.ndarray
    direct_sun: np.ndarray
    state: np.ndarray
    method: str
    seconds: float

    def both(self, state: np.ndarray) -> np.ndarray:
        """Whether a state (time,) is the reference's own, and not the open one."""
        return (state == self.state) & (state > 0)

    def rounds(self, state: np.ndarray) -> np.ndarray:
        """E (round, time, sensor) [lx]: open, but where the reference is in this state, too."""
        return np.where(self.both(state)[:, None], self.applied, self.is_open)
