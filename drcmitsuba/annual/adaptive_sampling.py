"""More samples until the intervals are as narrow as was asked for.

Samples are added in rounds, each a simulation of its own with another seed. Replicate r of a round
is averaged into replicate r of what is known: there stay as many replicates, independent as before,
each of more samples, and so their scatter goes on to tell the error. Rounds after the first aim:
for points of sDA and ASE at the sensors that are too close to call and the hours in doubt there.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from dataclasses import dataclass

import numpy as np
import xarray as xr

from drcmitsuba.annual import simulation
from drcmitsuba.annual.sample_accumulator import SampleAccumulator, by_state
from drcmitsuba.case.case import Case
from drcmitsuba.metrics.evaluate_metrics import EvaluatedMetrics, evaluate_metrics, may_close
from drcmitsuba.runtime.progress import Stage, timed
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.surfaces import State
from drcmitsuba.sky.daylight import Daylight, sources
from drcmitsuba.transport.sun_interpolation import mesh_of

MOST_AT_ONCE = 8
"""Rounds between two looks at the intervals."""


@dataclass(frozen=True)
class SamplingOutcome:
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


def toward_target(
    case: Case, light: Daylight, found: xr.Dataset, now: EvaluatedMetrics, stage: Stage,
    seconds: dict[str, float], scope: EnabledEffects, rays: Counter[str],
) -> tuple[xr.Dataset, EvaluatedMetrics, SamplingOutcome]:  # fmt: skip
    """Add rounds until the case's target or its limit of time is reached.

    Parameters
    ----------
    case : Case
        With an `accuracy.target`.
    light : Daylight
    found : xr.Dataset
        From `simulation.coefficients`: the first round.
    now : EvaluatedMetrics
        Of it.
    stage : callable
    seconds : dict
        Takes the seconds of the stage.
    scope : EnabledEffects
        What is simulated.
    rays : Counter
        Takes the number of rays by kind.

    Returns
    -------
    coefficients : xr.Dataset
    judgement : EvaluatedMetrics
        E and metrics of these coefficients.
    reached : SamplingOutcome
    """
    goal = case.accuracy.goal
    assert goal is not None
    start, most = time.perf_counter(), case.accuracy.time_limit
    first = rounds = int(found.attrs.get("rounds", 1))

    def over() -> bool:
        return time.perf_counter() - start > most

    pools = by_state(found)
    with timed(stage, f"toward {goal}", seconds) as done:
        while (width := now.half_width(goal.unit)) > goal.value and not over():
            done((goal.value / width) ** 2)
            sensors, hours = _worth_more(now, goal.unit)
            # The error falls with the root of the rounds; look again when they have doubled.
            missing = math.ceil((rounds - first + 1) * ((width / goal.value) ** 2 - 1))
            for _ in range(min(missing, rounds - first + 1, MOST_AT_ONCE)):
                if over():
                    break
                _sample(case, light, now, pools, rounds, sensors, hours, scope, rays)
                rounds += 1
            _close(case, light, pools, scope, rays)
            joined = simulation.states({s: pool.found for s, pool in pools.items()}, case)
            found = joined.assign_attrs({**found.attrs, "rounds": rounds})
            now = evaluate_metrics(case, light, found)
    reached = width <= goal.value
    reason = "target reached" if reached else f"limit of {most:g} s reached"
    return found, now, SamplingOutcome(str(goal), width, reached, rounds, reason)


def _worth_more(now: EvaluatedMetrics, unit: str) -> tuple[np.ndarray, np.ndarray]:
    """Sensors and time stamps that more samples are to be spent on."""
    E = now.illuminance
    everywhere = np.arange(E.sizes["sensor"]), np.arange(E.sizes["time"])
    if unit == "%":
        return everywhere
    sensors = np.union1d(*(now.draws.undecided(metric) for metric in ("sDA", "ASE")))
    hours = np.flatnonzero(now.draws.hours["sDA"] + now.draws.hours["ASE"])
    return (sensors, hours) if len(sensors) and len(hours) else everywhere


def _sample(
    case: Case, light: Daylight, now: EvaluatedMetrics, pools: dict[State, SampleAccumulator],
    number: int,
    sensors: np.ndarray, hours: np.ndarray, scope: EnabledEffects, rays: Counter[str],
) -> None:  # fmt: skip
    """Add one more round, of some sensors and time stamps."""
    seed = launch_seed(case.accuracy.seed, Stream.ROUNDS, number) >> 2  # below a case's limit
    again = case.model_copy(update={"accuracy": case.accuracy.model_copy(update={"seed": seed})})
    for state, pool in pools.items():
        at = hours if state == "open" else hours[now.draws.may_close[hours]]
        suns = light.suns.only(sources(light.sky.isel(time=at)))
        more = simulation.transport(
            again, state, suns, light.sky.attrs["latitude"],
            scope=scope, mesh=mesh_of(pool.found), sensors=sensors, rays=rays,
        )  # fmt: skip
        pool.add(more, sensors)


def _close(
    case: Case,
    light: Daylight,
    pools: dict[State, SampleAccumulator],
    scope: EnabledEffects,
    rays: Counter[str],
) -> None:
    """Find the shaded state of the hours that may close only by what was sampled since."""
    if case.shading is None:
        return
    closing = may_close(case, light, pools["open"].found)
    needed = light.suns.only(sources(light.sky.isel(time=closing)))
    if "shaded" in pools:
        kind = "sun" if "sun" in pools["shaded"].found.dims else "bin"
        needed = needed.only(pools["shaded"].missing(needed.labels, kind))
    if closing.any() and ("shaded" not in pools or needed.labels):
        mesh = mesh_of(pools["open"].found)
        latitude = light.sky.attrs["latitude"]
        more = simulation.transport(
            case, "shaded", needed, latitude, scope=scope, mesh=mesh, rays=rays
        )
        if "shaded" in pools:
            pools["shaded"].extend(more)
        else:
            pools["shaded"] = SampleAccumulator(more)
