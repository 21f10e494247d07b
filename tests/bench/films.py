"""The classroom with a film, O2, and its converged coefficients for some suns."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.case.case import Case
from drcmitsuba.case.reading import load_case
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.surfaces import surfaces_of
from drcmitsuba.sky.sun_models import Suns
from tests import radiance
from tests.bench.classroom import BINS, Classroom, KnownCoefficients

TRANSMISSIVITY = 0.82
"""Radiance's `glass` with it stands for the case's glazing in both programs."""
CONVERGED: dict[str, Any] = {
    "paths": 1024, "cell_size": 0.3, "cell_sky_rays": 1, "sensor_sky_rays": 1,
    "sensor_sun_samples": 16, "pane_points": 1024, "film_sky_samples": 1,
}  # fmt: skip


@dataclass(frozen=True)
class Filmed(Classroom):
    """Room, sensors and suns of the comparison with a film.

    `direct` is the straight light alone, and `interreflected` all other, the film's included.

    Parameters
    ----------
    picked : int
        Suns that Radiance is given and errors are measured on.
    folder : Path
        Where the film's file goes, made reciprocal: Radiance takes the component for light from the
        room where ours takes the one for light from outside.
    """

    picked: int = 4
    folder: Path = field(default_factory=lambda: Path(tempfile.mkdtemp()))

    @cached_property
    def case(self) -> Case:
        case = load_case("classroom/reference/o2").with_weather(self.weather)
        return radiance.reciprocal(case, self.folder)

    @cached_property
    def scene(self) -> scene.Scene:
        return radiance.with_glass(scene.load(self.case), TRANSMISSIVITY)

    @cached_property
    def scene_with_cells(self) -> scene.Scene:
        world = scene.load(self.case, effects=EnabledEffects(solved_cells=True))
        return radiance.with_glass(world, TRANSMISSIVITY)

    @cached_property
    def year(self) -> Suns:
        """The suns in front of the façade: for others nothing comes in by the film."""
        every = Classroom(self.weather).year
        return every.only(np.array(every.labels)[every.directions[:, 1] < -0.05])

    def ours(
        self, suns: Suns, points: np.ndarray | None = None, normals: np.ndarray | None = None, *,
        solved_cells: bool = False, **accuracy: Any,
    ) -> xr.Dataset:  # fmt: skip
        C = super().ours(suns, points, normals, solved_cells=solved_cells, **accuracy)
        scattered = C["direct"] - C["straight"] + C["interreflected"]
        return C.assign(direct=C["straight"], interreflected=scattered)

    def room(self, folder: Path) -> radiance.Room:
        text = radiance.scene_text(surfaces_of(self.case), TRANSMISSIVITY)
        return radiance.Room(text, *self.sensors, folder)


def reference(room: Filmed, replicates: int) -> KnownCoefficients:
    """Coefficients of the picked suns by a long run of ours, and its own error."""
    start = perf_counter()
    C = room.ours(room.suns, replicates=replicates, seed=1, **CONVERGED).isel(bin=slice(BINS, None))
    direct, rest = (C[name].values.astype(float) for name in ("direct", "interreflected"))
    noise = C["replicates"].values.std(axis=0, ddof=1) / np.sqrt(replicates)
    mean = (direct + rest).mean()
    own = float(np.sqrt(np.mean(noise**2)) / mean)
    print(
        f"Reference: ours, {replicates * CONVERGED['paths']} paths per sensor, "
        f"{perf_counter() - start:.0f} s, own RMS {own:.1%}; straight light "
        f"{direct.mean() / mean:.0%} of the mean.\n"
    )
    return KnownCoefficients(direct, rest, own)
