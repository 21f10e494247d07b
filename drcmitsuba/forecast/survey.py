"""What geometry says of the work in one state of the shade: cells, who sees sky and suns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from drcmitsuba_plugins.isotropic import OUT_DEPTH
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.tensor import TensorTree

from drcmitsuba.accuracy import Accuracy
from drcmitsuba.case import BsdfMaterial, Case
from drcmitsuba.coefficients import BLOCK
from drcmitsuba.coefficients import LANES as PATHS_AT_ONCE
from drcmitsuba.forecast.scout import Scout, Walked, gathered, photon_flights, straight_through
from drcmitsuba.geometry import boxes, rotation
from drcmitsuba.materials import SurfaceMaterial, film, is_diffuse
from drcmitsuba.scene import Scene, State, outline, sensor_points
from drcmitsuba.scope import Scope
from drcmitsuba.suns import Suns
from drcmitsuba.transport.films import SUN_SAMPLES, Films
from drcmitsuba.transport.gather import ROULETTE_DEPTH
from drcmitsuba.transport.panes import PanePatches
from drcmitsuba.transport.photon_paths import WEAK
from drcmitsuba.transport.photons import PATCH
from drcmitsuba.transport.ports import Ports, of_sky, of_suns
from drcmitsuba.transport.shadow_rays import CLUSTER, Openings, candidates

DIRECTIONS = 512
"""Of a whole sphere, to tell what is seen."""
MOST = 128
"""Receivers, and suns, that are looked from and at."""
CELL_POINTS = 10
"""Points on a face of a cell, to count the cells."""
MOST_POINTS = 1 << 16
PHOTONS = 512
"""Starts of photons that are tried on each kind of source and port."""
NEAR = 1e-3
"""Distance in front of a surface that tells where it lies [m]."""
MARGIN = NEAR / 2


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
    lit_by_sky: float
    lit_by_suns: float
    patches: float


class FilmTables(NamedTuple):
    """Tables of what films answer, in one replicate.

    Parameters
    ----------
    sun_rows, sky_rows : int
    evaluated : int
        Samples of f for each sun that may shine on them.
    looking : int
        Rows of the sky's table whose directions are tested for what stands in their way.
    """

    sun_rows: int
    sky_rows: int
    evaluated: int
    looking: int


@dataclass(frozen=True)
class Flown:
    """Photons of one component, or of the panes (""), by one kind of source.

    Parameters
    ----------
    name, kind : str
        Kind of source: "sky" or "sun".
    tried, followed, tests : float
        Photons of a replicate that are drawn, followed, and rays to where they come from.
    flights : float
        Of each one that is followed.
    """

    name: str
    kind: str
    tried: float
    followed: float
    tests: float
    flights: float


@dataclass(frozen=True)
class Survey:
    """One state of a case, as `scope` has it simulated.

    Parameters
    ----------
    case : Case
    state : {"open", "shaded"}
    scope : Scope
    suns : Suns
        That are followed: those that get in.
    """

    case: Case
    state: State
    scope: Scope
    suns: Suns

    @cached_property
    def scene(self) -> Scene:
        """As transport traces it, without what Mitsuba makes of it."""
        return outline(self.case, self.state, self.scope, _cells)

    @cached_property
    def scout(self) -> Scout:
        """The same surfaces for a few rays."""
        return Scout.of(self.scene.parts)

    @property
    def accuracy(self) -> Accuracy:
        """Of the case."""
        return self.case.accuracy

    @cached_property
    def _rng(self) -> np.random.Generator:
        return np.random.default_rng(7)

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
        a = self.accuracy
        size = max(1, min(BLOCK, PATHS_AT_ONCE // (a.replicates * a.paths)))
        return -(-len(self.sensors[0]) // size)

    @cached_property
    def walked(self) -> Walked:
        """Paths of the gather."""
        return gathered(
            self.scout, *self.sensors, depth=self.scope.depth, beyond=self.scope.beyond,
            roulette=ROULETTE_DEPTH, rng=self._rng,
        )  # fmt: skip

    @cached_property
    def cell_points(self) -> tuple[np.ndarray, np.ndarray, int]:
        """Points and normals of some cells, one each, and how many cells there are.

        In the room, all cells that enough vertices fall on; outside of it, where few are met, as
        many as Chao's estimator makes of the cells that the scout's paths met.
        """
        p, n = self._on_surfaces()
        first = self._first_of_cells(p, n)[0]
        a, walked = self.accuracy, self.walked
        met = a.replicates * a.paths * len(self.sensors[0]) * walked.vertices
        count = len(first) * (1 - np.exp(-met / max(1, len(first))))
        outside = ~self._within(walked.p)
        beyond, times = self._first_of_cells(walked.p[outside], walked.n[outside])
        once, twice = (int((times == k).sum()) for k in (1, 2))
        count += len(beyond) + once * (once - 1) / (2 * (twice + 1))
        p = np.concatenate([walked.p[outside][beyond], p[first]])
        n = np.concatenate([walked.n[outside][beyond], n[first]])
        some = self._rng.permutation(len(p))[:MOST]
        if len(beyond) and 0 not in some:  # one outside: no opening spares rays
            some[0] = 0
        return p[some] + NEAR * n[some], n[some], round(count)

    def _on_surfaces(self) -> tuple[np.ndarray, np.ndarray]:
        """Points spread over both sides of the diffuse surfaces that lie in the room."""
        scout, rng, size = self.scout, self._rng, self.accuracy.cell_size
        diffuse = np.array([is_diffuse(m) for m in scout.materials] or [False])
        mine = diffuse[scout.owner] if len(scout.owner) else np.zeros(0, bool)
        corner, u, v, n = (a[mine] for a in (scout.corner, scout.u, scout.v, scout.normal))
        area = np.linalg.norm(np.cross(u, v), axis=1) / 2
        if self.scope.depth == 0 or not area.sum():
            return np.zeros((0, 3)), np.zeros((0, 3))
        count = int(np.clip(CELL_POINTS * area.sum() / size**2, 1024, MOST_POINTS))
        at = rng.choice(len(area), count, p=area / area.sum())
        a, b = rng.random((2, count, 1))
        a, b = np.where(a + b > 1, 1 - a, a), np.where(a + b > 1, 1 - b, b)
        p = corner[at] + a * u[at] + b * v[at]
        p, n = np.concatenate([p, p]), np.concatenate([n[at], -n[at]])
        there = self._within(p + NEAR * n)
        return p[there], n[there]

    def _first_of_cells(self, p: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First point of every cell that points with normals lie in, and how many there are."""
        axis = abs(n).argmax(axis=1)
        side = 2 * axis + (n[np.arange(len(n)), axis] > 0)
        cubes = np.floor((p - self.scene.low) / self.accuracy.cell_size + 0.37).astype(np.int64)
        keys = np.column_stack([cubes, side])
        return np.unique(keys, axis=0, return_index=True, return_counts=True)[1:]

    def _within(self, p: np.ndarray) -> np.ndarray:
        """Which points lie in the room, and in no furniture; all of them without a room."""
        case, local = self.case, p @ rotation(self.case)
        if case.room is None:
            return np.ones(len(p), bool)
        there = ((local > -MARGIN) & (local < np.array(case.room.size) + MARGIN)).all(axis=1)
        for piece in case.furniture if len(case.furniture) < MOST else ():
            if piece.size[2] > 0:
                for corner, size in boxes(piece):
                    inside = (local > corner + MARGIN) & (local < corner + size - MARGIN)
                    there &= ~inside.all(axis=1)
        return there

    def seen(self, kind: str) -> Seen:
        """What "sensors", "cells" or "faces" of scattering panes or films see."""
        p, n, count = self._receivers(kind)
        if not len(p):
            return Seen(0, 0, 0, 0, 0, 0, 0, 0)
        openings = self._openings(p)
        if openings is not None and len(openings.quads) == 0:
            return Seen(count, 0, 0, 0, 0, 0, 0, 0)
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
            tried=len(rows) * CLUSTER / len(p), lit_by_sky=float(seen.any(axis=1).mean()),
            lit_by_suns=float(suns.any(axis=1).mean()), patches=min(1.0, float(patches)),
        )  # fmt: skip

    def _receivers(self, kind: str) -> tuple[np.ndarray, np.ndarray, int]:
        if kind == "cells":
            return self.cell_points
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
        if room is None:
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

    def film_tables(self) -> FilmTables:
        """Tables of all films."""
        films = self.films
        if films is None:
            return FilmTables(0, 0, 0, 0)
        rows = sum(mount.rows for mount in films.mounts)
        evaluated = sum(
            m.rows * SUN_SAMPLES["even" if m.bsdf.out_even else "uneven"] for m in films.mounts
        )
        sky = int(films.first_sky_rows()[-1])
        looking = sum(
            films.mounts[owner].rows
            for owner in films.patches.owner
            if not films.mounts[owner].exposed
        )
        return FilmTables(rows, sky, evaluated, looking)

    def looks(self, patches: PanePatches, kind: str) -> float:
        """Rays towards patches that a receiver traces for each one that is asked for."""
        p, n, count = self._receivers(kind)
        if not count:
            return 0.0
        rng = self._rng
        at = rng.choice(len(patches), 64, p=patches.area / patches.area.sum())
        a, b = rng.random((2, 64, 1))
        y = patches.corner[at] + a * patches.u[at] + b * patches.v[at]
        way = y[None] - p[:, None]
        distance = np.maximum(np.linalg.norm(way, axis=2), 1e-3)
        way = way / distance[..., None]
        cosine = np.einsum("pyi,pi->py", way, n)
        pane = abs(np.einsum("pyi,yi->py", way, patches.normal[at]))
        by_cosine = np.maximum(cosine, 0) * pane * patches.area.sum() / (np.pi * distance**2)
        return float((cosine > 0).mean() + np.minimum(by_cosine.mean(axis=1), 1).mean())

    def photons(self) -> list[Flown]:
        """Photons of one replicate."""
        found = []
        for ports in Ports.of(self.scene) if self.scene.followed else ():
            found.append(self._flown(ports, "sky"))
            found.append(self._flown(ports, "sun"))
        return found

    def _flown(self, ports: Ports, kind: str) -> Flown:
        rng, a = self._rng, self.accuracy
        if kind == "sky":
            sources = of_sky(self.subdivision or 1)
            followed = np.array([self.scope.ground, *[self.scope.sky] * (self.patches - 1)], bool)
            followed = followed[: self.patches]
        else:
            sources = of_suns(self.suns.directions, self.suns.diameter)
            followed = np.ones(len(self.suns.directions), bool)
        could = ports.could(sources)[: len(followed)] * followed[:, None]
        seen = np.flatnonzero(could.any(axis=1))
        tried = len(seen) * a.photons * (PATCH if kind == "sky" else 1)
        if not len(seen):
            return Flown(ports.name, kind, 0.0, 0.0, 0.0, 0.0)
        source = seen[rng.integers(len(seen), size=PHOTONS)]
        share = could[source] / could[source].sum(axis=1, keepdims=True)
        port = (share.cumsum(axis=1) > rng.random((PHOTONS, 1))).argmax(axis=1)
        corner, u, v = ports.edges
        x, y = rng.random((2, PHOTONS, 1))
        p = corner[port] + x * u[port] + y * v[port]
        d = sources.centre[source] + sources.radius[source, None] * _ball(PHOTONS, rng)
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        faces = (d * ports.normal[port]).sum(axis=1) < 0
        if ports.in_line:
            faces &= ~_passed(ports, p, d)
        p, d = p[faces] + NEAR * d[faces], d[faces]
        free = straight_through(self.scout, p, d)
        flights = photon_flights(
            self.scout, p[free], -d[free], name=ports.name, weak=WEAK, limit=a.photon_surfaces,
            rng=rng,
        )  # fmt: skip
        tests = 0.0 if ports.exposed else tried * float(faces.mean())
        return Flown(ports.name, kind, tried, tried * float(free.sum()) / PHOTONS, tests, flights)


def _passed(ports: Ports, p: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Whether light from directions d (ray, 3) has passed another port before it comes to p."""
    corner, u, v = ports.edges
    n, area = ports.normal, ports.area[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = ((corner * n).sum(axis=1) - p @ n.T) / (d @ n.T)
        at = p[:, None] + t[..., None] * d[:, None] - corner
        x = (at * (np.cross(v, n) / area)).sum(axis=2)
        y = (at * (np.cross(n, u) / area)).sum(axis=2)
    before = (d @ n.T < 0) & (t > NEAR) & (x >= 0) & (x < 1) & (y >= 0) & (y < 1)
    return np.asarray(before.any(axis=1))


class _OutCells(NamedTuple):
    """What is to be known of a film's plugin: its outgoing cells."""

    out_cells: int
    out_even: bool = True
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)


def _cells(material: SurfaceMaterial) -> _OutCells | None:
    """Outgoing cells of a film, as the plugins number them."""
    if not isinstance(material, BsdfMaterial):
        return None
    file = film(material.file).file
    if file.kind == "TensorTree3":
        return _OutCells(1 << 2 * OUT_DEPTH, False)
    parts = file.components.values()
    return _OutCells(max(1 << 2 * c.depth if isinstance(c, TensorTree) else len(c.incident)
                         for c in parts))  # fmt: skip


def _sphere(count: int) -> np.ndarray:
    """Directions spread evenly over the sphere (Fibonacci's lattice)."""
    i = np.arange(count) + 0.5
    z, turn = 1 - 2 * i / count, np.pi * (1 + np.sqrt(5)) * i
    level = np.sqrt(1 - z * z)
    return np.column_stack([level * np.cos(turn), level * np.sin(turn), z])


def _ball(count: int, rng: np.random.Generator) -> np.ndarray:
    """Points in the unit ball."""
    d = rng.standard_normal((count, 3))
    radius = np.cbrt(rng.random((count, 1)))
    return d / np.linalg.norm(d, axis=1, keepdims=True) * radius
