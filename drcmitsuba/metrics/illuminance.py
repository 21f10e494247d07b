"""Illuminance E of a case's period from its coefficients C, the shade applied."""

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
    """Time stamps at which the shade is closed, bool (time,), by the rule in the attributes of C.

    `direct` is from `direct_sun`, shade open [lx]. A shade without a rule raises InputError.
    """
    mean = schema.luminance(direct["direct_sun"])
    if not attributes.get("has_shade", 0):
        return xr.zeros_like(mean.isel(sensor=0, drop=True), dtype=bool)
    if not {"shade_threshold", "shade_area"} <= attributes.keys():
        got = "the coefficients do not say when the shade closes"
        raise InputError("coefficients", "shade_threshold, shade_area", got, "compute them anew")
    return shade_closed(mean, attributes["shade_threshold"], attributes["shade_area"])


def direct_sun(coefficients: Coefficients, sky: xr.Dataset) -> xr.Dataset:
    """`direct_sun` and `direct_sun_se` (time, sensor) [lx], shade open; channel where C has it."""
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
"""Attributes that fix a sun's position beside its label, with the difference [deg] that C and L may
have in each; 0 and None allow none."""

KEPT = (
    "case", "has_shade", "shade_threshold", "shade_area", "sda_threshold", "sda_fraction",
    "ase_threshold", "ase_hours", "latitude", "longitude", "timezone", "sun_time", "weather",
    "version", "settings",
)  # fmt: skip
"""Attributes of C that E keeps."""


def check_suns(
    attributes: Mapping[str, Any], sky: xr.Dataset, names: Iterable[str] = tuple(SUN_OF)
) -> None:
    """Raise InputError for suns of another place: the label of a sun states only its time.

    The attributes `names` of the coefficients may differ from the sky's as far as `SUN_OF` allows.
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
    """Illuminance E = C·L, the shade applied by the rule in the attributes of C.

    The 95 % interval of an entry is ± `interval_factor` (an attribute) standard errors: Student's
    t with one degree of freedom less than there are replicates.

    Parameters
    ----------
    coefficients : Coefficients
    sky : xr.Dataset
        `Daylight.sky`, or from `daylight.from_luminances`.
    direct : xr.Dataset, optional
        Direct sun from `direct_sun`; computed by default.

    Returns
    -------
    xr.Dataset
        Variables of `accumulate.illuminance` [lx], with a dim `channel` where C has one.

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
