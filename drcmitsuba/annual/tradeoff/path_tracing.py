"""The reference by the unbiased integrator `coefficient`.

It shares no cells, tables of films or patches with the settings that it checks: every hour has its
exact sun, the sky has Reinhart's subdivision 6. Direct sun, for ASE and the states of the façade,
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

from drcmitsuba import schema
from drcmitsuba.annual.attributes import spaces_text
from drcmitsuba.annual.tradeoff.reference import (
    ENOUGH,
    FEWEST_ROUNDS,
    ROUNDS,
    Reference,
    number_of,
    rule_of,
    some_sensors,
    spread,
)
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import BLOCKED, OPEN, State
from drcmitsuba.case.sun import TrueSun
from drcmitsuba.metrics.facade_states import ShadeRule, sunlit
from drcmitsuba.metrics.grids import grid_of_sensors
from drcmitsuba.metrics.watched_groups import watched
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
PILOT = 1 << 16
"""Number of paths in the launch that measures the speed."""
SUNS_PER_VERTEX = 8
"""Number of suns sampled at every vertex: about the least noise in a given time."""
DISK_SAMPLES, DISK_ROUNDS = 8, 32
"""Number of directions to every sun's disk in one launch, and of launches, for direct sun."""


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
    rule, direct = rule_of(case), direct_sun(case, light, OPEN)
    state, labels = np.zeros(len(times), np.int64), {0: OPEN}
    if rule is not None:
        indices = _states(case, light, rule, times, direct)
        state = number_of(rule.groups, indices)
        labels |= {int(n): rule.groups.label(row) for n, row in zip(state, indices, strict=True)}
    sensors = some_sensors(case)
    hours = [np.ones(len(times), bool), *(state == n for n in labels if n)]
    states = [
        _TracedState.of(case, label, light.only(some), sensors)
        for label, some in zip(labels.values(), hours, strict=True)
    ]
    spp, rounds = _sampled(states, until)
    is_open = np.stack([E for E, *_ in rounds])
    applied = is_open.copy()
    for k, some in enumerate(hours[1:], 1):
        applied[:, some] = np.stack([E[k] for E in rounds])
    method = f"unbiased path tracing, {spp * len(rounds)} paths from each of {len(sensors)} sensors"
    seconds = time.monotonic() - start
    return Reference(times, sensors, is_open, applied, direct, state, method, seconds)


def _states(
    case: Case, light: ReferenceDaylight, rule: ShadeRule, times: np.ndarray, direct: np.ndarray
) -> np.ndarray:
    """State of every group, an index, (time, group), by direct sun (time, sensor) [lx]."""
    at = prepared(case).receivers.coordinates.coords
    sun = xr.Dataset({"direct_sun": (("time", "sensor"), direct)}, {**at, "time": times})
    belongs = any(space.groups for space in prepared(case).spaces)
    if len(rule.groups) > 1 or belongs:
        blocked = np.full((len(rule.groups),) * 2, BLOCKED)
        np.fill_diagonal(blocked, 0)
        each = [direct_sun(case, light, rule.groups.label(row)) for row in blocked.tolist()]
        group = np.where(direct > 0, np.argmax(each, axis=0), -1)
        told = sun.assign_attrs(rule.groups.attributes() | {"spaces": spaces_text(case)})
        through = xr.DataArray(group, dims=("time", "sensor"))
        sun = sun.assign(sun_group=watched(through, told))
    closed = rule.closed(sunlit(sun, rule), np.bincount(grid_of_sensors(sun)))
    return rule.indices(closed, sun["time"])


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
        if (
            len(rounds) % ROUNDS == 0
            and len(rounds) > 0
            and spread([E for E, *_ in rounds]) < ENOUGH
        ):
            break
        rounds.append([state.illuminance(spp, 2 + len(rounds)) for state in states])
    return spp, rounds


def _channels(case: Case) -> Iterator[tuple[int, float]]:
    """Index and weight of each colour channel; a grey case has one channel."""
    yield from enumerate(schema.channel_weights(3 if scene.is_coloured(case) else 1))


def direct_sun(case: Case, light: ReferenceDaylight, state: State) -> np.ndarray:
    """Direct sun on all sensors of a case in a state, shape (time, sensor) [lx]."""
    points, normals = map(flat, prepared(case).receivers.at())
    lit = light.shining
    E = np.zeros((len(light.sun), dr.width(points) // 3))
    for channel, weight in _channels(case):
        world = scene.load(case, state, channel)
        for launch in range(DISK_ROUNDS):
            D = sun_deposit(
                world, points, normals, suns=light.directions[lit], diameter=light.diameter,
                samples=DISK_SAMPLES, seed=launch * DISK_SAMPLES,
            ).numpy()  # fmt: skip
            E[lit] += weight / DISK_ROUNDS * light.sun[lit, None] * D.T
    return E


@dataclass(frozen=True)
class _TracedState:
    """One state of the façade: a scene and a weight for every channel, the daylight and sensors."""

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
