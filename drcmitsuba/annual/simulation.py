"""Coefficients C of all states of a case, from its scene and its suns."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from drcmitsuba.annual.attributes import attributes, fingerprint
from drcmitsuba.annual.group_coefficients import years_of_states
from drcmitsuba.annual.hours_in_any_weather import hours_in_any_weather
from drcmitsuba.annual.pane_group_of_sun import PaneGroupOfSun
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.sample_accumulator import SampleAccumulator
from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, SHADED, VARYING, GroupStates, State
from drcmitsuba.case.sun import Adaptive
from drcmitsuba.metrics import illuminance
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.evaluate_metrics import draw_shade
from drcmitsuba.metrics.facade_states import FacadeStates
from drcmitsuba.metrics.intervals import ShadeDraws
from drcmitsuba.plan import plan
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress, part
from drcmitsuba.runtime.provenance import METHOD
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.sensors import sensor_coordinates, sensor_points
from drcmitsuba.schema import LUMINANCE_WEIGHTS
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.luminances import sources
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute
from drcmitsuba.transport.sun_interpolation import mesh_of, meshed, with_straight


def _scenes(case: Case, state: State, run: Run) -> Iterator[scene.Scene]:
    """Yield the scene of every colour channel, and add its rays to the run afterwards."""
    for channel in scene.channels_of(case, run.enabled_effects):
        world = scene.load(case, state, channel, run.enabled_effects)
        yield world
        run.ray_counter.update(world.ray_counter.counted())


def joined_channels(channels: list[xr.Dataset]) -> xr.Dataset:
    """Join channels along the dim `channel`; a grey case has no such dim."""
    if len(channels) == 1:
        return channels[0]
    names = np.array(list(LUMINANCE_WEIGHTS), dtype=object)
    return xr.concat(channels, xr.DataArray(names, dims="channel"))


def transport(
    case: Case, state: State, suns: Suns, latitude: float, *, run: Run | None = None,
    mesh: tuple[str, ...] = (), sensors: np.ndarray | None = None,
    progress: Progress = lambda share: None,
) -> xr.Dataset:  # fmt: skip
    """Coefficients C of a case in one state of its façade.

    Parameters
    ----------
    case : Case
    state : str
        State of the façade, see `case.groups`.
    suns : Suns
        Suns of the time stamps, or suns that stand for them.
    latitude : float
        Latitude [deg north], which only an adaptive sun needs.
    run : Run, optional
        Seed and effects; by default all effects with the case's seed.
    mesh : tuple of str
        Labels of the mesh of an adaptive sun; by default a new mesh is refined.
    sensors : np.ndarray of int, shape (n,), optional
        Indices of the sensors to simulate; by default all.
    progress : callable

    Returns
    -------
    xr.Dataset
        C of `transport.coefficients.compute` [sr], with a dim `channel` where the case is coloured.

    Raises
    ------
    InputError
        A sensor, a material or a component is unfit.
    """
    run = Run.of(case) if run is None else run
    (points, normals), at = sensor_points(case), sensor_coordinates(case)
    among = len(points)
    if sensors is None:
        run.distribute(state, suns, progress)
    else:
        points, normals, at = points[sensors], normals[sensors], at.isel(sensor=sensors)
    C = of_points(
        case, state, suns, latitude, points, normals, run=run, mesh=mesh, among=among,
        progress=progress,
    ).assign_coords(at.coords)  # fmt: skip
    groups = PaneGroupOfSun.of(case, state, suns, run) if sensors is None else None
    return C if groups is None else groups.added(C, points, normals)


def of_points(
    case: Case, state: State, suns: Suns, latitude: float, points: np.ndarray,
    normals: np.ndarray, *, run: Run, mesh: tuple[str, ...] = (), among: int | None = None,
    progress: Progress = lambda share: None,
) -> xr.Dataset:  # fmt: skip
    """Coefficients C of any points in a case, in one state of its façade.

    Parameters
    ----------
    points, normals : np.ndarray, shape (point, 3)
        Positions [m] and unit normals in the traced frame, as from `sensor_points`.
    among : int, optional
        Number of all points, where these are some of them: few points take more samples.
    case, state, suns, latitude, run, mesh, progress
        As for `transport`.

    Returns
    -------
    xr.Dataset
        C of `transport.coefficients.compute` [sr], with a dim `channel` where the case is coloured.
    """
    accuracy = run.accuracy(case, len(points) if among is None else among)
    subdivision = case.sky.subdivision
    count = len(scene.channels_of(case, run.enabled_effects))
    channels: list[xr.Dataset] = []
    for i, world in enumerate(_scenes(case, state, run)):
        done = part(progress, i / count, (i + 1) / count)
        content = block_content(world, points, normals, accuracy, subdivision)
        if isinstance(case.sun, Adaptive):
            nodes = mesh or (mesh_of(channels[0]) if channels else ())
            of_mesh = partial(
                meshed, world, points, normals, suns.diameter, accuracy, latitude=latitude,
                tolerance=case.sun.tolerance, finest=case.sun.finest, subdivision=subdivision,
                known=nodes, progress=done,
            )  # fmt: skip
            about = f"{case.name}, {state}, mesh of suns"
            kept = run.kept(about, *content, case.sun, suns.diameter, latitude, nodes)
            C = with_straight(
                kept.kept(len(points), of_mesh), world, points, normals, suns, accuracy
            )
        else:
            C = compute(
                world, points, normals, suns, accuracy, subdivision=subdivision,
                kept=run.kept(f"{case.name}, {state}", *content, suns), shared=run.shared,
                progress=done,
            )  # fmt: skip
        channels.append(C)
    return joined_channels(channels)


def block_content(
    world: scene.Scene,
    points: np.ndarray,
    normals: np.ndarray,
    accuracy: Accuracy,
    subdivision: int,
) -> tuple[Any, ...]:
    """Everything that C in a scene depends on, but the suns."""
    return world.content, points, normals, accuracy.sampling, subdivision


def is_kept(case: Case, daylight: Daylight, run: Run) -> bool:
    """Whether C of the open state is stored: a forecast would tell of work that is not done."""
    if run.blocks is None or isinstance(case.sun, Adaptive):
        return False
    (points, normals), effects = sensor_points(case), run.enabled_effects
    accuracy = run.accuracy(case, len(points))
    world = scene.load(case, OPEN, scene.channels_of(case, effects)[0], effects)
    content = block_content(world, points, normals, accuracy, case.sky.subdivision)
    return bool(run.kept(case.name, *content, daylight.suns).cover(len(points)))


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


class _Taken(NamedTuple):
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


def simulate(
    case: Case, daylight: Daylight, run: Run, known: Coefficients | None = None,
    needed: Callable[[xr.Dataset], np.ndarray] | None = None,
) -> SimulatedYear:  # fmt: skip
    """Simulate C of all states, each but the open one for the suns of hours that may take it.

    Parameters
    ----------
    case : Case
    daylight : Daylight
    run : Run
    known : Coefficients, optional
        C of this case for another weather [sr]; its bins are not computed again.
    needed : callable, optional
        Turns direct sun into a mask (time,) of the hours whose suns the state `shaded` needs, where
        these are not the hours in which the one shade may close.

    Returns
    -------
    SimulatedYear

    Raises
    ------
    InputError
        The known coefficients belong to another case.
    """
    effects = run.enabled_effects
    simulated = case if effects.shade else case.with_tables(shading=None, groups={})
    if known is not None:
        _refuse_others(known, case, daylight, effects)
    states = {} if known is None else known.states
    suns, latitude = daylight.suns, daylight.sky.attrs["latitude"]
    marked = attributes(case, daylight, effects)  # reads schedules, which may be unfit
    if not marked["has_shade"]:
        run = replace(run, shared=None)
    with run.timed("open façade") as done:
        C = _state(simulated, OPEN, suns, latitude, states.get(OPEN), (), run, done)
    coefficients = Coefficients(C.assign_attrs(marked))
    if not marked["has_shade"]:
        direct = illuminance.direct_sun(coefficients, daylight.sky)
        return SimulatedYear(coefficients, direct, None, daylight)
    taken = _taken(simulated, daylight, coefficients, needed)
    daylight = taken.daylight
    groups, every = GroupStates.of_attributes(marked), daylight.every
    if effects.every_shade and VARYING not in taken.hours:
        taken.hours[groups.label(groups.last)] = np.ones(every.sky.sizes["time"], bool)
    states_of = {state: hours for state, hours in taken.hours.items() if hours.any()}
    mesh, others = mesh_of(C), dict[State, xr.Dataset]()
    if VARYING in states_of:
        run.forget_paths()
        indices = FacadeStates.of(marked, taken.direct).of_group
        others[VARYING] = _varying(simulated, daylight, indices, run)
    elif states_of:
        with run.timed("shaded façade") as done:
            for i, (state, hours) in enumerate(states_of.items()):
                some = suns  # of shared blocks: any weather and rule may ask for any sun
                if not run.shares_blocks:
                    some = suns.only(sources(every.sky.isel(time=hours)))
                share = part(done, i / len(states_of), (i + 1) / len(states_of))
                known_C = states.get(state)
                others[state] = _state(simulated, state, some, latitude, known_C, mesh, run, share)
    run.forget_paths()
    return SimulatedYear(Coefficients(coefficients.open, others), *taken.of_case(), daylight)


def _taken(
    case: Case, daylight: Daylight, coefficients: Coefficients,
    needed: Callable[[xr.Dataset], np.ndarray] | None,
) -> _Taken:  # fmt: skip
    """States that the façade may take in every hour of a daylight; `needed` as for `simulate`.

    Where the states of a year are too many to be simulated one by one, those of the case's own
    time stamps alone are.
    """
    if daylight.year is not None:
        try:
            of_year = _taken(case, daylight.year, coefficients, needed)
        except InputError:  # too many for any weather
            of_year = None
        if of_year is None or VARYING in of_year.hours:
            return _taken(case, daylight.alone(), coefficients, needed)
        return of_year._replace(daylight=daylight)
    marked = coefficients.attrs
    direct = illuminance.direct_sun(coefficients, daylight.sky)
    if needed is not None:
        return _Taken(daylight, direct, None, {SHADED: needed(direct)})
    if case.effects.dark_hours == "all":  # another weather may let suns shine that do not here
        hours = hours_in_any_weather(case, daylight, coefficients, marked)
        return _Taken(daylight, direct, None, hours)
    shade = draw_shade(case, daylight.step_hours, direct, marked)
    return _Taken(daylight, direct, shade, shade.closures.others)


def _varying(case: Case, daylight: Daylight, indices: np.ndarray, run: Run) -> xr.Dataset:
    """`illuminance` (replicate, time, sensor) [lx] of a year in which the façade's state varies."""
    with run.timed("groups of panes") as done:
        years = [year for _, year in years_of_states(case, daylight, indices, run, done)]
    return years[0] if len(years) == 1 else xr.concat(years, "sensor")


def coefficients(case: Case, daylight: Daylight, run: Run | None = None) -> Coefficients:
    """Simulate C of all states [sr], by default with the effects of the case's plan."""
    if run is None:
        run = Run.of(case, plan(case, daylight).scope)
    return simulate(case, daylight, run).coefficients


def _refuse_others(
    known: Coefficients, case: Case, daylight: Daylight, enabled_effects: EnabledEffects
) -> None:
    """Refuse coefficients of another method, or that were computed for another case or place."""
    if (method := known.attrs.get("method")) != METHOD:
        got = "of an older version" if method is None else f"{method}, not {METHOD}"
        raise InputError("coefficients", "method", got, "compute them anew")
    if known.attrs.get("fingerprint") != fingerprint(case, enabled_effects):
        raise InputError(
            "coefficients", "case", "they were computed for another case or accuracy",
            "compute them anew",
        )  # fmt: skip
    names = illuminance.SUN_OF if case.sun.model != "adaptive" else ("latitude",)
    illuminance.check_suns(known.attrs, daylight.sky, names)


def _state(
    case: Case, state: State, suns: Suns, latitude: float, known: xr.Dataset | None,
    mesh: tuple[str, ...], run: Run, progress: Progress,
) -> xr.Dataset:  # fmt: skip
    """C of one state; known suns are not simulated again."""
    if known is None:
        return transport(case, state, suns, latitude, run=run, mesh=mesh, progress=progress)
    if not isinstance(case.sun, Adaptive):
        accumulator = SampleAccumulator(known)
        missing = suns.only(accumulator.missing(suns.labels, "bin"))
        if missing.labels:
            more = transport(case, state, missing, latitude, run=run, progress=progress)
            accumulator.extend(more)
        return accumulator.coefficients
    points, normals = sensor_points(case)
    accuracy = run.accuracy(case, len(points))
    channels = [known.isel(channel=i, drop=True) for i in range(known.sizes.get("channel", 0))]
    C = joined_channels(
        [
            with_straight(C, world, points, normals, suns, accuracy)
            for C, world in zip(channels or [known], _scenes(case, state, run), strict=True)
        ]
    )
    groups = PaneGroupOfSun.of(case, state, suns, run)
    return C if groups is None else groups.added(C, points, normals)
