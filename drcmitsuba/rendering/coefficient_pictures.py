r"""Coefficient pictures: luminance of every pixel per luminance of each sky bin, ∂L/∂L_bin.

They follow from the light paths of a view without tracing. The picture of an hour's sky, in which
each patch has one luminance, is their sum :math:`\sum_b C_b L_b`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches, patch_index
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.rendering.caustics import CausticMap
from drcmitsuba.rendering.pixel_paths import PixelPaths
from drcmitsuba.rendering.surface_light import SurfaceLight
from drcmitsuba.rendering.traced_view import TracedView
from drcmitsuba.schema import mean_and_error

ENTRIES = 1 << 23
"""Number of entries (surface, bin) of one launch."""


def coefficient_pictures(traced: TracedView) -> Iterator[xr.Dataset]:
    """Coefficients of the pixels for ground and sky patches, some rows of the picture at a time.

    Parameters
    ----------
    traced : TracedView

    Yields
    ------
    xr.Dataset
        `coefficient` and its standard error `coefficient_se` [1], dims (row, column, bin); rows
        from the top.
    """
    light, columns = traced.light, traced.columns
    subdivision, replicates = light.base.subdivision, light.base.accuracy.replicates
    assert subdivision is not None
    labels = np.array(Patches(subdivision).labels, dtype=object)
    cells, glow = _of_cells(light), _Glow.of(traced, len(labels))
    caustics = None if traced.caustics is None else traced.caustics.by_bin()
    dr.eval(cells, glow)
    for paths in traced.tiles():
        by_slot = _slots(traced, paths, cells, glow, caustics, subdivision, len(labels))
        each = by_slot.reshape(-1, replicates, len(labels)).swapaxes(0, 1)
        first = paths.first // replicates // columns
        shape = (paths.slots // replicates // columns, columns, len(labels))
        parts = zip(("coefficient", "coefficient_se"), mean_and_error(each), strict=True)
        data = {
            name: (("row", "column", "bin"), part.reshape(shape).astype(np.float32))
            for name, part in parts
        }
        yield xr.Dataset(data, {"bin": labels, "row": first + np.arange(shape[0])})


class _Glow(NamedTuple):
    """Radiance of panes per radiance of the sky's bins [1], flat (replicate, entry, bin)."""

    seen: mi.Float
    """As rays of the eye see it."""
    looked: mi.Float
    """As surfaces get it that look at the panes."""

    @classmethod
    def of(cls, traced: TracedView, bins: int) -> _Glow:
        """Radiance of the panes of a view."""
        glow, deposits = traced.glow, traced.light.deposits
        if not len(glow.table):
            none = dr.zeros(mi.Float, max(1, len(deposits) * len(glow) * bins))
            return cls(none, none)
        own = dr.concat([glow.table.by_bin(one).array for one in deposits])
        more = mi.Float(0)
        if traced.caustics is not None:
            more = traced.caustics.glow_by_bin(glow, traced.light)
        return cls(glow.of_eye(own, bins) + more, glow.of_surfaces(own, bins))


def _of_cells(light: SurfaceLight) -> mi.Float:
    """Irradiance of the cells per radiance of the sky's bins [sr], flat (replicate, cell, bin)."""
    lit = light.sky
    if lit is None or lit.cells is None:
        return mi.Float(0)
    return light.reflected(lit.cells.sky).array


def _slots(
    traced: TracedView,
    paths: PixelPaths,
    cells: mi.Float,
    glow: _Glow,
    caustics: CausticMap | None,
    subdivision: int,
    bins: int,
) -> np.ndarray:
    """Coefficients of some pixels in every replicate [1], shape (slot, bin)."""
    out, stride = dr.zeros(mi.Float, paths.slots * bins), dr.opaque(mi.UInt32, bins)
    first = dr.opaque(mi.UInt32, paths.first)
    dr.eval(out)
    if dr.width(paths.outside):
        at = (paths.outside_slot - first) * stride + patch_index(paths.outside_d, subdivision)
        dr.scatter_add(out, paths.outside, at)
        dr.eval(out)
    if dr.width(paths.pane):
        lane = dr.arange(mi.UInt32, dr.width(paths.pane) * bins)
        ray, bin_ = lane // stride, lane % stride
        slot = dr.gather(mi.UInt32, paths.pane_slot, ray)
        replicate = slot % traced.light.base.accuracy.replicates
        entry = replicate * dr.opaque(mi.UInt32, len(traced.glow))
        entry += dr.gather(mi.UInt32, paths.pane_at, ray)
        value = dr.gather(mi.Float, glow.seen, entry * stride + bin_)
        value *= dr.gather(mi.Float, paths.pane, ray)
        dr.scatter_add(out, value, (slot - first) * stride + bin_)
        dr.eval(out)
    if dr.width(paths.weight):
        _add_surfaces(out, traced, paths, cells, glow, stride)
        if caustics is not None:
            _add_caustics(out, traced, paths, caustics, stride)
    shares = traced.sampling.samples // traced.light.base.accuracy.replicates
    return np.asarray(out.numpy()).reshape(paths.slots, bins) / np.float32(shares)


def _add_surfaces(
    out: mi.Float, traced: TracedView, paths: PixelPaths, cells: mi.Float, glow: _Glow,
    stride: mi.UInt32,
) -> None:  # fmt: skip
    """Add what the surfaces reflect that rays show."""
    first, weight = dr.opaque(mi.UInt32, paths.first), paths.weight * dr.inv_pi
    replicate = paths.slot % traced.light.base.accuracy.replicates
    if dr.width(paths.sky):
        surface = dr.arange(mi.UInt32, dr.width(paths.sky)) // traced.sampling.sky
        value = mi.Float(paths.sky) * dr.gather(mi.Float, weight, surface)
        at = (dr.gather(mi.UInt32, paths.slot, surface) - first) * stride + paths.sky_bin
        dr.scatter_add(out, value, at, value > 0)
        dr.eval(out)
    of_cells = replicate * dr.opaque(mi.UInt32, traced.light.cells)
    if dr.width(paths.gather_surface):
        _add_rays(out, paths, weight, of_cells, cells, stride)
    elif dr.width(paths.gather):
        rays = traced.sampling.paths
        _add_sums(out, paths, paths.gather_cell, paths.gather, cells, of_cells, rays, 0, stride)
    rays, of_panes = traced.sampling.panes, replicate * dr.opaque(mi.UInt32, len(traced.glow))
    for start in range(0, dr.width(paths.look), max(1, dr.width(paths.weight) * rays)):
        _add_sums(out, paths, paths.look_at, paths.look, glow.looked, of_panes, rays, start, stride)


def _add_caustics(
    out: mi.Float, traced: TracedView, paths: PixelPaths, caustics: CausticMap, stride: mi.UInt32
) -> None:
    """Add the light that components throw on surfaces: one entry for each, where photons fell."""
    replicate = paths.slot % traced.light.base.accuracy.replicates
    cell, known = caustics.cells(mi.Point3f(paths.p), mi.Normal3f(paths.n), replicate)
    share, base = mi.Float16(known), dr.zeros(mi.UInt32, dr.width(cell))
    dr.eval(cell, share, base)
    _add_sums(out, paths, cell, share, caustics.E, base, 1, 0, stride)


def _add_sums(
    out: mi.Float, paths: PixelPaths, at: mi.UInt32, share: mi.Float16, table: mi.Float,
    base: mi.UInt32, rays: int, start: int, stride: mi.UInt32,
) -> None:  # fmt: skip
    """Add the light of table entries on as many rays from each surface, a lane for each bin."""
    bins, surfaces = int(stride[0]), dr.width(paths.weight)
    first, step = dr.opaque(mi.UInt32, paths.first), max(1, ENTRIES // bins)
    for begin in range(0, surfaces, step):
        lane = dr.arange(mi.UInt32, min(step, surfaces - begin) * bins)
        surface = lane // stride + dr.opaque(mi.UInt32, begin)
        entry = surface * dr.opaque(mi.UInt32, rays) + dr.opaque(mi.UInt32, start)
        of = dr.gather(mi.UInt32, base, surface)
        value = _sum(entry, of, lane % stride, at, share, table, rays, stride)
        value *= dr.gather(mi.Float, paths.weight, surface) * dr.inv_pi
        slot = dr.gather(mi.UInt32, paths.slot, surface) - first
        dr.scatter_add(out, value, slot * stride + lane % stride)
        dr.eval(out)


def _add_rays(
    out: mi.Float, paths: PixelPaths, weight: mi.Float, base: mi.UInt32, table: mi.Float,
    stride: mi.UInt32,
) -> None:  # fmt: skip
    """Add the light of cells on paths that follow all bounces, a lane for each vertex and bin."""
    bins, rays = int(stride[0]), dr.width(paths.gather)
    first = dr.opaque(mi.UInt32, paths.first)
    for begin in range(0, rays, max(1, ENTRIES // bins)):
        size = min(max(1, ENTRIES // bins), rays - begin)
        lane = dr.arange(mi.UInt32, size * bins)
        ray, bin_ = lane // stride + dr.opaque(mi.UInt32, begin), lane % stride
        surface = dr.gather(mi.UInt32, paths.gather_surface, ray)
        cell = dr.gather(mi.UInt32, base, surface) + dr.gather(mi.UInt32, paths.gather_cell, ray)
        value = mi.Float(dr.gather(mi.Float16, paths.gather, ray))
        value *= dr.gather(mi.Float, table, cell * stride + bin_)
        value *= dr.gather(mi.Float, weight, surface)
        slot = dr.gather(mi.UInt32, paths.slot, surface) - first
        dr.scatter_add(out, value, slot * stride + bin_)
        dr.eval(out)


@symbolic
def _sum(
    entry: mi.UInt32, base: mi.UInt32, bin_: mi.UInt32, at: mi.UInt32, weight: mi.Float16,
    table: mi.Float, rays: int, stride: mi.UInt32,
) -> mi.Float:  # fmt: skip
    """Σ weight · table[base + at, bin] over the rays of a surface."""
    count, index, total = dr.opaque(mi.UInt32, rays), mi.UInt32(0), mi.Float(0)
    while dr.hint(index < count, exclude=[entry, base, bin_, at, weight, table, stride]):
        row = base + dr.gather(mi.UInt32, at, entry + index)
        value = mi.Float(dr.gather(mi.Float16, weight, entry + index))
        total += value * dr.gather(mi.Float, table, row * stride + bin_)
        index += 1
    return total
