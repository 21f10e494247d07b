"""Rays of the view out: how far points see beyond clear openings."""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import GlazingMaterial
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.launch_size import SHADOW_RAYS
from drcmitsuba.scene import scene as scenes
from drcmitsuba.scene.geometry import given_points, origin, rotation
from drcmitsuba.scene.panes_in_state import grouped_panes
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.sensors import refuse_in_solids
from drcmitsuba.transport.windows.deposit import WindowPanes, Windows

ELEVATIONS = (-45, -30, -15, -8, -4, -2, 0, 2, 4, 8, 15, 30, 45)
"""Elevations of the rays [deg]."""
MOST_POINTS = 20_000


def view_distances(
    case: Case, points: Sequence[Sequence[float]] | None = None, *,
    azimuths: int = 360, elevations: Sequence[float] = ELEVATIONS,
) -> xr.DataArray:  # fmt: skip
    """Trace how far points see beyond clear openings, for `metrics.view_out`.

    Parameters
    ----------
    case : Case
        Its shades are open; clear glass and holes are seen through, films and diffusers not.
    points : sequence of (x, y, z), optional
        Eyes in the coordinates of the case file [m]; by default its sensors.
    azimuths : int
        Number of rays around, from north by east.
    elevations : sequence of float
        Angles above the horizon [deg].

    Returns
    -------
    DataArray (sensor, azimuth, elevation)
        Horizontal distance from the opening to what the ray meets outside [m]; ∞ where it meets
        nothing, NaN where it passes no clear opening on its way.

    Raises
    ------
    InputError
        A point within a wall, too many rays, or elevations beyond the zenith.

    Examples
    --------
    >>> import drcmitsuba
    >>> case = drcmitsuba.load_case("office.toml")
    >>> seen = drcmitsuba.view_distances(case, [(3.0, 1.0, 1.2)])  # an eye [m]
    >>> bool(drcmitsuba.metrics.sight_angle(seen)[0] > 90)
    True
    """
    backend.select()
    if points is None:
        eyes, coords = prepared(case).receivers.points, prepared(case).receivers.coordinates.coords
    else:
        given = given_points(points, case.source)
        refuse_in_solids(case, given - origin(case), origin(case))
        eyes = (given - origin(case)) @ rotation(case).T
        at = eyes + origin(case)
        coords = xr.Dataset(coords={a: ("sensor", at[:, i]) for i, a in enumerate("xyz")}).coords
    up = np.asarray(elevations, float)
    if not (0 < len(eyes) <= MOST_POINTS and 3 < azimuths <= 3600 and 0 < len(up) <= 180):
        got = f"{len(eyes)} points, {azimuths} azimuths, {len(up)} elevations"
        raise InputError("view", "rays", got, f"give 1 to {MOST_POINTS}, 4 to 3600, 1 to 180")
    if not (abs(up) < 90).all():
        raise InputError("view", "elevations", "beyond the zenith", "give less than 90 degrees")
    world, windows = scenes.load(case), Windows(_clear_windows(case))
    around = np.arange(azimuths) * (360 / azimuths)
    few = max(1, SHADOW_RAYS // (len(around) * len(up)))
    blocks = (eyes[i : i + few] for i in range(0, len(eyes), few))
    values = np.concatenate([_distances(world, windows, some, around, up) for some in blocks])
    dims = ("sensor", "azimuth", "elevation")
    out = xr.DataArray(values, dims=dims, coords={"azimuth": around, "elevation": up})
    out.attrs = {"units": "m", "long_name": "horizontal distance beyond the opening"}
    return out.assign_coords(coords)


def _clear_windows(case: Case) -> list[WindowPanes]:
    """Openings that are seen through, in the open state."""
    groups = prepared(case).windows
    return [
        WindowPanes(str(panes.group), panes.quads)
        for panes in grouped_panes(case, groups=groups)
        if panes.materials[0] is None or isinstance(panes.materials[0], GlazingMaterial)
    ]


def _distances(
    world: scenes.Scene, windows: Windows, eyes: np.ndarray, around: np.ndarray, up: np.ndarray
) -> np.ndarray:
    """Distances from eyes (sensor, 3) [m], shape (sensor, azimuth, elevation) [m]."""
    shape = len(eyes), len(around), len(up)
    if not len(windows):
        return np.full(shape, np.nan)
    azimuth, elevation = np.meshgrid(np.radians(around), np.radians(up), indexing="ij")
    x, y = np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation)
    d = np.stack([x, y, np.sin(elevation)], axis=-1).reshape(-1, 3)
    lane, each = dr.arange(mi.UInt32, len(eyes) * len(d)), dr.opaque(mi.UInt32, len(d))
    p = dr.gather(mi.Point3f, flat(eyes), lane // each)
    ray = mi.Ray3f(p, dr.gather(mi.Vector3f, flat(d), lane % each))
    met = world.opaque.ray_intersect_preliminary(ray, coherent=False)
    far = dr.select(met.is_valid(), met.t, dr.inf).numpy().reshape(shape)
    passed, near = (values.reshape(shape) for values in windows.left_at(ray))
    seen = passed & (near < far * (1 - 1e-4))
    return np.where(seen, (far - np.where(seen, near, 0)) * np.cos(elevation), np.nan)
