"""Illuminance E of a case's period from its coefficients C, the shade applied."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba import schema
from drcmitsuba.case.groups import GroupStates
from drcmitsuba.metrics import accumulate
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.facade_states import FacadeStates
from drcmitsuba.metrics.intervals import t_factor
from drcmitsuba.metrics.watched_groups import watched
from drcmitsuba.runtime.errors import InputError


def direct_sun(coefficients: Coefficients, sky: xr.Dataset) -> xr.Dataset:
    """`direct_sun` and `direct_sun_se` (time, sensor) [lx], shade open; channel where C has it.

    With several groups of panes `sun_group` says through which the sun comes; −1 for one that
    belongs to other spaces.
    """
    is_open = coefficients.open
    direct = by_channel(accumulate.direct_sun, is_open, sky)
    if "grid" in is_open.coords:  # the shade closes by the sun on each grid
        direct = direct.assign_coords(grid=is_open["grid"])
    if "pane_group" in is_open:
        one = is_open.isel(channel=1) if "channel" in is_open.dims else is_open
        through = watched(accumulate.sun_group(one, sky), is_open)
        direct = schema.describe(direct.assign(sun_group=through))
    return direct


def by_channel(function: Callable[..., xr.Dataset], first: xr.Dataset, *arrays: Any) -> xr.Dataset:
    """Apply an accumulation to each colour channel of the first array, or once to a grey one.

    Of the other arrays, and of lists of arrays, those with a channel are taken apart as well.
    """
    arrays = (first, *arrays)
    if "channel" not in first.dims:
        return function(*arrays)

    def at(array: Any, channel: int) -> Any:
        if isinstance(array, list):
            return [at(each, channel) for each in array]
        if isinstance(array, xr.Dataset | xr.DataArray) and "channel" in array.dims:
            return array.isel(channel=channel, drop=True)
        return array

    channels = [
        function(*(at(array, i) for array in arrays)) for i in range(first.sizes["channel"])
    ]
    return xr.concat(channels, first["channel"], coords="minimal", compat="override")


SUN_OF = {"latitude": 0.5, "longitude": 0.5, "timezone": 0, "sun_diameter": 0, "sun_time": None}
"""Attributes that fix a sun's position beside its label, with the difference [deg] that C and L may
have in each; 0 and None allow none."""

KEPT = (
    "case", "has_shade", "shade_threshold", "shade_area", "groups", "schedule", "sda_threshold",
    "sda_fraction", "ase_threshold", "ase_hours", "latitude", "longitude", "timezone", "sun_time",
    "weather", "version", "method", "settings", "spaces",
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
    coefficients: Coefficients, sky: xr.Dataset, direct: xr.Dataset | None = None,
    taken: FacadeStates | None = None,
) -> xr.Dataset:  # fmt: skip
    """Illuminance E = C·L, the shade applied by the rule in the attributes of C.

    The 95 % interval of an entry is ± `interval_factor` (an attribute) standard errors: Student's
    t with one degree of freedom less than there are replicates.

    Parameters
    ----------
    coefficients : Coefficients
    sky : xr.Dataset
        `Daylight.sky`, or from `sky.luminances.from_luminances`.
    direct : xr.Dataset, optional
        Direct sun from `direct_sun`; computed by default.
    taken : FacadeStates, optional
        State of the façade at every time stamp; by default as the direct sun of these sensors says.

    Returns
    -------
    xr.Dataset
        Variables of `accumulate.illuminance` [lx], with a dim `channel` where C has one. Groups of
        panes add `sun_group`, as from `direct_sun`, and the coordinate `facade_state` (time,
        group), the index of each group's state.

    Raises
    ------
    InputError
        A bin has no coefficients, or the suns of C stand elsewhere than those of the sky.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba.metrics.illuminance import illuminance
    >>> result = drcmitsuba.evaluate("office.toml")
    >>> E = illuminance(result.by_state, result.daylight.sky)
    >>> float(abs(E["total"] - result.illuminance["total"]).max()) < 0.1
    True
    """
    check_suns(coefficients.attrs, sky)
    direct = direct_sun(coefficients, sky) if direct is None else direct
    taken = FacadeStates.of(coefficients.attrs, direct) if taken is None else taken
    others = [coefficients.others.get(state) for state in taken.states[1:]]
    parts = direct.drop_vars("sun_group", errors="ignore")
    out = by_channel(accumulate.illuminance, coefficients.open, others, sky, taken.index, parts)
    if "sun_group" in direct:
        out["sun_group"] = direct["sun_group"]
    if "groups" in coefficients.attrs:
        groups = GroupStates.of_attributes(coefficients.attrs)
        names = np.array(groups.names, dtype=object)
        of_group = (("time", "group"), taken.of_group.astype(np.float32))
        out = out.assign_coords(group=names, facade_state=of_group)
        out = schema.describe(out)
    out.attrs = {k: v for k, v in coefficients.attrs.items() if k in KEPT}
    out.attrs["interval_factor"] = t_factor(coefficients.open.sizes["replicate"])
    return out


def replicates(coefficients: Coefficients, sky: xr.Dataset) -> xr.DataArray:
    """Illuminance by each replicate of C, the shade applied as the mean direct sun says.

    Parameters
    ----------
    coefficients : Coefficients
        C of all states [sr]; a coloured case counts by its luminance.
    sky : xr.Dataset
        `Daylight.sky`, or from `sky.luminances.from_luminances`.

    Returns
    -------
    xr.DataArray (replicate, time, sensor)
        E [lx].

    Raises
    ------
    InputError
        A state has no coefficients.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba.metrics.illuminance import replicates
    >>> result = drcmitsuba.evaluate("office.toml")
    >>> replicates(result.by_state, result.daylight.sky).dims
    ('replicate', 'time', 'sensor')
    """
    C = coefficients.by_luminance()
    taken = FacadeStates.of(C.attrs, direct_sun(C, sky))
    sensors = np.arange(C.open.sizes["sensor"])
    E = accumulate.replicates(C.open, sky, sensors)
    for i, state in enumerate(taken.states[1:], 1):
        here = np.flatnonzero(taken.index == i)
        if not len(here):
            continue
        if state not in C.others:
            remedy = "compute the coefficients of all states"
            raise InputError("coefficients", "state", f"no {state!r}", remedy)
        E[:, here] = accumulate.replicates(C.others[state], sky.isel(time=here), sensors)
    at = {k: c for k, c in C.open.coords.items() if c.dims == ("sensor",)}
    clock = {"clock": sky["clock"]} if "clock" in sky.coords else {}
    return xr.DataArray(
        E, {"time": sky["time"], **clock, **at}, ("replicate", "time", "sensor"), "E"
    )
