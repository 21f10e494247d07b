"""Group of panes through which each sun comes straight to a sensor; the rule of shades asks it."""

from __future__ import annotations

from functools import partial
from typing import Any

import mitsuba as mi
import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import BLOCKED, OPEN, State
from drcmitsuba.case.sun import ThreePhase
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.scene import scene
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.launch_size import SENSORS
from drcmitsuba.transport.openings import in_rooms
from drcmitsuba.transport.shadow_rays import RIM, sun_deposit

PATCH_WIDTH = 10.0
"""Angle across Tregenza's patches, roughly [deg]."""


def with_pane_group(case: Case, state: State, C: xr.Dataset, suns: Suns, run: Run) -> xr.Dataset:
    """Add the group of panes through which each sun comes straight to C of the open state.

    It is the group without which the most light is lost. The rays are the same in all scenes, of
    which each has one group of panes blocked. With a single group C stays as it is.
    """
    groups = PaneGroups.of(case)
    if state != OPEN or len(groups) < 2:
        return C
    points, normals = sensor_points(case)
    suns = suns.where(run.enabled_effects.enabled_suns(suns))
    if isinstance(case.sun, ThreePhase):  # patches of the sky stand for the sun
        patches = Patches(case.sky.subdivision)
        labels, directions = tuple(patches.labels[1:]), patches.directions[1:]
        suns = Suns(labels, directions, PATCH_WIDTH / case.sky.subdivision)
    dim = "sun" if "sun_straight" in C else "bin"
    coloured = len(scene.channels_of(case, run.enabled_effects)) > 1
    channel = 1 if coloured else -1  # green stands for all colours
    kind: dict[str, Any] = {"suns": suns.directions, "diameter": suns.diameter, "samples": RIM}
    seed = launch_seed(run.seed, Stream.PANE_GROUPS)

    def straight(blocked: int | None) -> np.ndarray:
        """D of the suns (sensor, sun) [sr] with a group of panes blocked."""
        indices = [BLOCKED if g == blocked else 0 for g in range(len(groups))]
        world = scene.load(case, groups.states.label(indices), channel, run.enabled_effects)
        kept = run.kept(f"{case.name}, group {blocked}", world.content, points, normals, seed, suns)
        D = kept.kept(len(points), partial(of_scene, world))["D"]
        return np.asarray(D.transpose("sensor", "sun").values)

    def of_scene(world: scene.Scene) -> xr.Dataset:
        D = []
        for start in range(0, len(points), SENSORS):
            here = slice(start, start + SENSORS)
            closed = in_rooms(world, points[here])
            within = None if closed is None else mi.Bool(closed)
            p, n = flat(points[here]), flat(normals[here])
            D.append(sun_deposit(world, p, n, seed=seed, within=within, **kind).numpy())
        run.ray_counter.update(world.ray_counter.counted())
        return xr.Dataset({"D": (("sensor", "sun"), np.concatenate(D))})

    out = np.full((len(points), len(suns.labels)), -1, np.float32)
    if suns.labels:
        whole = straight(None)
        most = 1e-3 * whole  # rounding loses nothing
        for g in range(len(groups)):
            lost = whole - straight(g)
            out[lost > most] = g
            most = np.maximum(most, lost)
    values = xr.DataArray(out, dims=("sensor", dim), coords={dim: np.array(suns.labels, object)})
    return C.assign(
        pane_group=values.reindex({dim: C[dim]}, fill_value=np.float32(-1)).drop_vars(dim)
    )
