"""Illuminance of a case's period from its coefficients, the shade applied."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import xarray as xr

from drcmitsuba import schema
from drcmitsuba.metrics import accumulate
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.intervals import t_factor
from drcmitsuba.metrics.shade import shade_closed
from drcmitsuba.runtime.errors import InputError


def is_closed(attributes: Mapping[str, Any], direct: xr.Dataset) -> xr.DataArray:
    """Whether the shade is closed, bool by time.

    Parameters
    ----------
    attributes : mapping
        Of the coefficients: the rule of the shade; without a shade it never closes.
    direct : xr.Dataset
        From `direct_sun`, state open.

    Raises
    ------
    InputError
        There is a shade without the rule by which it closes.
    """
    mean = schema.luminance(direct["direct_sun"])
    if not attributes.get("has_shade", 0):
        return xr.zeros_like(mean.isel(sensor=0, drop=True), dtype=bool)
    if not {"shade_threshold", "shade_area"} <= attributes.keys():
        got = "the coefficients do not say when the shade closes"
        raise InputError("coefficients", "shade_threshold, shade_area", got, "compute them anew")
    return shade_closed(mean, attributes["shade_threshold"], attributes["shade_area"])


def direct_sun(coefficients: Coefficients, sky: xr.Dataset) -> xr.Dataset:
    """Direct sun with the shade open, and its standard error.

    Parameters
    ----------
    coefficients : Coefficients
    sky : xr.Dataset
        Of `Daylight`.

    Returns
    -------
    xr.Dataset
        `direct_sun`, `direct_sun_se`, dims (time, sensor) [lx], by channel where C is.
    """
    return by_channel(accumulate.direct_sun, coefficients.open, sky)


Array = xr.Dataset | xr.DataArray | None


def by_channel(function: Callable[..., xr.Dataset], *arrays: Array) -> xr.Dataset:
    """Apply an accumulation to each colour channel of the first array, or once to a grey one."""
    first = arrays[0]
    assert first is not None
    if "channel" not in first.dims:
        return function(*arrays)

    def at(array: Array, channel: int) -> Array:
        if array is None or "channel" not in array.dims:
            return array
        return array.isel(channel=channel, drop=True)

    channels = [
        function(*(at(array, i) for array in arrays)) for i in range(first.sizes["channel"])
    ]
    return xr.concat(channels, first["channel"], coords="minimal", compat="override")


SUN_OF = {"latitude": 0.5, "longitude": 0.5, "timezone": 0, "sun_diameter": 0, "sun_time": None}
"""What a sun's place follows from beside its label, and how far C and L may differ in it [deg]."""


KEPT = (
    "case", "has_shade", "shade_threshold", "shade_area", "sda_threshold", "sda_fraction",
    "ase_threshold", "ase_hours", "latitude", "longitude", "timezone", "weather", "version",
    "settings",
)  # fmt: skip
"""Attributes of C that E has as well."""


def check_suns(
    attributes: Mapping[str, Any], sky: xr.Dataset, names: Iterable[str] = tuple(SUN_OF)
) -> None:
    """Refuse suns of another place, since labels tell only their time.

    Parameters
    ----------
    attributes : mapping
        Of the coefficients.
    sky : xr.Dataset
    names : iterable of str
        Attributes that are compared.

    Raises
    ------
    InputError
        An attribute differs by more than `SUN_OF` allows.
    """
    for name in names:
        margin = SUN_OF[name]
        ours, theirs = attributes.get(name), sky.attrs.get(name)
        if ours is None or theirs is None or ours == theirs:
            continue  # arrays that users made themselves may lack it
        if not margin or abs(ours - theirs) > margin:
            got = f"{ours}, but {theirs} in the sky"
            raise InputError("coefficients", name, got, "compute coefficients for this weather")


def illuminance(
    coefficients: Coefficients, sky: xr.Dataset, direct: xr.Dataset | None = None
) -> xr.Dataset:
    """E = C·L, with the shade that the coefficients name.

    The 95 % interval of an entry is ± `interval_factor` standard errors, an attribute: Student's
    t with as many degrees of freedom as there are replicates, less one.

    Parameters
    ----------
    coefficients : Coefficients
    sky : xr.Dataset
        Of `Daylight`, or from `daylight.from_luminances`.
    direct : xr.Dataset, optional
        From `direct_sun`, where it is known.

    Returns
    -------
    xr.Dataset
        As from `accumulate.illuminance`, by channel where C is.

    Raises
    ------
    InputError
        A bin has no coefficients, or the suns of C stand elsewhere than those of the sky.
    """
    check_suns(coefficients.attrs, sky)
    direct = direct_sun(coefficients, sky) if direct is None else direct
    closed = is_closed(coefficients.attrs, direct)
    states = coefficients.open, coefficients.shaded
    out = by_channel(accumulate.illuminance, *states, sky, closed, direct)
    out.attrs = {k: v for k, v in coefficients.attrs.items() if k in KEPT}
    out.attrs["interval_factor"] = t_factor(coefficients.open.sizes["replicate"])
    return out
