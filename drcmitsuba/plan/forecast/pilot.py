"""A pilot of one state of a case: transport itself, on few sensors, suns and photons.

Only this module and `pilot_paths` call transport. The evaluation uses the same kernels, so none is
compiled in vain. The scene counts the rays, which are scaled to all sensors, suns and photons.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import ceil, prod

import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.groups import State
from drcmitsuba.plan.forecast.pilot_paths import (
    REPLICATES,
    SENSORS,
    PilotPaths,
    pilot_sensors,
    spread,
)
from drcmitsuba.plan.planning import Plan
from drcmitsuba.runtime import launch_size
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.random_streams import Draw, Stream, launch_seed
from drcmitsuba.runtime.ray_counter import Purpose
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.scene import Scene, load
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute, groups_of
from drcmitsuba.transport.films.answers import SAMPLES
from drcmitsuba.transport.films.films import FEW_ROWS, Films
from drcmitsuba.transport.films.orientation import Mount
from drcmitsuba.transport.gather.blocks import KEPT
from drcmitsuba.transport.gather.paths import USUAL
from drcmitsuba.transport.interreflection.cell_rays import ROUNDS
from drcmitsuba.transport.photons.ports import patch_ratio
from drcmitsuba.transport.photons.tracer import PATCH
from drcmitsuba.transport.rays.shadow_rays import sun_deposit
from drcmitsuba.transport.shared_paths import SharedPaths

INCIDENT = 0.2
"""Share of a film's incident cells that the suns of a year meet, roughly."""
SUNS, PHOTONS, FILM_SAMPLES = 128, 1 << 14, 8
"""Largest number of suns; approximate photons of a replicate; directions from a film's cell."""

Amount = tuple[str, str, float]
"""Effect, unit of work, number of units."""


@dataclass(frozen=True)
class Pilot:
    """Pilot of one state of the shade: scene, sensors, suns and accuracy of the evaluation."""

    scene: Scene
    points: np.ndarray
    normals: np.ndarray
    suns: Suns
    accuracy: Accuracy
    bins: tuple[int, int]
    """Number of bins of sky and ground, and of suns."""
    paths: PilotPaths
    cells: float
    """Number of cells of the evaluation."""
    groups: int
    """Number of groups of rooms, each of which lights its own cells."""
    coefficients: xr.Dataset
    """C of the pilot's sensors for the sky and the pilot's suns [sr]."""
    traced: dict[Purpose, dict[str, int]]
    """Number of rays of the pilot by purpose and kind."""
    scale: dict[str, float]
    """Factors from the rays of the pilot to those of the evaluation, by names of the purpose."""
    few: Suns
    """Suns of the pilot."""
    photons: int
    """Number of photons of a sun of the pilot."""
    shared: SharedPaths | None
    """Paths that a pilot of a further state shares, as its evaluation does; None without one."""
    gathers: bool
    """Whether the paths of the sensors are traced for this state."""

    @classmethod
    def of(cls, plan: Plan, state: State, suns: Suns, first: Pilot | None = None) -> Pilot:
        """Trace the pilot of a state, which may share paths with the `first` one.

        Green stands for all colours.
        """
        case, effects = plan.simulated, plan.scope
        scene = load(case, state, 1 if effects.channels else -1, effects)
        points, normals = prepared(case).receivers.at()
        a, rooms = case.accuracy.of_points(len(points)), prepared(case).rooms_of(points)
        patches = len(Patches(case.sky.subdivision)) if effects.sky or effects.ground else 0
        bins = patches, len(suns.labels)
        few = suns.where(np.isin(np.arange(bins[1]), spread(bins[1], SUNS)))
        if first is not None:
            few = _among(first.few, suns)
        paths = PilotPaths.of(scene, points, normals, a, rooms) if any(bins) else PilotPaths()
        some = pilot_sensors(len(points), a, paths.bounces)
        photons = few_photons(a.photons, case.sky.subdivision, patches, len(few.labels))
        photons = photons if first is None else first.photons
        film_samples = min(a.film_sky_samples, FILM_SAMPLES)
        less = {"photons": photons, "film_sky_samples": film_samples, "replicates": REPLICATES}
        shared = None if first is None else first.shared
        if first is None and effects.shade and len(prepared(case).groups):
            shared = SharedPaths()
        before = scene.ray_counter.counted()["path"]
        C = compute(
            scene, points[some], normals[some], few, a.model_copy(update=less),
            subdivision=case.sky.subdivision, shared=shared,
        )  # fmt: skip
        gathers = scene.ray_counter.counted()["path"] > before
        rays = scene.ray_counter.by_purpose()
        cells = paths.cells(a.replicates * a.paths * len(points) * paths.vertices)
        met = max(1.0, paths.met)
        if first is not None and not gathers:
            cells = first.cells
            met = max(1.0, cells) if effects.solved_cells else met
        elif effects.solved_cells:
            cells = _between_cells(rays, ROUNDS[1:]) / (REPLICATES * a.cell_paths)
            met = max(1.0, cells)
        scale = {
            Stream.SENSORS.name: len(points) / len(some),
            Stream.CELLS.name: cells / met,
            Stream.PHOTONS.name: a.photons / photons,
            Stream.FILMS.name + Draw.SKY.name: a.film_sky_samples / film_samples,
            Draw.SUN.name: bins[1] / max(1, len(few.labels)),
            Draw.PEAKS.name: bins[1] / max(1, len(few.labels)),
        }
        return cls(
            scene, points, normals, suns, a, bins, paths, cells,
            len(groups_of(rooms, len(points))), C, rays, scale, few, photons, shared, gathers,
        )  # fmt: skip

    @property
    def count(self) -> int:
        """Number of gather paths of all replicates."""
        return self.accuracy.replicates * self.accuracy.paths * len(self.points)

    @property
    def vertices(self) -> float:
        """Number of vertices of all replicates for which memory is reserved."""
        return self.count * self.paths.bounces

    @property
    def keeps_paths(self) -> bool:
        """Whether the paths of all sensors fit in memory, so that states share them."""
        return self.count * self.paths.vertices <= KEPT

    @property
    def blocks(self) -> int:
        """Number of blocks of sensors that are gathered one after another."""
        most = launch_size.PATHS * USUAL
        return max(-(-len(self.points) // launch_size.SENSORS), ceil(self.vertices / most))

    @cached_property
    def films(self) -> Films | None:
        """Films of the scene, cut into patches."""
        size, suns = 2 * self.accuracy.cell_size, self.suns
        return Films.of(self.scene, size, suns.directions, suns.diameter)

    @property
    def film_values(self) -> float:
        """Number of values of the films' BSDFs that all replicates look up for the suns."""
        suns, own = self.bins[1], self.accuracy.replicates * SAMPLES
        mounts = () if self.films is None else self.films.mounts
        return sum(m.rows * (self._incident(m) if m.bsdf.out_even else own * suns) for m in mounts)

    def _incident(self, mount: Mount) -> float:
        """Number of incident cells that suns meet."""
        return min(INCIDENT * mount.bsdf.out_cells, self.bins[1])

    @cached_property
    def _even_films(self) -> np.ndarray:
        """Whether light of each patch of films is a product, see `Films.even_rows`."""
        assert self.films is not None
        most = FEW_ROWS * self.accuracy.pane_points
        even = np.array([m.exposed and m.rows <= most for m in self.films.mounts])
        return np.asarray(even[self.films.patches.owner])

    @property
    def film_products(self) -> float:
        """Number of products of a replicate that make the light of exposed films."""
        if self.films is None:
            return 0
        n, some = len(self.points), np.unique(self.films.patches.owner[self._even_films])
        products = 0.0
        for mount in (self.films.mounts[i] for i in some):
            products += mount.rows * (n + self.cells) * self.bins[0]
            if mount.bsdf.out_even:
                incident = self._incident(mount)
                products += incident * (mount.rows * (n + self.cells) + n * self.cells)
            else:
                products += mount.rows * n * (self.cells + 2 * self.bins[1])
        return products

    def rays(self) -> Iterator[Amount]:
        """Rays of the evaluation by effect and kind, and the sums of the answers of films."""
        vertices = self.count * self.paths.vertices
        again = 2 - KEPT / max(KEPT, vertices)  # paths beyond the memory are traced twice
        if self.gathers:
            of_sensors = again * self.count * self.paths.rays + self.paths.before
            yield "interreflection", "path", of_sensors
        replicates = self.accuracy.replicates / REPLICATES
        yield "solved_cells", "path", replicates * _between_cells(self.traced)
        for purpose, rays in self.traced.items():
            scale = prod(self.scale.get(name, 1.0) for name in (*purpose, "".join(purpose)))
            if purpose and Stream.SUN_RIMS.name not in purpose:
                scale *= self.accuracy.replicates / REPLICATES
            for effect, share in self._effects(purpose):
                for kind in ("shadow", "pane", "photon"):
                    yield effect, kind, share * scale * rays[kind]
            if Draw.FILMS.name in purpose:
                summed = scale * rays["pane"] * (1 - float(self._even_films.mean()))
                yield "films", "film_sum", summed * sum(self.bins)

    def _effects(self, purpose: Purpose) -> list[tuple[str, float]]:
        """Effects that the rays of a purpose serve, each with its share [–]."""
        stream, draw, *port = (*purpose, "", "")
        if stream in ("", Stream.PHOTONS.name):
            return [("components" if not purpose or port[0] else "pane_to_pane", 1.0)]
        if {Stream.FILMS.name, Draw.FILMS.name, Draw.PEAKS.name} & set(purpose):
            return [("films", 1.0)]
        if Stream.PANES.name in purpose:
            return [("scattering_panes", 1.0)]
        if draw == Draw.SUN.name:
            return [("suns", 1.0)]
        D = self.coefficients["straight"].values[:, : self.bins[0]]
        ground = float(D[:, 0].sum() / max(D.sum(), 1e-30)) if self.scene.effects.sky else 1.0
        return [("sky", 1 - ground), ("ground", ground)]

    def sunlit(self, directions: np.ndarray) -> np.ndarray:
        """Share [–] of a sun's normal illuminance on each sensor, shape (sensor, direction)."""
        some = spread(len(self.points), 2 * SENSORS)
        p, n = flat(self.points[some]), flat(self.normals[some])
        D = sun_deposit(
            self.scene, p, n, suns=directions, diameter=self.suns.diameter, samples=1,
            seed=launch_seed(self.accuracy.seed, Stream.SUN_RIMS),
        )  # fmt: skip
        return np.asarray(D.numpy() / disk_solid_angle(self.suns.diameter))


def few_photons(photons: int, subdivision: int, patches: int, suns: int) -> int:
    """Number of photons of a sun in a pilot of some patches and suns, at most `photons`.

    It is a multiple of what patches of a finer sky divide evenly, so that their number scales, too.
    """
    step = patch_ratio(subdivision) ** 2
    least = PHOTONS / (PATCH * patches / step + suns + 1)
    return min(photons, step * max(1, round(least / step)))


def _among(few: Suns, suns: Suns) -> Suns:
    """Those of a few suns that are among others; where there is none, some of the others."""
    known = set(suns.labels)
    mine = few.where(np.array([label in known for label in few.labels], bool))
    count = len(suns.labels)
    return mine if mine.labels else suns.where(np.isin(np.arange(count), spread(count, SUNS)))


def _between_cells(traced: dict[Purpose, dict[str, int]], rounds: tuple[str, ...] = ROUNDS) -> int:
    """Number of rays from cells to other cells in some rounds."""
    return sum(n["path"] for purpose, n in traced.items() if not {*rounds}.isdisjoint(purpose))
