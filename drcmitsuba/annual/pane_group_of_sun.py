"""Group of panes through which each sun comes straight to a sensor; the rule of shades asks it."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import partial

import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import BLOCKED, OPEN, State
from drcmitsuba.case.sun import ThreePhase
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.launch_size import SENSORS
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.scene import scene
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.rays.openings import in_rooms, within_of
from drcmitsuba.transport.rays.shadow_rays import RIM, sun_deposit

PATCH_WIDTH = 10.0
"""Angle across Tregenza's patches, roughly [deg]."""


@dataclass(frozen=True)
class PaneGroupOfSun:
    """Scenes of the open state, one whole and others with one group of panes blocked.

    A sun comes through the group without which the most light is lost. The rays are the same in all
    scenes.
    """

    name: str
    """Name of the case, for lists of blocks."""
    suns: Suns
    """Suns that shine; patches of the sky where these stand for the sun."""
    whole: scene.Scene
    without: tuple[scene.Scene, ...]
    """Scenes without light through one group each."""
    run: Run

    @classmethod
    def of(cls, case: Case, state: State, suns: Suns, run: Run) -> PaneGroupOfSun | None:
        """Load the scenes; None of another state than the open one, and of a single group of all
        spaces.
        """
        groups, spaces = prepared(case).groups, prepared(case).spaces
        if state != OPEN or len(groups) < (1 if any(space.groups for space in spaces) else 2):
            return None
        suns = suns.where(run.enabled_effects.enabled_suns(suns))
        if isinstance(case.sun, ThreePhase):  # patches of the sky stand for the sun
            patches = Patches(case.sky.subdivision)
            labels, directions = tuple(patches.labels[1:]), patches.directions[1:]
            suns = Suns(labels, directions, PATCH_WIDTH / case.sky.subdivision)
        coloured = len(scene.channels_of(case, run.enabled_effects)) > 1
        channel = 1 if coloured else -1  # green stands for all colours

        def blocked(group: int) -> scene.Scene:
            indices = [BLOCKED if g == group else 0 for g in range(len(groups))]
            label = groups.states.label(indices)
            return scene.load(case, label, channel, run.enabled_effects)

        without = tuple(blocked(g) for g in range(len(groups)))
        return cls(case.name, suns, blocked(-1), without, run)

    def added(self, C: xr.Dataset, points: np.ndarray, normals: np.ndarray) -> xr.Dataset:
        """Add `pane_group` (sensor, bin or sun) to C of sensors, −1 where no sun comes straight.

        Parameters
        ----------
        C : xr.Dataset
            Coefficients of the open state for these sensors.
        points, normals : np.ndarray, shape (sensor, 3)
            As from `sensor_points`.
        """
        dim = "sun" if "sun_straight" in C else "bin"
        coords = {dim: np.array(self.suns.labels, object)}
        group = self.of_sensors(points, normals)
        values = xr.DataArray(group, dims=("sensor", dim), coords=coords)
        values = values.astype(np.float32).reindex({dim: C[dim]}, fill_value=np.float32(-1))
        return C.assign(pane_group=values.drop_vars(dim))

    def of_sensors(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Group of every sun of `suns` at sensors, −1 for none, int, shape (sensor, sun)."""
        contents = [world.content for world in (self.whole, *self.without)]
        about, seed = (
            f"{self.name}, groups of panes",
            launch_seed(self.run.seed, Stream.PANE_GROUPS),
        )
        kept = self.run.kept(about, *contents, points, normals, seed, self.suns)
        made = kept.kept(len(points), partial(self._of_points, points, normals, seed))
        return np.asarray(made["group"].values)

    def _of_points(self, points: np.ndarray, normals: np.ndarray, seed: int) -> xr.Dataset:
        """Number of the group of every sun (sensor, sun)."""
        out, before = np.full((len(points), len(self.suns.labels)), -1, np.int16), self._rays()
        for start in range(0, len(points) if self.suns.labels else 0, SENSORS):
            here = slice(start, start + SENSORS)
            whole = self._straight(self.whole, points[here], normals[here], seed)
            most = 1e-3 * whole  # rounding loses nothing
            for g, world in enumerate(self.without):
                lost = whole - self._straight(world, points[here], normals[here], seed)
                out[here][lost > most] = g
                most = np.maximum(most, lost)
        self.run.ray_counter.update(self._rays() - before)
        return xr.Dataset({"group": (("sensor", "sun"), out)})

    def _rays(self) -> Counter[str]:
        """Number of rays by kind so far."""
        counts = (world.ray_counter.counted() for world in (self.whole, *self.without))
        return sum(map(Counter, counts), Counter())

    def _straight(
        self, world: scene.Scene, points: np.ndarray, normals: np.ndarray, seed: int
    ) -> np.ndarray:
        """D of the suns in a scene [sr], shape (sensor, sun)."""
        within = within_of(world, points, in_rooms(world, points))
        D = sun_deposit(
            world, flat(points), flat(normals), suns=self.suns.directions,
            diameter=self.suns.diameter, samples=RIM, seed=seed, within=within,
        )  # fmt: skip
        return np.asarray(D.numpy())
