"""Names, dimensions and units of every array that passes between modules or lies on disk."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

VARIABLES: dict[str, tuple[str, str]] = {
    # name: (unit, long name)
    "L": ("cd/m2", "luminance of the sky patches, the ground and the suns"),
    "sky": ("cd/m2", "luminance of the sky patches and the ground"),
    "sun": ("cd/m2", "luminance of the sun"),
    "direct_normal_illuminance": ("lx", "illuminance by the sun on a plane that faces it"),
    "diffuse_horizontal_illuminance": ("lx", "horizontal illuminance by the sky patches"),
    "dni": ("W/m2", "direct normal irradiance"),
    "dhi": ("W/m2", "diffuse horizontal irradiance"),
    "ghi": ("W/m2", "global horizontal irradiance"),
    "dew_point": ("degC", "dew point temperature"),
    "solar_zenith": ("deg", "geometric solar zenith angle"),
    "solar_azimuth": ("deg", "solar azimuth from north by east"),
    "direction": ("1", "unit vector to the sun: x east, y north, z up"),
    "instant": ("", "time at which the sun is taken"),
    "straight": ("sr", "coefficient of light that comes straight, through clear panes only"),
    "direct": ("sr", "coefficient of light that met no diffuse surface"),
    "interreflected": ("sr", "coefficient of light that met a diffuse surface"),
    "sun_straight": ("sr", "coefficient of each time stamp's own sun, straight"),
    "pane_group": ("", "group of panes through which straight light comes; -1 for none"),
    "mesh_error": ("sr", "standard error of interpolation between the suns of the mesh"),
    "replicates": ("sr", "direct + interreflected of each independent replicate"),
    "by_window": ("sr", "coefficient by window and number of bounces"),
    "exposure": ("lx h", "light exposure by window, source and number of bounces"),
    "total": ("lx", "illuminance, shade applied"),
    "total_open": ("lx", "illuminance, shade open"),
    "sky_open": ("lx", "illuminance by sky and ground, shade open"),
    "sun_open": ("lx", "illuminance by the sun, all bounces, shade open"),
    "direct_sun": ("lx", "illuminance by sun that comes straight, shade open"),
    "sun_group": ("", "group of panes through which the direct sun comes; -1 for none"),
    "melanopic": ("lx", "melanopic equivalent daylight illuminance, shade applied"),
    "s_cone_opic": ("lx", "S-cone-opic equivalent daylight illuminance"),
    "m_cone_opic": ("lx", "M-cone-opic equivalent daylight illuminance"),
    "l_cone_opic": ("lx", "L-cone-opic equivalent daylight illuminance"),
    "chromaticity_x": ("1", "chromaticity x, CIE 1931"),
    "chromaticity_y": ("1", "chromaticity y, CIE 1931"),
    "spectrum": ("1", "mean light by wavelength, per that of D65 of the same illuminance"),
    "wavelength": ("nm", "wavelength"),
    "cct": ("K", "correlated colour temperature"),
    "duv": ("1", "distance from the Planckian locus in CIE 1960 u, v; above it positive"),
    "rhodopic": ("lx", "rhodopic equivalent daylight illuminance"),
    "dgp": ("1", "daylight glare probability"),
    "dgp_sharp": ("1", "daylight glare probability, peaks of films as narrow as the sun"),
    "illuminance": ("lx", "vertical illuminance at the eye"),
    "contrast": ("1", "logarithmic term of the daylight glare probability"),
    "x": ("m", "position of the sensor, to the east"),
    "y": ("m", "position of the sensor, to the north"),
    "z": ("m", "position of the sensor, upwards"),
    "nx": ("1", "normal of the sensor, to the east"),
    "ny": ("1", "normal of the sensor, to the north"),
    "nz": ("1", "normal of the sensor, upwards"),
    "grid": ("", "name of the sensor's grid"),
    "time": ("", "start of the interval, local standard time"),
    "clock": ("", "start of the interval, clock time with daylight saving"),
    "daylight": ("", "1 where sky or sun is bright"),
    "shade_closed": ("", "whether the shade is closed, of any group of panes"),
    "facade_state": ("", "state of every group of panes"),
}
"""Unit and long name of the variables; `…_se` is the standard error of each."""

_OF_C, _OF_E = ("state", "sensor", "bin"), ("time", "sensor")
DIMS: dict[str, tuple[str, ...]] = {
    "replicates": ("state", "replicate", "sensor", "bin"),
    **{n + s: _OF_C for n in ("straight", "direct", "interreflected") for s in ("", "_se")},
    **dict.fromkeys(("sun_straight", "sun_straight_se"), ("state", "sensor", "sun")),
    "pane_group": ("state", "sensor", "bin"),
    "mesh_error": ("state", "sensor"),
    **dict.fromkeys(("x", "y", "z", "nx", "ny", "nz", "grid"), ("sensor",)),
    **{name: (name,) for name in ("state", "bin", "time")},
    "L": ("time", "bin"),
    "sun_direction": ("time", "axis"),
    **dict.fromkeys(("blend_bin", "blend_weight"), ("time", "blend")),
    **dict.fromkeys(("sun_bin", "clock"), ("time",)),
    **{n + s: _OF_E for n in ("total", "direct_sun") for s in ("", "_se")},
    "sun_group": _OF_E,
    "facade_state": ("time", "group"),
}
"""Dims of the arrays on disk; `channel` comes first where there is one."""

TEXTS, DATES = ("state", "bin", "sun_bin", "blend_bin", "grid"), ("time", "clock")
LARGEST = {"L": 1e13, "sun": 1e13, "total": 1e17, "direct_sun": 1e17, "exposure": 1e21}
LARGEST |= dict.fromkeys("xyz", 1e9)
"""Larger values mark damage: no sun (of 0.01°) is as bright [cd/m²] or gives as much E [lx], and no
map has such coordinates [m]."""
LARGEST_OTHER = 1e6

NUMBERS = {"latitude", "longitude", "timezone", "sun_diameter", "step_hours", "interval_factor"}
NUMBERS |= {"has_shade", "shade_threshold", "shade_area"}
NUMBERS |= {"sda_threshold", "sda_fraction", "ase_threshold", "ase_hours"}
"""Attributes that are numbers."""

MOST = 1e9
"""Largest magnitude of such an attribute."""

LUMINANCE_WEIGHTS = {"red": 0.2126, "green": 0.7152, "blue": 0.0722}
"""Channels of a coloured case and their share of luminance (ITU-R BT.709 primaries)."""


def channel_weights(channels: int) -> tuple[float, ...]:
    """Weight of every channel in luminance [–]; a grey case has one channel, of weight 1."""
    return tuple(LUMINANCE_WEIGHTS.values()) if channels > 1 else (1.0,)


def describe(data: xr.Dataset) -> xr.Dataset:
    """Set unit and long name of every variable and coordinate that the table knows.

    Dates have their unit from the file format, and truth values have none.
    """
    for name, variable in data.variables.items():
        error = "standard error of: " if str(name).endswith("_se") else ""
        base = str(name).removesuffix("_se").removesuffix("_at_views")
        if base in VARIABLES and not (name == "sun" and "sun" in data.dims):
            unit, long_name = VARIABLES[base]
            units = {"units": unit} if unit else {}
            variable.attrs.update(units, long_name=error + long_name)
    return data


class UnknownLabelsError(KeyError):
    """Labels that are not among the known ones: `labels`, a tuple of str."""

    def __init__(self, labels: Iterable[str]):
        self.labels = tuple(map(str, labels))
        super().__init__(f"no {self.labels[0]!r} ({len(self.labels)} missing)")


def positions(labels: ArrayLike, known: Iterable[str], missing: int | None = None) -> np.ndarray:
    """Position of each label among the known labels, matched exactly.

    Parameters
    ----------
    labels : array of str, any shape
        Labels of bins, suns or sensors.
    known : iterable of str
        Labels in the order of the array that they index.
    missing : int, optional
        Position given to a label that is not known.

    Returns
    -------
    np.ndarray of int64, shape of `labels`

    Raises
    ------
    UnknownLabelsError
        A label is not known, and no `missing` is given.
    """
    wanted = np.asarray(labels, dtype=object)
    place = {str(label): i for i, label in enumerate(known)}
    at = np.array([place.get(str(label), -1) for label in wanted.ravel()], np.int64)
    at = at.reshape(wanted.shape)
    if (unknown := at < 0).any():
        if missing is None:
            raise UnknownLabelsError(wanted[unknown])
        at[unknown] = missing
    return at


def luminance(values: xr.DataArray) -> xr.DataArray:
    """Weigh the colour channels of an array to luminance; a grey array passes unchanged."""
    if "channel" not in values.dims:
        return values
    weights = xr.DataArray(list(LUMINANCE_WEIGHTS.values()), dims="channel")
    return (values * weights).sum("channel").astype(values.dtype)


def by_luminance(data: xr.Dataset) -> xr.Dataset:
    """`luminance` of all arrays; grey data pass unchanged."""
    return data.map(luminance, keep_attrs=True) if "channel" in data.dims else data


def mean_and_error(
    replicates: np.ndarray | Sequence[np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Mean of independent replicates, along the first axis, and its standard error.

    Few passes are made, in memory that is asked for once; differences from the first replicate keep
    the digits.
    """
    n, first = len(replicates), replicates[0]
    total, squares, difference = np.zeros_like(first), np.zeros_like(first), np.empty_like(first)
    for values in replicates[1:]:
        np.subtract(values, first, out=difference)
        total += difference
        np.multiply(difference, difference, out=difference)
        squares += difference
    total /= n
    squares -= n * total * total
    return first + total, np.sqrt(np.maximum(squares, 0) / (n * (n - 1)))
