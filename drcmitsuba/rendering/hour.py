"""Picture of an hour: the sum over light paths with the light of the hour."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.rendering.caustics import CausticMap
from drcmitsuba.rendering.outside import OutsideLuminances
from drcmitsuba.rendering.pixel_paths import PixelPaths
from drcmitsuba.rendering.sun_on_surfaces import (
    along_peaks,
    direct_sun,
    in_mirrors,
    in_rough_mirrors,
)
from drcmitsuba.rendering.surface_light import Glowing, HourSources
from drcmitsuba.rendering.traced_view import TracedView
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.schema import mean_and_error


@dataclass(frozen=True)
class Luminance:
    """Luminance of the pixels in one colour channel."""

    mean: np.ndarray
    """[cd/m²], shape (row, column)."""
    error: np.ndarray
    """Standard error of the mean [cd/m²], shape (row, column)."""
    disk: np.ndarray
    """Part of the mean that is the sun's disk, seen straight or in planar mirrors, without noise
    [cd/m²]."""


@dataclass(frozen=True)
class LightParts:
    """Luminance of the pixels by what they show, (row, column) each."""

    straight: np.ndarray
    """All but `gathered` [cd/m²]: the outside, panes, and surfaces in the sun."""
    reflected: np.ndarray
    """Luminance per irradiance of the surfaces that the pixels show [1/sr]."""
    gathered: np.ndarray
    """Light of the sky, panes and other surfaces on these surfaces [cd/m²]: the noisy part."""


@dataclass(frozen=True)
class _Tables:
    """Light of the hour on cells, of the sky, of panes, as flat arrays."""

    cells: mi.Float
    """Irradiance [lx], (replicate, cell)."""
    sky: mi.Float
    """Luminance of ground and patches [cd/m²]."""
    glow: Glowing
    """Panes that scatter."""
    caustics: tuple[CausticMap, ...]
    """Irradiance by components [lx]."""
    sun: float
    """Luminance of the sun that lights surfaces [cd/m²]; 0 without one."""


def luminance(traced: TracedView, outside: OutsideLuminances, sky: np.ndarray) -> Luminance:
    """Luminance of a view at an instant, with the sun's disk.

    Parameters
    ----------
    traced, outside, sky
        As for `replicates`.

    Returns
    -------
    Luminance
    """
    parts = [mean_and_error(each) for each in _tiles(traced, outside, sky)]
    shape = traced.rows, traced.columns
    mean, error = (np.concatenate(whole).reshape(shape) for whole in zip(*parts, strict=True))
    disk = outside.disk_in(traced.scene, traced.view, shape, traced.images)
    return Luminance(mean + disk, error, disk)


def in_parts(traced: TracedView, outside: OutsideLuminances, sky: np.ndarray) -> LightParts:
    """Parts of the luminance of a view at an instant, means of the replicates.

    Parameters
    ----------
    traced, outside, sky
        As for `replicates`.

    Returns
    -------
    LightParts
    """
    tables, parts = _tables(traced, outside, sky), []
    for paths in traced.tiles():
        whole = _slots(traced, paths, outside, tables)
        reflected, gathered = _reflected(traced, paths, tables)
        each = np.stack([whole - gathered, reflected, gathered])
        parts.append(each.reshape(3, -1, traced.light.base.accuracy.replicates).mean(axis=2))
    shape = traced.rows, traced.columns
    straight, reflected, gathered = np.concatenate(parts, axis=1).reshape(3, *shape)
    disk = outside.disk_in(traced.scene, traced.view, shape, traced.images)
    return LightParts(straight + disk, reflected, gathered)


def replicates(traced: TracedView, outside: OutsideLuminances, sky: np.ndarray) -> np.ndarray:
    """Independent estimates of the luminance of a view at an instant.

    Parameters
    ----------
    traced : TracedView
    outside : Outside
        Light of the instant.
    sky : np.ndarray, shape (bin,)
        Luminances of ground and sky patches [cd/m²], which light the surfaces.

    Returns
    -------
    np.ndarray, shape (replicate, row, column)
        Luminance without the sun's disk where it is seen straight or in planar mirrors [cd/m²].
    """
    parts = list(_tiles(traced, outside, sky))
    return np.concatenate(parts, axis=1).reshape(-1, traced.rows, traced.columns)


def _tiles(traced: TracedView, outside: OutsideLuminances, sky: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the replicates of some pixels at a time [cd/m²], shape (replicate, pixel)."""
    tables = _tables(traced, outside, sky)
    for paths in traced.tiles():
        of_slots = _slots(traced, paths, outside, tables)
        yield of_slots.reshape(-1, traced.light.base.accuracy.replicates).T


def _tables(traced: TracedView, outside: OutsideLuminances, sky: np.ndarray) -> _Tables:
    """Light of an instant, as for `replicates`."""
    light = traced.light
    sun = outside.sun if traced.scene.effects.suns else 0.0
    sources = HourSources(sky, sun, outside.direction)
    by_sun = light.under(outside.direction) if sun > 0 else None
    glow = light.glow(traced.glow, sources, by_sun)
    caustics: tuple[CausticMap, ...] = ()
    if (photons := traced.caustics) is not None:
        of_sun = photons.of_sun(sources)
        caustics = photons.under(sources, of_sun)
        more = photons.glow(traced.glow, light, sources, by_sun, of_sun)
        glow = replace(glow, whole=glow.whole + more)
    tables = _Tables(light.irradiance(sources, by_sun), flat(sky), glow, caustics, sun)
    dr.eval(tables.cells, glow.whole, glow.rest)
    return tables


def _slots(
    traced: TracedView, paths: PixelPaths, outside: OutsideLuminances, tables: _Tables
) -> np.ndarray:
    """Luminance of some pixels in every replicate [cd/m²], shape (slot,)."""
    replicates = traced.light.base.accuracy.replicates
    out = dr.zeros(mi.Float, paths.slots)
    first = dr.opaque(mi.UInt32, paths.first)
    dr.eval(out)

    def add(slot: mi.UInt32, value: mi.Float) -> None:
        dr.scatter_add(out, value, slot - first)
        dr.eval(out)

    if dr.width(paths.outside):
        lit = outside.with_sun(paths.outside_d, paths.outside_sun)
        add(paths.outside_slot, paths.outside * lit)
    if dr.width(paths.rough) and outside.sun > 0:
        add(paths.rough_slot, paths.rough * in_rough_mirrors(traced, paths, outside))
    if dr.width(paths.pane):
        entry = paths.pane_slot % replicates * dr.opaque(mi.UInt32, len(traced.glow))
        glow = dr.gather(mi.Float, tables.glow.whole, entry + paths.pane_at)
        add(paths.pane_slot, paths.pane * glow)
    if dr.width(paths.weight):
        E = _irradiance(traced, paths, tables)
        for one in tables.caustics:
            E += one.on(mi.Point3f(paths.p), mi.Normal3f(paths.n), paths.slot % replicates)
        if tables.sun > 0:
            E += direct_sun(traced, paths, outside)
            E += in_mirrors(traced, paths, outside)
            E += along_peaks(traced, paths, outside, tables.glow)
        add(paths.slot, paths.weight * E * dr.inv_pi)
    return np.asarray(out.numpy()) / np.float32(traced.sampling.samples // replicates)


def _reflected(
    traced: TracedView, paths: PixelPaths, tables: _Tables
) -> tuple[np.ndarray, np.ndarray]:
    """Luminance of surfaces by irradiance [1/sr], and by what they gather [cd/m²], (slot,) each."""
    both, first = [], dr.opaque(mi.UInt32, paths.first)
    E = _irradiance(traced, paths, tables) if dr.width(paths.weight) else mi.Float()
    for light in (mi.Float(1), E):
        out = dr.zeros(mi.Float, paths.slots)
        if dr.width(paths.weight):
            dr.scatter_add(out, paths.weight * light * dr.inv_pi, paths.slot - first)
        both.append(out)
    dr.eval(both)
    samples = np.float32(traced.sampling.samples // traced.light.base.accuracy.replicates)
    reflected, gathered = (np.asarray(out.numpy()) / samples for out in both)
    return reflected, gathered


def _irradiance(traced: TracedView, paths: PixelPaths, tables: _Tables) -> mi.Float:
    """Irradiance of the surfaces by all but the direct sun [lx]."""
    count = dr.width(paths.weight)
    replicate = paths.slot % traced.light.base.accuracy.replicates
    cells, entries = (dr.opaque(mi.UInt32, n) for n in (traced.light.cells, len(traced.glow)))
    E = dr.zeros(mi.Float, count)
    dr.eval(E, replicate)
    if dr.width(paths.gather) and dr.width(paths.gather_surface):
        cell = dr.gather(mi.UInt32, replicate, paths.gather_surface) * cells + paths.gather_cell
        value = mi.Float(paths.gather) * dr.gather(mi.Float, tables.cells, cell)
        dr.scatter_add(E, value, paths.gather_surface)
    elif dr.width(paths.gather):
        E += _sum(traced.sampling.paths, replicate * cells, paths.gather_cell, paths.gather,
                  tables.cells)  # fmt: skip
    dr.eval(E)
    if dr.width(paths.sky):
        none = dr.zeros(mi.UInt32, count)
        E += _sum(traced.sampling.sky, none, paths.sky_bin, paths.sky, tables.sky)
    rays, whole = traced.sampling.panes, count * traced.sampling.panes
    for column in range(dr.width(paths.look) // max(1, whole)):
        here = dr.opaque(mi.UInt32, column * whole)
        E += _sum(rays, replicate * entries, paths.look_at, paths.look, tables.glow.rest, here)
    return E


@symbolic
def _sum(
    rays: int, base: mi.UInt32, at: mi.UInt32, weight: mi.Float16, table: mi.Float,
    first: mi.UInt32 | int = 0,
) -> mi.Float:  # fmt: skip
    """Σ weight · table[base + at] over the rays of every surface."""
    count, index, total = dr.opaque(mi.UInt32, rays), mi.UInt32(0), mi.Float(0)
    entry = dr.arange(mi.UInt32, dr.width(base)) * count + first
    while dr.hint(index < count, exclude=[base, at, weight, table]):
        here = dr.gather(mi.UInt32, at, entry + index)
        value = mi.Float(dr.gather(mi.Float16, weight, entry + index))
        total += value * dr.gather(mi.Float, table, base + here)
        index += 1
    return total
