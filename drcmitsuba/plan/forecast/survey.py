"""What geometry says of the work in one state of the shade: cells, who sees sky and suns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.plan.forecast.cells import MOST, NEAR, CellCount
from drcmitsuba.plan.forecast.film_tables import FilmTables, out_cells, tables_of
from drcmitsuba.plan.forecast.scout import Scout
from drcmitsuba.plan.forecast.walks import Walked, gathered, straight_through
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.scene import Scene, outline
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.scene.surfaces import State
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import BLOCK
from drcmitsuba.transport.coefficients import LANES as PATHS_AT_ONCE
from drcmitsuba.transport.films import Films
from drcmitsuba.transport.gather import PILOT, USUAL, WHITE, reflectance_of
from drcmitsuba.transport.panes import PanePatches
from drcmitsuba.transport.shadow_rays import CLUSTER, Openings, candidates

DIRECTIONS = 512
"""Of a whole sphere, to tell what is seen."""
TRIED = 256
"""Rays that tell how many get out."""
POINTS = 64
"""On panes, to tell how many rays look at them."""


@dataclass(frozen=True)
class Seen:
    """What receivers see of the sky and of suns.

    Parameters
    ----------
    count : float
        Receivers.
    sky, ground : float
        Share of the rays by the cosine law that are traced to the sky, and below the horizon.
    suns : float
        Share of the pairs of receiver and sun whose rays are traced.
    tried : float
        Lanes that are launched for each receiver and ray to every sun.
    free : float
        Share of the rays that are traced which get out, by clear panes if there are any.
    lit_by_sky, lit_by_suns : float
        Shares of the receivers that see any sky, any sun.
    patches : float
        Bins of the sky that are seen at all, relative to all.
    """

    count: float
    sky: float
    ground: float
    suns: float
    tried: float
    free: float
    lit_by_sky: float
    lit_by_suns: float
    patches: float


@dataclass(frozen=True)
class Survey:
    """One state of a case, as `scope` has it simulated.

    Parameters
    ----------
    case : Case
    state : {"open", "shaded"}
    scope : EnabledEffects
    suns : Suns
        That are followed: those that get in.
    """

    case: Case
    state: State
    scope: EnabledEffects
    suns: Suns

    @cached_property
    def scene(self) -> Scene:
        """As transport traces it, without what Mitsuba makes of it."""
        return outline(self.case, self.state, self.scope, out_cells)

    @cached_property
    def scout(self) -> Scout:
        """The same surfaces for a few rays."""
        return Scout.of(self.scene.parts)

    @property
    def accuracy(self) -> Accuracy:
        """Of the case."""
        return self.case.accuracy

    @cached_property
    def sensors(self) -> tuple[np.ndarray, np.ndarray]:
        """Points and normals of all sensors."""
        return sensor_points(self.case)

    @property
    def subdivision(self) -> int:
        """Of the sky; 0 where neither sky nor ground is simulated."""
        return self.case.sky.subdivision if self.scope.sky or self.scope.ground else 0

    @property
    def patches(self) -> int:
        """Bins of sky and ground that are followed."""
        return self.patches_of_sky if self.subdivision else 0

    @property
    def patches_of_sky(self) -> int:
        """Bins of sky and ground in the case."""
        return len(Patches(self.case.sky.subdivision))

    @property
    def blocks(self) -> int:
        """Blocks of sensors."""
        return -(-len(self.sensors[0]) // self.block)

    @property
    def block(self) -> int:
        """Sensors that are gathered at once."""
        a = self.accuracy
        lanes = int(PATHS_AT_ONCE * USUAL / self.bounces)
        return min(len(self.sensors[0]), max(1, min(BLOCK, lanes // (a.replicates * a.paths))))

    @property
    def is_white(self) -> bool:
        """Whether vertices of some paths are counted first, see `gather.expected_bounces`."""
        return max(map(reflectance_of, self.scene.parts), default=0.0) >= WHITE

    @property
    def bounces(self) -> float:
        """Vertices of a path that there is room for."""
        return max(USUAL, 1.2 * self.walked.vertices) if self.is_white else USUAL

    @property
    def pilots(self) -> int:
        """Paths whose vertices are counted first; twice where there are more than is usual."""
        if not self.is_white:
            return 0
        times = 2 if self.walked.vertices > USUAL else 1
        return times * min(PILOT, len(self.sensors[0])) * self.accuracy.paths

    @cached_property
    def walked(self) -> Walked:
        """Paths of the gather."""
        return gathered(
            self.scout, *self.sensors, depth=self.scope.depth, beyond=self.scope.beyond,
            rng=np.random.default_rng(7),
        )  # fmt: skip

    @cached_property
    def cells(self) -> tuple[np.ndarray, np.ndarray, int]:
        """Points and normals of some cells, and how many there are."""
        a = self.accuracy
        met = a.replicates * a.paths * len(self.sensors[0]) * self.walked.vertices
        low, rng = self.scene.low, np.random.default_rng(13)
        return CellCount(self.case, self.scout, self.walked, low, met, rng).points()

    def seen(self, kind: str) -> Seen:
        """What "sensors", "cells", or "faces" of diffusing panes or "film faces" see."""
        if kind not in self._seen:
            self._seen[kind] = self._look(kind)
        return self._seen[kind]

    @cached_property
    def _seen(self) -> dict[str, Seen]:
        return {}

    def _look(self, kind: str) -> Seen:
        p, n, count = self._receivers(kind)
        if not len(p):
            return Seen(0, 0, 0, 0, 0, 0, 0, 0, 0)
        openings = self._openings(p)
        if openings is not None and len(openings.quads) == 0:
            return Seen(count, 0, 0, 0, 0, 0, 0, 0, 0)
        d = _sphere(DIRECTIONS)
        cosines = np.maximum(n @ d.T, 0) * (4 / DIRECTIONS)
        passes = self._passes(openings, p, d)
        up = d[:, 2] >= 0
        by_sky = cosines * passes * (up & self.scope.sky)
        by_ground = cosines * passes * (~up & self.scope.ground)
        seen = (by_sky + by_ground) > 0
        at = self._some_suns
        suns = (n @ at.T > 0) & self._passes(openings, p, at)
        rows = np.zeros(0, int)
        if len(at):
            rows = candidates(openings, p, n, self.suns.directions, self._radius)[0]
        patches = seen.any(axis=0).sum() / (DIRECTIONS / 2)
        return Seen(
            count=count, sky=float(by_sky.sum(axis=1).mean()),
            ground=float(by_ground.sum(axis=1).mean()), suns=float(suns.mean()) if len(at) else 0.0,
            tried=len(rows) * CLUSTER / len(p), free=self._free(p, d, seen),
            lit_by_sky=float(seen.any(axis=1).mean()),
            lit_by_suns=float(suns.any(axis=1).mean()), patches=min(1.0, float(patches)),
        )  # fmt: skip

    def _free(self, p: np.ndarray, d: np.ndarray, traced: np.ndarray) -> float:
        """Share of rays (receiver, direction) that are traced and get out; of some of them."""
        rows, columns = np.nonzero(traced)
        if not len(rows):
            return 0.0
        some = np.random.default_rng(19).integers(len(rows), size=TRIED)
        return float(straight_through(self.scout, p[rows[some]], d[columns[some]]).mean())

    def _receivers(self, kind: str) -> tuple[np.ndarray, np.ndarray, int]:
        if kind == "cells":
            return self.cells
        if kind == "sensors":
            p, n = self.sensors
            some = np.linspace(0, len(p) - 1, min(MOST, len(p))).round().astype(int)
            return p[some], n[some], len(p)
        patches = self.pane_patches if kind == "faces" else self.film_patches
        if patches is None:
            return np.zeros((0, 3)), np.zeros((0, 3)), 0
        middle = patches.corner + (patches.u + patches.v) / 2
        some = np.linspace(0, len(middle) - 1, min(MOST, len(middle))).round().astype(int)
        n = patches.normal[some]
        p = np.concatenate([middle[some] + NEAR * n, middle[some] - NEAR * n])
        return p, np.concatenate([n, -n]), 2 * len(patches)

    def _openings(self, p: np.ndarray) -> Openings | None:
        room = self.scene.enclosure
        if room is None or not room.spares:
            return None
        local = p @ room.turn
        contained = ((local > -1e-5) & (local < room.size + 1e-5)).all()
        return Openings(room.openings) if contained else None

    def _passes(self, openings: Openings | None, p: np.ndarray, d: np.ndarray) -> np.ndarray:
        if openings is None:
            return np.ones((len(p), len(d)), bool)
        return openings.reached(p, d, np.zeros(len(d)))

    @property
    def _radius(self) -> float:
        return float(np.radians(self.suns.diameter) / 2)

    @cached_property
    def _some_suns(self) -> np.ndarray:
        count = len(self.suns.directions)
        some = np.linspace(0, count - 1, min(2 * MOST, count)).round().astype(int)
        return self.suns.directions[some]

    @cached_property
    def pane_patches(self) -> PanePatches | None:
        """Patches of the panes that scatter evenly."""
        quads = [panes.quads for panes in self.scene.scattering]
        return PanePatches.of(quads, 2 * self.accuracy.cell_size) if quads else None

    @cached_property
    def films(self) -> Films | None:
        """Films cut into patches."""
        return Films.of(
            self.scene, 2 * self.accuracy.cell_size, self.suns.directions, self.suns.diameter
        )

    @property
    def film_patches(self) -> PanePatches | None:
        """Patches of the films."""
        return None if self.films is None else self.films.patches

    @property
    def film_tables(self) -> FilmTables:
        """Tables of all films."""
        return tables_of(self.films)

    def looks(self, patches: PanePatches, kind: str) -> float:
        """Rays towards patches that a receiver traces for each one that is asked for."""
        p, n, count = self._receivers(kind)
        if not count:
            return 0.0
        rng = np.random.default_rng(17)
        at = rng.choice(len(patches), POINTS, p=patches.area / patches.area.sum())
        a, b = rng.random((2, POINTS, 1))
        y = patches.corner[at] + a * patches.u[at] + b * patches.v[at]
        way = y[None] - p[:, None]
        distance = np.maximum(np.linalg.norm(way, axis=2), 1e-3)
        way = way / distance[..., None]
        cosine = np.einsum("pyi,pi->py", way, n)
        pane = abs(np.einsum("pyi,yi->py", way, patches.normal[at]))
        by_cosine = np.maximum(cosine, 0) * pane * patches.area.sum() / (np.pi * distance**2)
        return float((cosine > 0).mean() + np.minimum(by_cosine.mean(axis=1), 1).mean())


def _sphere(count: int) -> np.ndarray:
    """Directions spread evenly over the sphere (Fibonacci's lattice)."""
    i = np.arange(count) + 0.5
    z, turn = 1 - 2 * i / count, np.pi * (1 + np.sqrt(5)) * i
    level = np.sqrt(1 - z * z)
    return np.column_stack([level * np.cos(turn), level * np.sin(turn), z])
