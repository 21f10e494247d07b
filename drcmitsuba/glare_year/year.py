r"""A year of glare: DGP of every view at every time stamp, without pictures.

With the vertical illuminance E_v at the eye from the coefficients C, and the luminance L_s, solid
angle ω_s and position index P_s of the glare sources [1]_,

.. math:: DGP = c_1 E_v + c_2 \log_{10}(1 + \sum_s L_s^2 ω_s / (E_v^{1.87} P_s^2)) + c_3 .

Where several groups of panes close, the rays of an eye are traced once for each number of a fill,
and every state of the façade is a sum of what they see and of light by element (`by_element`). What
a ray sees through panes has the luminance of the sky's patch there, a film that of its BSDF, a
surface that of its illuminance. The suns' disks are sources of their own. The replicates of C give
E_v and the surfaces, and with them DGP, an error.

A case with one group, or with none, is simulated state by state (`state`), and so is one whose
light no sum over elements holds.

References
----------
.. [1] J. Wienold, J. Christoffersen, "Evaluation methods and development of a new glare prediction
   model for daylight environments with the use of CCD cameras", Energy and Buildings 38(7), 2006.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from drcmitsuba.annual.applied_states import applied_states
from drcmitsuba.annual.attributes import settings as settings_of_case
from drcmitsuba.annual.run import Run
from drcmitsuba.case.accuracy import AT_SENSORS
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, VARYING, State
from drcmitsuba.case.reading import load_case
from drcmitsuba.case.sun import Adaptive
from drcmitsuba.glare_year import forecast
from drcmitsuba.glare_year.by_element import ElementTracing
from drcmitsuba.glare_year.element_sampler import ElementSampler
from drcmitsuba.glare_year.eye_samples import EyeSamples
from drcmitsuba.glare_year.eyes import Eyes, eyes
from drcmitsuba.glare_year.facades import FacadesOfCase
from drcmitsuba.glare_year.result import GlareYear
from drcmitsuba.glare_year.rounds import (
    IntervalLook,
    Sampler,
    StateSampler,
    of_glare,
    of_illuminance,
    toward,
)
from drcmitsuba.glare_year.rule import Rule
from drcmitsuba.glare_year.state_doubts import StateDoubts
from drcmitsuba.metrics.intervals.facade_draws import DrawnStates
from drcmitsuba.plan import plan
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.progress import Stage, silent
from drcmitsuba.scene.fills import openings_of
from drcmitsuba.scene.geometry import origin
from drcmitsuba.scene.panes_in_state import groups_with_surfaces
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.schema import describe, mean_and_error
from drcmitsuba.sky.daylight import Daylight, daylight
from drcmitsuba.sky.luminances import bright_hours


def glare(
    case: Case | str | Path, points: ArrayLike | None = None, *, rule: Rule | None = None,
    stage: Stage = silent, told: Callable[[float], None] | None = None,
) -> GlareYear:  # fmt: skip
    """Evaluate the glare of every view of a case at every time stamp of its period.

    Parameters
    ----------
    case : Case, str or Path
        Case, TOML file, or name of a shipped case. Its period are the occupied hours, of which
        those with daylight are counted.
    points : array_like, shape (point, 3), optional
        Places of eyes in the coordinates of the case file [m], from each of which eight views look
        round; by default the views of the case.
    rule : Rule, optional
        Threshold of glare sources, constants of DGP; by default those of `evalglare`.
    stage : callable, optional
        Function that shows the stages of the work.
    told : callable, optional
        Takes the forecast of the time of all stages [s], before most of them.

    Returns
    -------
    GlareYear
        DGP by state of the façade, time stamp and view. States are all groups of panes open, all
        in their next state, and so on; with a shade the last one is `applied`, in which each time
        stamp has the state that the shade takes.

    Raises
    ------
    InputError
        There is no view, a view lies in a solid or outside the room, or the case is unfit.
    BackendError
        No fit LLVM or GPU.

    Notes
    -----
    The interval of DGP holds the noise of E_v and, to first order, that of the luminances of bright
    surfaces, `luminance_noise`. Pixels have a size, `pixels.SIDE`, that it does not hold.

    Examples
    --------
    >>> import drcmitsuba
    >>> year = drcmitsuba.glare("desk.toml")
    >>> year.share(0.40).sel(state="open").dims
    ('view',)
    >>> saved = year.save("glare")
    """
    if not isinstance(case, Case):
        case = load_case(case)
    backend.select()
    run, rule = replace(Run.of(case), stage=stage), Rule() if rule is None else rule
    looking = eyes(case, points)
    with run.timed("sky"):
        light = daylight(case)
        planned = plan(case, light, looking.positions)
    run = replace(run, enabled_effects=planned.scope)
    simulated = case if planned.scope.shade else case.with_tables(shading=None, groups={})
    sampler = _sampler(simulated, light, looking, rule, run)
    if told is not None:
        told(forecast.seconds(simulated, sampler.traced(), light, looking, planned.scope))
    if isinstance(sampler, ElementSampler):
        planned = planned.summed(always=True)
    states = sampler.states
    made = partial(rated, case, light, looking, states, rule=rule, run=run, drawn=sampler.drawn)

    def look(samples: list[EyeSamples]) -> IntervalLook:
        assert target is not None
        if target.unit == AT_SENSORS:
            return of_illuminance(samples[: len(states)], target)
        return of_glare(made(samples, ()), target)

    samples, target, notes = sampler.first(), case.accuracy.eye_goal, sampler.notes()
    if target is not None:
        samples, note = toward(target, sampler, samples, look)
        notes = (*notes, note)
    elif case.accuracy.goal is not None:
        got = f'accuracy.target: "{case.accuracy.goal}" is one of an evaluation'
        notes = (*notes, f"{got}; glare adds no rounds toward it")
    return made(samples, (*light.notes, *planned.notes(), *notes))


def _sampler(case: Case, light: Daylight, looking: Eyes, rule: Rule, run: Run) -> Sampler:
    """Way to simulate a case: as a whole, by element, or state by state."""
    groups = prepared(case).groups.states
    if not any(groups.closable):
        return StateSampler(case, light, looking, rule, run, (OPEN,))
    is_sum = not isinstance(case.sun, Adaptive) and not groups_with_surfaces(case)
    if is_sum and len(groups) > 1:  # one group has few states, and leaves out nothing
        panes = openings_of(case)
        facades = FacadesOfCase(case, panes, light, run).of({})
        return ElementSampler(ElementTracing(case, panes, light, run), facades, looking, rule)
    applied = applied_states(case, light, run)
    assert applied is not None
    each, taken = [groups.label(row) for row in groups.in_step], applied.closures
    if VARYING in taken.states:
        note = "glare with the shade applied is left out: its groups take too many states to be "
        note += "simulated one by one, and light of this case is no sum over openings"
        states = tuple(dict.fromkeys(each))
        return StateSampler(case, light, looking, rule, run, states, remarks=(note,))
    states = tuple(dict.fromkeys((*each, *taken.states)))
    place, drawn = np.array([states.index(state) for state in taken.states]), taken.in_draws()
    drawn = drawn._replace(others=place[drawn.others])
    return StateSampler(case, light, looking, rule, run, states, place[taken.state], drawn)


def pseudo_values(rule: Rule, E: np.ndarray, S: np.ndarray, deviations: np.ndarray) -> np.ndarray:
    """DGP by each replicate, as pseudo-values of the jackknife: R · DGP − (R − 1) · DGP without r.

    Their scatter gives the error of DGP from the errors of means, which are smaller than those of
    replicates: a replicate of its own may have a negative sum.
    """
    R = len(E)
    mean = E.mean(axis=0)
    without = rule.dgp(mean - (E - mean) / (R - 1), np.maximum(S - deviations / (R - 1), 0))
    return np.asarray(R * rule.dgp(mean, S) - (R - 1) * without)


def rated(
    case: Case, light: Daylight, looking: Eyes, states: Sequence[State],
    samples: Sequence[EyeSamples], notes: Sequence[str], *, rule: Rule, run: Run,
    drawn: DrawnStates | None = None,
) -> GlareYear:  # fmt: skip
    """DGP of the samples of all states, and what it follows from.

    Samples of `drawn.others` follow those of the states.
    """
    dims = ("state", "time", "view")
    samples, others = samples[: len(states)], samples[len(states) :]
    E, S, sharp, deviations = _stacked(samples, slice(None))
    mean, error = mean_and_error(E)
    replicates = pseudo_values(rule, E, S, deviations).astype(np.float32)
    doubts = None
    if drawn is not None and len(drawn.hours):
        E_others, S_others, _, of_others = _stacked(others, drawn.hours)
        of_draws = pseudo_values(rule, E_others, S_others, of_others).astype(np.float32)
        doubts = StateDoubts(drawn.hours, drawn.drawn, of_draws)
    values: dict[str, Any] = {
        "dgp": rule.dgp(mean, S), "dgp_se": mean_and_error(replicates)[1],
        "illuminance": mean, "illuminance_se": error,
        "contrast": np.log10(1 + S / np.maximum(mean, 1e-9) ** 1.87),
    }  # fmt: skip
    if (sharp > S).any():
        values["dgp_sharp"] = rule.dgp(mean, sharp)
    places = looking.points + origin(case)
    coords: dict[str, Any] = {
        "state": np.array([*states], object), "time": light.sky["time"].values,
        "clock": ("time", light.sky["clock"].values), "view": np.array(looking.names, object),
        "daylight": ("time", bright_hours(light.sky).astype(np.int8)),
    }  # fmt: skip
    if (inside := prepared(case).rooms_of(looking.points)) is not None:
        names = np.array([*(space.name for space in prepared(case).spaces), ""], object)
        coords["space"] = "view", names[inside]
    for axes, columns in (("xyz", places), (("dx", "dy", "dz"), looking.forward)):
        coords |= {axis: ("view", columns[:, k]) for k, axis in enumerate(axes)}
    data = {name: (dims, v.astype(np.float32)) for name, v in values.items()}
    hours = describe(xr.Dataset(data, coords))
    hours.attrs = {"case": case.name, "step_hours": light.step_hours, "weather": light.source}
    settings = {**settings_of_case(case, light), "rule": rule.to_dict(), "seed": run.seed}
    settings["notes"] = [*notes]
    return GlareYear(case, hours, replicates, settings, dict(run.seconds), doubts)


def _stacked(samples: Sequence[EyeSamples], hours: np.ndarray | slice) -> list[np.ndarray]:
    """E_v, sums, sharp sums and deviations of several samples at some hours, by state.

    Shapes ([replicate,] state, hour, view).
    """
    axes = {"illuminance": 1, "sums": 0, "sharp": 0, "deviations": 1}
    return [
        np.stack([getattr(s, name)[..., hours, :] for s in samples], axis)
        for name, axis in axes.items()
    ]
