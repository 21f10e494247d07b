r"""Light of sensors by window, source and bounces, in the states of a case's time stamps.

.. math:: H_{s,w,k} = \sum_{t \in s} \sum_b C_{s,w,k,b} L_{t,b} \, \Delta t \quad [\mathrm{lx\,h}]

with the time stamps t at which the façade is in the state s.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.annual.attributes import settings_text
from drcmitsuba.annual.result import Result
from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, SHADED, GroupStates, State
from drcmitsuba.metrics.stored_arrays import open_dataset
from drcmitsuba.plan import Plan, plan
from drcmitsuba.report.lights import MOST_STATES
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress, Stage, part
from drcmitsuba.scene import scene
from drcmitsuba.scene.panes_in_state import grouped_panes
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.schema import channel_weights
from drcmitsuba.sky.daylight import Daylight, daylight
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.windows.deposit import WindowPanes
from drcmitsuba.transport.windows.light_paths import by_window_and_bounce, most_points

SOURCES = ("ground", "sky", "sun")
BLOCK = 128
"""Largest number of sensors whose coefficients are held at once where all are asked for."""
MOST_WINDOWS = 12
"""Largest number of windows that are told apart by their materials, too."""


@dataclass(frozen=True)
class LightTracing:
    """States of a case's façade by time stamp, and the suns of these: what light is traced for."""

    case: Case
    simulated: Case
    """The case without the effects that its plan leaves out."""
    light: Daylight
    hours: dict[State, np.ndarray]
    """Whether the façade is in each state at each time stamp, bool (time,), by state."""
    suns: Suns
    """Suns of the time stamps themselves, whatever suns stand for them in the case."""
    run: Run
    by_evaluation: bool
    """Whether the states are those of an evaluation; without one every state is there always."""

    @classmethod
    def of(cls, case: Case, results: Result | str | Path | None, stage: Stage) -> LightTracing:
        """Compute the sky of a case, plan it, and read the states of its results.

        Raises
        ------
        InputError
            The results are of another case.
        """
        backend.select()
        run = replace(Run.of(case), stage=stage)
        with run.timed("sky"):
            light = daylight(case)
            planned = plan(case, light)
            hours = _hours(planned, light, results)
        run = replace(run, enabled_effects=replace(planned.scope, solved_cells=False))
        suns = _suns(light.sky, case.outside.sun_diameter)
        return cls(case, planned.simulated, light, hours, suns, run, results is not None)

    def coefficients(self, sensors: Sequence[int], progress: Progress) -> xr.Dataset:
        """C by window and its standard error (state, window, bounces, sensor, bin) [sr].

        The sensors are given and labelled by their numbers.
        """
        parts = []
        for i, state in enumerate(self.hours):
            share = part(progress, i / len(self.hours), (i + 1) / len(self.hours))
            parts.append(
                _coefficients(self.simulated, state, self.suns, [*sensors], self.run, share)
            )
        C = _by_state(parts, [*self.hours])
        at = prepared(self.case).receivers.coordinates.isel(sensor=[*sensors])
        return C.assign_coords(at.coords).assign_coords(
            sensor=[*sensors], source=np.array(SOURCES, object)
        )

    @property
    def block(self) -> int:
        """Number of sensors whose coefficients are held at once where all are asked for."""
        names = len(_windows(self.simulated)) + len(self.simulated.components) + 2
        bins = self.light.sky.sizes["bin"] + len(self.suns.labels)
        replicates = self.run.accuracy(self.case, BLOCK).replicates
        return max(1, min(BLOCK, most_points(names, bins, replicates)))

    def exposure(self, C: xr.DataArray) -> xr.DataArray:
        """Light exposure (state, window, source, bounces, sensor) [lx h] by coefficients."""
        dims, values = _exposure(C, self.light, self.suns, self._within)
        coords = {dim: C[dim] for dim in dims if dim in C.coords}
        return xr.DataArray(values, {**coords, "source": np.array(SOURCES, object)}, dims)

    @property
    def state_hours(self) -> np.ndarray:
        """Time for which the façade is in each state [h], shape (state,)."""
        return self._within.sum(axis=1) * self.light.step_hours

    @property
    def attributes(self) -> dict[str, Any]:
        """Origin of the light as attributes of a file."""
        case, light = self.case, self.light
        return {
            "case": case.name, "by_evaluation": int(self.by_evaluation),
            "settings": settings_text(case, light),
            "notes": json.dumps(light.notes, ensure_ascii=False),
            "hours_left_out": float((~self._within.any(axis=0)).sum() * light.step_hours),
            **{name: light.sky.attrs[name] for name in ("latitude", "longitude")},
        }  # fmt: skip

    @property
    def _within(self) -> np.ndarray:
        return np.stack([*self.hours.values()])


def _hours(
    planned: Plan, light: Daylight, results: Result | str | Path | None
) -> dict[State, np.ndarray]:
    """Whether the façade is in each state at each time stamp, bool (time,), by state."""
    always = np.ones(light.sky.sizes["time"], bool)
    if results is None:
        has_shade = planned.scope.shade and len(prepared(planned.simulated).groups) > 0
        return dict.fromkeys((OPEN, SHADED) if has_shade else (OPEN,), always)
    if isinstance(results, Result):
        E, path = results.illuminance, Path("results")
    else:
        path = Path(results) / "illuminance.nc"
        E = open_dataset(path, "time")
    case = planned.facts.case
    if E.attrs.get("settings") != settings_text(case, light):
        got = f"the results are not of {case.source}: of another version of it or its files, "
        got += "of some of its spaces, or of a choice of fills"
        raise InputError(path, "settings", got, "evaluate the case again, or name another folder")
    if not E.attrs.get("has_shade", 0):
        return {OPEN: always}
    groups = prepared(case).groups.states
    indices = _own_states(path, E, groups)
    rows, of_row, count = np.unique(indices, axis=0, return_inverse=True, return_counts=True)
    most = np.argsort(-count, kind="stable")[:MOST_STATES]
    return {groups.label(rows[i]): of_row.ravel() == i for i in most.tolist()}


def _own_states(path: Path, E: xr.Dataset, groups: GroupStates) -> np.ndarray:
    """States of a case's groups at every time stamp of an evaluation, int, (time, group).

    The evaluation may know panes of no group as a further one of one state.
    """
    known = GroupStates.of_attributes(E.attrs)
    of_known = dict(zip(known.names, known.states, strict=True))
    of_own = dict(zip(groups.names, groups.states, strict=True))
    moving = {name: states for name, states in of_known.items() if len(states) > 1}
    if other := [name for name, states in moving.items() if states != of_own.get(name)]:
        got = f"other states of panes than the case's: {', '.join(sorted(other))}"
        raise InputError(path, "groups", got, "evaluate the case itself")
    name = "facade_state" if "facade_state" in E.coords else "shade_closed"
    of_time = np.asarray(E[name].values).reshape(E.sizes["time"], len(known)).astype(int)
    indices = np.zeros((len(of_time), len(groups)), int)
    for g, group in enumerate(groups.names):
        if group in of_known:
            indices[:, g] = of_time[:, known.names.index(group)]
    return indices


def _suns(sky: xr.Dataset, diameter: float) -> Suns:
    """Suns of the time stamps themselves, whatever suns stand for them in the case."""
    labels = sky["sun_bin"].values.astype(object)
    up = np.flatnonzero(labels != "")
    return Suns(tuple(map(str, labels[up])), sky["sun_direction"].values[up], diameter)


def _windows(case: Case) -> list[WindowPanes]:
    """Windows of a case: its `[groups]`, or the panes of each material and direction.

    Of more than `MOST_WINDOWS` all panes of a direction are one.
    """
    groups = prepared(case).windows
    names = [*groups.states.names]
    if len(names) > MOST_WINDOWS:
        names = [", ".join(facings) for facings in groups.facings]
    quads: dict[str, list[np.ndarray]] = {name: [] for name in names}
    for panes in grouped_panes(case, groups=groups):
        quads[names[panes.group]].append(panes.quads)
    return [WindowPanes(name, np.concatenate(mine)) for name, mine in quads.items() if mine]


def _coefficients(
    case: Case, state: State, suns: Suns, sensors: list[int], run: Run, progress: Progress
) -> xr.Dataset:
    """C by window and bounces in a state of the façade, by luminance [sr]."""
    points, normals = prepared(case).receivers.at(sensors)
    accuracy = run.accuracy(case, len(points))
    effects, windows = run.enabled_effects, _windows(case)
    channels = scene.channels_of(case, effects)
    weights = channel_weights(len(channels))
    of_channels = [
        weight * by_window_and_bounce(
            scene.load(case, state, channel, effects), points, normals, suns, accuracy, windows,
            subdivision=case.sky.subdivision,
            progress=part(progress, i / len(channels), (i + 1) / len(channels)),
        )
        for i, (channel, weight) in enumerate(zip(channels, weights, strict=True))
    ]  # fmt: skip
    with xr.set_options(arithmetic_join="exact"):
        return reduce(lambda a, b: a + b, of_channels)  # errors, too: channels share their paths


def _by_state(parts: list[xr.Dataset], states: list[State]) -> xr.Dataset:
    """Join C of all states; what some states have no light of is 0 there, as between panes."""
    names = list(dict.fromkeys(name for part in parts for name in part["window"].values))
    alike = [part.reindex(window=np.array(names, object), fill_value=0) for part in parts]
    states_dim = xr.DataArray(np.array(states, object), dims="state", name="state")
    return xr.concat(alike, states_dim, join="exact")


def _exposure(
    C: xr.DataArray, light: Daylight, suns: Suns, within: np.ndarray
) -> tuple[tuple[str, ...], np.ndarray]:
    """Light exposure (state, window, source, bounces, sensor) [lx h], of hours (state, time)."""
    L, step = light.sky, light.step_hours
    up = L["sun_bin"].values.astype(str) != ""
    patches = step * (within.astype(np.float32) @ L["sky"].values)
    disks = step * within[:, up] * L["sun"].values[up]
    count = patches.shape[1]
    parts = []
    for bins, values in (
        (slice(0, 1), patches[:, :1]), (slice(1, count), patches[:, 1:]),
        (slice(count, None), disks),
    ):  # fmt: skip
        parts.append(np.einsum("swkpb,sb->swkp", C.values[..., bins], values))
    return ("state", "window", "source", "bounces", "sensor"), np.stack(parts, axis=2)
