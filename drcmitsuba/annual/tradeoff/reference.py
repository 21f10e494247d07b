"""The reference: illuminance by the unbiased integrator `coefficient`, for some hours of the year.

The reference shares no cells, tables of films or patches with the settings that it checks: every
hour has its exact sun, the sky has Reinhart's subdivision 6. Direct sun, for ASE and the shade,
comes from many shadow rays to every disk; these have no cells either.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba import metrics, schema
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import State
from drcmitsuba.case.sensors import Sensors
from drcmitsuba.case.sun import TrueSun
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.launch_size import PATHS
from drcmitsuba.scene import scene
from drcmitsuba.scene.mitsuba_scenes import mitsuba_scene
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.transport.rays.shadow_rays import sun_deposit

SUBDIVISION = 6
"""Reinhart's factor of the reference's sky: 5185 patches."""
HOURS, MOST_SENSORS = 200, 600
"""Approximate number of time stamps, and largest number of sensors, of the reference."""
FEWEST_ROUNDS, ROUNDS = 4, 16
"""Smallest number of rounds, and number of rounds that the time is divided into at least."""
ENOUGH = 0.5
"""RMS error of the reference [% of the mean E] below which it stops early."""
PILOT = 1 << 16
"""Number of paths in the launch that measures the speed."""
SUNS_PER_VERTEX = 8
"""Number of suns sampled at every vertex: about the least noise in a given time."""
DISK_SAMPLES, DISK_ROUNDS = 8, 32
"""Number of directions to every sun's disk in one launch, and of launches, for direct sun."""


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


@dataclass(frozen=True)
class Reference:
    """Illuminance by the unbiased integrator.

    Parameters
    ----------
    times : np.ndarray of datetime64, shape (time,)
    sensors : np.ndarray of int, shape (sensor,)
        Positions in the case's grid.
    is_open : np.ndarray, shape (round, time, sensor)
        E of independent rounds, shade open [lx].
    shaded : np.ndarray, shape (round, closed time, sensor)
        E of the same rounds with the shade closed [lx], at the time stamps that `closed` marks.
    direct_sun : np.ndarray, shape (time, all sensors)
        Direct sun, shade open [lx].
    closed : np.ndarray of bool, shape (time,)
    paths : int
        Number of paths from every sensor in all rounds, for each state.
    """

    times: np.ndarray
    sensors: np.ndarray
    is_open: np.ndarray
    shaded: np.ndarray
    direct_sun: np.ndarray
    closed: np.ndarray
    paths: int
    seconds: float

    def rounds(self, closed: np.ndarray) -> np.ndarray:
        """E (round, time, sensor) [lx], the shade closed where `closed` and the reference agree."""
        both = closed & self.closed
        E = self.is_open.copy()
        E[:, both] = self.shaded[:, both[self.closed]]
        return E


@dataclass(frozen=True)
class ReferenceDaylight:
    """Sky and suns of the reference's hours: luminances [cd/m²] and directions."""

    sky: np.ndarray
    sun: np.ndarray
    directions: np.ndarray
    diameter: float

    @classmethod
    def of(cls, case: Case, times: np.ndarray) -> ReferenceDaylight:
        """Exact suns and a fine sky for some of a case's hours."""
        sky = case.sky.model_copy(update={"subdivision": SUBDIVISION})
        whole = daylight(case.with_tables(sky=sky, sun=TrueSun()))
        L, sun = whole.sky.sel(time=times), whole.sun.sel(time=times)
        directions = sun["direction"].transpose("time", "axis").values
        return cls(L["sky"].values, L["sun"].values, directions, case.outside.sun_diameter)

    def only(self, hours: np.ndarray) -> ReferenceDaylight:
        """Daylight of some hours only."""
        return ReferenceDaylight(
            self.sky[hours], self.sun[hours], self.directions[hours], self.diameter
        )

    @property
    def shining(self) -> np.ndarray:
        """Positions of the hours with sun."""
        return np.flatnonzero(self.sun > 0)


def trace_reference(case: Case, times: np.ndarray, until: float) -> Reference:
    """Trace the reference at `times` (time,), in rounds until a time by `time.monotonic` [s].

    Four rounds are traced in any case.
    """
    start = time.monotonic()
    backend.select()
    light = ReferenceDaylight.of(case, times)
    direct = direct_sun(case, light)
    shading = case.shading
    closed = np.zeros(len(times), bool)
    if shading is not None:
        at = prepared(case).receivers.coordinates.coords
        as_array = xr.DataArray(direct, at, ("time", "sensor"))
        closed = metrics.shade_closed(as_array, shading.threshold, shading.area).values
    sensors = some_sensors(case)
    states = [_TracedState.of(case, "open", light, sensors)]
    if closed.any():
        states.append(_TracedState.of(case, "shaded", light.only(closed), sensors))
    spp, rounds = _sampled(states, until)
    E = [np.stack(of_state) for of_state in zip(*rounds, strict=True)]
    shaded = E[1] if closed.any() else np.zeros((len(rounds), 0, len(sensors)), np.float32)
    return Reference(
        times, sensors, E[0], shaded, direct, closed, spp * len(rounds), time.monotonic() - start
    )


def _sampled(states: list[_TracedState], until: float) -> tuple[int, list[list[np.ndarray]]]:
    """Number of paths from a sensor in each round, and E [lx] by round and state."""
    pilot = max(1, PILOT // len(states[0].points))
    for seed in (0, 1):  # the first one compiles
        begin = time.monotonic()
        _ = [state.illuminance(pilot, seed) for state in states]
    pace = (time.monotonic() - begin) / pilot
    left = max(until - time.monotonic(), 0) / ROUNDS
    spp = int(np.clip(left / pace, 1, max(1, PATHS // len(states[0].points))))
    rounds: list[list[np.ndarray]] = []
    while len(rounds) < FEWEST_ROUNDS or time.monotonic() + spp * pace < until:
        # The spread reads all rounds, so it is computed once in `ROUNDS` rounds only.
        if len(rounds) % ROUNDS == 0 and len(rounds) > 0 and _spread(rounds) < ENOUGH:
            break
        rounds.append([state.illuminance(spp, 2 + len(rounds)) for state in states])
    return spp, rounds


def _spread(rounds: list[list[np.ndarray]]) -> float:
    """RMS of the standard error of E, shade open [% of the mean E]."""
    E = np.stack([is_open for is_open, *_ in rounds])
    return 100 * float(np.sqrt(E.var(axis=0, ddof=1).mean() / len(E)) / E.mean())


def _channels(case: Case) -> Iterator[tuple[int, float]]:
    """Index and weight of each colour channel; a grey case has one channel."""
    yield from enumerate(schema.channel_weights(3 if scene.is_coloured(case) else 1))


def direct_sun(case: Case, light: ReferenceDaylight) -> np.ndarray:
    """Direct sun on all sensors of a case, shape (time, sensor) [lx]."""
    points, normals = map(flat, prepared(case).receivers.at())
    lit = light.shining
    E = np.zeros((len(light.sun), dr.width(points) // 3))
    for channel, weight in _channels(case):
        world = scene.load(case, "open", channel)
        for launch in range(DISK_ROUNDS):
            D = sun_deposit(
                world, points, normals, suns=light.directions[lit], diameter=light.diameter,
                samples=DISK_SAMPLES, seed=launch * DISK_SAMPLES,
            ).numpy()  # fmt: skip
            E[lit] += weight / DISK_ROUNDS * light.sun[lit, None] * D.T
    return E


@dataclass(frozen=True)
class _TracedState:
    """One state of the shade: a scene and a weight for every channel, the daylight and sensors."""

    channels: list[tuple[mi.Scene, float]]
    light: ReferenceDaylight
    points: np.ndarray
    normals: np.ndarray

    @classmethod
    def of(
        cls, case: Case, state: State, light: ReferenceDaylight, sensors: np.ndarray
    ) -> _TracedState:
        points, normals = prepared(case).receivers.at(sensors)
        channels = [
            (_with_sources(scene.load(case, state, channel).full, light), weight)
            for channel, weight in _channels(case)
        ]
        return cls(channels, light, points, normals)

    def illuminance(self, spp: int, seed: int) -> np.ndarray:
        """E (time, sensor) [lx] of `spp` paths from every sensor."""
        many = {"suns_per_vertex": SUNS_PER_VERTEX, "suns_per_pane": SUNS_PER_VERTEX}
        plugin = mi.load_dict({"type": "coefficient", **many})
        lit, bins = self.light.shining, self.light.sky.shape[1]
        E = np.zeros((len(self.light.sun), len(self.points)))
        for channel, (world, weight) in enumerate(self.channels):
            key = seed * len(self.channels) + channel
            parts = plugin.sensors(world, self.points, self.normals, spp, key).numpy()
            C = weight * parts.sum(axis=0)
            E += self.light.sky @ C[:, :bins].T
            E[lit] += self.light.sun[lit, None] * C[:, bins:].T
        return E.astype(np.float32)


def _with_sources(walls: mi.Scene, light: ReferenceDaylight) -> mi.Scene:
    """Scene of the walls, the fine sky and the suns that shine."""
    world: dict[str, Any] = {f"shape{i}": shape for i, shape in enumerate(walls.shapes())}
    world["sky"] = {"type": "tregenza_sky", "subdivision": SUBDIVISION}
    if len(light.shining):
        directions = mi.TensorXf(light.directions[light.shining].astype(np.float32))
        world["suns"] = {
            "type": "sun_disks", "directions": directions, "diameter": light.diameter,
        }  # fmt: skip
    return mitsuba_scene(world)
