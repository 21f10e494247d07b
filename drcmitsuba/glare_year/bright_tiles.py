"""Bright tiles of an eye's rays in many hours, from the luminances of its pixels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.glare_year.luminances import PixelRows
from drcmitsuba.glare_year.tiles import MOST_RAYS, EyeTiles
from drcmitsuba.runtime.flat_arrays import flat, flat_indices, row_and_column


@dataclass(frozen=True, eq=False)
class BrightTiles:
    """Bright tiles of all hours, tile by tile."""

    hours: int
    """Number of hours."""
    rays: mi.UInt32
    """Bright rays of every tile in every hour, as bits, flat (tile, hour)."""
    at: mi.UInt32
    """Places of the bright tiles among all of these, in rising order."""
    tile: mi.UInt32
    """Tile of each of them."""
    hour: mi.UInt32
    """Its hour."""
    count: mi.Float
    """Number of its rays that count: a peak joins others, but is no part of their source."""
    total: mi.Float
    """Sum of their luminances [cd/m²]."""


def bright_tiles(
    light: PixelRows, tiles: EyeTiles, threshold: np.ndarray, peak: float
) -> Iterator[BrightTiles]:
    """Yield tiles with rays above a threshold (hour,), and those with rays above the peak."""
    if not len(light.pixel):
        return
    summands = _summands(light, tiles)
    for low, high in ((threshold, peak), (np.maximum(threshold, peak), np.inf)):
        tile, hour = row_and_column(dr.arange(mi.UInt32, len(tiles) * light.hours), light.hours)
        limit, most = dr.gather(mi.Float, flat(low), hour), dr.opaque(mi.Float, high)
        hours = dr.opaque(mi.UInt32, light.hours)
        rays, count, total = _rays(light.values, tile, hour, hours, *summands, limit, most)
        dr.eval(rays, count, total)
        at = dr.compress(rays > 0)
        if dr.width(at):
            counts, totals = dr.gather(mi.Float, count, at), dr.gather(mi.Float, total, at)
            place = row_and_column(at, light.hours)
            dr.eval(place, counts, totals)
            yield BrightTiles(light.hours, rays, at, *place, counts, totals)
        if not dr.any(mi.Float(dr.popcnt(rays)) > count):  # no ray is above the peak
            return


def _summands(light: PixelRows, tiles: EyeTiles) -> tuple[mi.UInt32, mi.UInt32]:
    """First summand of the luminances of every tile's pixels, and all of them.

    A summand has the row that it takes, its weight, and, last of its pixel, the pixel's rays as
    bits and their number, before it 0; weight and number are the bits of their floats.
    """
    first, pixel, rays = tiles.members
    start = np.searchsorted(light.pixel, np.arange(light.pixels + 1))
    count = np.diff(start)[pixel]
    ends = np.cumsum(count)
    summand = np.arange(count.sum()) + np.repeat(start[pixel] - (ends - count), count)
    out, last = np.zeros((len(summand), 4), np.uint32), ends[count > 0] - 1
    out[:, 0], out[:, 1] = light.row[summand], light.weight[summand].view(np.uint32)
    out[last, 2] = rays[count > 0]
    number = sum((rays[count > 0] >> bit) & 1 for bit in range(MOST_RAYS))
    out[last, 3] = number.astype(np.float32).view(np.uint32)
    return flat_indices(np.r_[0, ends][first]), flat_indices(out)


@symbolic
def _rays(
    rows: mi.Float, tile: mi.UInt32, hour: mi.UInt32, hours: mi.UInt32, first: mi.UInt32,
    summands: mi.UInt32, low: mi.Float, high: mi.Float,
) -> tuple[mi.UInt32, mi.Float, mi.Float]:  # fmt: skip
    """Bright rays of tiles in their hours; number of those that count; sum of their luminances."""
    summand, end = dr.gather(mi.UInt32, first, tile), dr.gather(mi.UInt32, first, tile + 1)
    bright, count, total, value = mi.UInt32(0), mi.Float(0), mi.Float(0), mi.Float(0)
    while dr.hint(summand < end, exclude=[rows, hour, hours, summands, low, high]):
        row, weight, rays, number = dr.gather(mi.Vector4u, summands, summand)
        of_row = dr.gather(mi.Float, rows, row * hours + hour)
        value += dr.reinterpret_array(mi.Float, weight) * of_row
        is_bright = value > low
        bright |= dr.select(is_bright, rays, 0)
        counted = is_bright & (value <= high)
        number = dr.select(counted, dr.reinterpret_array(mi.Float, number), 0)
        count += number
        total += value * number
        value = dr.select(rays > 0, 0, value)
        summand += 1
    return bright, count, total
