"""Illuminance of a case's period from its coefficients, the shade applied."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import xarray as xr

from drcmitsuba import schema
from drcmitsuba.metrics import accumulate
from drcmitsuba.metrics.intervals import t_factor
from drcmitsuba.metrics.shade import shade_closed
from drcmitsuba.runtime.errors import InputError


def is_closed(coefficients: xr.Dataset, light: xr.Dataset) -> xr.DataArray:
    """When the shade closes: bool by time, from the coefficients of the open state.

    The thresholds are attributes of the coefficients; without a shade it never closes.
    """
    direct = direct_sun(coefficients, light)["direct_sun"]
    if not coefficients.attrs.get("has_shade", 0):
        return xr.zeros_like(direct.isel(sensor=0, drop=True), dtype=bool)
    attrs = coefficients.attrs
    if not {"shade_threshold", "shade_area"} <= attrs.keys():
        got = "they say not when the shade closes"
        raise InputError("coefficients", "shade_threshold, shade_area", got, "compute them anew")
    return shade_closed(direct, attrs["shade_threshold"], attrs["shade_area"])


def direct_sun(coefficients: xr.Dataset, light: xr.Dataset) -> xr.Dataset:
    """Direct sun and its standard error, in luminance."""
    return by_channel(accumulate.direct_sun, coefficients, light).map(schema.luminance)


def by_channel(
    function: Callable[..., xr.Dataset], *arrays: xr.Dataset | xr.DataArray | None
) -> xr.Dataset:
    """Apply an accumulation to each colour channel of the coefficients, or once to grey ones."""
    first = arrays[0]
    assert first is not None
    if "channel" not in first.dims:
        return function(*arrays)
    found = [
        function(
            *(
                a.isel(channel=i, drop=True) if a is not None and "channel" in a.dims else a
                for a in arrays
            )
        )
        for i in range(first.sizes["channel"])
    ]
    return xr.concat(found, first["channel"], coords="minimal", compat="override")


SUN_OF = {"latitude": 0.5, "longitude": 0.5, "timezone": 0, "sun_diameter": 0, "sun_time": None}
"""What a sun's place follows from beside its label, and how far C and L may differ in it [deg]."""


def check_suns(
    coefficients: xr.Dataset, light: xr.Dataset, names: Iterable[str] = tuple(SUN_OF)
) -> None:
    """Refuse suns of another place: labels tell only their time."""
    for name in names:
        margin = SUN_OF[name]
        ours, theirs = coefficients.attrs.get(name), light.attrs.get(name)
        if ours is None or theirs is None or ours == theirs:
            continue  # arrays that the user made himself may not tell
        if not margin or abs(ours - theirs) > margin:
            got = f"{ours}, but {theirs} in the sky"
            raise InputError("coefficients", name, got, "compute coefficients for this weather")


def illuminance(coefficients: xr.Dataset, light: xr.Dataset) -> xr.Dataset:
    """E from C (dims state, …) and the sky, with the shade that the coefficients name.

    The 95 % interval of an entry is ± `interval_factor` standard errors, an attribute: Student's
    t with as many degrees of freedom as there are replicates, less one.

    Raises
    ------
    InputError
        A bin has no coefficients, or the suns of C stand elsewhere than those of the sky.
    """
    check_suns(coefficients, light)
    if "open" not in coefficients["state"].values or coefficients.sizes["replicate"] < 2:
        got = "no state open, or a single replicate"
        raise InputError("coefficients", "state, replicate", got, "compute them anew")
    is_open = coefficients.sel(state="open", drop=True)
    closed = is_closed(is_open, light)
    shaded = None
    if "shaded" in coefficients["state"].values:
        shaded = coefficients.sel(state="shaded", drop=True)
    out = by_channel(accumulate.illuminance, is_open, shaded, light, closed)
    keep = ("has_shade", "shade_threshold", "shade_area")
    out.attrs = {k: v for k, v in coefficients.attrs.items() if k in keep}
    out.attrs["interval_factor"] = t_factor(coefficients.sizes["replicate"])
    return out
