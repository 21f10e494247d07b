r"""Who lights a point: C and the year's light of sensors by window, state, source and bounces.

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
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.annual.attributes import settings
from drcmitsuba.annual.result import Result
from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, SHADED, GroupStates, State
from drcmitsuba.case.reading import load_case
from drcmitsuba.metrics.stored_arrays import open_dataset
from drcmitsuba.plan import Plan, plan
from drcmitsuba.report.lights import of_period
from drcmitsuba.runtime import backend, storage
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress, Stage, part, silent
from drcmitsuba.scene import scene
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.panes_in_state import grouped_panes
from drcmitsuba.scene.sensors import sensor_coordinates, sensor_points
from drcmitsuba.schema import LUMINANCE_WEIGHTS, describe
from drcmitsuba.sky.daylight import Daylight, daylight
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.light_paths import by_window_and_bounce
from drcmitsuba.transport.window_deposit import Window

SOURCES = ("ground", "sky", "sun")
MOST_POINTS = 24
"""Largest number of points."""
MOST_STATES = 4
"""Largest number of states of the façade, those of the most hours."""
MOST_WINDOWS = 12
"""Largest number of windows that are told apart by their materials, too."""
NEAR = 1.0
"""Largest distance from a point to its nearest sensor [m]."""


@dataclass(frozen=True, repr=False)
class Lights:
    """Light of chosen points by where it comes from; shows itself in Jupyter.

    Parameters
    ----------
    dataset : xr.Dataset
        `by_window` and `by_window_se`: C (state, window, bounces, sensor, bin) [sr]; their sum over
        windows and bounces is C. `exposure` (state, window, source, bounces, sensor) [lx h]: light
        of the time stamps at which the façade is in the state; `hours` (state,) [h]: how long that
        is. `direction` (bin, axis) and `solid_angle` (bin,) [sr] of the bins. The coordinate
        `sensor` is the number of the sensor.
    """

    dataset: xr.Dataset

    @property
    def shares(self) -> xr.DataArray:
        """Share in the light of a point (window, source, bounces, sensor) [–].

        The states count by their hours in an evaluation; without one only the first state counts.
        """
        light = of_period(self.dataset)
        return light / light.sum(["window", "source", "bounces"])

    def figure(self, sensor: int | None = None) -> Any:
        """Draw where the light of a sensor, by default the first one, comes from.

        Returns
        -------
        matplotlib.figure.Figure
            Light of the year by window, source and bounces; the sky as the point sees it by each
            window, straight and after bounces, with the suns of the year as dots.
        """
        from drcmitsuba.report.sky_dome import who_lights

        known = self.dataset["sensor"].values.tolist()
        sensor = known[0] if sensor is None else sensor
        if sensor not in known:
            got = f"no sensor {sensor}"
            raise InputError("lights", "sensor", got, f"choose one of {known}")
        return who_lights(self.dataset.sel(sensor=sensor))

    def save(self, folder: str | Path) -> list[Path]:
        """Write `lights.nc` and a picture of every point to a folder, and return their paths."""
        from drcmitsuba.report import plots

        folder = Path(folder)
        storage.save_netcdf(self.dataset, folder / "lights.nc")
        for old in folder.glob("lights_*.png"):
            old.unlink()
        sensors = self.dataset["sensor"].values.tolist()
        pictures = [plots.save(self.figure(s), folder / f"lights_{s}.png") for s in sensors]
        return [folder / "lights.nc", *pictures]

    def __repr__(self) -> str:
        sizes = self.dataset.sizes
        return (
            f"<Lights of {self.dataset.attrs['case']!r}: {sizes['sensor']} points, "
            f"{sizes['window']} windows, {sizes['state']} states, {sizes['bin']} bins>"
        )

    def _repr_html_(self) -> str:
        """Pictures of the first points."""
        from drcmitsuba.report import plots

        sensors = self.dataset["sensor"].values.tolist()[:3]
        images = [plots.html_image(self.figure(s), f"who lights sensor {s}") for s in sensors]
        return "".join(images)


def lights(
    case: Case | str | Path, points: Sequence[Sequence[float]], *,
    results: Result | str | Path | None = None, stage: Stage = silent,
) -> Lights:  # fmt: skip
    """Find out who lights points: by which window, from which source, after how many bounces.

    Parameters
    ----------
    case : Case, str or Path
        Case, TOML file, or name of a shipped case.
    points : sequence of (x, y) or (x, y, z)
        Points [m]; the sensor nearest to each is taken.
    results : Result, str or Path, optional
        Evaluation of this case, or its folder: the states of its façade count hour by hour. By
        default every state counts all the time.
    stage : callable, optional
        Function that shows the stages of the work.

    Returns
    -------
    Lights

    Raises
    ------
    InputError
        A point far from all sensors, too many points, or results of another case.
    """
    case = case if isinstance(case, Case) else load_case(case)
    backend.select()
    run = replace(Run.of(case), stage=stage)
    with run.timed("sky"):
        sensors = nearest_sensors(case, points)
        light = daylight(case)
        planned = plan(case, light)
        hours = _hours(planned, light, results)
    run = replace(run, enabled_effects=replace(planned.scope, solved_cells=False))
    suns = _suns(light.sky, case.outside.sun_diameter)
    parts = []
    with run.timed("who lights the points") as done:
        for i, state in enumerate(hours):
            share = part(done, i / len(hours), (i + 1) / len(hours))
            parts.append(_coefficients(planned.simulated, state, suns, sensors, run, share))
    C = _by_state(parts, [*hours])
    at = sensor_coordinates(case).isel(sensor=sensors)
    C = C.assign_coords(at.coords).assign_coords(sensor=sensors)
    within = np.stack([*hours.values()])
    C = C.assign_coords(source=np.array(SOURCES, object))
    C["hours"] = ("state", within.sum(axis=1) * light.step_hours)
    C["exposure"] = _exposure(C["by_window"], light, suns, within)
    patches, disk = Patches(case.sky.subdivision), disk_solid_angle(suns.diameter)
    C["direction"] = (("bin", "axis"), np.concatenate([patches.directions, suns.directions]))
    C["solid_angle"] = ("bin", np.append(patches.solid_angles, np.full(len(suns.labels), disk)))
    C.attrs = {
        "case": case.name, "by_evaluation": int(results is not None),
        "subdivision": case.sky.subdivision,
        "settings": json.dumps(settings(case, light), ensure_ascii=False),
    }  # fmt: skip
    return Lights(describe(C))


def nearest_sensors(case: Case, points: Sequence[Sequence[float]]) -> list[int]:
    """Numbers of the sensors nearest to points (x, y) or (x, y, z) [m], each once.

    Raises
    ------
    InputError
        No point, too many of them, or one that is far from all sensors.
    """
    known = sensor_coordinates(case)
    at, chosen = np.stack([known[axis].values for axis in "xyz"], axis=1), []
    if not 0 < len(points) <= MOST_POINTS:
        got = f"{len(points)} points"
        raise InputError(case.source, "points", got, f"give 1 to {MOST_POINTS} of them")
    for point in points:
        if len(point) not in (2, 3) or not np.isfinite(point).all():
            got = ", ".join(f"{v:g}" for v in point)
            raise InputError(case.source, "points", got, "give x,y or x,y,z in metres")
        away = np.linalg.norm(at[:, : len(point)] - point, axis=1)
        sensor = int(away.argmin())
        if away[sensor] > NEAR:
            near = ", ".join(f"{v:g}" for v in at[sensor].round(3))
            got = f"no sensor within {NEAR:g} m of {', '.join(f'{v:g}' for v in point)}"
            raise InputError(case.source, "points", got, f"the nearest one is at {near}")
        chosen.append(sensor)
    return [*dict.fromkeys(chosen)]


def _hours(
    planned: Plan, light: Daylight, results: Result | str | Path | None
) -> dict[State, np.ndarray]:
    """Whether the façade is in each state at each time stamp, bool (time,), by state."""
    always = np.ones(light.sky.sizes["time"], bool)
    if results is None:
        has_shade = planned.scope.shade and len(PaneGroups.of(planned.simulated)) > 0
        return dict.fromkeys((OPEN, SHADED) if has_shade else (OPEN,), always)
    if isinstance(results, Result):
        E, path = results.illuminance, Path("results")
    else:
        path = Path(results) / "illuminance.nc"
        E = open_dataset(path, "time")
    case = planned.facts.case
    if E.attrs.get("settings") != json.dumps(settings(case, light), ensure_ascii=False):
        got = f"the results are not of {case.source}, or of another version of it"
        raise InputError(path, "settings", got, "evaluate the case again, or name another folder")
    if not E.attrs.get("has_shade", 0):
        return {OPEN: always}
    groups = GroupStates.of_attributes(E.attrs)
    name = "facade_state" if "facade_state" in E.coords else "shade_closed"
    indices = np.asarray(E[name].values).reshape(len(always), len(groups)).astype(int)
    rows, of_row, count = np.unique(indices, axis=0, return_inverse=True, return_counts=True)
    most = np.argsort(-count, kind="stable")[:MOST_STATES]
    return {groups.label(rows[i]): of_row.ravel() == i for i in most.tolist()}


def _suns(sky: xr.Dataset, diameter: float) -> Suns:
    """Suns of the time stamps themselves, whatever suns stand for them in the case."""
    labels = sky["sun_bin"].values.astype(object)
    up = np.flatnonzero(labels != "")
    return Suns(tuple(map(str, labels[up])), sky["sun_direction"].values[up], diameter)


def _windows(case: Case) -> list[Window]:
    """Windows of a case: its `[groups]`, or the panes of each material and direction.

    Of more than `MOST_WINDOWS` all panes of a direction are one.
    """
    groups = PaneGroups.of_windows(case)
    names = [*groups.states.names]
    if len(names) > MOST_WINDOWS:
        names = [", ".join(facings) for facings in groups.facings]
    quads: dict[str, list[np.ndarray]] = {name: [] for name in names}
    for panes in grouped_panes(case, groups=groups):
        quads[names[panes.group]].append(panes.quads)
    return [Window(name, np.concatenate(mine)) for name, mine in quads.items() if mine]


def _coefficients(
    case: Case, state: State, suns: Suns, sensors: list[int], run: Run, progress: Progress
) -> xr.Dataset:
    """C by window and bounces in a state of the façade, by luminance [sr]."""
    points, normals = (a[sensors] for a in sensor_points(case))
    accuracy = case.accuracy.model_copy(update={"seed": run.seed})
    effects, windows = run.enabled_effects, _windows(case)
    channels = scene.channels_of(case, effects)
    weights = LUMINANCE_WEIGHTS.values() if len(channels) > 1 else (1.0,)
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
