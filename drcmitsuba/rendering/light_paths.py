"""Light paths of a picture: what its pixels see, and what lights the surfaces that they show.

All of a picture that does not depend on the hour: for each ray from the eye where it leaves the
scene, the pane that glows, and the first diffuse surface with rays to other surfaces, to the sky
and to the panes. A picture of an hour is a sum over these paths, without tracing again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.picture.view import PictureView
from drcmitsuba.rendering.eye_paths import EyePaths, follow
from drcmitsuba.rendering.glow import Glow
from drcmitsuba.rendering.sky_rays import Windows, sky_rays
from drcmitsuba.rendering.surface_light import SurfaceLight, base_deposit
from drcmitsuba.rendering.view_rays import pixel_rays
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.cell_points import Drawn, draw_all
from drcmitsuba.transport.cells import Cells, Grid, Vertices
from drcmitsuba.transport.gather import gather
from drcmitsuba.transport.gather_blocks import Gathered, with_weights
from drcmitsuba.transport.openings import in_rooms
from drcmitsuba.transport.solved_cells import solved

LANES = 1 << 18
"""Number of rays from the eye in one launch."""


@dataclass(frozen=True)
class Sampling:
    """Numbers of rays of a picture."""

    samples: int = 8
    """Rays from the eye in each pixel, a multiple of the number of replicates."""
    paths: int = 16
    """Rays from each surface that a ray shows to other surfaces."""
    sky: int = 8
    """Rays from each such surface to the sky."""
    panes: int = 16
    """Points on scattering panes, and as many directions to them, for each such surface."""

    def __post_init__(self) -> None:
        for name, most in (("samples", 1 << 16), ("paths", 256), ("sky", 256), ("panes", 256)):
            if not 1 <= (got := getattr(self, name)) <= most:
                raise InputError("sampling", name, str(got), f"give 1 to {most}")

    def rounded(self, replicates: int) -> Sampling:
        """Return the same with as many samples as replicates, or a multiple."""
        return replace(self, samples=-(-self.samples // replicates) * replicates)


@dataclass(frozen=True)
class Paths:
    """Light paths of some pixels, as flat arrays; a `slot` is pixel · replicates + replicate."""

    first: int
    """First slot of these pixels."""
    slots: int
    """Number of slots."""
    through_slot: np.ndarray
    through_d: np.ndarray
    through: np.ndarray
    """Rays that leave the scene straight: direction (ray, 3) and weight."""
    mirrored_slot: np.ndarray
    mirrored_d: np.ndarray
    mirrored: np.ndarray
    """Rays that leave it by mirrors."""
    pane_slot: np.ndarray
    pane_at: np.ndarray
    pane: np.ndarray
    """Rays that meet a scattering pane: entry of the glow's table, and weight."""
    slot: np.ndarray
    p: np.ndarray
    n: np.ndarray
    weight: np.ndarray
    """Surfaces that rays show: points [m] and normals (surface, 3), and weight of E/π."""
    gather_surface: np.ndarray
    gather_cell: np.ndarray
    gather: np.ndarray
    """Rays to other surfaces: index of the surface, cell, and irradiance per irradiance. Rays that
    end at once are as many for each surface, and need no index."""
    sky_bin: np.ndarray
    sky: np.ndarray
    """Rays to the sky, as many for each surface: bin and irradiance [sr]."""
    look_at: np.ndarray
    look: np.ndarray
    """Looks at panes (column, surface, ray): entry of the glow's table and irradiance [sr]."""

    @property
    def nbytes(self) -> int:
        """Size in memory [bytes]."""
        return sum(np.asarray(getattr(self, f.name)).nbytes for f in fields(self))


@dataclass(frozen=True)
class TracedView:
    """Light paths of a whole picture, and the light on the surfaces of its scene."""

    scene: Scene
    view: PictureView
    """View in the frame in which the scene is traced."""
    rows: int
    columns: int
    sampling: Sampling
    light: SurfaceLight
    glow: Glow
    tiles: Callable[[], Iterator[Paths]]
    """Gives the light paths of all pixels, some at a time."""


def _flat(values: mi.Point3f) -> np.ndarray:
    return np.asarray(dr.ravel(values).numpy()).reshape(-1, 3)


_Surfaces = tuple[
    np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray,
    np.ndarray, np.ndarray,
]  # fmt: skip


class _Tracer:
    """Traces the pixels of a view, some at a time, and collects the cells that they meet."""

    def __init__(
        self, scene: Scene, view: PictureView, rows: int, columns: int, sampling: Sampling,
        accuracy: Accuracy, subdivision: int, glow: Glow,
    ):  # fmt: skip
        self.scene, self.view, self.rows, self.columns = scene, view, rows, columns
        self.sampling, self.accuracy, self.subdivision, self.glow = (
            sampling, accuracy, subdivision, glow,
        )  # fmt: skip
        self.windows, self.once = Windows.of(scene), scene.effects.solved_cells
        self.grid = Grid.of(scene, accuracy.cell_size)
        self.cells = Cells.none(self.grid)
        self.drawn: tuple[Drawn | None, ...] = (None,) * accuracy.replicates
        self.seen = mi.Float64()
        inside = in_rooms(scene, np.array([view.position]))
        self.in_room = None if inside is None else bool(inside[0])

    def _seed(self, stream: Stream) -> int:
        return launch_seed(self.accuracy.seed, stream)

    def pixels(self) -> Iterator[slice]:
        """Pixels of each launch."""
        count, step = self.rows * self.columns, max(1, LANES // self.sampling.samples)
        return (slice(i, min(i + step, count)) for i in range(0, count, step))

    def paths(self, here: slice) -> Paths:
        """Trace the light paths of some pixels."""
        s, R = self.sampling.samples, self.accuracy.replicates
        lane = dr.arange(mi.UInt32, (here.stop - here.start) * s)
        lane += dr.opaque(mi.UInt32, here.start * s)
        seed = self._seed(Stream.EYE_PATHS)
        d, exists = pixel_rays(self.view, self.rows, self.columns, lane, s, seed)
        eye = dr.opaque(mi.Point3f, list(map(float, self.view.position)))
        with self.scene.ray_counter.purpose(Stream.EYE_PATHS.name):
            seen = follow(self.scene, eye, d, exists, lane, s, seed)
        dr.eval(seen)
        slot = (lane // s) * R + lane % s // (s // R)

        def some(weight: mi.Float) -> mi.UInt32:
            return dr.compress(weight > 0)

        through, mirrored, pane = (some(w) for w in (seen.through, seen.mirrored, seen.pane))
        at, glows = mi.UInt32(), mi.Float()
        if dr.width(pane):
            o, towards = (dr.gather(type(x), x, pane) for x in (seen.pane_o, seen.pane_d))
            at, glows = self.glow.seen(o, towards, dr.gather(mi.Float, seen.pane, pane))

        def of(index: mi.UInt32, values: Any) -> np.ndarray:
            return np.asarray(dr.gather(type(values), values, index).numpy())

        def directions(index: mi.UInt32, of_rays: mi.Vector3f) -> np.ndarray:
            return _flat(dr.gather(mi.Vector3f, of_rays, index))

        surface = some(seen.weight)
        first, slots = here.start * R, (here.stop - here.start) * R
        return Paths(
            first, slots,
            of(through, slot), directions(through, seen.d), of(through, seen.through),
            of(mirrored, slot), directions(mirrored, seen.mirrored_d), of(mirrored, seen.mirrored),
            of(pane, slot), at.numpy(), glows.numpy(),
            of(surface, slot), *self._surfaces(seen, lane, surface),
        )  # fmt: skip

    def _surfaces(self, seen: EyePaths, lane: mi.UInt32, surface: mi.UInt32) -> _Surfaces:
        """Points, normals and weights of the surfaces that rays show, and rays from them."""
        if dr.width(surface) == 0:
            none, whole = np.zeros(0, np.float32), np.zeros(0, np.uint32)
            points = np.zeros((0, 3), np.float32)
            return points, points, none, whole, whole, none, whole, none, whole, none
        p, n = (dr.gather(type(x), x, surface) for x in (seen.p, seen.n))
        weight, number = (dr.gather(type(x), x, surface) for x in (seen.weight, lane))
        dr.eval(p, n, weight, number)
        points, normals = _flat(p), _flat(n)
        within = None
        if self.in_room is not None:
            within = dr.gather(mi.Bool, seen.within, surface).numpy() & self.in_room
        with self.scene.ray_counter.purpose(Stream.EYE_GATHER.name):
            met = gather(
                self.scene, points, normals, replicates=1, paths=self.sampling.paths,
                grid=self.grid, seed=self._seed(Stream.EYE_GATHER), within=within, once=self.once,
                numbers=number,
            )  # fmt: skip
        row, cell, value = self._met(met, weight)
        bins, sky, at, look = (np.zeros(0, t) for t in (np.uint16, np.float32) * 2)
        if self.scene.effects.sky or self.scene.effects.ground:
            with self.scene.ray_counter.purpose(Stream.EYE_SKY.name):
                found = sky_rays(
                    self.scene, self.windows, p, n, number, rays=self.sampling.sky,
                    subdivision=self.subdivision, seed=self._seed(Stream.EYE_SKY),
                )  # fmt: skip
            bins, sky = found[0].numpy().astype(np.uint16), found[1].numpy()
        if self.glow.columns:
            with self.scene.ray_counter.purpose(Stream.EYE_PANES.name):
                looked = self.glow.looked(
                    p, n, number, rays=self.sampling.panes, seed=self._seed(Stream.EYE_PANES)
                )
            at, look = looked[0].numpy(), looked[1].numpy()
        return points, normals, weight.numpy(), row, cell, value, bins, sky, at, look

    def _met(self, met: Vertices, weight: mi.Float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Surface, cell and weight of the vertices of gather paths, whose cells are collected."""
        if len(met) == 0:
            return np.zeros(0, np.uint32), np.zeros(0, np.uint32), np.zeros(0, np.float32)
        self.cells = self.cells.extended(met)
        cell, count = self.cells.of(met), self.cells.count
        shown = replace(met, weight=met.weight * dr.gather(mi.Float, weight, met.row))
        if self.once:
            self.seen = with_weights(self.seen, count, cell, shown.weight)
        self.drawn = draw_all(shown, cell, count, self.drawn, weighted=self.once)
        dr.eval(cell)
        row = np.zeros(0, np.uint32) if self.once else met.row.numpy()
        return row, cell.numpy(), met.weight.numpy()

    def gathered(self) -> Gathered:
        """Cells that the rays of all pixels have met."""
        drawn = tuple(one for one in self.drawn if one is not None)
        return Gathered(lambda here: None, (), self.cells, drawn, {}, None, self.seen)  # type: ignore[arg-type,return-value]


def trace(
    scene: Scene, view: PictureView, rows: int, columns: int, *, sampling: Sampling,
    accuracy: Accuracy, subdivision: int, diameter: float, progress: Progress = lambda share: None,
) -> TracedView:  # fmt: skip
    """Trace the light paths of a picture.

    Parameters
    ----------
    scene : Scene
    view : PictureView
        View in the frame in which the scene is traced.
    rows, columns : int
        Size of the picture.
    sampling : Sampling
    accuracy : Accuracy
        Samples of the light on surfaces, cell size, replicates, seed.
    subdivision : int
        Reinhart's factor MF of the sky.
    diameter : float
        Angle across the sun [deg].
    progress : callable

    Returns
    -------
    TracedView
    """
    base = base_deposit(scene, accuracy, subdivision, diameter)
    glow = Glow(scene, base.films, base.patches)
    tracer = _Tracer(scene, view, rows, columns, sampling, accuracy, subdivision, glow)
    tiles = []
    for here in tracer.pixels():
        tiles.append(tracer.paths(here))
        progress(0.8 * here.stop / (rows * columns))
    gathered, transfer = tracer.gathered(), None
    if tracer.once and gathered.cells.count:
        gathered, transfer = solved(scene, gathered, accuracy)
    drawn = gathered.drawn or (None,) * accuracy.replicates
    light = SurfaceLight.of(base, gathered.cells.keys, drawn, transfer)
    progress(1.0)
    return TracedView(scene, view, rows, columns, sampling, light, glow, lambda: iter(tiles))
