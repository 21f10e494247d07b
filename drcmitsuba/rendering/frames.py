"""Frames of a view, whose façade has one state, or follows the control of the case."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np

from drcmitsuba.annual.applied_states import applied_states
from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import APPLIED, OPEN, State
from drcmitsuba.case.reading import load_case
from drcmitsuba.case.weather import PeriodTable
from drcmitsuba.plan import plan
from drcmitsuba.rendering.pixel_paths import Sampling
from drcmitsuba.rendering.prepared_view import prepare
from drcmitsuba.rendering.rendering import Rendering, Source
from drcmitsuba.rendering.rounds import PictureTarget, toward
from drcmitsuba.rendering.view_facade import ViewFacade
from drcmitsuba.rendering.view_of_case import COLUMNS, Instant, Size, instant_of
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Stage, silent
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.sky.daylight import Daylight, daylight
from drcmitsuba.sky.luminances import at_rows

TIME_LIMIT = 60.0
"""Time for further rounds toward a target of pictures, unless another is given [s]."""


def frames(
    case: Case | str | Path, view: str | None, times: Iterable[Instant], *,
    size: Size = COLUMNS, sampling: Sampling | None = None, state: State = OPEN,
    states: Sequence[State] = (), source: Source = "all", target: str | None = None,
    time_limit: float = TIME_LIMIT, folder: str | Path | None = None, stage: Stage = silent,
) -> Iterator[Rendering]:  # fmt: skip
    """Render a view of a case at some instants, state of the façade by state.

    Light paths are traced once for all states, or for the one that occurs. Where states have
    surfaces of their own, they are traced for every state that occurs, and those of one state are
    in memory at a time.

    Parameters
    ----------
    times : iterable of str, np.datetime64 or datetime
        Local standard times, such as "03-21 10:30".
    state : str
        State of the façade, or `applied`: at each time the one that the shade takes in its hour.
    states : sequence of str, optional
        States that are shown later from the same folder: light paths are traced for all.
    source : {"all", "sky", "sun"}
        Light that is shown, as for `PreparedView.at`.
    target : str, optional
        Largest `Rendering.half_width` of every picture, such as "2 %", toward which further rounds
        of the same numbers of rays are averaged. A note says what each picture reached.
    time_limit : float
        Time for further rounds of all pictures [s]; no round begins after it.
    case, view, size, sampling, folder, stage
        As for `prepare`.

    Yields
    ------
    Rendering
        One for each time, those of one state after another.

    Raises
    ------
    InputError
        As `prepare`; a time is no instant of the weather; the state is `applied`, and the case has
        no shade; or the target or its time is unfit.

    Examples
    --------
    >>> from drcmitsuba import rendering
    >>> times = ("03-20 10:00", "03-20 15:00")
    >>> shown = list(rendering.frames("desk.toml", "desk", times, size=16))
    >>> [frame.picture.luminance.shape for frame in shown]
    [(16, 16), (16, 16)]
    """
    if not isinstance(case, Case):
        case = load_case(case)
    backend.select()
    goal = None if target is None else PictureTarget.parse(target, time_limit)
    if isinstance(times, str | np.datetime64 | datetime):
        raise InputError("picture", "times", str(times), "give a list of times")
    instants = [*map(instant_of, times)]
    by_time = [state] * len(instants)
    if state == APPLIED:
        by_time = states_at(case, np.array(instants), stage)
    shown = sorted(zip(instants, by_time, strict=True), key=lambda each: by_time.index(each[1]))
    for mine in _together(case, shown):
        first = mine[0][1]
        prepared = prepare(
            case, view, size=size, sampling=sampling, state=first, states=(*states, *by_time),
            folder=folder, stage=stage,
        )  # fmt: skip
        with stage("pictures" if len(mine) == len(shown) else f"pictures, {first}") as done:
            if goal is None:
                for i, (instant, one) in enumerate(mine, 1):
                    rendering = prepared.at(instant, source, one)
                    done(i / len(mine))
                    yield rendering
            else:
                own = replace(goal, seconds=goal.seconds * len(mine) / len(shown))
                there = None if folder is None else Path(folder)
                yield from toward(own, prepared, mine, source, there, done)
        del prepared  # before the light paths of the next state


def _together(
    case: Case, shown: Sequence[tuple[np.datetime64, State]]
) -> Iterator[Sequence[tuple[np.datetime64, State]]]:
    """Instants, each with its state, that share light paths."""
    if shown and ViewFacade.of(case, OPEN).panes is not None:
        yield shown
        return
    for state in dict.fromkeys(one for _, one in shown):
        yield [each for each in shown if each[1] == state]


def render(
    case: Case | str | Path, view: str | None = None, time: Instant = "03-21 12:00", *,
    size: Size = COLUMNS, sampling: Sampling | None = None, state: State = OPEN,
    source: Source = "all", target: str | None = None, time_limit: float = TIME_LIMIT,
    stage: Stage = silent,
) -> Rendering:  # fmt: skip
    """Render a view of a case at an instant, in cd/m².

    Parameters
    ----------
    time : str, np.datetime64 or datetime
        Local standard time, such as "03-21 10:30".
    case, view, size, sampling, state, source, target, time_limit, stage
        As for `frames`, which serves many instants.

    Returns
    -------
    Rendering

    Raises
    ------
    InputError
        As `frames`.

    Examples
    --------
    >>> import drcmitsuba
    >>> shown = drcmitsuba.render("desk.toml", "desk", "03-20 12:00", size=16)
    >>> shown.picture.luminance.shape
    (16, 16)
    """
    (one,) = frames(
        case, view, [time], size=size, sampling=sampling, state=state, source=source,
        target=target, time_limit=time_limit, stage=stage,
    )  # fmt: skip
    return one


def states_at(case: Case, instants: np.ndarray, stage: Stage = silent) -> list[State]:
    """State of the façade that the control of a case takes in the hours of some instants.

    Parameters
    ----------
    case : Case
    instants : np.ndarray of datetime64, shape (time,)
        Local standard time of the nominal year.
    stage : callable, optional
        Shows the stages of the work.

    Returns
    -------
    list of str
        State at each instant: as `evaluate` has it, also in hours outside of the case's period.

    Raises
    ------
    InputError
        The case has no shade, or an instant is not in the weather.
    """
    groups = prepared(case).groups.states
    if not len(groups):
        remedy = f"add [shading] or [groups] to the case, or give another state than {APPLIED}"
        raise InputError(case.source, "shading", "none", remedy)
    backend.select()
    light, row = _hours_of(case, instants)
    run = replace(Run.of(case, plan(case, light).scope), stage=stage)
    applied = applied_states(case, light, run)
    if applied is None:
        return [OPEN] * len(instants)
    return [groups.label(states) for states in applied.taken.of_group[row].tolist()]


def _hours_of(case: Case, instants: np.ndarray) -> tuple[Daylight, np.ndarray]:
    """Daylight of the hours in which instants lie, and the row of each instant in it.

    Time stamps of a case's own are instants, not hours: its control decides at the instants.
    """
    asked = daylight(case, instants)
    if case.period.timestamps is not None:
        return asked, np.arange(len(instants))
    year = daylight(case.with_tables(period=PeriodTable().of_year()))
    hours = np.searchsorted(year.sky["time"].values, instants, side="right") - 1
    rows, row = np.unique(hours, return_inverse=True)
    return at_rows(year, rows), row
