"""Light paths of a picture: what its pixels see, and what lights the surfaces that they show.

All of a picture that does not depend on the hour: for each ray from the eye where it leaves the
scene, the pane that glows, and the first diffuse surface with rays to other surfaces, to the sky
and to the panes. A picture of an hour is a sum over these paths, without tracing again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.eye.ends import Ends, OnWay
from drcmitsuba.eye.paths import EyePaths
from drcmitsuba.picture.view import PictureView
from drcmitsuba.rendering.caustics import Caustics
from drcmitsuba.rendering.glow import GlowTable
from drcmitsuba.rendering.sky_rays import SkyOpenings, sky_rays
from drcmitsuba.rendering.surface_light import SurfaceLight, base_deposit
from drcmitsuba.rendering.view_rays import pixel_rays
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.cells.cells import CellGrid, Cells
from drcmitsuba.transport.cells.points import CellPoints
from drcmitsuba.transport.cells.vertices import Vertices
from drcmitsuba.transport.gather.blocks import Gathered, with_weights
from drcmitsuba.transport.gather.paths import gather
from drcmitsuba.transport.interreflection.solved_cells import solved
from drcmitsuba.transport.mirrors.image_suns import ImageSuns
from drcmitsuba.transport.mirrors.sun_lobes import SunLobes
from drcmitsuba.transport.rays.openings import in_rooms

LANES = 1 << 18
"""Number of rays from the eye in one launch."""
DRAWN = 32
"""One in so many vertices may become a point that stands for its cell."""


@dataclass(frozen=True)
class Sampling:
    """Numbers of rays of a picture.

    Examples
    --------
    >>> from drcmitsuba import rendering
    >>> rendering.Sampling(samples=10, sky=32).rounded(replicates=4).samples
    12
    """

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

    def nbytes(self, columns: int) -> int:
        """Size of the light paths of a pixel [bytes], at most, with `columns` looks at panes."""
        return self.samples * (112 + 6 * (self.paths + self.sky + self.panes * columns))

    def rounded(self, replicates: int) -> Sampling:
        """Return the same with as many samples as replicates, or a multiple."""
        return replace(self, samples=-(-self.samples // replicates) * replicates)


@dataclass(frozen=True)
class PixelPaths:
    """Light paths of some pixels; a `slot` is pixel · replicates + replicate."""

    first: int
    """First slot of these pixels."""
    slots: int
    """Number of slots."""
    outside_slot: mi.UInt32
    outside_d: mi.Vector3f
    outside: mi.Float
    outside_sun: mi.Float
    """Rays that leave the scene: direction, weight, and share of the sun's light that counts."""
    rough_slot: mi.UInt32
    rough_part: mi.UInt32
    rough_p: mi.Vector3f
    rough_n: mi.Vector3f
    rough_d: mi.Vector3f
    rough: mi.Float
    """Rough mirrors that rays meet: parts of the scene, points [m], normals, directions from the
    eye, and weight of what they show of the sun."""
    pane_slot: mi.UInt32
    pane_at: mi.UInt32
    pane: mi.Float
    """Rays that meet a scattering pane: entry of the glow's table, and weight."""
    slot: mi.UInt32
    p: mi.Vector3f
    n: mi.Vector3f
    weight: mi.Float
    """Surfaces that rays show: points [m], normals, and weight of E/π."""
    gather_surface: mi.UInt32
    gather_cell: mi.UInt32
    gather: mi.Float16
    """Rays to other surfaces: index of the surface, cell, and irradiance per irradiance. Rays that
    end at once are as many for each surface, and need no index."""
    sky_bin: mi.UInt32
    sky: mi.Float16
    """Rays to the sky, as many for each surface: bin and irradiance [sr]."""
    look_at: mi.UInt32
    look: mi.Float16
    """Looks at panes (column, surface, ray): entry of the glow's table and irradiance [sr]."""

    def arrays(self) -> dict[str, Any]:
        """Return the arrays by their names."""
        return {f.name: getattr(self, f.name) for f in fields(self)[2:]}

    @property
    def nbytes(self) -> int:
        """Size in memory [bytes]."""
        return sum(_bytes(array) for array in self.arrays().values())


def _bytes(array: Any) -> int:
    """Size of an array in memory [bytes]."""
    if dr.depth_v(array) > 1:
        return sum(map(_bytes, array))
    return dr.width(array) * dr.itemsize_v(array) if dr.width(array) else 0


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
    glow: GlowTable
    tiles: Callable[[], Iterator[PixelPaths]]
    """Gives the light paths of all pixels, some at a time."""

    @cached_property
    def images(self) -> ImageSuns | None:
        """Images of suns in the planar mirrors of the scene; None without any."""
        return ImageSuns.of(self.scene)

    @cached_property
    def lobes(self) -> tuple[SunLobes, ...]:
        """Lobes of suns in the rough mirrors of the scene."""
        return SunLobes.of(self.scene)

    @cached_property
    def caustics(self) -> Caustics | None:
        """Photons of the components of the scene; None without any."""
        base = self.light.base
        return Caustics.of(self.scene, base.accuracy, base.subdivision, base.diameter)


def _at(values: Any, index: mi.UInt32) -> Any:
    """Entries of an array, or None of None."""
    return None if values is None else dr.gather(type(values), values, index)


def _rows(values: mi.Vector3f) -> np.ndarray:
    """Vectors as rows (vector, 3)."""
    return np.asarray(dr.ravel(values).numpy()).reshape(-1, 3)


_Surfaces = tuple[Any, Any, Any, Any, Any, Any, Any, Any, Any, Any]


class _Tracer:
    """Traces the pixels of a view, some at a time, and collects the cells that they meet."""

    def __init__(
        self, scene: Scene, view: PictureView, rows: int, columns: int, sampling: Sampling,
        accuracy: Accuracy, subdivision: int, glow: GlowTable, eye: EyePaths,
    ):  # fmt: skip
        self.scene, self.view, self.rows, self.columns = scene, view, rows, columns
        self.sampling, self.accuracy, self.subdivision, self.glow = (
            sampling, accuracy, subdivision, glow,
        )  # fmt: skip
        self.eye = eye
        self.windows, self.once = SkyOpenings.of(scene), scene.effects.solved_cells
        self.grid = CellGrid.of(scene, accuracy.cell_size)
        self.cells = Cells.none(self.grid)
        self.drawn = CellPoints.none(accuracy.replicates)
        self.seen = mi.Float64()
        inside = in_rooms(scene, np.array([view.position]))
        self.in_room = None if inside is None else bool(inside[0])

    def _seed(self, stream: Stream) -> int:
        return launch_seed(self.accuracy.seed, stream)

    def pixels(self) -> Iterator[slice]:
        """Pixels of each launch, whole rows of the picture."""
        rows = max(1, LANES // self.sampling.samples // self.columns)
        count, step = self.rows * self.columns, rows * self.columns
        return (slice(i, min(i + step, count)) for i in range(0, count, step))

    def paths(self, here: slice) -> PixelPaths:
        """Trace the light paths of some pixels."""
        s, R = self.sampling.samples, self.accuracy.replicates
        lane = dr.arange(mi.UInt32, (here.stop - here.start) * s)
        lane += dr.opaque(mi.UInt32, here.start * s)
        seed = self._seed(Stream.EYE_PATHS)
        d, exists = pixel_rays(self.view, self.rows, self.columns, lane, s, seed)
        dr.eval(d, exists)
        some = dr.compress(exists)
        eye = dr.opaque(mi.Point3f, list(map(float, self.view.position)))
        with self.scene.ray_counter.purpose(Stream.EYE_PATHS.name):
            seen = self.eye.ends(
                eye, dr.gather(mi.Vector3f, d, some), dr.gather(mi.UInt32, lane, some), s, seed
            )
        lane = dr.gather(mi.UInt32, lane, some)
        slot = (lane // s) * R + lane % s // (s // R)

        def slots(ends: Ends) -> mi.UInt32:
            return dr.gather(mi.UInt32, slot, ends.ray)

        panes, rough = seen.panes, seen.rough
        at, glows = mi.UInt32(), mi.Float()
        if dr.width(panes.ray):
            at, glows = self.glow.seen(panes.p, panes.d, panes.weight)
        first, slots_here = here.start * R, (here.stop - here.start) * R
        paths = PixelPaths(
            first, slots_here,
            slots(seen.outside), seen.outside.d, seen.outside.weight, seen.outside.sun,
            slots(rough), rough.part, mi.Vector3f(rough.front), mi.Vector3f(rough.n), rough.d,
            rough.weight,
            slots(panes), at, glows,
            slots(seen.surfaces), *self._surfaces(seen.surfaces, lane),
        )  # fmt: skip
        dr.eval(paths.arrays())
        return paths

    def _surfaces(self, seen: Ends, lane: mi.UInt32) -> _Surfaces:
        """Points, normals and weights of the surfaces that rays show, and rays from them."""
        whole, none = mi.UInt32(), mi.Float16()
        if dr.width(seen.ray) == 0:
            p = mi.Vector3f(mi.Float(), mi.Float(), mi.Float())
            return p, p, mi.Float(), whole, whole, none, whole, none, whole, none
        p, n = mi.Vector3f(seen.front), mi.Vector3f(seen.n)
        weight, number = (
            seen.weight * self.eye.reflected(seen),
            dr.gather(mi.UInt32, lane, seen.ray),
        )
        dr.eval(p, n, weight, number)
        within = None
        if self.in_room is not None:
            within = (seen.met & int(OnWay.PANE) == 0).numpy() & self.in_room
        with self.scene.ray_counter.purpose(Stream.EYE_GATHER.name):
            met = gather(
                self.scene, _rows(p), _rows(n), replicates=1, paths=self.sampling.paths,
                grid=self.grid, seed=self._seed(Stream.EYE_GATHER), within=within, once=self.once,
                numbers=number,
            )  # fmt: skip
        row, cell, value = self._met(met, weight)
        sky_bin, sky, at, look = whole, none, whole, none
        if self.scene.effects.sky or self.scene.effects.ground:
            with self.scene.ray_counter.purpose(Stream.EYE_SKY.name):
                sky_bin, of_sky = sky_rays(
                    self.scene, self.windows, mi.Point3f(p), mi.Normal3f(n), number,
                    rays=self.sampling.sky, subdivision=self.subdivision,
                    seed=self._seed(Stream.EYE_SKY),
                )  # fmt: skip
            sky = mi.Float16(of_sky)
        if self.glow.columns:
            with self.scene.ray_counter.purpose(Stream.EYE_PANES.name):
                at, of_panes = self.glow.looked(
                    mi.Point3f(p), mi.Normal3f(n), number, rays=self.sampling.panes,
                    seed=self._seed(Stream.EYE_PANES),
                )  # fmt: skip
            look = mi.Float16(of_panes)
        return p, n, weight, row, cell, value, sky_bin, sky, at, look

    def _met(self, met: Vertices, weight: mi.Float) -> tuple[mi.UInt32, mi.UInt32, mi.Float16]:
        """Surface, cell and weight of the vertices of gather paths, whose cells are collected."""
        none = mi.UInt32(), mi.UInt32(), mi.Float16()
        if len(met) == 0:
            return none
        shown = met.weight * dr.gather(mi.Float, weight, met.row)
        if not dr.any(shown > 0):  # only black surfaces
            return none
        before = dr.opaque(mi.UInt32, self.cells.count)
        self.cells = self.cells.extended(met)
        cell, count = self.cells.of(met), self.cells.count
        dr.eval(cell, shown)
        if self.once:
            self.seen = with_weights(self.seen, count, cell, shown)
        # Of the many vertices few decide which points stand for cells, but all in new cells.
        few = dr.arange(mi.UInt32, len(met)) % DRAWN == 0
        some = dr.compress((shown > 0) & (few | (cell >= before)))
        columns = {name: _at(getattr(met, name), some) for name in ("row", "key", "tag", "within")}
        share = dr.select(dr.gather(mi.Bool, few, some), mi.Float(DRAWN), 1)
        points = {
            name: dr.ravel(dr.gather(mi.Point3f, getattr(met, name), some)) for name in ("p", "n")
        }
        drawn = Vertices(weight=_at(shown, some) * share, **columns, **points)
        dr.eval(drawn.weight)
        self.drawn = self.drawn.extended(drawn, _at(cell, some), count)
        return mi.UInt32() if self.once else met.row, cell, mi.Float16(met.weight)

    def gathered(self) -> Gathered:
        """Cells that the rays of all pixels have met."""
        return Gathered(lambda here: None, (), self.cells, self.drawn, {}, None, self.seen)  # type: ignore[arg-type,return-value]


def trace(
    scene: Scene, view: PictureView, rows: int, columns: int, *, sampling: Sampling,
    accuracy: Accuracy, subdivision: int, diameter: float, progress: Progress = lambda share: None,
    keep: Callable[[PixelPaths], None] | None = None,
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
    keep : callable, optional
        Takes the light paths of some pixels at a time; by default they stay in memory.

    Returns
    -------
    TracedView
        Without light paths where `keep` takes them.
    """
    traced = untraced(scene, view, rows, columns, sampling, accuracy, subdivision, diameter)
    eye = EyePaths.of(scene, diameter)
    tracer = _Tracer(scene, view, rows, columns, sampling, accuracy, subdivision, traced.glow, eye)
    kept: list[PixelPaths] = []
    for here in tracer.pixels():
        (keep or kept.append)(tracer.paths(here))
        progress(0.9 * here.stop / (rows * columns))
    gathered, transfer = tracer.gathered(), None
    if tracer.once and gathered.cells.count:
        gathered, transfer = solved(scene, gathered, accuracy)
    light = SurfaceLight.of(traced.light.base, gathered.cells.keys, gathered.drawn, transfer)
    progress(1.0)
    return replace(traced, light=light, tiles=lambda: iter(kept))


def untraced(
    scene: Scene, view: PictureView, rows: int, columns: int, sampling: Sampling,
    accuracy: Accuracy, subdivision: int, diameter: float,
) -> TracedView:  # fmt: skip
    """Begin a view, with the panes of its scene, but without cells and light paths."""
    base = base_deposit(scene, accuracy, subdivision, diameter)
    glow = GlowTable(scene, base.films, base.patches)
    light = SurfaceLight(base, mi.UInt32(), CellPoints.none(accuracy.replicates), None, None)
    return TracedView(scene, view, rows, columns, sampling, light, glow, lambda: iter(()))
