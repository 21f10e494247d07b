"""The lamella room of the validation, and how fast photons go there: ours and Radiance's."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from time import perf_counter
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.scene import scene
from drcmitsuba.scene.geometry import Surface
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute
from drcmitsuba.transport.photons.ports import of_suns
from drcmitsuba.transport.photons.starts import PhotonRows, PhotonStarts
from drcmitsuba.transport.photons.tracer import PhotonTracer
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
        Sensors along a side of the room, in the middle of fields that our squares fill.
    finer : int
        Look-ups of Radiance along a side of such a field.
    """

    count: int = 64
    side: int = 16
    finer: int = 4

    @property
    def surfaces(self) -> list[Surface]:
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
        """Radiance gets this room, with a photon port for the panes."""
        points = room.sensors(self.side * self.finer)
        text = radiance.scene_text(self.surfaces, room.TRANSMISSIVITY)
        ports = modifiers(self.surfaces, ["pane"])
        return PhotonRoom(
            text + receivers(room.receiver()), *points, folder, ports, os.cpu_count() or 1
        )

    def by_field(self, fine: np.ndarray) -> np.ndarray:
        """Means over the fields, shape (sensor, sun), of Radiance's look-ups."""
        n, k = self.side, self.finer
        return fine.reshape(n, k, n, k, -1).mean(axis=(1, 3)).reshape(n * n, -1)


def tracer(lamellae: Lamellae, photons: int = 1 << 14) -> PhotonTracer:
    """Photons of the suns."""
    traced = PhotonTracer.of(
        lamellae.scene, *lamellae.sensors, lamellae.suns.directions, DIAMETER, None,
        Accuracy(photons=photons, sensor_square=0.25),
    )  # fmt: skip
    assert traced is not None
    return traced


def photon_rate(traced: PhotonTracer, run: int) -> tuple[float, float]:
    """Segments of photons in a second, and segments to a photon."""
    start = perf_counter()
    books = traced.traced(run).ledgers.values()
    segments = sum(book.segments for book in books)
    return segments / (perf_counter() - start), segments / sum(book.photons for book in books)


def ray_rate(traced: PhotonTracer, run: int) -> float:
    """Bare closest hits in a second, of the photons' own rays from surface to surface.

    Random rays through the room would not compare: between lamellae a ray takes thrice as long.
    """
    starts = PhotonStarts(traced.ports)
    scene, sources = starts.scene.full, of_suns(traced.suns, traced.diameter)
    rows = PhotonRows.of(traced.ports, sources, np.ones(len(sources.bins), bool))
    lane = dr.arange(mi.UInt32, len(rows) * traced.count)
    start = starts.start(sources, rows, traced.count, np.array([run]), lane)
    p, d, active = start.p, start.d, start.flux > 0
    hits, seconds = 0, 0.0
    while True:
        lanes = dr.compress(active)
        if not dr.width(lanes):
            return hits / seconds
        random = mi.PCG32(dr.width(lanes), dr.opaque(mi.UInt64, run + hits))
        p, d = dr.gather(mi.Point3f, p, lanes), dr.gather(mi.Vector3f, d, lanes)
        ray = mi.Ray3f(p, d)
        dr.eval(ray)
        dr.sync_thread()
        begin = perf_counter()
        hit = scene.ray_intersect_preliminary(ray, coherent=False)
        dr.eval(hit)
        dr.sync_thread()
        seconds += perf_counter() - begin
        hits += dr.width(lanes)
        si = hit.compute_surface_interaction(ray)
        u = [random.next_float32() for _ in range(3)]
        ctx = mi.BSDFContext(mi.TransportMode.Importance)
        bs, weight = si.bsdf().sample(ctx, si, u[0], mi.Point2f(u[1], u[2]), si.is_valid())
        d = si.to_world(bs.wo)
        p = si.spawn_ray(d).o
        diffuse = mi.has_flag(bs.sampled_type, mi.BSDFFlags.DiffuseReflection)
        active = si.is_valid() & (weight[0] > 0) & ~diffuse


def converged(lamellae: Lamellae) -> tuple[np.ndarray, float]:
    """Coefficients (sensor, sun) by a long run of ours, and their own relative RMS error."""
    C = lamellae.ours(seed=1, **CONVERGED)
    replicates = C["replicates"].values.astype(float)
    mean = replicates.mean(axis=0)
    noise = replicates.std(axis=0, ddof=1) / np.sqrt(len(replicates))
    return mean, float(np.sqrt(np.mean(noise**2)) / mean.mean())


def relative_error(values: np.ndarray, known: np.ndarray) -> float:
    """RMS over sensors and suns, bias included, over the mean."""
    return float(np.sqrt(np.mean((values - known) ** 2)) / known.mean())


def year_errors(illuminance: xr.Dataset, least: float = 1.0) -> np.ndarray:
    """Relative standard errors of sunlight where there is at least so much of it [lx]."""
    sun, error = (illuminance[f"sun_open{end}"].values for end in ("", "_se"))
    lit = sun >= least
    return error[lit] / sun[lit]
