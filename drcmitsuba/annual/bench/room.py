"""The classroom of the comparison: open windows, so that no formula of glass stands between."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.facade import Facade, Strip
from drcmitsuba.case.reading import load_case
from drcmitsuba.case.sensors import Sensors
from drcmitsuba.scene import scene as scenes
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.mitsuba_scenes import mitsuba_scene
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.sky import daylight
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute

CASE = "classroom/reference/existing"
BINS = len(Patches())
"""Number of bins of ground and sky."""
NO_SUNS = Suns((), np.zeros((0, 3)))


def opened(case: Case) -> Case:
    """Put holes in place of every strip of a case's façades, and leave its shade away."""
    facade = {
        side: Facade(
            segments=f.segments, frame=f.frame, frame_reflectance=f.frame_reflectance,
            strips=tuple(
                Strip(bottom=s.bottom, top=s.top, material="open", segments=s.segments)
                for s in f.strips
            ),
        )
        for side, f in case.facade.items()
    }  # fmt: skip
    return case.model_copy(update={"facade": facade, "shading": None})


@dataclass(frozen=True)
class BenchRoom:
    """Room, sensors and suns of the comparison.

    Parameters
    ----------
    weather : Path or None
        Weather file of the year; None for the package's default year.
    picked : int
        Number of suns that errors are measured on, evenly spread over the year's.
    every : int
        Only every so many-th of the 24 × 24 sensors along each axis.
    """

    weather: Path | None = None
    picked: int = 100
    every: int = 1

    @cached_property
    def case(self) -> Case:
        """The case, whose grid covers the same floor with fewer sensors."""
        case = opened(load_case(CASE)).with_weather(self.weather)
        grid = case.sensors
        assert isinstance(grid, Sensors)
        nx, ny = (n // self.every for n in grid.count)
        sensors = grid.model_copy(
            update={"count": (nx, ny), "spacing": grid.spacing * self.every}
        )  # fmt: skip
        return case.with_tables(sensors=sensors)

    @cached_property
    def scene(self) -> scenes.Scene:
        """Scene in which paths follow all bounces."""
        return scenes.load(self.case)

    @cached_property
    def scene_with_cells(self) -> scenes.Scene:
        """Scene whose light between surfaces is solved on cells."""
        return scenes.load(self.case, effects=EnabledEffects(solved_cells=True))

    @cached_property
    def sensors(self) -> tuple[np.ndarray, np.ndarray]:
        """Points [m] and normals, shape (sensor, 3) each."""
        points, normals = prepared(self.case).receivers.at()
        return points, normals

    @cached_property
    def year(self) -> Suns:
        """All suns above the horizon in the EvalDRC calendar."""
        return Suns.of(daylight.daylight(self.case).sun, self.case.outside.sun_diameter)

    @cached_property
    def suns(self) -> Suns:
        """The picked ones."""
        at = np.linspace(0, len(self.year.labels) - 1, self.picked).round().astype(int)
        return self.year.only(np.array(self.year.labels)[at])

    def ours(
        self, suns: Suns, points: np.ndarray | None = None, normals: np.ndarray | None = None, *,
        solved_cells: bool = False, **accuracy: Any,
    ) -> xr.Dataset:  # fmt: skip
        """Coefficients [sr] of ground, sky and suns, by `transport.coefficients.compute`."""
        if points is None or normals is None:
            points, normals = self.sensors
        world = self.scene_with_cells if solved_cells else self.scene
        return compute(world, points, normals, suns, Accuracy(**accuracy))

    def with_sources(self, suns: Suns | None) -> mi.Scene:
        """Mitsuba scene for the plugin `coefficient`: the sky, or suns."""
        walls = {f"wall{i}": shape for i, shape in enumerate(self.scene.full.shapes())}
        source: dict[str, Any] = {"type": "tregenza_sky"}
        if suns is not None:
            directions = mi.TensorXf(suns.directions.astype(np.float32))
            source = {"type": "sun_disks", "directions": directions, "diameter": suns.diameter}
        return mitsuba_scene({**walls, "source": source})
