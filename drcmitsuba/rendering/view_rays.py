"""Rays of the pixels of a view, several a pixel, spread evenly over it."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.picture.view import PictureView
from drcmitsuba.runtime.random_streams import even_numbers

_ANGLES = {
    "perspective": dr.atan,
    "hemispherical": dr.safe_asin,
    "equidistant": lambda rho: rho,
    "equisolid": lambda rho: 2 * dr.safe_asin(0.5 * rho),
    "stereographic": lambda rho: 2 * dr.atan(0.5 * rho),
}
"""Angle to the centre of the view of a distance ρ from it, see `picture.projection`."""


def directions(view: PictureView, x: mi.Float, y: mi.Float) -> tuple[mi.Vector3f, mi.Bool]:
    """Directions that places in the picture show, as `PictureView.directions`, and if there is one.

    Parameters
    ----------
    view : PictureView
    x, y : mi.Float
        Places over width and height [–], from the lower left corner.

    Returns
    -------
    d : mi.Vector3f
        Unit vectors.
    exists : mi.Bool
        Whether the projection reaches the place.
    """
    wide, high = map(float, view.half_size)
    u, v = 2 * wide * (x - 0.5 + view.shift), 2 * high * (y - 0.5 + view.lift)
    rho = dr.sqrt(dr.fma(u, u, v * v))
    exists = rho <= float(view.projection.distance(np.array(view.projection.widest)))
    theta = _ANGLES[view.kind](rho)
    aside = dr.select(rho > 1e-5, dr.sin(theta) / dr.maximum(rho, 1e-5), 1)
    right, up, forward = (mi.Vector3f(*map(float, axis)) for axis in view.frame)
    d = dr.normalize(u * aside * right + v * aside * up + dr.cos(theta) * forward)
    return dr.select(exists, d, forward), exists


def pixel_rays(
    view: PictureView, rows: int, columns: int, lane: mi.UInt32, samples: int, seed: int
) -> tuple[mi.Vector3f, mi.Bool]:
    """Directions of rays, `samples` a pixel.

    Parameters
    ----------
    view : PictureView
    rows, columns : int
        Size of the picture.
    lane : mi.UInt32
        Numbers of rays, pixel · samples + index; pixels row by row from the top.
    samples : int
        Number of rays of a pixel.
    seed : int

    Returns
    -------
    d, exists
        As from `directions`.
    """
    pixel, across = lane // samples, dr.opaque(mi.UInt32, columns)
    place = even_numbers(lane % samples, pixel, seed, 0)
    x = (mi.Float(pixel % across) + place.x) / dr.opaque(mi.Float, columns)
    y = 1 - (mi.Float(pixel // across) + place.y) / dr.opaque(mi.Float, rows)
    return directions(view, x, y)
