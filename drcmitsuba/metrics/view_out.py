"""View out of EN 17037 as far as geometry tells: width, outside distance, layers, level.

The functions take the distances that rays from each point see beyond clear openings, as
`drcmitsuba.view_distances` traces them. Whether a view pleases, and what grows or moves in it,
geometry does not tell.

References
----------
.. [1] EN 17037:2018, "Daylight in buildings", view out; thresholds as read in the documentation of
   ClimateStudio, viewEN17037.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from drcmitsuba.metrics.point_autonomy import by_sensor
from drcmitsuba.runtime.errors import InputError

WIDTHS = (14.0, 28.0, 54.0)
"""Least horizontal sight angles of the levels minimum, medium, high [deg]."""
DISTANCES = (6.0, 20.0, 50.0)
"""Least outside distances [m]."""
LAYERS = ("sky", "landscape", "ground")
"""Layers of a view; a level asks for 1, 2 or 3 of them, the landscape among them."""
LEVELS = ("none", "minimum", "medium", "high")
HORIZON = 3.0
"""Elevation up to which land is seen where nothing stands, above and below the horizon [deg]."""


def sight_angle(distance: xr.DataArray) -> xr.DataArray:
    """Horizontal sight angle, the sum of all azimuths at which some elevation has a view [1].

    Parameters
    ----------
    distance : DataArray (sensor, azimuth, elevation)
        Horizontal distance from the opening to what a ray meets outside [m]: ∞ where it meets
        nothing, NaN where it passes no clear opening. The azimuths are evenly spaced over the
        circle, from north by east; elevations are above the horizon [deg].

    Returns
    -------
    DataArray (sensor,)
        Angle [deg]; a half of the azimuths' step is its error at each edge of an opening.

    Raises
    ------
    InputError
        Other dims, azimuths that are not evenly spaced, no ray, or negative distances.

    Examples
    --------
    >>> import drcmitsuba
    >>> case = drcmitsuba.load_case("office.toml")
    >>> seen = drcmitsuba.view_distances(case, [(3.0, 1.0, 1.2)])
    >>> float(drcmitsuba.metrics.sight_angle(seen)[0]) > 90
    True
    """
    values = _checked(distance)
    step = 360.0 / values.shape[1]
    seen = ~np.isnan(values).all(axis=2)
    return by_sensor(distance, step * seen.sum(axis=1), "width", "horizontal sight angle", "deg")


def outside_distance(distance: xr.DataArray) -> xr.DataArray:
    """Outside distance, from the opening to what stands opposite [1].

    It is the median over the azimuths with a view of the nearest thing at the elevation next to the
    horizon; parameters and errors are those of `sight_angle`.

    Returns
    -------
    DataArray (sensor,)
        Distance [m]: ∞ where at least half of the azimuths meet nothing, 0 without a view.

    Examples
    --------
    >>> import drcmitsuba
    >>> case = drcmitsuba.load_case("office.toml")
    >>> seen = drcmitsuba.view_distances(case, [(3.0, 1.0, 1.2)])
    >>> drcmitsuba.metrics.outside_distance(seen).values
    array([inf])
    """
    values = _checked(distance)
    level = abs(distance["elevation"].values)
    order = np.argsort(level, kind="stable")
    nearest = np.full(values.shape[:2], np.nan)
    for k in order[::-1]:  # the elevation next to the horizon at which there is a view
        here = values[:, :, k]
        nearest = np.where(np.isnan(here), nearest, here)
    out = np.zeros(len(values))
    for i, row in enumerate(nearest):
        known = np.sort(row[~np.isnan(row)])
        if len(known):
            out[i] = known[len(known) // 2]
    return by_sensor(distance, out, "distance", "outside distance", "m")


def view_layers(distance: xr.DataArray) -> xr.DataArray:
    """Layers of the view: sky above, landscape, ground below [1].

    Things outside are landscape; so is the land within `HORIZON` of the horizon where nothing
    stands. Parameters and errors are those of `sight_angle`.

    Returns
    -------
    DataArray of bool (layer, sensor)
        Whether each layer is seen.

    Examples
    --------
    >>> import drcmitsuba
    >>> case = drcmitsuba.load_case("office.toml")
    >>> seen = drcmitsuba.view_distances(case, [(3.0, 1.0, 1.2)])
    >>> drcmitsuba.metrics.view_layers(seen).values.ravel()
    array([ True,  True,  True])
    """
    values, elevation = _checked(distance), distance["elevation"].values
    is_free, met = np.isinf(values), np.isfinite(values)
    far = is_free & (abs(elevation) <= HORIZON)
    parts = (is_free & (elevation > HORIZON), met | far, is_free & (elevation < -HORIZON))
    layers = [by_sensor(distance, part.any(axis=(1, 2)), "layers", "", "") for part in parts]
    out = xr.concat(layers, xr.Variable("layer", np.array(LAYERS, object)))
    out.attrs = {"long_name": "layers of the view"}
    return out


def view_level(distance: xr.DataArray) -> xr.DataArray:
    """Level of the view by its width, outside distance and layers [1].

    Parameters and errors are those of `sight_angle`; a tie passes.

    Returns
    -------
    DataArray of int (sensor,)
        0 for none, 1 minimum, 2 medium, 3 high: the lowest of the three.

    Examples
    --------
    >>> import drcmitsuba
    >>> case = drcmitsuba.load_case("office.toml")
    >>> seen = drcmitsuba.view_distances(case, [(3.0, 1.0, 1.2)])
    >>> drcmitsuba.metrics.view_level(seen).values
    array([3])
    """
    layers = view_layers(distance)
    width, far = sight_angle(distance).values, outside_distance(distance).values
    count = layers.values.sum(axis=0) * layers.sel(layer="landscape").values
    by_width = np.searchsorted(WIDTHS, width, side="right")
    by_distance = np.searchsorted(DISTANCES, far, side="right")
    lowest = np.minimum(np.minimum(by_width, by_distance), count)
    return by_sensor(distance, lowest, "view level", "level of EN 17037, view out", "")


def _checked(distance: xr.DataArray) -> np.ndarray:
    """Distances (sensor, azimuth, elevation) [m], else an InputError."""
    if not isinstance(distance, xr.DataArray):
        raise InputError("view", "type", type(distance).__name__, "give an xarray DataArray")
    dims = ("sensor", "azimuth", "elevation")
    if set(distance.dims) != {*dims} or distance.size == 0:
        got = ", ".join(map(str, distance.dims)) or "no dims"
        raise InputError("view", "dims", got, f"give {', '.join(dims)}, none of them empty")
    if not {"azimuth", "elevation"} <= {*distance.coords}:
        raise InputError("view", "azimuth, elevation", "no angles", "give both in degrees")
    azimuth, elevation = (distance[name].values.astype(float) for name in dims[1:])
    steps = np.diff(np.append(azimuth, azimuth[0] + 360))
    if not (np.isfinite(azimuth).all() and np.allclose(steps, 360 / len(azimuth), atol=1e-3)):
        raise InputError("view", "azimuth", "no even steps", "give them all around, evenly [deg]")
    if not (abs(elevation) <= 90).all():
        raise InputError("view", "elevation", "beyond the zenith", "give -90 to 90 degrees")
    values = distance.transpose(*dims).values
    if values.dtype.kind not in "fiu" or (values < 0).any():
        raise InputError("view", "distance", "negative, or no numbers", "give metres")
    return values.astype(float)
