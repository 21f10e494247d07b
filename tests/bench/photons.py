"""The lamella room of the validation, and how fast photons go there: ours and Radiance's."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from time import perf_counter
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba import scene
from drcmitsuba.accuracy import Accuracy
from drcmitsuba.coefficients import compute
from drcmitsuba.suns import Suns
from drcmitsuba.transport.photons import Photons
from tests import radiance
from tests.validation import lamella_room as room
from tests.validation.radiance_photons import PhotonRoom, modifiers, receivers

CASE = "lamella/lamella"
DIAMETER = 0.5
CONVERGED: dict[str, Any] = {
    "replicates": 8, "photons": 1 << 15, "paths": 4096, "cell_size": 0.15, "cell_sky_rays": 1,
    "sensor_sky_rays": 1, "sensor_square": 0.25,
}  # fmt: skip


@dataclass(frozen=True)
class Lamellae:
    """The room, its sensors and suns, none of which shines between the lamellae.

    Parameters
    ----------
    count : int
        Suns.
    side : int
        Sensors along a side of the room.
    """

    count: int = 8
    side: int = 16

    @property
    def surfaces(self) -> list[scene.Surface]:
        return [*room.shell(), room.casing(), room.pane(), room.lamellae(bend=20, pieces=4)]

    @cached_property
    def scene(self) -> scene.Scene:
        built = scene.build(self.surfaces, ports=(room.port(),))
        return radiance.with_glass(built, room.TRANSMISSIVITY)

    @cached_property
    def sensors(self) -> tuple[np.ndarray, np.ndarray]:
        return room.sensors(self.side)

    @cached_property
    def suns(self) -> Suns:
        directions = room.suns(self.count, lowest=35.0)
        return Suns(tuple(f"sun_{i}" for i in range(self.count)), directions, DIAMETER)

    def ours(self, **accuracy: Any) -> xr.Dataset:
        """Coefficients of the suns."""
        settings = Accuracy(**accuracy)
        return compute(self.scene, *self.sensors, self.suns, settings, subdivision=None)

    def theirs(self, folder: Path) -> PhotonRoom:
        """What Radiance is given."""
        text = radiance.scene_text(self.surfaces, room.TRANSMISSIVITY)
        ports = modifiers(self.surfaces, ["pane"])
        return PhotonRoom(text + receivers(room.receiver()), *self.sensors, folder, ports)


def photon_rate(lamellae: Lamellae, photons: int = 1 << 18, runs: int = 3) -> tuple[float, float]:
    """Segments of photons in a second, and segments to a photon; the fastest of some runs."""
    traced = Photons.of(
        lamellae.scene, *lamellae.sensors, lamellae.suns.directions, DIAMETER, None,
        Accuracy(photons=photons, sensor_square=0.25),
    )  # fmt: skip
    assert traced is not None
    traced.traced(0)  # compiles
    rates = []
    for run in range(runs):
        start = perf_counter()
        books = traced.traced(run + 1).ledgers.values()
        segments = sum(book.segments for book in books)
        rates.append(segments / (perf_counter() - start))
    return max(rates), segments / sum(book.photons for book in books)


def ray_rate(lamellae: Lamellae, lanes: int = 1 << 21, runs: int = 5) -> float:
    """Bare closest hits in a second, of rays that go from anywhere in the room in any direction."""
    low, high = lamellae.scene.low, lamellae.scene.high

    def hits(seed: int) -> tuple[mi.Ray3f, float]:
        random = mi.PCG32(lanes, dr.opaque(mi.UInt64, seed))
        at = [random.next_float32() for _ in range(5)]
        p = mi.Point3f(*(dr.opaque(mi.Float, float(a)) for a in low))
        p += mi.Vector3f(*at[:3]) * mi.Vector3f(
            *(dr.opaque(mi.Float, float(b)) for b in high - low)
        )
        ray = mi.Ray3f(p, mi.warp.square_to_uniform_sphere(mi.Point2f(*at[3:])))
        dr.eval(ray)
        dr.sync_thread()
        start = perf_counter()
        found = lamellae.scene.full.ray_intersect_preliminary(ray, coherent=False)
        dr.eval(found.t)
        dr.sync_thread()
        return ray, perf_counter() - start

    hits(0)  # compiles
    return lanes / min(hits(seed + 1)[1] for seed in range(runs))


def converged(lamellae: Lamellae) -> tuple[np.ndarray, float]:
    """Coefficients (sensor, sun) by a long run of ours, and their own relative RMS error."""
    C = lamellae.ours(seed=1, **CONVERGED)
    replicates = C["replicates"].values.astype(float)
    mean = replicates.mean(axis=0)
    noise = replicates.std(axis=0, ddof=1) / np.sqrt(len(replicates))
    return mean, float(np.sqrt(np.mean(noise**2)) / mean.mean())


def relative_error(found: np.ndarray, known: np.ndarray) -> float:
    """RMS over sensors and suns, bias included, over the mean."""
    return float(np.sqrt(np.mean((found - known) ** 2)) / known.mean())


def year_errors(illuminance: xr.Dataset, least: float = 1.0) -> np.ndarray:
    """Relative standard errors of sunlight where there is at least so much of it [lx]."""
    sun, error = (illuminance[f"sun_open{end}"].values for end in ("", "_se"))
    lit = sun >= least
    return error[lit] / sun[lit]
