"""More samples until the intervals are as narrow as the target of the case.

Samples are added in rounds, each a simulation of its own with another seed. Replicate r of a round
is averaged into replicate r of the coefficients C: the replicates stay independent and as many, so
that their scatter still gives the error. With a target of sDA and ASE, later rounds simulate only
the sensors that are too close to call, and the suns of the hours in doubt there; with one of every
sensor, only the sensors that are wider.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.annual import simulation
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.sample_accumulator import SampleAccumulator
from drcmitsuba.case.accuracy import AT_SENSORS
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, VARYING, State
from drcmitsuba.metrics import illuminance
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.evaluate_metrics import EvaluatedMetrics, draw_shade, evaluate_metrics
from drcmitsuba.metrics.intervals import t_factor
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.random_streams import Stream, case_seed
from drcmitsuba.runtime.time_limit import TimeLimit
from drcmitsuba.schema import by_luminance
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.luminances import sources
from drcmitsuba.transport.sun_interpolation import mesh_of

ROUNDS_AT_ONCE = 8
"""Largest number of rounds between two looks at the intervals."""


@dataclass(frozen=True)
class SamplingOutcome:
    """Outcome of the sampling toward a target.

    Parameters
    ----------
    target : str
        Target of the case, such as "1 point".
    half_width : float
        Half the width of the widest interval, in the target's unit.
    reached : bool
        Whether the widest interval is as narrow as the target.
    rounds : int
        Number of rounds, the first one included.
    reason : str
        Reason why the sampling ended.
    """

    target: str
    half_width: float
    reached: bool
    rounds: int
    reason: str


@dataclass
class _Sampling:
    """Coefficients of all states while rounds are added to them."""

    case: Case
    daylight: Daylight
    run: Run
    first: Coefficients
    states: dict[State, SampleAccumulator]

    @property
    def coefficients(self) -> Coefficients:
        """Coefficients of all rounds so far."""
        states = {state: samples.coefficients for state, samples in self.states.items()}
        return Coefficients(states.pop(OPEN), states).assign_attrs(**self.first.attrs)

    def transport(
        self, state: State, labels: Iterable[str], run: Run, **options: Any
    ) -> xr.Dataset:
        """Simulate some suns in a state, on the mesh of the first round."""
        mesh = mesh_of(self.states.get(state, self.states[OPEN]).coefficients)
        return simulation.transport(
            self.case, state, self.daylight.suns.only(labels), self.daylight.sky.attrs["latitude"],
            run=run, mesh=mesh, **options,
        )  # fmt: skip

    def add_round(
        self, number: int, evaluated: EvaluatedMetrics, sensors: np.ndarray, hours: np.ndarray
    ) -> None:
        """Add a round of some sensors and of the suns of some time stamps."""
        run = replace(self.run, seed=case_seed(self.case.accuracy.seed, Stream.ROUNDS, number))
        for state, samples in self.states.items():
            at = hours
            if state != OPEN:
                if (possible := evaluated.draws.possible.get(state)) is None:
                    continue  # no draw of the rounds so far takes it any more
                at = hours[possible[hours]]
            labels = sources(self.daylight.sky.isel(time=at))
            more = self.transport(state, labels, run, sensors=sensors)
            samples.add(more, sensors)

    def evaluate(self) -> EvaluatedMetrics:
        """Evaluate the metrics; first simulate the states of hours that may newly take them."""
        attributes, light = self.first.attrs, self.daylight
        direct = illuminance.direct_sun(self.coefficients, light.every.sky)
        shade = None
        if attributes["has_shade"]:
            shade = draw_shade(self.case, light.step_hours, direct, attributes)
            for state, hours in shade.closures.others.items():
                self._extend(state, hours)
        if light.year is not None:
            direct = direct.isel(time=light.rows)
            shade = None if shade is None else shade.at(light.rows)
        return evaluate_metrics(self.case, light, self.coefficients, direct, shade)

    def _extend(self, state: State, hours: np.ndarray) -> None:
        """Simulate the suns of some of all hours, bool (time,), that a state lacks."""
        if state == VARYING:
            got = "a target, with more states than are simulated one by one"
            raise InputError(self.case.source, "accuracy.target", got, "leave it out")
        labels = self.daylight.suns.only(sources(self.daylight.every.sky.isel(time=hours))).labels
        samples = self.states.get(state)
        if samples is None:
            if hours.any():
                self.states[state] = SampleAccumulator(self.transport(state, labels, self.run))
            return
        missing = samples.missing(labels, "sun" if "sun" in samples.coefficients.dims else "bin")
        if missing:
            samples.extend(self.transport(state, missing, self.run))


def toward_target(
    case: Case, daylight: Daylight, coefficients: Coefficients, evaluated: EvaluatedMetrics,
    run: Run,
) -> tuple[Coefficients, EvaluatedMetrics, SamplingOutcome]:  # fmt: skip
    """Add rounds until the case's target or its limit of time is reached.

    Starts from the first round, `simulation.simulate`, and its metrics; the case has an
    `accuracy.sensor_goal`. Returns the mean of all rounds, its metrics, and the outcome.
    """
    target = case.accuracy.sensor_goal
    assert target is not None
    limit = TimeLimit(case.accuracy.time_limit)
    first = rounds = int(coefficients.attrs.get("rounds", 1))
    sampling = None
    with run.timed(f"toward {target}") as done:
        while (width := _half_width(evaluated, case)) > target.value and not limit.is_over:
            done((target.value / width) ** 2)
            if sampling is None:
                states = {s: SampleAccumulator(C) for s, C in coefficients.states.items()}
                sampling = _Sampling(case, daylight, run, coefficients, states)
            sensors, hours = _worth_more(evaluated, case)
            # The error falls with the root of the rounds; look again when they have doubled.
            missing = math.ceil((rounds - first + 1) * ((width / target.value) ** 2 - 1))
            for _ in range(min(missing, rounds - first + 1, ROUNDS_AT_ONCE)):
                if limit.is_over:
                    break
                sampling.add_round(rounds, evaluated, sensors, hours)
                rounds += 1
            evaluated = sampling.evaluate()
    if sampling is not None:
        coefficients = sampling.coefficients.assign_attrs(rounds=rounds)
    reached = width <= target.value
    reason = "target reached" if reached else f"limit of {limit.seconds:g} s reached"
    return coefficients, evaluated, SamplingOutcome(str(target), width, reached, rounds, reason)


def of_hours(E: np.ndarray, error: np.ndarray, replicates: int) -> np.ndarray:
    """Half a 95 % interval of the illuminance of an hour over it [%], shape (sensor,).

    The root mean square of all hours, weighted by the illuminance; 0 where it is dark.

    Parameters
    ----------
    E, error : np.ndarray, shape (time, sensor)
        Illuminance and its standard error [lx].
    replicates : int
        Number of replicates that the error comes from.
    """
    noise, light = ((v.astype(float) ** 2).sum(axis=0) for v in (error, E))
    share = np.sqrt(noise / np.where(light > 0, light, 1)) * (light > 0)
    return np.asarray(100 * t_factor(replicates) * share)


def _at_sensors(evaluated: EvaluatedMetrics, case: Case) -> np.ndarray:
    E = evaluated.illuminance
    E = by_luminance(E) if "channel" in E["total"].dims else E
    total, error = (E[v].transpose("time", "sensor").values for v in ("total", "total_se"))
    return of_hours(total, error, case.accuracy.replicates)


def _half_width(evaluated: EvaluatedMetrics, case: Case) -> float:
    """Half the width of the widest interval, in the target's unit."""
    assert case.accuracy.goal is not None
    if case.accuracy.goal.unit == AT_SENSORS:
        return float(_at_sensors(evaluated, case).max(initial=0))
    return evaluated.half_width(case.accuracy.goal.unit)


def _worth_more(evaluated: EvaluatedMetrics, case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the sensors and of the time stamps that need more samples."""
    E, draws, target = evaluated.illuminance, evaluated.draws, case.accuracy.goal
    assert target is not None
    sensors, hours = np.arange(E.sizes["sensor"]), np.arange(E.sizes["time"])
    if target.unit == AT_SENSORS:
        return np.flatnonzero(_at_sensors(evaluated, case) > target.value), hours
    if target.unit == "%":
        return sensors, hours
    some = np.union1d(*(draws.undecided(metric) for metric in ("sDA", "ASE")))
    at = np.flatnonzero(draws.hours["sDA"] + draws.hours["ASE"])
    return (some, at) if len(some) and len(at) else (sensors, hours)
