"""A pilot of one state of a case: transport itself, on few sensors, suns and photons.

Only this module of the forecast calls transport. The evaluation uses the same kernels, so none is
compiled in vain. The scene counts the rays, which are scaled to all sensors, suns and photons.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import mitsuba as mi
import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.plan.planning import Plan
from drcmitsuba.runtime.random_streams import Draw, Stream, launch_seed
from drcmitsuba.runtime.ray_counter import Purpose
from drcmitsuba.scene.scene import Scene, load
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.scene.surfaces import State
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport import launch_size
from drcmitsuba.transport.cells import Grid
from drcmitsuba.transport.coefficients import compute, straight_suns
from drcmitsuba.transport.diffusing_panes import PanePatches
from drcmitsuba.transport.films import SUN_SAMPLES, Films
from drcmitsuba.transport.gather import USUAL, expected_bounces, gather
from drcmitsuba.transport.gather_blocks import KEPT
from drcmitsuba.transport.photons import PATCH
from drcmitsuba.transport.shadow_rays import sun_deposit

REPLICATES = 2
"""Number of replicates of a pilot: the smallest that has a standard error."""
SENSORS, RAYS, VERTICES = 48, 1 << 20, 1 << 16
"""Largest numbers of sensors and of their rays to the sky; approximate number of vertices."""
SUNS, PHOTONS, FILM_SAMPLES = 128, 1 << 14, 8
"""Largest number of suns; approximate photons of a replicate; directions from a film's cell."""
ANSWERED = 0.9
"""Part of the rays to films that reach the film."""

Amount = tuple[str, str, float]
"""Effect, unit of work, number of units."""


class Paths(NamedTuple):
    """Paths of the gather.

    Parameters
    ----------
    rays, vertices : float
        Mean number of rays and of diffuse vertices of one path.
    before : int
        Number of rays that measure the length of paths first, where surfaces are white.
    bounces : float
        Number of vertices of one path for which memory is reserved.
    times : np.ndarray, shape (cell,)
        Number of vertices in each cell that the pilot met.
    """

    rays: float = 0.0
    vertices: float = 0.0
    before: int = 0
    bounces: float = USUAL
    times: np.ndarray = np.zeros(0, int)

    @classmethod
    def of(cls, scene: Scene, points: np.ndarray, normals: np.ndarray, a: Accuracy) -> Paths:
        """Trace the paths of the pilot's sensors, as `compute` does."""
        if scene.effects.depth == 0:
            return cls()
        grid, counted = Grid.of(scene, a.cell_size), scene.ray_counter.counted
        seed = launch_seed(a.seed, Stream.PATH_LENGTHS)
        start = counted()["path"]
        bounces = expected_bounces(scene, points, normals, a.paths, grid, seed)
        before = counted()["path"]
        some = pilot_sensors(len(points), a, bounces)
        vertices = gather(
            scene, points[some], normals[some], replicates=REPLICATES, paths=a.paths, grid=grid,
            seed=launch_seed(a.seed, Stream.PATHS), bounces=bounces,
        )  # fmt: skip
        rays = counted()["path"] - before
        traced = REPLICATES * len(some) * a.paths
        times = np.unique(vertices.key.numpy(), return_counts=True)[1]
        return cls(rays / traced, len(vertices) / traced, before - start, bounces, times)

    def cells(self, vertices: float) -> float:
        """Number of cells that this number of vertices meets, by Chao's estimator [1]_.

        References
        ----------
        .. [1] A. Chao et al., "Rarefaction and extrapolation with Hill numbers", 2014, eq. (9).
        """
        n, once, twice = self.times.sum(), (self.times == 1).sum(), (self.times == 2).sum()
        unseen = once * once / (2 * twice) if twice else once * (once - 1) / 2
        share = once / max(1, n * unseen + once)
        return float(len(self.times) + unseen * (1 - (1 - share) ** max(0.0, vertices - n)))


@dataclass(frozen=True)
class Pilot:
    """Pilot of one state of the shade.

    Parameters
    ----------
    scene : Scene
    points, normals : np.ndarray, shape (sensor, 3)
        Positions [m] and normals of all sensors.
    suns : Suns
        All suns that the evaluation simulates.
    bins : tuple of int
        Number of bins of sky and ground, and of suns.
    accuracy : Accuracy
        Accuracy of the case.
    paths : Paths
    coefficients : xr.Dataset
        C of the pilot's sensors for the sky and the pilot's suns [sr].
    rays : dict of Purpose to dict of str to int
        Number of rays of the pilot by purpose and kind.
    scale : dict of str to float
        Factors from the rays of the pilot to those of the evaluation, by names of the purpose.
    """

    scene: Scene
    points: np.ndarray
    normals: np.ndarray
    suns: Suns
    bins: tuple[int, int]
    accuracy: Accuracy
    paths: Paths
    coefficients: xr.Dataset
    rays: dict[Purpose, dict[str, int]]
    scale: dict[str, float]

    @classmethod
    def of(cls, plan: Plan, state: State, suns: Suns) -> Pilot:
        """Trace the pilot of a state; green stands for all colours."""
        case, effects, a = plan.simulated, plan.scope, plan.simulated.accuracy
        scene = load(case, state, 1 if effects.channels else -1, effects)
        points, normals = sensor_points(case)
        patches = len(Patches(case.sky.subdivision)) if effects.sky or effects.ground else 0
        bins = patches, len(suns.labels)
        few = suns.where(np.isin(np.arange(bins[1]), spread(bins[1], SUNS)))
        paths = Paths.of(scene, points, normals, a) if any(bins) else Paths()
        some = pilot_sensors(len(points), a, paths.bounces)
        photons = max(1, PHOTONS // (PATCH * patches + len(few.labels) + 1))
        less = {"photons": photons, "film_sky_samples": FILM_SAMPLES}
        less = {name: min(number, getattr(a, name)) for name, number in less.items()}
        pilot = a.model_copy(update={**less, "replicates": REPLICATES})
        C = compute(
            scene, points[some], normals[some], few, pilot, subdivision=case.sky.subdivision
        )
        whole = a.replicates * a.paths * len(points) * paths.vertices
        scale = {
            Stream.SENSORS.name: len(points) / len(some),
            Stream.CELLS.name: paths.cells(whole) / max(1, len(paths.times)),
            Stream.PHOTONS.name: a.photons / less["photons"],
            "answers": a.film_sky_samples / less["film_sky_samples"],
            Draw.SUN.name: bins[1] / max(1, len(few.labels)),
            Draw.PEAKS.name: bins[1] / max(1, len(few.labels)),
        }
        rays = scene.ray_counter.by_purpose()
        return cls(scene, points, normals, suns, bins, a, paths, C, rays, scale)

    @property
    def count(self) -> int:
        """Number of gather paths of all replicates."""
        return self.accuracy.replicates * self.accuracy.paths * len(self.points)

    @property
    def cells(self) -> float:
        """Number of cells of the evaluation."""
        return self.paths.cells(self.count * self.paths.vertices)

    @property
    def block(self) -> int:
        """Number of sensors that are gathered at once."""
        a = self.accuracy
        most = int(launch_size.PATHS * USUAL / self.paths.bounces) // (a.replicates * a.paths)
        return min(len(self.points), max(1, min(launch_size.SENSORS, most)))

    @cached_property
    def films(self) -> Films | None:
        """Films of the scene, cut into patches."""
        size, suns = 2 * self.accuracy.cell_size, self.suns
        return Films.of(self.scene, size, suns.directions, suns.diameter)

    @property
    def film_rows(self) -> tuple[float, float, float]:
        """Number of rows of the films' tables, by sky and by suns; values of f for each sun."""
        if self.films is None:
            return 0, 0, 0
        mounts = self.films.mounts
        values = (m.rows * SUN_SAMPLES["even" if m.bsdf.out_even else "uneven"] for m in mounts)
        return int(self.films.first_sky_rows()[-1]), sum(m.rows for m in mounts), sum(values)

    @cached_property
    def faces(self) -> int:
        """Number of faces of the patches of panes that scatter evenly."""
        quads = [panes.quads for panes in self.scene.scattering]
        return 2 * len(PanePatches.of(quads, 2 * self.accuracy.cell_size)) if quads else 0

    @property
    def scatters(self) -> bool:
        """Whether a pane or component sends light on in new directions."""
        return bool(self.faces) or self.films is not None or self.scene.followed

    @cached_property
    def seen(self) -> tuple[float, float, float]:
        """Shares [–] of pairs of sensor and sky bin, and of sensor and sun, that see each other;
        share of the ground in the light of sky and ground."""  # noqa: D209
        D = np.split(self.coefficients["straight"].values, [-min(self.bins[1], SUNS)], axis=1)
        sky, sun = (part if part.size else np.zeros((1, 1)) for part in D)
        ground = float(sky[:, 0].sum() / max(sky.sum(), 1e-30))
        return float((sky > 0).mean()), float((sun > 0).mean()), ground

    def traced(self) -> Iterator[Amount]:
        """Rays and lanes of the evaluation, by effect."""
        lanes, paths = self.scene.ray_counter.lanes, self.paths
        vertices = self.count * paths.vertices
        again = 2 - KEPT / max(KEPT, vertices)  # paths beyond the memory are traced twice
        yield "interreflection", "path", again * self.count * paths.rays + paths.before
        for purpose, rays in self.rays.items():
            stream, draw = (*purpose, "", "")[:2]
            shadow, pane, photon = rays["shadow"], rays["pane"], rays["photon"]
            answers = (stream, draw) == (Stream.FILMS.name, Draw.SKY.name)
            names = (*purpose, "answers") if answers else purpose
            scale = self.accuracy.replicates / REPLICATES if purpose else 1.0
            scale *= float(np.prod([self.scale.get(name, 1.0) for name in names]))
            for effect, share in self._effects(purpose):
                some = share * scale
                yield effect, "shadow", some * shadow
                yield effect, "pane", some * pane
                yield effect, "photon", some * photon
                yield effect, "look", some * lanes[purpose, "pane"]
                yield effect, "start", some * lanes[purpose, "photon"]
                if draw == Draw.FILMS.name and self.films is not None:
                    bins = self.bins[0] + len(self.films.suns)
                    yield effect, "film_sum", ANSWERED * some * pane * bins
                if stream != Stream.PHOTONS.name and purpose and not answers:
                    lane = "sky_lane" if draw == Draw.SKY.name else "sun_lane"
                    yield effect, lane, some * lanes[purpose, "shadow"]
                    yield effect, "pierced", some * shadow * (self.scene.clear is not None)

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
        ground = self.seen[2] if self.scene.effects.sky else 1.0
        return [("sky", 1 - ground), ("ground", ground)]

    def straight(self, suns: Suns) -> float:
        """Number of shadow rays of all sensors to suns that give straight light only."""
        few = suns.where(np.isin(np.arange(len(suns.labels)), spread(len(suns.labels), SUNS)))
        some = pilot_sensors(len(self.points), self.accuracy, USUAL)
        before = self.scene.ray_counter.counted()["shadow"]
        straight_suns(self.scene, self.points[some], self.normals[some], few, self.accuracy)
        rays = self.scene.ray_counter.counted()["shadow"] - before
        return rays * len(self.points) / len(some) * len(suns.labels) / max(1, len(few.labels))

    def sunlit(self, directions: np.ndarray) -> np.ndarray:
        """Share [–] of a sun's normal illuminance on each sensor, shape (sensor, direction)."""
        some = spread(len(self.points), 2 * SENSORS)
        p, n = (mi.Float(x[some].astype(np.float32).ravel()) for x in (self.points, self.normals))
        D = sun_deposit(
            self.scene, p, n, suns=directions, diameter=self.suns.diameter, samples=1,
            seed=launch_seed(self.accuracy.seed, Stream.SUN_RIMS),
        )  # fmt: skip
        return np.asarray(D.numpy() / disk_solid_angle(self.suns.diameter))


def spread(count: int, most: int) -> np.ndarray:
    """Evenly spread indices below `count`: at most `most`, and at least one."""
    return np.linspace(0, count - 1, min(count, max(1, most))).round().astype(int)


def pilot_sensors(count: int, a: Accuracy, bounces: float) -> np.ndarray:
    """Indices of the pilot's sensors among all `count` sensors."""
    by_paths = int(VERTICES / (REPLICATES * a.paths * bounces))
    return spread(count, min(SENSORS, RAYS // a.sensor_sky_rays, by_paths))
