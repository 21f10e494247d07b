"""More samples until the intervals are as narrow as was asked for.

Samples are added in rounds, each a simulation of its own with another seed. Replicate r of a round
is averaged into replicate r of what is known: there stay as many replicates, independent as before,
each of more samples, and so their scatter goes on to tell the error. Rounds after the first aim:
for points of sDA and ASE at the sensors that are too close to call and the hours in doubt there.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
import xarray as xr

from drcmitsuba import simulation
from drcmitsuba.case import Case
from drcmitsuba.judgement import Judgement, judge
from drcmitsuba.light import Daylight, sources
from drcmitsuba.progress import Stage, timed
from drcmitsuba.scene import State
from drcmitsuba.transport.deposit import launch_seed

MOST_AT_ONCE = 8
"""Rounds between two looks at the intervals."""


@dataclass(frozen=True)
class Reached:
    """How far the sampling came.

    Parameters
    ----------
    target : str
    half_width : float
        Half the width of the intervals, in the target's unit.
    reached : bool
    rounds : int
        Of sampling, the first among them.
    reason : str
        Why it ended.
    """

    target: str
    half_width: float
    reached: bool
    rounds: int
    reason: str


class Pool:
    """Coefficients, averaged over the rounds that each of their entries was sampled in."""

    def __init__(self, found: xr.Dataset):
        self.found = found.copy(deep=True)
        self._rounds = {
            kind: np.ones((found.sizes["state"], found.sizes["sensor"], found.sizes[kind]))
            for kind in ("bin", "sun")
            if kind in found.dims
        }

    def add(self, more: xr.Dataset, sensors: np.ndarray) -> None:
        """Average one more round into the entries that it has; NaN marks those it has not."""
        known = list(self.found["state"].values)
        states = np.array([known.index(s) for s in more["state"].values])
        for kind, rounds in self._rounds.items():
            at = {str(label): i for i, label in enumerate(self.found[kind].values)}
            bins = np.array([at[str(label)] for label in more[kind].values], dtype=np.int64)
            where = np.ix_(states, sensors, bins)
            share = 1 / (rounds[where] + 1)
            for name, values in more.data_vars.items():
                if kind not in values.dims:
                    continue
                of_all = [d for d in ("replicate", "channel") if d in values.dims]
                order = [*map(str, of_all), "state", "sensor", kind]
                into = self.found[name].transpose(*order).values
                here = (Ellipsis, *where)
                old, new = into[here], values.transpose(*order).values
                mixed = old + share * (new - old)
                if str(name).endswith("_se"):
                    mixed = np.hypot((1 - share) * old, share * new)
                into[here] = np.where(np.isnan(new), old, mixed)
                if name in ("replicates", "sun_straight"):
                    sampled = ~np.isnan(new).reshape(-1, *share.shape)[0]
            rounds[where] += sampled


def toward_target(
    case: Case, light: Daylight, found: xr.Dataset, now: Judgement, stage: Stage,
    seconds: dict[str, float],
) -> tuple[xr.Dataset, Judgement, Reached]:  # fmt: skip
    """Add rounds until the case's target or its limit of time is reached.

    Parameters
    ----------
    case : Case
        With an `accuracy.target`.
    light : Daylight
    found : xr.Dataset
        From `simulation.coefficients`: the first round.
    now : Judgement
        Of it.
    stage : callable
    seconds : dict
        Takes the seconds of the stage.

    Returns
    -------
    coefficients : xr.Dataset
    judgement : Judgement
        E and metrics of these coefficients.
    reached : Reached
    """
    goal = case.accuracy.goal
    assert goal is not None
    start, rounds, most = time.perf_counter(), 1, case.accuracy.time_limit

    def over() -> bool:
        return time.perf_counter() - start > most

    pool = Pool(found)
    with timed(stage, f"toward {goal}", seconds) as done:
        while (width := now.half_width(goal.unit)) > goal.value and not over():
            done((goal.value / width) ** 2)
            sensors, hours = _worth_more(now, goal.unit)
            # The error falls with the root of the rounds; look again when they have doubled.
            missing = math.ceil(rounds * ((width / goal.value) ** 2 - 1))
            for _ in range(min(missing, rounds, MOST_AT_ONCE)):
                if over():
                    break
                pool.add(_round(case, light, now, pool.found, rounds, sensors, hours), sensors)
                rounds += 1
            now = judge(case, light, pool.found)
    reached = width <= goal.value
    reason = "target reached" if reached else f"limit of {most:g} s reached"
    return pool.found, now, Reached(str(goal), width, reached, rounds, reason)


def _worth_more(now: Judgement, unit: str) -> tuple[np.ndarray, np.ndarray]:
    """Sensors and time stamps that more samples are to be spent on."""
    E = now.illuminance
    everywhere = np.arange(E.sizes["sensor"]), np.arange(E.sizes["time"])
    if unit == "%":
        return everywhere
    sensors = np.union1d(*(now.draws.undecided(metric) for metric in ("sDA", "ASE")))
    hours = np.flatnonzero(now.draws.hours["sDA"] + now.draws.hours["ASE"])
    return (sensors, hours) if len(sensors) and len(hours) else everywhere


def _round(
    case: Case, light: Daylight, now: Judgement, known: xr.Dataset, number: int,
    sensors: np.ndarray, hours: np.ndarray,
) -> xr.Dataset:  # fmt: skip
    """Coefficients of one more round, of some sensors and time stamps."""
    seed = launch_seed(case.accuracy, 8, number) >> 2  # within what a case may name
    again = case.model_copy(update={"accuracy": case.accuracy.model_copy(update={"seed": seed})})
    mesh = simulation.mesh_of(known)
    states: tuple[State, ...] = ("open", "shaded")
    found: dict[str, xr.Dataset] = {}
    for state in states[: known.sizes["state"]]:
        at = hours
        if state == "shaded":  # only known for the hours that may close
            at = hours[now.draws.may_close[hours]]
        suns = light.suns.only(sources(light.sky.isel(time=at)))
        found[state] = simulation.transport(
            again, state, suns, light.sky.attrs["latitude"], mesh=mesh, sensors=sensors
        )
    return simulation.states(found, case)
