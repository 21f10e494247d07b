"""Coefficients C of all states of a case, from its scene and its suns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.annual.attributes import attributes, fingerprint
from drcmitsuba.annual.pane_group_of_sun import PaneGroupOfSun
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.sample_accumulator import SampleAccumulator
from drcmitsuba.annual.simulated_year import SimulatedYear, simulated_year
from drcmitsuba.annual.summed_year import years_of_states
from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, State
from drcmitsuba.case.sun import Adaptive
from drcmitsuba.metrics import illuminance
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.plan import plan
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress, part
from drcmitsuba.runtime.provenance import METHOD
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.schema import LUMINANCE_WEIGHTS
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute
from drcmitsuba.transport.sun_interpolation import mesh_of, meshed, with_straight


def _scenes(
    case: Case, state: State, run: Run, tint: scene.Tint = scene.untinted
) -> Iterator[scene.Scene]:
    """Yield the scene of every colour channel, and add its rays to the run afterwards."""
    for channel in scene.channels_of(case, run.enabled_effects):
        world = scene.load(case, state, channel, run.enabled_effects, tint=tint)
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
    (points, normals), at = prepared(case).receivers.at(), prepared(case).receivers.coordinates
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
    tint: scene.Tint = scene.untinted, progress: Progress = lambda share: None,
) -> xr.Dataset:  # fmt: skip
    """Coefficients C of any points in a case, in one state of its façade.

    Parameters
    ----------
    points, normals : np.ndarray, shape (point, 3)
        Positions [m] and unit normals in the traced frame, as from `sensor_points`.
    among : int, optional
        Number of all points, where these are some of them: few points take more samples.
    tint : callable
        Gives the materials, see `scene.load`.
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
    rooms = prepared(case).rooms_of(points)
    channels: list[xr.Dataset] = []
    for i, world in enumerate(_scenes(case, state, run, tint)):
        done = part(progress, i / count, (i + 1) / count)
        content = block_content(world, points, normals, accuracy, subdivision, rooms)
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
                rooms=rooms, progress=done,
            )  # fmt: skip
        channels.append(C)
    return joined_channels(channels)


def block_content(
    world: scene.Scene,
    points: np.ndarray,
    normals: np.ndarray,
    accuracy: Accuracy,
    subdivision: int,
    rooms: np.ndarray | None,
) -> tuple[Any, ...]:
    """Everything that C in a scene depends on, but the suns."""
    return world.content, points, normals, accuracy.sampling, subdivision, rooms


def is_kept(case: Case, daylight: Daylight, run: Run) -> bool:
    """Whether C of the open state is stored: a forecast would tell of work that is not done."""
    if run.blocks is None or isinstance(case.sun, Adaptive):
        return False
    (points, normals), effects = prepared(case).receivers.at(), run.enabled_effects
    accuracy = run.accuracy(case, len(points))
    world = scene.load(case, OPEN, scene.channels_of(case, effects)[0], effects)
    rooms = prepared(case).rooms_of(points)
    content = block_content(world, points, normals, accuracy, case.sky.subdivision, rooms)
    return bool(run.kept(case.name, *content, daylight.suns).cover(len(points)))


@dataclass(frozen=True)
class _Traced:
    """States of a case that are traced one by one, or were known before."""

    case: Case
    daylight: Daylight
    run: Run
    known: Mapping[State, xr.Dataset]
    """C of another weather by state."""
    mesh: list[str] = field(default_factory=list)
    """Labels of the mesh of an adaptive sun, once the open state has refined it."""

    def state(self, state: State, labels: np.ndarray | None, progress: Progress) -> xr.Dataset:
        """C of one state; see `StateSource`. Known suns are not simulated again."""
        case, run, suns, known = self.case, self.run, self.daylight.suns, self.known.get(state)
        latitude, mesh = self.daylight.sky.attrs["latitude"], tuple(self.mesh)
        if labels is not None and not run.shares_blocks:  # else any weather may ask for any sun
            suns = suns.only(labels)
        C = _state(case, state, suns, latitude, known, mesh, run, progress)
        if state == OPEN:
            self.mesh[:] = mesh_of(C)
        return C

    def year(self, daylight: Daylight, indices: np.ndarray, progress: Progress) -> xr.Dataset:
        """E of a year; see `StateSource`."""
        self.run.forget_paths()
        every = years_of_states(self.case, daylight, indices, self.run, progress)
        years = [year for _, year in every]
        return years[0] if len(years) == 1 else xr.concat(years, "sensor")


def simulate(
    case: Case, daylight: Daylight, run: Run, known: Coefficients | None = None,
    needed: Callable[[xr.Dataset], dict[State, np.ndarray]] | None = None,
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
        Turns direct sun into a mask (time,) of the hours for each state but the open one, where
        these are not the hours in which the rule and the schedules may ask for it.

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
    marked = attributes(case, daylight, effects)  # reads schedules, which may be unfit
    if not marked["has_shade"]:
        run = replace(run, shared=None)
    traced = _Traced(simulated, daylight, run, {} if known is None else known.states)
    return simulated_year(traced, simulated, daylight, run, marked, needed)


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
    if enabled_effects.suns and not known.attrs.get("suns", 1):
        got = "no sun shone in the weather that they were computed for"
        raise InputError("coefficients", "suns", got, "compute them anew")
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
    points, normals = prepared(case).receivers.at()
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
