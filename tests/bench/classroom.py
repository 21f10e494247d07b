"""The classroom with open windows, its converged coefficients, and the error of an estimate."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from time import perf_counter
from typing import Any

import mitsuba as mi
import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.reading import load_case
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.scene.surfaces import surfaces_of
from drcmitsuba.sky import daylight
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute
from tests import radiance

CASE = "classroom/reference/existing"
GENEVA = "shared/data/weather/CHE_Geneva.067000_IWEC.epw"
NO_SUNS = Suns((), np.zeros((0, 3)))
BINS = len(Patches())
DENSE: dict[str, Any] = {
    "replicates": 64,
    "paths": 1,
    "sensor_sky_rays": 8192,
    "sensor_sun_samples": 16,
}
"""Samples of the reference's direct part, which has no cells and converges fast."""


def best_weather() -> Path | None:
    """The Geneva year of the published comparison, where it lies beside the repository."""
    file = Path(__file__).resolve().parents[3] / GENEVA
    return file if file.is_file() else None


@dataclass(frozen=True)
class Classroom:
    """Room, sensors and suns of the comparison.

    Parameters
    ----------
    weather : Path or None
        Weather file of the year; None for the package's default year.
    picked : int
        Suns that errors are measured on, evenly spread over the year's.
    """

    weather: Path | None = field(default_factory=best_weather)
    picked: int = 100

    @cached_property
    def case(self) -> Case:
        return radiance.opened(load_case(CASE)).with_weather(self.weather)

    @cached_property
    def scene(self) -> scene.Scene:
        """Scene in which paths follow all bounces."""
        return scene.load(self.case)

    @cached_property
    def scene_with_cells(self) -> scene.Scene:
        """Scene whose light between surfaces is solved on cells."""
        return scene.load(self.case, effects=EnabledEffects(solved_cells=True))

    @cached_property
    def sensors(self) -> tuple[np.ndarray, np.ndarray]:
        return sensor_points(self.case)

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
        """Coefficients by `drcmitsuba.transport.coefficients.compute`."""
        if points is None or normals is None:
            points, normals = self.sensors
        world = self.scene_with_cells if solved_cells else self.scene
        return compute(world, points, normals, suns, Accuracy(**accuracy))

    def room(self, folder: Path) -> radiance.Room:
        """Radiance gets this room."""
        return radiance.Room(radiance.scene_text(surfaces_of(self.case)), *self.sensors, folder)

    def with_sources(self, suns: Suns | None) -> mi.Scene:
        """Mitsuba scene for the plugin `coefficient`: the sky, or suns."""
        walls = {f"wall{i}": shape for i, shape in enumerate(self.scene.full.shapes())}
        source: dict = {"type": "tregenza_sky"}
        if suns is not None:
            directions = mi.TensorXf(suns.directions.astype(np.float32))
            source = {"type": "sun_disks", "directions": directions, "diameter": suns.diameter}
        return mi.load_dict({"type": "scene", **walls, "source": source}, optimize=False)


@dataclass(frozen=True)
class Reference:
    """Converged coefficients of one kind of source.

    Parameters
    ----------
    direct, interreflected : np.ndarray, shape (sensor, bin)
        [sr].
    own_error : float
        Relative RMS error of the reference itself.
    """

    direct: np.ndarray
    interreflected: np.ndarray
    own_error: float

    @property
    def total(self) -> np.ndarray:
        return self.direct + self.interreflected

    def errors(self, total: np.ndarray, direct: np.ndarray) -> Errors:
        """Errors of an estimate; nothing is subtracted, bias and the reference's own are in."""
        dark = self.direct == 0

        def rms(a: np.ndarray, b: np.ndarray) -> float:
            return float(np.sqrt(np.mean((a - b) ** 2)))

        return Errors(
            total=rms(total, self.total) / self.total.mean(),
            direct=rms(direct, self.direct) / self.total.mean(),
            dark=rms(total[dark], self.total[dark]) / self.total[dark].mean(),
            mean=float(total.mean() / self.total.mean()),
        )


@dataclass(frozen=True)
class Errors:
    """Relative RMS errors over all (sensor, bin) entries.

    Parameters
    ----------
    total, direct : float
        RMS error over the mean entry of the reference.
    dark : float
        RMS error over the mean, of entries without any direct light: the interreflected part.
    mean : float
        Mean entry over the reference's.
    """

    total: float
    direct: float
    dark: float
    mean: float

    def within(self, other: Errors, every: bool) -> bool:
        """At most the other's error over all entries, and if asked in no part of them larger."""
        parts = self.direct <= other.direct and self.dark <= other.dark
        return self.total <= other.total and (not every or parts)


def reference(room: Classroom, suns: Suns | None, rounds: int, folder: Path | None) -> Reference:
    """Reference for the sky (`suns` None) or for suns, from a folder if it holds it.

    Interreflected light is by the plugin `coefficient`, which has no cells and no bias, in rounds
    of 2048 paths from every sensor; direct light by a dense run of our own deposit, checked here
    against the plugin's.
    """
    kind = "sky" if suns is None else "suns"
    weather = room.weather.stem if room.weather else "default"
    file = folder / f"{kind}_{weather}_{room.picked}_{rounds}.npz" if folder else None
    if file is not None and file.is_file():
        with np.load(file) as saved:
            direct, halves = saved["direct"], saved["halves"]
    else:
        start = perf_counter()
        first = slice(0, BINS) if suns is None else slice(BINS, None)
        C = room.ours(NO_SUNS if suns is None else suns, **DENSE)
        direct = C["direct"].values[:, first].astype(float)
        plugin, sources = mi.load_dict({"type": "coefficient"}), room.with_sources(suns)
        halves = np.zeros((2, 2, *direct.shape))  # half, direct or interreflected, sensor, bin
        for i in range(rounds):
            halves[i % 2] += plugin.sensors(sources, *room.sensors, 2048, i).numpy() / (rounds / 2)
        seconds = perf_counter() - start
        if file is not None:
            file.parent.mkdir(parents=True, exist_ok=True)
            np.savez(file, direct=direct, halves=halves)
        print(f"Reference for the {kind}: made in {seconds:.0f} s.")
    plain, noise = halves.mean(axis=0), (halves[0] - halves[1]) / 2
    result = Reference(direct, plain[1], 0.0)
    mean = result.total.mean()
    error, apart = (np.sqrt(np.mean(a**2)) / mean for a in (noise[0], plain[0] - direct))
    own = float(np.sqrt(np.mean(noise[1] ** 2)) / mean)
    print(
        f"Reference for the {kind}: {rounds * 2048} paths per sensor, own RMS {own:.1%}; direct "
        f"part {direct.mean() / mean:.0%} of the mean, {apart:.1%} RMS from the plugin's, whose "
        f"own error is {error:.1%}; sums agree to {plain[0].mean() / direct.mean() - 1:+.3%}.\n"
    )
    return Reference(result.direct, result.interreflected, own)
