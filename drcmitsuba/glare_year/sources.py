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
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.glare_year.bright_tiles import BrightTiles, bright_tiles
from drcmitsuba.glare_year.components import components, followed
from drcmitsuba.glare_year.luminances import PixelRows
from drcmitsuba.glare_year.tiles import GROUPS, EyeTiles, Links
from drcmitsuba.picture.position_index import position_index
from drcmitsuba.runtime.flat_arrays import flat, flat_indices, row_and_column

LEAST = 1e-12
"""Smallest solid angle of a source [sr]."""
DARK = (1 << 32) - 1
"""In place of the number of a bright tile: it is dark."""


@dataclass(frozen=True, eq=False)
class SourceParts:
    """Parts of sources: bright tiles that are joined and that the same views see."""

    tile: mi.UInt32
    """One of the tiles of every part."""
    hour: mi.UInt32
    light: SourceLight
    one: mi.UInt32
    """Part at the first end of each link between parts that not all the same views see."""
    two: mi.UInt32
    """Part at its other end."""


class SourceLight(NamedTuple):
    """Sums over the rays of sources, or of parts of them."""

    solid_angle: mi.Float64
    """[sr]"""
    flux: mi.Vector4d
    """Sums of directions weighted by luminance · solid angle, and of the weights [cd/m² sr]."""

    def added(self, slot: mi.UInt32, count: int, active: mi.Bool | bool = True) -> SourceLight:
        """Sums by slot, of which there are `count`."""
        solid_angle, flux = dr.zeros(mi.Float64, count), dr.zeros(mi.Float64, 4 * count)
        dr.scatter_add(solid_angle, self.solid_angle, slot, active)
        dr.scatter_add(flux, self.flux, slot, active)
        dr.eval(solid_angle, flux)
        return SourceLight(solid_angle, dr.gather(mi.Vector4d, flux, dr.arange(mi.UInt32, count)))

    def at(self, index: mi.UInt32) -> SourceLight:
        """Those of some of the sources."""
        return SourceLight(*(dr.gather(type(each), each, index) for each in self))


def contrast_sums(
    light: PixelRows, tiles: EyeTiles, frames: np.ndarray, threshold: np.ndarray, peak: float
) -> np.ndarray:
    """Σ L_s² ω_s / P_s² of some views from one place, in some hours.

    Parameters
    ----------
    light : PixelRows
        Luminances of the pixels, without the suns' disks.
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
    views, alike = np.arange(len(frames)), threshold.ndim == 1
    out = np.zeros((len(frames), light.hours))
    for some, limit in (
        [(views, threshold)] if alike else zip(views[:, None], threshold, strict=True)
    ):
        for bright in bright_tiles(light, tiles, limit, peak):
            parts = _parts(bright, tiles)
            out[some] += _sums(parts, tiles.ahead[some], frames[some], light.hours)
    return out


def bright_light(
    light: PixelRows, tiles: EyeTiles, threshold: np.ndarray, peak: float
) -> np.ndarray:
    """Light of all that is bright before the views of `tiles`, without peaks.

    Parameters are those of `contrast_sums`, with a threshold (hour,).

    Returns
    -------
    np.ndarray, shape (5, view, hour)
        Sums of direction · luminance · solid angle by axis and of luminance · solid angle
        [cd/m² sr], and of solid angles [sr].
    """
    out = np.zeros((5, len(tiles.forward), light.hours))
    bright = next(bright_tiles(light, tiles, threshold, peak), None)  # peaks come after the rest
    if bright is not None:
        of_tiles = _light_of(bright, tiles)
        for view, ahead in enumerate(tiles.ahead):
            before = dr.gather(mi.Bool, mi.Bool(ahead), bright.tile)
            sums = of_tiles.added(bright.hour, light.hours, before)
            out[:, view] = *(axis.numpy() for axis in sums.flux), sums.solid_angle.numpy()
    return out


def _light_of(bright: BrightTiles, tiles: EyeTiles) -> SourceLight:
    """Sums over the bright rays of each tile."""
    direction = dr.gather(mi.Vector3f, flat(tiles.direction), bright.tile)
    flux = tiles.solid_angle * mi.Float64(bright.total)
    return SourceLight(
        tiles.solid_angle * mi.Float64(bright.count),
        mi.Vector4d(*(flux * mi.Float64(axis) for axis in direction), flux),
    )


def _parts(bright: BrightTiles, tiles: EyeTiles) -> SourceParts:
    """Parts that bright tiles make."""
    alike, others = tiles.links
    root = _joined(bright, alike, len(tiles))
    is_root = root == dr.arange(mi.UInt32, dr.width(root))
    part = dr.gather(mi.UInt32, dr.cumsum(dr.select(is_root, mi.UInt32(1), 0)) - 1, root)
    tops = dr.compress(is_root)
    tile, hour = (dr.gather(mi.UInt32, values, tops) for values in (bright.tile, bright.hour))
    across = _across(bright, others, len(tiles), part)
    return SourceParts(tile, hour, _light_of(bright, tiles).added(part, dr.width(tops)), *across)


def _joined(bright: BrightTiles, links: Links, tiles: int) -> mi.UInt32:
    """First of the bright tiles that links join with each of them.

    In each round tiles take the next link that leads to another root, and the larger root follows
    the smallest one that it is joined with. A tile without such a link will never have one.
    """
    root = dr.arange(mi.UInt32, dr.width(bright.at))
    if not len(links.one):
        return root
    first, each = (
        flat_indices(links.first(tiles)),
        (flat_indices(links.two), flat_indices(links.reach)),
    )
    shown, hours = (
        dr.full(mi.UInt32, DARK, dr.width(bright.rays)),
        dr.opaque(mi.UInt32, bright.hours),
    )
    searching, link = root, dr.gather(mi.UInt32, first, bright.tile)
    while True:
        dr.scatter(shown, root, bright.at)
        dr.eval(shown, root)
        tile, hour, own = (
            dr.gather(mi.UInt32, of, searching) for of in (bright.tile, bright.hour, root)
        )
        end = dr.gather(mi.UInt32, first, tile + 1)
        other, link = _first_apart(link, end, tile, hour, own, hours, bright.rays, shown, *each)
        dr.eval(own, other, link)
        kept = dr.compress(other != DARK)
        if not dr.width(kept):
            return root
        low, high = dr.minimum(own, other), dr.maximum(own, other)
        if searching is root:  # each of them follows a tile before it
            forest = low
        else:
            forest = mi.UInt32(root)
            dr.scatter_reduce(dr.ReduceOp.Min, forest, low, high, other != DARK)
        dr.eval(forest)
        root = followed(forest)
        searching, link = (dr.gather(mi.UInt32, of, kept) for of in (searching, link))


@symbolic
def _first_apart(
    link: mi.UInt32, end: mi.UInt32, tile: mi.UInt32, hour: mi.UInt32, root: mi.UInt32,
    hours: mi.UInt32, rays: mi.UInt32, shown: mi.UInt32, two: mi.UInt32, reach: mi.UInt32,
) -> tuple[mi.UInt32, mi.UInt32]:  # fmt: skip
    """Another root than that of some bright tiles, or `DARK`, and the link to it.

    `shown` are the roots of all tiles in all hours, those of dark tiles `DARK`.
    """
    own, other = dr.gather(mi.UInt32, rays, tile * hours + hour), mi.UInt32(DARK)
    while dr.hint(
        (link < end) & (other == DARK),
        exclude=[end, hour, root, hours, rays, shown, two, reach, own],
    ):
        there = dr.gather(mi.UInt32, two, link) * hours + hour
        of_there = dr.gather(mi.UInt32, shown, there)
        apart = (of_there != DARK) & (of_there != root)
        if dr.hint(apart, exclude=[link, own, rays, there, reach]):
            apart = _met(link, own, dr.gather(mi.UInt32, rays, there), reach)
        other = dr.select(apart, of_there, other)
        link = dr.select(apart, link, link + 1)
    return other, link


def _met(link: mi.UInt32, own: mi.UInt32, others: mi.UInt32, reach: mi.UInt32) -> mi.Bool:
    """Whether some bright rays of a link's tiles are near each other."""
    reached = mi.UInt32(0)
    for group in range(GROUPS):
        some = (own >> (4 * group)) & 15
        reached |= dr.gather(mi.UInt32, reach, (link * GROUPS + group) * 16 + some)
    return (reached & others) > 0


def _across(
    bright: BrightTiles, links: Links, tiles: int, part: mi.UInt32
) -> tuple[mi.UInt32, mi.UInt32]:
    """Parts (bright tile,) at both ends of links between tiles that not all the same views see."""
    border = np.unique(links.one)
    if not len(border):
        return mi.UInt32(), mi.UInt32()
    parts = dr.full(mi.UInt32, DARK, dr.width(bright.rays))
    dr.scatter(parts, part, bright.at)
    lane, hours = dr.arange(mi.UInt32, len(border) * bright.hours), mi.UInt32(bright.hours)
    row, hour = row_and_column(lane, bright.hours)
    tile = dr.gather(mi.UInt32, flat_indices(border), row)
    count, most = dr.zeros(mi.UInt32, 1), len(links.one) * bright.hours
    pairs = dr.empty(mi.UInt32, most), dr.empty(mi.UInt32, most)
    dr.make_opaque(hours, parts, count, *pairs)
    first, two, reach = map(flat_indices, (links.first(tiles), links.two, links.reach))
    _note_pairs(tile, hour, hours, bright.rays, parts, first, two, reach, count, *pairs)
    dr.eval(count, *pairs)
    made = dr.arange(mi.UInt32, count[0])
    return _once(*(dr.gather(mi.UInt32, end, made) for end in pairs))


@symbolic
def _note_pairs(
    tile: mi.UInt32, hour: mi.UInt32, hours: mi.UInt32, rays: mi.UInt32, parts: mi.UInt32,
    first: mi.UInt32, two: mi.UInt32, reach: mi.UInt32, count: mi.UInt32, ours: mi.UInt32,
    theirs: mi.UInt32,
) -> None:  # fmt: skip
    """Note the parts of some tiles, and those that links join them with, one after another."""
    here = tile * hours + hour
    own, part = dr.gather(mi.UInt32, rays, here), dr.gather(mi.UInt32, parts, here)
    link, end = dr.gather(mi.UInt32, first, tile), dr.gather(mi.UInt32, first, tile + 1)
    end, last = dr.select(own > 0, end, link), mi.UInt32(DARK)
    while dr.hint(
        link < end, exclude=[hour, hours, rays, parts, two, reach, own, part, here, tile]
    ):
        there = dr.gather(mi.UInt32, two, link) * hours + hour
        other = dr.gather(mi.UInt32, parts, there)
        fresh = (other != DARK) & (other != last)
        if dr.hint(fresh, exclude=[link, own, rays, there, reach]):
            fresh = _met(link, own, dr.gather(mi.UInt32, rays, there), reach)
        slot = dr.scatter_inc(count, mi.UInt32(0), fresh)
        dr.scatter(ours, part, slot, fresh)
        dr.scatter(theirs, other, slot, fresh)
        last = dr.select(fresh, other, last)
        link += 1


def _once(one: mi.UInt32, two: mi.UInt32) -> tuple[mi.UInt32, mi.UInt32]:
    """Pairs without most of those that are there again.

    Of the pairs with the same first one, those are dropped that equal the one that wrote last.
    """
    if not dr.width(one):
        return one, two
    dr.eval(one, two)
    own, last = dr.arange(mi.UInt32, dr.width(one)), dr.zeros(mi.UInt32, dr.max(one)[0] + 1)
    dr.scatter(last, own, one)
    last = dr.gather(mi.UInt32, last, one)
    kept = dr.compress((last == own) | (dr.gather(mi.UInt32, two, last) != two))
    ends = (dr.gather(mi.UInt32, end, kept) for end in (one, two))
    return next(ends), next(ends)


def _sums(parts: SourceParts, ahead: np.ndarray, frames: np.ndarray, hours: int) -> np.ndarray:
    """Σ L² ω / P² over the sources in front of some views, shape (view, hour)."""
    views, count = len(frames), dr.width(parts.tile)
    view, part = row_and_column(dr.arange(mi.UInt32, count * views), count)
    before = dr.gather(mi.Bool, mi.Bool(ahead.ravel()),
                       view * ahead.shape[1] + dr.gather(mi.UInt32, parts.tile, part))  # fmt: skip
    dr.eval(before)
    source = components(count * views, *_edges_of_views(parts, before, views))
    light = parts.light.at(part).added(source, count * views, before)
    kept = dr.compress(light.solid_angle > LEAST)
    if not dr.width(kept):
        return np.zeros((views, hours))
    light, (view, part) = light.at(kept), row_and_column(kept, count)
    axes, towards = flat(frames), dr.normalize(mi.Vector3f(light.flux.xyz))
    rows = (dr.gather(mi.Vector3f, axes, 3 * view + k) for k in range(3))
    P = position_index(mi.Vector3f(*(dr.dot(row, towards) for row in rows)))
    each = light.flux.w**2 / light.solid_angle / mi.Float64(P) ** 2
    out = dr.zeros(mi.Float64, views * hours)
    dr.scatter_add(out, each, view * hours + dr.gather(mi.UInt32, parts.hour, part))
    return np.asarray(out.numpy().reshape(views, hours))


def _edges_of_views(parts: SourceParts, before: mi.Bool, views: int) -> tuple[mi.UInt32, mi.UInt32]:
    """Links between the parts (view · part,) that each view has before it."""
    links, count = dr.width(parts.one), dr.width(parts.tile)
    if not links:
        return mi.UInt32(), mi.UInt32()
    view, link = row_and_column(dr.arange(mi.UInt32, links * views), links)
    of_view = view * dr.opaque(mi.UInt32, count)
    one, two = (of_view + dr.gather(mi.UInt32, end, link) for end in (parts.one, parts.two))
    joins = dr.compress(dr.gather(mi.Bool, before, one) & dr.gather(mi.Bool, before, two))
    ends = (dr.gather(mi.UInt32, end, joins) for end in (one, two))
    return next(ends), next(ends)
