"""Light paths of a picture: what its pixels see, and what lights the surfaces that they show.

All of a picture that depends neither on the hour nor on the state of the façade: for each ray from
the eye where it leaves the scene, the pane that glows, and the first diffuse surface with rays to
other surfaces, to the sky and to the panes. Rays of the eye, and those to the sky and to panes, are
traced with the first fill in all openings, with the second one, and so on, by the same random
numbers. Paths between surfaces draw the fill of each opening that they meet. A picture of an hour
is a sum over these paths, without tracing again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.eye.ends import OnWay
from drcmitsuba.picture.view import PictureView
from drcmitsuba.rendering.eye_by_element import EyeByElement, ShownSurfaces, concat, counted_on
from drcmitsuba.rendering.facade_scenes import FacadeScenes
from drcmitsuba.rendering.pixel_paths import PixelPaths, Sampling
from drcmitsuba.rendering.sky_rays import SkyOpenings, SkyRays, sky_rays
from drcmitsuba.rendering.view_by_element import ViewByElement, ViewCells
from drcmitsuba.rendering.view_rays import pixel_rays
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.transport.cells.cells import CellGrid, Cells
from drcmitsuba.transport.cells.points import CellPoints
from drcmitsuba.transport.cells.vertices import Vertices
from drcmitsuba.transport.gather.blocks import Gathered, with_weights
from drcmitsuba.transport.gather.paths import gather
from drcmitsuba.transport.interreflection.solved_cells import solved
from drcmitsuba.transport.rays.openings import in_rooms

LANES = 1 << 18
"""Number of rays from the eye in one launch."""
DRAWN = 32
"""One in so many vertices may become a point that stands for its cell."""


class _Met(NamedTuple):
    """Rays from surfaces to cells, see `PixelPaths`."""

    surface: mi.UInt32
    cell: mi.UInt32
    weight: mi.Float16
    marked: mi.UInt32
    mark: mi.UInt32

    @classmethod
    def none(cls) -> _Met:
        """No rays."""
        return cls(mi.UInt32(), mi.UInt32(), mi.Float16(), mi.UInt32(), mi.UInt32())


def _at(values: Any, index: mi.UInt32) -> Any:
    """Entries of an array, or None of None."""
    return None if values is None else dr.gather(type(values), values, index)


def _rows(values: mi.Vector3f) -> np.ndarray:
    """Vectors as rows (vector, 3)."""
    return np.asarray(dr.ravel(values).numpy()).reshape(-1, 3)


class _Tracer:
    """Traces the pixels of a view, some at a time, and collects the cells that they meet."""

    def __init__(self, begun: ViewByElement):
        self.view, self.scenes, self.glows = begun, begun.scenes, begun.glows
        self.accuracy, self.sampling = begun.accuracy, begun.sampling
        self.eye = EyeByElement(self.scenes, self.glows, begun.diameter)
        inner = self.scenes.inner
        self.windows, self.once = SkyOpenings.of(inner), inner.effects.solved_cells
        self.grid = CellGrid.of(inner, self.accuracy.cell_size)
        self.cells = Cells.none(self.grid)
        self.drawn = CellPoints.none(self.accuracy.replicates)
        self.seen = mi.Float64()
        inside = in_rooms(self.scenes.fills[0], np.array([begun.view.position]))
        self.in_room = None if inside is None else bool(inside[0])

    def _seed(self, stream: Stream) -> int:
        return launch_seed(self.accuracy.seed, stream)

    def pixels(self) -> Iterator[slice]:
        """Pixels of each launch, whole rows of the picture."""
        rows, columns = self.view.rows, self.view.columns
        count, step = rows * columns, max(1, LANES // self.sampling.samples // columns) * columns
        return (slice(i, min(i + step, count)) for i in range(0, count, step))

    def paths(self, here: slice) -> PixelPaths:
        """Trace the light paths of some pixels."""
        s, R = self.sampling.samples, self.accuracy.replicates
        lane = dr.arange(mi.UInt32, (here.stop - here.start) * s)
        lane += dr.opaque(mi.UInt32, here.start * s)
        seed, view = self._seed(Stream.EYE_PATHS), self.view
        d, exists = pixel_rays(view.view, view.rows, view.columns, lane, s, seed)
        dr.eval(d, exists)
        some = dr.compress(exists)
        eye = dr.opaque(mi.Point3f, list(map(float, view.view.position)))
        d, lane = dr.gather(mi.Vector3f, d, some), dr.gather(mi.UInt32, lane, some)
        slot = (lane // s) * R + lane % s // (s // R)
        with self.scenes.inner.ray_counter.purpose(Stream.EYE_PATHS.name):
            seen = self.eye.seen(eye, d, lane, s, seed)

        def slots(ray: mi.UInt32) -> mi.UInt32:
            return dr.gather(mi.UInt32, slot, ray)

        outside, rough, panes, shown = seen.outside, seen.rough, seen.panes, seen.surfaces
        first, slots_here = here.start * R, (here.stop - here.start) * R
        paths = PixelPaths(
            first, slots_here,
            slots(outside.ray), outside.d, outside.weight, outside.sun, seen.of_outside,
            slots(rough.ray), rough.part, mi.Vector3f(rough.front), mi.Vector3f(rough.n), rough.d,
            rough.weight, seen.of_rough,
            slots(panes.ray), panes.at, panes.weight, panes.element,
            slots(shown.ray), shown.p, shown.n, shown.weight, shown.element,
            *self._from_surfaces(shown, dr.gather(mi.UInt32, lane, shown.ray)),
        )  # fmt: skip
        dr.eval(paths.arrays())
        return paths

    def _from_surfaces(self, shown: ShownSurfaces, number: mi.UInt32) -> tuple[Any, ...]:
        """Rays from surfaces, whose random numbers are told by their rays' `number`."""
        whole, none, inner = mi.UInt32(), mi.Float16(), self.scenes.inner
        met, sky, at, look = _Met.none(), SkyRays(whole, whole, none), whole, none
        if dr.width(shown.ray) == 0:
            return *met, *sky, at, look
        p, n = mi.Point3f(shown.p), mi.Normal3f(shown.n)
        dr.eval(number)
        within = None
        if self.in_room is not None:
            within = (shown.met & int(OnWay.PANE) == 0).numpy() & self.in_room
        with inner.ray_counter.purpose(Stream.EYE_GATHER.name):
            vertices = gather(
                inner, _rows(shown.p), _rows(shown.n), replicates=1, paths=self.sampling.paths,
                grid=self.grid, seed=self._seed(Stream.EYE_GATHER), marks=self.scenes.marks,
                within=within, once=self.once, numbers=number,
            )  # fmt: skip
        met = self._met(vertices, shown.weight)
        if inner.effects.sky or inner.effects.ground:
            with inner.ray_counter.purpose(Stream.EYE_SKY.name):
                sky = sky_rays(
                    self.scenes, self.windows, p, n, number, rays=self.sampling.sky,
                    subdivision=self.view.subdivision, seed=self._seed(Stream.EYE_SKY),
                )  # fmt: skip
            sky = sky._replace(weight=mi.Float16(sky.weight))
        if any(glow.columns for glow in self.glows):
            with inner.ray_counter.purpose(Stream.EYE_PANES.name):
                at, look = self._looks(p, n, number)
        return *met, *sky, at, look

    def _looks(
        self, p: mi.Point3f, n: mi.Normal3f, number: mi.UInt32
    ) -> tuple[mi.UInt32, mi.Float16]:
        """Looks at the panes of every fill: entries among those of all tables, and irradiance."""
        at, look, first = [], [], 0
        for glow in self.glows:
            if glow.columns:
                entry, value = glow.looked(
                    p, n, number, rays=self.sampling.panes, seed=self._seed(Stream.EYE_PANES)
                )
                at.append(counted_on(entry, first))
                look.append(mi.Float16(value))
            first += len(glow)
        return concat(at), concat(look)

    def _met(self, met: Vertices, weight: mi.Float) -> _Met:
        """Rays to cells from the vertices of gather paths, whose cells are collected."""
        if len(met) == 0:
            return _Met.none()
        shown = met.weight * dr.gather(mi.Float, weight, met.row)
        if not dr.any(shown > 0):  # only black surfaces
            return _Met.none()
        before = dr.opaque(mi.UInt32, self.cells.count)
        self.cells = self.cells.extended(met)
        cell, count = self.cells.of(met), self.cells.count
        dr.eval(cell, shown)
        if self.once:
            self.seen = with_weights(self.seen, count, cell, shown)
        # Of the many vertices few decide which points stand for cells, but all in new cells.
        few = ((met.tag * mi.UInt32(0x9E3779B1)) >> 16) % DRAWN == 0  # in any order of threads
        some = dr.compress((shown > 0) & (few | (cell >= before)))
        columns = {name: _at(getattr(met, name), some) for name in ("row", "key", "tag", "within")}
        share = dr.select(dr.gather(mi.Bool, few, some), mi.Float(DRAWN), 1)
        points = {
            name: dr.ravel(dr.gather(mi.Point3f, getattr(met, name), some)) for name in ("p", "n")
        }
        drawn = Vertices(weight=_at(shown, some) * share, **columns, **points)
        dr.eval(drawn.weight)
        self.drawn = self.drawn.extended(drawn, _at(cell, some), count)
        marked, mark = mi.UInt32(), mi.UInt32()
        if met.mark is not None:
            marked = dr.compress((met.mark > 0) & (met.weight > 0))
            mark = dr.gather(mi.UInt32, met.mark, marked)
        surface = mi.UInt32() if self.once else met.row
        return _Met(surface, cell, mi.Float16(met.weight), marked, mark)

    def collected(self) -> ViewCells:
        """Cells that the rays of all pixels have met, and light between them."""
        gathered, transfer = Gathered(
            lambda here: None, (), self.cells, self.drawn, {}, None, self.seen  # type: ignore[arg-type,return-value]
        ), None  # fmt: skip
        if self.once and gathered.cells.count:
            gathered, transfer = solved(
                self.scenes.inner, gathered, self.accuracy, self.scenes.marks
            )
        return ViewCells(gathered.cells.keys, gathered.drawn, transfer, self.eye.again)


def trace(
    scenes: FacadeScenes, view: PictureView, rows: int, columns: int, *, sampling: Sampling,
    accuracy: Accuracy, subdivision: int, diameter: float, progress: Progress = lambda share: None,
    keep: Callable[[PixelPaths], None] | None = None,
) -> ViewByElement:  # fmt: skip
    """Trace the light paths of a picture.

    Parameters
    ----------
    scenes : FacadeScenes
    view : PictureView
        View in the frame in which the scenes are traced.
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
    ViewByElement
        Without light paths where `keep` takes them.
    """
    begun = untraced(scenes, view, rows, columns, sampling, accuracy, subdivision, diameter)
    tracer, kept = _Tracer(begun), list[PixelPaths]()
    for here in tracer.pixels():
        (keep or kept.append)(tracer.paths(here))
        progress(0.9 * here.stop / (rows * columns))
    cells = tracer.collected()
    progress(1.0)
    return replace(begun, cells=cells, tiles=lambda: iter(kept))


def untraced(
    scenes: FacadeScenes, view: PictureView, rows: int, columns: int, sampling: Sampling,
    accuracy: Accuracy, subdivision: int, diameter: float,
) -> ViewByElement:  # fmt: skip
    """Begin a view, without cells and light paths."""
    none = ViewCells.none(accuracy.replicates)
    return ViewByElement(
        scenes, view, rows, columns, sampling, accuracy, subdivision, diameter, none,
        lambda: iter(()),
    )  # fmt: skip
