r"""Glare sources of every hour, from the luminances of an eye's pixels.

Two tiles are joined where a bright ray of one is within half of the opening angle of a bright ray
of the other, and a chain of such tiles is one source: the rule of `picture.glare_sources`. Rays
brighter than the peak are taken out of their source and joined among themselves. Each hour is
labelled in parallel: a tile takes the least label of its neighbours until none changes. Chains end
where a view ends: first tiles are joined that the same views have in front of them, then, view by
view, what they make.

The sum that DGP asks for is Σ L_s² ω_s / P_s², with the mean luminance L_s, the solid angle ω_s and
the position index P_s of each source.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.picture.position_index import position_index
from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.flat_arrays import flat, flat_indices

spatial = lazy.module("scipy.spatial")
sparse = lazy.module("scipy.sparse")
csgraph = lazy.module("scipy.sparse.csgraph")

LEAST = 1e-12
"""Smallest solid angle of a source [sr]."""
MOST_RAYS = 16
"""Largest number of rays of a tile."""
PAIRS = 1 << 13
"""Number of pairs of tiles whose rays are compared at once."""


class Links(NamedTuple):
    """Pairs of tiles whose rays may be within half of the opening angle."""

    first: np.ndarray
    """First link of every tile, and last the number of links, int, shape (tile + 1,)."""
    size: int
    one: mi.UInt32
    """Tile that a link leads from."""
    two: mi.UInt32
    """Tile that a link leads to."""
    reach: mi.UInt32
    """Rays of the second tile that each ray of the first reaches, as bits, (link · MOST_RAYS,)."""


@dataclass(frozen=True, eq=False)
class Tiles:
    """Rays of an eye by tile."""

    first: np.ndarray
    """First ray of every tile, and last the number of rays, int, shape (tile + 1,)."""
    rays: np.ndarray
    """Unit vectors, sorted by tile, at most `MOST_RAYS` of each, shape (ray, 3)."""
    pixel: np.ndarray
    """Pixel whose luminance each ray has, int, shape (ray,)."""
    solid_angle: float
    """Solid angle of a ray [sr]."""
    forward: np.ndarray
    """Lines of sight of the views, shape (view, 3)."""
    opening: float = 0.2
    """Opening angle within which bright rays are one source [rad]."""

    def __len__(self) -> int:
        """Count the tiles."""
        return len(self.first) - 1

    @cached_property
    def direction(self) -> np.ndarray:
        """Unit vectors to the tiles' centres, shape (tile, 3)."""
        middle = np.add.reduceat(self.rays, self.first[:-1], axis=0)
        return np.asarray(middle / np.linalg.norm(middle, axis=1, keepdims=True))

    @cached_property
    def by_pixel(self) -> np.ndarray:
        """Solid angles of the pixels [sr], shape (pixel,)."""
        return self.solid_angle * np.bincount(self.pixel)

    @cached_property
    def ahead(self) -> np.ndarray:
        """Whether each view has each tile in front of it, shape (view, tile)."""
        return np.asarray(self.forward @ self.direction.T > 0)

    @cached_property
    def links(self) -> tuple[Links, Links]:
        """Links between tiles that the same views have in front of them, and other links."""
        of_tile = np.repeat(np.arange(len(self)), np.diff(self.first))
        spread = np.zeros(len(self))
        np.maximum.at(spread, of_tile, np.linalg.norm(self.rays - self.direction[of_tile], axis=1))
        longest = 2 * np.sin(self.opening / 4)
        width = longest + 2 * spread.max(initial=0)
        pairs = spatial.cKDTree(self.direction).query_pairs(width, output_type="ndarray")
        _, seen_by = np.unique(self.ahead, axis=1, return_inverse=True)
        alike = np.equal(*seen_by.ravel()[pairs].T)
        return self._reaching(pairs[alike], longest), self._reaching(pairs[~alike], longest)

    def _reaching(self, pairs: np.ndarray, longest: float) -> Links:
        """Links of those pairs of tiles of which some rays are near each other."""
        sizes = np.diff(self.first)
        inside = np.minimum(np.arange(MOST_RAYS), sizes[:, None] - 1)
        d = self.rays[self.first[:-1, None] + inside]  # a last ray may stand more than once
        bits = np.where(np.arange(MOST_RAYS) < sizes[:, None], 1 << np.arange(MOST_RAYS), 0)
        pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
        reach = np.zeros((len(pairs), MOST_RAYS), np.uint32)
        for start in range(0, len(pairs), PAIRS):
            one, two = pairs[start : start + PAIRS].T
            near = 1 - np.einsum("pix,pjx->pij", d[one], d[two]) <= longest**2 / 2
            reach[start : start + PAIRS] = (near * bits[two][:, None]).sum(axis=2)
        linked = reach.any(axis=1)
        pairs, reach = pairs[linked], reach[linked]
        first = np.searchsorted(pairs[:, 0], np.arange(len(self) + 1))
        one, two = (flat_indices(np.append(column, 0)) for column in pairs.T)  # never empty
        return Links(first, len(pairs), one, two, flat_indices(np.append(reach.ravel(), 0)))


@dataclass(frozen=True, eq=False)
class Bright:
    """Bright parts of tiles in some hours: those above the threshold, or above the peak."""

    tile: mi.UInt32
    hour: mi.UInt32
    part: mi.UInt32
    """Index of the part of a source that tiles make which the same views see."""
    solid_angle: mi.Float
    """[sr]"""
    flux: mi.Float
    """Luminance · solid angle [cd/m² sr]."""
    source: np.ndarray
    """Source that a part belongs to in each view, int, shape (view, part)."""


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
        for bright in _bright(L, tiles, limit, peak):
            out[some] += _sums(bright, tiles, frames, some, out.shape[1])
    return out


def _bright(L: mi.Float, tiles: Tiles, threshold: np.ndarray, peak: float) -> list[Bright]:
    """Bright tiles with their sources: at most those below the peak, and those above."""
    hours = dr.opaque(mi.UInt32, len(threshold))
    lane = dr.arange(mi.UInt32, len(tiles) * len(threshold))
    limit = dr.gather(mi.Float, flat(threshold), lane % hours)
    every, peaks, sums = _tile_sums(
        L, lane, hours, flat_indices(tiles.first), flat_indices(tiles.pixel), limit,
        dr.opaque(mi.Float, peak),
    )  # fmt: skip
    dr.eval(every, peaks, sums)
    omega = mi.Float(tiles.solid_angle)
    below = omega * mi.Float(dr.popcnt(every & ~peaks)), omega * sums[0]
    found = [_joined(tiles, every, (every & ~peaks) > 0, below, hours)]  # peaks join, too
    if dr.any(peaks > 0):
        above = omega * mi.Float(dr.popcnt(peaks)), omega * sums[1]
        found.append(_joined(tiles, peaks, peaks > 0, above, hours))
    return [bright for bright in found if bright is not None]


@dr.syntax
def _tile_sums(
    L: mi.Float, lane: mi.UInt32, hours: mi.UInt32, first: mi.UInt32, pixel: mi.UInt32,
    limit: mi.Float, peak: mi.Float,
) -> tuple[mi.UInt32, mi.UInt32, tuple[mi.Float, mi.Float]]:  # fmt: skip
    """Bright rays of each tile and hour and those above the peak, as bits; sums of luminances."""
    tile, hour = lane // hours, lane % hours
    ray, end = dr.gather(mi.UInt32, first, tile), dr.gather(mi.UInt32, first, tile + 1)
    every, peaks, bit = mi.UInt32(0), mi.UInt32(0), mi.UInt32(1)
    below, above = mi.Float(0), mi.Float(0)
    while dr.hint(ray < end, exclude=[L, hours, pixel, limit, peak, hour, first]):
        value = dr.gather(mi.Float, L, dr.gather(mi.UInt32, pixel, ray) * hours + hour)
        is_bright = value > limit
        is_peak = is_bright & (value > peak)
        every |= dr.select(is_bright, bit, 0)
        peaks |= dr.select(is_peak, bit, 0)
        below += dr.select(is_bright & ~is_peak, value, 0)
        above += dr.select(is_peak, value, 0)
        bit <<= 1
        ray += 1
    return every, peaks, (below, above)


def _joined(
    tiles: Tiles, bits: mi.UInt32, counted: mi.Bool, sums: tuple[mi.Float, mi.Float],
    hours: mi.UInt32,
) -> Bright | None:  # fmt: skip
    """Sources of the bright rays of every hour; only `counted` tiles add to them."""
    at = dr.compress(bits > 0)
    if not dr.width(at):
        return None
    alike, across = tiles.links
    first = flat_indices(alike.first)
    label = dr.full(mi.UInt32, dr.width(bits), dr.width(bits))
    dr.eval(label)
    dr.scatter(label, at, at)
    dr.eval(label)
    while True:
        hooked = mi.UInt32(label)
        dr.eval(hooked)
        _hook(hooked, label, at, hours, bits, first, alike.two, alike.reach)
        dr.eval(hooked)
        changed = dr.any(dr.gather(mi.UInt32, hooked, at) != dr.gather(mi.UInt32, label, at))
        for _ in range(2):
            jumped = dr.gather(mi.UInt32, hooked, dr.gather(mi.UInt32, hooked, at))
            dr.eval(jumped)
            dr.scatter(hooked, jumped, at)
            dr.eval(hooked)
        label = hooked
        if not changed:
            break
    root = dr.gather(mi.UInt32, label, at) == at
    number = dr.zeros(mi.UInt32, dr.width(bits))
    dr.eval(number)
    order = dr.cumsum(dr.select(root, mi.UInt32(1), 0))
    dr.scatter(number, order - 1, at, root)
    dr.eval(number)
    tops = dr.compress(root)
    of_top = dr.gather(mi.UInt32, at, tops)
    edges = [np.zeros(0, int)] * 2
    met = dr.compress(_meet(bits, hours, across)) if across.size else mi.UInt32()
    if dr.width(met):
        link, hour = met // hours, met % hours
        ends = (
            dr.gather(mi.UInt32, tile, link) * hours + hour for tile in (across.one, across.two)
        )
        labels = (dr.gather(mi.UInt32, label, end) for end in ends)
        edges = [dr.gather(mi.UInt32, number, top).numpy().astype(int) for top in labels]
    source = _of_views(tiles.ahead[:, (of_top // hours).numpy()], *edges)
    kept = dr.compress(counted)
    part = dr.gather(mi.UInt32, number, dr.gather(mi.UInt32, label, kept))
    omega, flux = (dr.gather(mi.Float, values, kept) for values in sums)
    return Bright(kept // hours, kept % hours, part, omega, flux, source)


def _of_views(ahead: np.ndarray, one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """Source of every part in each view, int, (view, part): parts in front that edges join.

    Parameters
    ----------
    ahead : np.ndarray of bool, shape (view, part)
        Whether each view has each part in front of it.
    one, two : np.ndarray of int, shape (edge,)
        Parts at the ends of the edges.
    """
    parts = ahead.shape[1]
    out = np.zeros(ahead.shape, int)
    for view, seen in enumerate(ahead):
        joins = seen[one] & seen[two]
        ends = (one[joins], two[joins])
        graph = sparse.coo_array((np.ones(joins.sum(), np.int8), ends), shape=(parts, parts))
        out[view] = csgraph.connected_components(graph, directed=False)[1]
    return out


@dr.syntax
def _meet(bits: mi.UInt32, hours: mi.UInt32, links: Links) -> mi.Bool:
    """Whether rays at the two ends of each link are bright and near each other in each hour."""
    lane = dr.arange(mi.UInt32, links.size * int(hours[0]))
    link, hour = lane // hours, lane % hours
    own, shown = (
        dr.gather(mi.UInt32, bits, dr.gather(mi.UInt32, tile, link) * hours + hour)
        for tile in (links.one, links.two)
    )
    met, i, reach = mi.UInt32(0), mi.UInt32(0), links.reach
    while (i < MOST_RAYS) & (met == 0) & (own > 0) & (shown > 0):
        one = dr.gather(mi.UInt32, reach, link * MOST_RAYS + i)
        met = dr.select((own >> i) & 1 == 1, one & shown, 0)
        i += 1
    return met > 0


@dr.syntax
def _hook(
    hooked: mi.UInt32, label: mi.UInt32, at: mi.UInt32, hours: mi.UInt32, bits: mi.UInt32,
    first: mi.UInt32, others: mi.UInt32, reach: mi.UInt32,
) -> None:  # fmt: skip
    """Give the tile of the larger label the smaller one, wherever linked tiles have two labels."""
    tile, hour = at // hours, at % hours
    mine, own = dr.gather(mi.UInt32, label, at), dr.gather(mi.UInt32, bits, at)
    link, end = dr.gather(mi.UInt32, first, tile), dr.gather(mi.UInt32, first, tile + 1)
    while link < end:
        place = dr.gather(mi.UInt32, others, link) * hours + hour
        theirs = dr.gather(mi.UInt32, label, place)
        shown = dr.gather(mi.UInt32, bits, place)
        met, i = mi.UInt32(0), mi.UInt32(0)
        while (theirs != mine) & (shown > 0) & (i < MOST_RAYS) & (met == 0):
            one = dr.gather(mi.UInt32, reach, link * MOST_RAYS + i)
            met = dr.select((own >> i) & 1 == 1, one & shown, 0)
            i += 1
        least, most = dr.minimum(mine, theirs), dr.maximum(mine, theirs)
        dr.scatter_reduce(dr.ReduceOp.Min, hooked, least, most, met > 0)
        link += 1


def _sums(
    bright: Bright, tiles: Tiles, frames: np.ndarray, some: np.ndarray, hours: int
) -> np.ndarray:
    """Σ L² ω / P² over the sources in front of some views, shape (view, hour)."""
    views, entries, parts = len(some), dr.width(bright.tile), bright.source.shape[1]
    count = dr.opaque(mi.UInt32, entries)
    lane = dr.arange(mi.UInt32, entries * views)
    entry, view = lane % count, lane // count
    tile = dr.gather(mi.UInt32, bright.tile, entry)
    d = dr.gather(mi.Vector3f, flat(tiles.direction), tile)
    ahead = dr.gather(mi.Bool, mi.Bool(tiles.ahead[some].ravel()), view * len(tiles) + tile)
    of_view = view * dr.opaque(mi.UInt32, parts)
    part = of_view + dr.gather(mi.UInt32, bright.part, entry)
    slot = of_view + dr.gather(mi.UInt32, flat_indices(bright.source[some]), part)
    omega = dr.gather(mi.Float, bright.solid_angle, entry)
    flux = dr.gather(mi.Float, bright.flux, entry)
    columns = []
    for values in (omega, flux, flux * d.x, flux * d.y, flux * d.z):
        column = dr.zeros(mi.Float, parts * views)
        dr.scatter_add(column, values, slot, ahead)
        columns.append(column)
    hour = dr.zeros(mi.UInt32, parts * views)
    dr.eval(hour, columns)
    dr.scatter(hour, dr.gather(mi.UInt32, bright.hour, entry), slot, ahead)
    w, f, *xyz = (column.numpy().reshape(views, -1).astype(float) for column in columns)
    towards = np.stack(xyz, axis=-1)
    seen = w > LEAST
    local = np.einsum("vsi,vki->vsk", towards, frames[some])
    length = np.linalg.norm(local, axis=-1, keepdims=True)
    P = position_index(local / np.where(length > 0, length, 1))
    each = np.where(seen, f**2 / np.where(seen, w, 1) / P**2, 0)
    at = hour.numpy().reshape(views, -1) + hours * np.arange(views)[:, None]
    return np.bincount(at.ravel(), each.ravel(), views * hours).reshape(views, hours)
