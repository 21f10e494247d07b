r"""Glare sources of every hour, from the luminances of an eye's pixels.

Two tiles are joined where a bright ray of one is within half of the opening angle of a bright ray
of the other, and a chain of such tiles is one source: the rule of `picture.glare_sources`. Rays
brighter than the peak are taken out of their source and joined among themselves. The bright tiles
of all hours are the nodes of one graph. Chains end where a view ends: first tiles are joined that
the same views have in front of them, to *parts*; then, view by view, parts are.

The sum that DGP asks for is Σ L_s² ω_s / P_s², with the mean luminance L_s, the solid angle ω_s and
the position index P_s of each source.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.glare_year.components import components
from drcmitsuba.glare_year.tiles import GROUPS, EyeTiles, Links
from drcmitsuba.picture.position_index import position_index
from drcmitsuba.runtime.flat_arrays import flat, flat_indices

LEAST = 1e-12
"""Smallest solid angle of a source [sr]."""


@dataclass(frozen=True, eq=False)
class SourceParts:
    """Parts of sources: bright tiles that are joined and that the same views see."""

    tile: mi.UInt32
    """One of the tiles of every part."""
    hour: mi.UInt32
    solid_angle: mi.Float
    """[sr]"""
    flux: mi.Float
    """Luminance · solid angle [cd/m² sr]."""
    moment: mi.Vector3f
    """Sum of the directions of the tiles, weighted by their flux [cd/m² sr]."""
    one: mi.UInt32
    """Part at the first end of each link between parts that not all the same views see."""
    two: mi.UInt32
    """Part at its other end."""


def contrast_sums(
    luminance: np.ndarray, tiles: EyeTiles, frames: np.ndarray, threshold: np.ndarray, peak: float
) -> np.ndarray:
    """Σ L_s² ω_s / P_s² of some views from one place, in some hours.

    Parameters
    ----------
    luminance : np.ndarray, shape (pixel, hour)
        Luminance of the pixels, without the suns' disks [cd/m²].
    tiles : Tiles
    frames : np.ndarray, shape (view, 3, 3)
        Unit vectors to the right, up and forward of the views of `tiles`.
    threshold : np.ndarray, shape (hour,) or (view, hour)
        Luminance above which a pixel is bright [cd/m²].
    peak : float
        Luminance above which pixels are sources of their own [cd/m²].

    Returns
    -------
    np.ndarray, shape (view, hour)
        Sums [cd²/m⁴ sr].
    """
    views = np.arange(len(frames))
    out = np.zeros((len(frames), luminance.shape[1]))
    L = flat(luminance)
    alike = threshold.ndim == 1
    for some, limit in (
        [(views, threshold)] if alike else zip(views[:, None], threshold, strict=True)
    ):
        for parts in _bright(L, tiles, limit, peak):
            out[some] += _sums(parts, tiles.ahead[some], frames[some], out.shape[1])
    return out


def _bright(L: mi.Float, tiles: EyeTiles, threshold: np.ndarray, peak: float) -> list[SourceParts]:
    """Parts of sources below the peak, and of those above it."""
    hours = dr.opaque(mi.UInt32, len(threshold))
    lane = dr.arange(mi.UInt32, len(tiles) * len(threshold))
    limit = dr.gather(mi.Float, flat(threshold), lane % hours)
    members = (flat_indices(column) for column in tiles.members)
    every, peaks, sums = _tile_sums(L, lane, hours, *members, limit, dr.opaque(mi.Float, peak))
    dr.eval(every, peaks, sums)
    omega = mi.Float(tiles.solid_angle)
    below = omega * mi.Float(dr.popcnt(every & ~peaks)), omega * sums[0]
    kinds = [_joined(tiles, every, below, hours)]  # peaks join, too
    if dr.any(peaks > 0):
        above = omega * mi.Float(dr.popcnt(peaks)), omega * sums[1]
        kinds.append(_joined(tiles, peaks, above, hours))
    return [parts for parts in kinds if parts is not None]


@symbolic
def _tile_sums(
    L: mi.Float, lane: mi.UInt32, hours: mi.UInt32, first: mi.UInt32, pixel: mi.UInt32,
    rays: mi.UInt32, limit: mi.Float, peak: mi.Float,
) -> tuple[mi.UInt32, mi.UInt32, tuple[mi.Float, mi.Float]]:  # fmt: skip
    """Bright rays of each tile and hour and those above the peak, as bits; sums of luminances."""
    tile, hour = lane // hours, lane % hours
    member, end = dr.gather(mi.UInt32, first, tile), dr.gather(mi.UInt32, first, tile + 1)
    every, peaks = mi.UInt32(0), mi.UInt32(0)
    below, above = mi.Float(0), mi.Float(0)
    while dr.hint(member < end, exclude=[L, hours, pixel, rays, limit, peak, hour]):
        value = dr.gather(mi.Float, L, dr.gather(mi.UInt32, pixel, member) * hours + hour)
        bits = dr.gather(mi.UInt32, rays, member)
        is_bright = value > limit
        is_peak = is_bright & (value > peak)
        total = value * mi.Float(dr.popcnt(bits))
        every |= dr.select(is_bright, bits, 0)
        peaks |= dr.select(is_peak, bits, 0)
        below += dr.select(is_bright & ~is_peak, total, 0)
        above += dr.select(is_peak, total, 0)
        member += 1
    return every, peaks, (below, above)


def _joined(
    tiles: EyeTiles, bits: mi.UInt32, sums: tuple[mi.Float, mi.Float], hours: mi.UInt32
) -> SourceParts | None:
    """Parts that the bright rays of every hour make.

    Parameters
    ----------
    bits : mi.UInt32, shape (tile · hour,)
        Bright rays.
    sums : tuple of mi.Float, shape (tile · hour,)
        Solid angle [sr] and luminance · solid angle [cd/m² sr] of what counts of a tile.
    """
    at = dr.compress(bits > 0)
    entries = dr.width(at)
    if not entries:
        return None
    number = dr.zeros(mi.UInt32, dr.width(bits))
    dr.eval(number)
    dr.scatter(number, dr.arange(mi.UInt32, entries), at)
    dr.eval(number)
    tile, hour = at // hours, at % hours
    dr.eval(tile, hour)
    alike, across = _edges(tiles.links, tile, hour, bits, number, hours)
    label = components(entries, *alike)
    root = label == dr.arange(mi.UInt32, entries)
    part = dr.gather(mi.UInt32, dr.cumsum(dr.select(root, mi.UInt32(1), 0)) - 1, label)
    tops = dr.compress(root)
    omega, flux = (dr.gather(mi.Float, values, at) for values in sums)
    moment = flux * dr.gather(mi.Vector3f, flat(tiles.direction), tile)
    solid_angle, total, *moments = _added((omega, flux, *moment), part, dr.width(tops))
    one, two = (dr.gather(mi.UInt32, part, end) for end in across)
    return SourceParts(
        dr.gather(mi.UInt32, tile, tops), dr.gather(mi.UInt32, hour, tops), solid_angle, total,
        mi.Vector3f(*moments), one, two,
    )  # fmt: skip


def _added(
    values: tuple[mi.Float, ...], slot: mi.UInt32, count: int, active: mi.Bool | bool = True
) -> list[mi.Float]:
    """Sums of columns by slot."""
    columns = []
    for one in values:
        column = dr.zeros(mi.Float, count)
        dr.scatter_add(column, one, slot, active)
        columns.append(column)
    dr.eval(columns)
    return columns


def _edges(
    links: Links, tile: mi.UInt32, hour: mi.UInt32, bits: mi.UInt32, number: mi.UInt32,
    hours: mi.UInt32,
) -> list[tuple[mi.UInt32, mi.UInt32]]:  # fmt: skip
    """Edges between bright tiles of each hour: those that the same views see, and others.

    Parameters
    ----------
    links : Links
    tile, hour : mi.UInt32, shape (node,)
        Bright tile and its hour.
    bits, number : mi.UInt32, shape (tile · hour,)
        Bright rays, and the node of a bright tile.
    """
    most = int(np.diff(links.first).max(initial=0))
    if not most:
        return [(mi.UInt32(), mi.UInt32())] * 2
    nodes = dr.opaque(mi.UInt32, dr.width(tile))
    lane = dr.arange(mi.UInt32, dr.width(tile) * most)
    turn = lane // nodes
    node = lane - turn * nodes  # neighbours are hours of one tile: their memory is, too
    own_tile, own_hour = (dr.gather(mi.UInt32, values, node) for values in (tile, hour))
    first = flat_indices(links.first)
    link = dr.gather(mi.UInt32, first, own_tile) + turn
    exists = link < dr.gather(mi.UInt32, first, own_tile + 1)
    here = own_tile * hours + own_hour
    there = dr.gather(mi.UInt32, flat_indices(links.two), link, exists) * hours + own_hour
    own, shown = (dr.gather(mi.UInt32, bits, place, exists) for place in (here, there))
    reach, reached = flat_indices(links.reach), mi.UInt32(0)
    for group in range(GROUPS):
        some = (own >> (4 * group)) & 15
        reached |= dr.gather(mi.UInt32, reach, (link * GROUPS + group) * 16 + some, exists)
    met = (reached & shown) > 0
    alike = dr.gather(mi.Bool, mi.Bool(links.alike), link, exists)
    other = dr.gather(mi.UInt32, number, there, met)
    dr.eval(met, alike, node, other)
    edges = []
    for kind in (met & alike, met & ~alike):
        kept = dr.compress(kind)
        edges.append((dr.gather(mi.UInt32, node, kept), dr.gather(mi.UInt32, other, kept)))
    return edges


def _sums(parts: SourceParts, ahead: np.ndarray, frames: np.ndarray, hours: int) -> np.ndarray:
    """Σ L² ω / P² over the sources in front of some views, shape (view, hour)."""
    views, count = len(frames), dr.width(parts.tile)
    stride = dr.opaque(mi.UInt32, count)
    lane = dr.arange(mi.UInt32, count * views)
    part, view = lane % stride, lane // stride
    before = dr.gather(mi.Bool, mi.Bool(ahead.ravel()),
                       view * ahead.shape[1] + dr.gather(mi.UInt32, parts.tile, part))  # fmt: skip
    dr.eval(before)
    source = components(count * views, *_edges_of_views(parts, before, views))
    values = (parts.solid_angle, parts.flux, *parts.moment)
    each = tuple(dr.gather(mi.Float, column, part) for column in values)
    columns = _added(each, source, count * views, before)
    kept = dr.compress(columns[0] > LEAST)
    if not dr.width(kept):
        return np.zeros((views, hours))
    w, f, *xyz = (dr.gather(mi.Float, column, kept).numpy().astype(float) for column in columns)
    view_of, hour_of = (
        values.numpy()
        for values in (kept // stride, dr.gather(mi.UInt32, parts.hour, kept % stride))
    )
    local = np.einsum("si,ski->sk", np.stack(xyz, axis=-1), frames[view_of])
    P = position_index(local / np.linalg.norm(local, axis=-1, keepdims=True))
    sums = np.bincount(view_of * hours + hour_of, f**2 / w / P**2, views * hours)
    return sums.reshape(views, hours)


def _edges_of_views(parts: SourceParts, before: mi.Bool, views: int) -> tuple[mi.UInt32, mi.UInt32]:
    """Links between the parts (view · part,) that each view has before it."""
    links, count = dr.width(parts.one), dr.width(parts.tile)
    if not links:
        return mi.UInt32(), mi.UInt32()
    lane, stride = dr.arange(mi.UInt32, links * views), dr.opaque(mi.UInt32, links)
    link, of_view = lane % stride, lane // stride * count
    one, two = (of_view + dr.gather(mi.UInt32, end, link) for end in (parts.one, parts.two))
    joins = dr.compress(dr.gather(mi.Bool, before, one) & dr.gather(mi.Bool, before, two))
    ends = (dr.gather(mi.UInt32, end, joins) for end in (one, two))
    return next(ends), next(ends)
