"""Picture of an hour: the sum over light paths with the light of the hour."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.sampling import TO_UNIT, disk_solid_angle, random_bits, sample_disk

from drcmitsuba.rendering.light_paths import Paths, TracedView
from drcmitsuba.rendering.outside import Outside
from drcmitsuba.rendering.surface_light import Sources
from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.schema import mean_and_error
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.shadow_rays import straight


@dataclass(frozen=True)
class Luminance:
    """Luminance of the pixels in one colour channel."""

    mean: np.ndarray
    """[cd/m²], shape (row, column)."""
    error: np.ndarray
    """Standard error of the mean [cd/m²], shape (row, column)."""


@dataclass(frozen=True)
class _Tables:
    """Light of the hour on cells, of the sky, of panes, as flat arrays."""

    cells: mi.Float
    """Irradiance [lx], (replicate, cell)."""
    sky: mi.Float
    """Luminance of ground and patches [cd/m²]."""
    glow: mi.Float
    """Radiance of the panes' entries [cd/m²], (replicate, entry)."""


def luminance(traced: TracedView, outside: Outside, sky: np.ndarray) -> Luminance:
    """Luminance of a view at an instant, with the sun's disk.

    Parameters
    ----------
    traced, outside, sky
        As for `replicates`.

    Returns
    -------
    Luminance
    """
    mean, error = mean_and_error(replicates(traced, outside, sky))
    disk = outside.disk_in(traced.scene, traced.view, (traced.rows, traced.columns))
    return Luminance(mean + disk, error)


def replicates(traced: TracedView, outside: Outside, sky: np.ndarray) -> np.ndarray:
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
        Luminance without the sun's disk where it is seen straight [cd/m²].
    """
    light = traced.light
    sun = outside.sun if _lights(traced, outside) else 0.0
    sources = Sources(sky, sun, outside.direction)
    by_sun = light.under(outside.direction) if sun > 0 else []
    glow = light.glow(traced.glow, sources, by_sun) if len(traced.glow) else mi.Float(0)
    tables = _Tables(light.irradiance(sources, by_sun), flat(sky), glow)
    dr.eval(tables.cells, tables.glow)
    parts = [_slots(traced, paths, outside, tables, sun) for paths in traced.tiles()]
    count = light.base.accuracy.replicates
    of_pixels = np.concatenate(parts).reshape(traced.rows, traced.columns, count)
    return np.moveaxis(of_pixels, -1, 0)


def _lights(traced: TracedView, outside: Outside) -> bool:
    """Whether the sun shines and can light what is simulated."""
    suns = Suns(("sun",), outside.direction[None], outside.diameter)
    return outside.sun > 0 and bool(traced.scene.effects.enabled_suns(suns)[0])


def _directions(d: np.ndarray) -> mi.Vector3f:
    return mi.Vector3f(*(flat(d[:, i]) for i in range(3)))


def _slots(
    traced: TracedView, paths: Paths, outside: Outside, tables: _Tables, sun: float
) -> np.ndarray:
    """Luminance of some pixels in every replicate [cd/m²], shape (slot,)."""
    accuracy = traced.light.base.accuracy
    replicates = accuracy.replicates
    out = dr.zeros(mi.Float, paths.slots)
    first = dr.opaque(mi.UInt32, paths.first)
    dr.eval(out)

    def add(slot: np.ndarray, value: mi.Float) -> None:
        dr.scatter_add(out, value, flat_indices(slot) - first)
        dr.eval(out)

    if len(paths.through):
        d = _directions(paths.through_d)
        add(paths.through_slot, flat(paths.through) * outside.sky(d))
    if len(paths.mirrored):
        d = _directions(paths.mirrored_d)
        add(paths.mirrored_slot, flat(paths.mirrored) * outside.with_sun(d))
    if len(paths.pane):
        at = flat_indices(paths.pane_slot) % replicates * len(traced.glow)
        glow = dr.gather(mi.Float, tables.glow, at + flat_indices(paths.pane_at))
        add(paths.pane_slot, flat(paths.pane) * glow)
    if len(paths.weight):
        E = _irradiance(traced, paths, tables)
        if sun > 0:
            E += _direct_sun(traced, paths, outside)
        add(paths.slot, flat(paths.weight) * E * dr.inv_pi)
    shares = traced.sampling.samples // replicates
    return np.asarray(out.numpy()) / np.float32(shares)


def _irradiance(traced: TracedView, paths: Paths, tables: _Tables) -> mi.Float:
    """Irradiance of the surfaces by all but the direct sun [lx]."""
    count, replicates = len(paths.weight), traced.light.base.accuracy.replicates
    replicate = flat_indices(paths.slot) % replicates
    E = dr.zeros(mi.Float, count)
    dr.eval(E, replicate)
    if len(paths.gather):
        row = flat_indices(paths.gather_surface)
        if not len(paths.gather_surface):
            row = dr.arange(mi.UInt32, len(paths.gather)) // traced.sampling.paths
        cells = dr.opaque(mi.UInt32, traced.light.cells)
        cell = dr.gather(mi.UInt32, replicate, row) * cells + flat_indices(paths.gather_cell)
        dr.scatter_add(E, flat(paths.gather) * dr.gather(mi.Float, tables.cells, cell), row)
        dr.eval(E)
    if len(paths.sky):
        row = dr.arange(mi.UInt32, len(paths.sky)) // traced.sampling.sky
        L = dr.gather(mi.Float, tables.sky, flat_indices(paths.sky_bin))
        dr.scatter_add(E, flat(paths.sky) * L, row)
        dr.eval(E)
    if len(paths.look):
        row = dr.arange(mi.UInt32, len(paths.look)) // traced.sampling.panes
        row %= dr.opaque(mi.UInt32, count)
        at = dr.gather(mi.UInt32, replicate, row) * dr.opaque(mi.UInt32, len(traced.glow))
        L = dr.gather(mi.Float, tables.glow, at + flat_indices(paths.look_at))
        dr.scatter_add(E, flat(paths.look) * L, row)
        dr.eval(E)
    return E


def _direct_sun(traced: TracedView, paths: Paths, outside: Outside) -> mi.Float:
    """Irradiance of the surfaces by the sun through openings and clear panes [lx]."""
    p, n = (_directions(a) for a in (paths.p, paths.n))
    number = dr.arange(mi.UInt32, len(paths.weight)) + dr.opaque(mi.UInt32, paths.first)
    seed = launch_seed(traced.light.base.accuracy.seed, Stream.EYE_SUN)
    place = mi.Point2f(*(mi.Float(v >> 8) * TO_UNIT for v in random_bits(number, seed)))
    centre = dr.opaque(mi.Vector3f, list(map(float, outside.direction)))
    d = sample_disk(centre, outside.diameter, place)
    cosine = dr.dot(n, d)
    with traced.scene.ray_counter.purpose(Stream.EYE_SUN.name):
        tau = straight(traced.scene, mi.Point3f(p), d, cosine > 0)
    E = dr.opaque(mi.Float, outside.sun * disk_solid_angle(outside.diameter))
    return dr.select(tau > 0, tau * cosine * E, 0)
