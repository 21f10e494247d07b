r"""Glare sources of every hour, from the luminances of an eye's pixels.

Bright pixels of a tile stand together at the tile's centre. Bright tiles are joined to one source
by the rule of `picture.glare_sources`: a chain of them in which each is within half of the opening
angle of the next. Pixels brighter than the peak are taken out of their source and joined among
themselves. Each hour is labelled in parallel: a tile takes the least label of its neighbours until
none changes.

The sum that DGP asks for is Σ L_s² ω_s / P_s², with the mean luminance L_s, the solid angle ω_s and
the position index P_s of each source.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.picture.position_index import position_index
from drcmitsuba.runtime.flat_arrays import flat, flat_indices

LEAST = 1e-12
"""Smallest solid angle of a source [sr]."""


@dataclass(frozen=True, eq=False)
class Tiles:
    """Tiles of an eye's pixels, which are sorted by tile."""

    first: np.ndarray
    """First pixel of every tile, and last the number of pixels, int, shape (tile + 1,)."""
    direction: np.ndarray
    """Unit vectors to the tiles' centres, shape (tile, 3)."""
    solid_angle: np.ndarray
    """Solid angles of the pixels [sr], shape (pixel,)."""
    opening: float = 0.2
    """Opening angle within which bright tiles are one source [rad]."""

    def __len__(self) -> int:
        """Count the tiles."""
        return len(self.direction)

    @cached_property
    def neighbours(self) -> np.ndarray:
        """Tiles within half of the opening angle, padded with the tile itself, (tile, most)."""
        count, near = len(self), []
        block = max(1, (1 << 22) // max(count, 1))
        for start in range(0, count, block):
            here = self.direction[start : start + block] @ self.direction.T
            near += [np.flatnonzero(row) for row in here >= np.cos(self.opening / 2)]
        most = max(map(len, near), default=0)
        out = np.repeat(np.arange(count)[:, None], max(most, 1), axis=1)
        for i, row in enumerate(near):
            out[i, : len(row)] = row
        return out


@dataclass(frozen=True, eq=False)
class Bright:
    """Bright parts of tiles in some hours: those above the threshold, or above the peak."""

    tile: mi.UInt32
    hour: mi.UInt32
    source: mi.UInt32
    """Index of the source among `count`."""
    solid_angle: mi.Float
    """[sr]"""
    flux: mi.Float
    """Luminance · solid angle [cd/m² sr]."""
    count: int


def contrast_sums(
    luminance: np.ndarray, tiles: Tiles, frames: np.ndarray, threshold: np.ndarray, peak: float
) -> np.ndarray:
    """Σ L_s² ω_s / P_s² of some views from one place, in some hours.

    Parameters
    ----------
    luminance : np.ndarray, shape (pixel, hour)
        Luminance of the pixels, without the suns' disks [cd/m²].
    tiles : Tiles
    frames : np.ndarray, shape (view, 3, 3)
        Unit vectors to the right, up and forward.
    threshold : np.ndarray, shape (hour,) or (view, hour)
        Luminance above which a pixel is bright [cd/m²].
    peak : float
        Luminance above which pixels are sources of their own [cd/m²].

    Returns
    -------
    np.ndarray, shape (view, hour)
        Sums [cd²/m⁴ sr].
    """
    out = np.zeros((len(frames), luminance.shape[1]))
    L = flat(luminance)
    if threshold.ndim == 1:
        for bright in _bright(L, tiles, threshold, peak):
            out += _sums(bright, tiles, frames, out.shape[1])
    else:
        for i, limit in enumerate(threshold):
            for bright in _bright(L, tiles, limit, peak):
                out[i] += _sums(bright, tiles, frames[i : i + 1], out.shape[1])[0]
    return out


def _bright(L: mi.Float, tiles: Tiles, threshold: np.ndarray, peak: float) -> list[Bright]:
    """Bright tiles with their sources: at most those below the peak, and those above."""
    hours = dr.opaque(mi.UInt32, len(threshold))
    lane = dr.arange(mi.UInt32, len(tiles) * len(threshold))
    limit = dr.gather(mi.Float, flat(threshold), lane % hours)
    below, above = _tile_sums(
        L, lane, hours, flat_indices(tiles.first), flat(tiles.solid_angle), limit,
        dr.opaque(mi.Float, peak),
    )  # fmt: skip
    dr.eval(below, above)
    every = below[0] + above[0] > LEAST  # peaks join what lies around them
    found = [_joined(tiles, every, below[0] > LEAST, below, hours)]
    if dr.any(above[0] > LEAST):
        found.append(_joined(tiles, above[0] > LEAST, above[0] > LEAST, above, hours))
    return [bright for bright in found if bright is not None]


@dr.syntax
def _tile_sums(
    L: mi.Float, lane: mi.UInt32, hours: mi.UInt32, first: mi.UInt32, omega: mi.Float,
    limit: mi.Float, peak: mi.Float,
) -> tuple[tuple[mi.Float, mi.Float], tuple[mi.Float, mi.Float]]:  # fmt: skip
    """Solid angle and flux of each tile's pixels above the limit, below and above the peak."""
    tile, hour = lane // hours, lane % hours
    pixel, end = dr.gather(mi.UInt32, first, tile), dr.gather(mi.UInt32, first, tile + 1)
    w0, f0, w1, f1 = mi.Float(0), mi.Float(0), mi.Float(0), mi.Float(0)
    while dr.hint(pixel < end, exclude=[L, hours, omega, limit, peak, hour, first]):
        value = dr.gather(mi.Float, L, pixel * hours + hour)
        w = dr.gather(mi.Float, omega, pixel)
        is_peak = value > peak
        is_bright = (value > limit) & ~is_peak
        w0 += dr.select(is_bright, w, 0)
        f0 += dr.select(is_bright, w * value, 0)
        w1 += dr.select(is_peak & (value > limit), w, 0)
        f1 += dr.select(is_peak & (value > limit), w * value, 0)
        pixel += 1
    return (w0, f0), (w1, f1)


def _joined(
    tiles: Tiles, bright: mi.Bool, counted: mi.Bool, sums: tuple[mi.Float, mi.Float],
    hours: mi.UInt32,
) -> Bright | None:  # fmt: skip
    """Sources of the bright tiles of every hour; only `counted` ones add to them."""
    at = dr.compress(bright)
    if not dr.width(at):
        return None
    label = dr.full(mi.UInt32, dr.width(bright), dr.width(bright))
    dr.eval(label)
    dr.scatter(label, at, at)
    near, most = flat_indices(tiles.neighbours), tiles.neighbours.shape[1]
    while True:
        before = dr.gather(mi.UInt32, label, at)
        least = _least(label, at, hours, near, dr.opaque(mi.UInt32, most))
        dr.eval(before, least)
        if not dr.any(least != before):
            break
        for place in (before, at):  # the tile that gave its label takes the new one, too
            dr.scatter_reduce(dr.ReduceOp.Min, label, least, place)
        dr.eval(label)
        jumped = dr.gather(mi.UInt32, label, dr.gather(mi.UInt32, label, at))
        dr.eval(jumped)
        dr.scatter(label, jumped, at)
        dr.eval(label)
    root = dr.gather(mi.UInt32, label, at) == at
    number = dr.zeros(mi.UInt32, dr.width(bright))
    dr.eval(number)
    order = dr.cumsum(dr.select(root, mi.UInt32(1), 0))
    dr.scatter(number, order - 1, at, root)
    dr.eval(number)
    kept = dr.compress(counted)
    source = dr.gather(mi.UInt32, number, dr.gather(mi.UInt32, label, kept))
    omega, flux = (dr.gather(mi.Float, values, kept) for values in sums)
    return Bright(kept // hours, kept % hours, source, omega, flux, int(order[-1]))


@dr.syntax
def _least(
    label: mi.UInt32, at: mi.UInt32, hours: mi.UInt32, near: mi.UInt32, most: mi.UInt32
) -> mi.UInt32:
    """Least label of each bright tile and its neighbours in the same hour."""
    tile, hour = at // hours, at % hours
    least, i = dr.gather(mi.UInt32, label, at), mi.UInt32(0)
    while dr.hint(i < most, exclude=[label, at, hours, near, most, tile, hour]):
        other = dr.gather(mi.UInt32, near, tile * most + i)
        least = dr.minimum(least, dr.gather(mi.UInt32, label, other * hours + hour))
        i += 1
    return least


def _sums(bright: Bright, tiles: Tiles, frames: np.ndarray, hours: int) -> np.ndarray:
    """Σ L² ω / P² over the sources in front of each view, shape (view, hour)."""
    views, entries = len(frames), dr.width(bright.tile)
    count = dr.opaque(mi.UInt32, entries)
    lane = dr.arange(mi.UInt32, entries * views)
    entry, view = lane % count, lane // count
    forward = dr.gather(mi.Vector3f, flat(frames[:, 2]), view)
    tile = dr.gather(mi.UInt32, bright.tile, entry)
    d = dr.gather(mi.Vector3f, flat(tiles.direction), tile)
    ahead = dr.dot(d, forward) > 0
    slot = dr.gather(mi.UInt32, bright.source, entry) + view * dr.opaque(mi.UInt32, bright.count)
    omega = dr.gather(mi.Float, bright.solid_angle, entry)
    flux = dr.gather(mi.Float, bright.flux, entry)
    columns = []
    for values in (omega, flux, flux * d.x, flux * d.y, flux * d.z):
        column = dr.zeros(mi.Float, bright.count * views)
        dr.scatter_add(column, values, slot, ahead)
        columns.append(column)
    hour = dr.zeros(mi.UInt32, bright.count)
    dr.eval(hour, columns)
    dr.scatter(hour, bright.hour, bright.source)
    w, f, *xyz = (column.numpy().reshape(views, -1).astype(float) for column in columns)
    towards = np.stack(xyz, axis=-1)
    seen = w > LEAST
    local = np.einsum("vsi,vki->vsk", towards, frames)
    length = np.linalg.norm(local, axis=-1, keepdims=True)
    P = position_index(local / np.where(length > 0, length, 1))
    parts = np.where(seen, f**2 / np.where(seen, w, 1) / P**2, 0)
    at = hour.numpy() + hours * np.arange(views)[:, None]
    return np.bincount(at.ravel(), parts.ravel(), views * hours).reshape(views, hours)
