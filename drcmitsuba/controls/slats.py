"""Cut-off angle of slats: in every hour the flattest that keeps the sun out.

References
----------
.. [1] EnergyPlus Engineering Reference, "Window calculation module: shading device, slats".
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from drcmitsuba.case.groups import GroupStates
from drcmitsuba.controls.control import states_of
from drcmitsuba.controls.hysteresis import normals
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.labelled import in_order

TIE = 1e-9
"""Difference of angles that counts as a tie [deg]."""


def profile_angle(sun: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Profile angle of the sun, its height in the section through a vertical façade.

    Parameters
    ----------
    sun : np.ndarray, shape (time, 3)
        Unit vectors to the sun: x east, y north, z up.
    normal : np.ndarray, shape (3,)
        Horizontal normal of the façade.

    Returns
    -------
    np.ndarray, shape (time,)
        Angle above the horizon, 0 to 90 [deg]; NaN where the sun is behind the façade or down.
    """
    ahead, height = sun @ normal, sun[:, 2]
    seen = (ahead > 0) & (height > 0)
    return np.where(seen, np.degrees(np.arctan2(height, np.where(seen, ahead, 1.0))), np.nan)


def cut_off_angle(profile: np.ndarray, spacing: float, width: float) -> np.ndarray:
    """Tilt from which on slats of no thickness let no direct sun through.

    Slats at the distance s with the width w and the tilt β, outer edge down, cut the sun of the
    profile angle d off where w sin(β + d) ≥ s cos d: β = arcsin(s cos d / w) − d [1].

    Parameters
    ----------
    profile : np.ndarray, shape (time,)
        From `profile_angle` [deg].
    spacing, width : float
        s and w in the same unit.

    Returns
    -------
    np.ndarray, shape (time,)
        β, 0 where flat slats are enough [deg]; NaN where there is no sun, infinite where no tilt is
        enough: the slats are narrower than their gap.

    Examples
    --------
    >>> import numpy as np
    >>> from drcmitsuba import controls
    >>> controls.cut_off_angle(np.array([20.0, 60.0]), spacing=0.05, width=0.05).round(1)
    array([50.,  0.])
    """
    if not (0 < spacing < np.inf and 0 < width < np.inf):
        got = f"spacing {spacing:g}, width {width:g}"
        raise InputError("slats", "spacing, width", got, "give lengths above 0")
    d = np.radians(profile)
    ratio = spacing / width * np.cos(d)
    with np.errstate(invalid="ignore"):
        tilt = np.degrees(np.arcsin(np.minimum(ratio, 1)) - d)
        return np.where(ratio > 1, np.inf, np.maximum(tilt, 0))


def cut_off(
    E: xr.Dataset, weather: xr.Dataset, time: xr.DataArray, *, groups: GroupStates,
    azimuths: Sequence[float], tilts: Sequence[Sequence[float]], spacing: float, width: float,
) -> xr.DataArray:  # fmt: skip
    """Take in every hour the flattest slats that keep the direct sun out.

    Parameters
    ----------
    E : xr.Dataset
        Not used.
    weather : xr.Dataset
        `dni` (time,) [W/m²] and `sun_direction` (time, axis), from `outside`.
    time : xr.DataArray (time,)
    groups : GroupStates
    azimuths : sequence of float, one for each group
        Direction that the group faces, from north by east [deg].
    tilts : sequence of sequences of float, one for each group
        Tilt of the slats in every state but the first, which has none, outer edge down [deg].
    spacing, width : float
        Distance of the slats and their width, in the same unit.

    Returns
    -------
    xr.DataArray of int, dims (time, group)
        0 without direct sun on the façade; the most tilted state where none keeps the sun out.

    Raises
    ------
    InputError
        Other numbers of azimuths or tilts, lengths of 0.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba import controls
    >>> case = drcmitsuba.load_case("corner_office.toml")
    >>> groups, weather = controls.groups_of(case), controls.outside(case)
    >>> states = controls.cut_off(
    ...     None, weather, weather["time"], groups=groups, azimuths=[180, 90],
    ...     tilts=[[30.0, 60.0], [45.0]], spacing=0.05, width=0.05,
    ... )
    >>> states.dims
    ('time', 'group')
    """
    n = normals(azimuths, groups)
    of_groups = [np.atleast_1d(of_group) for of_group in tilts]
    counts = [len(of_group) for of_group in of_groups]
    if counts != list(groups.last):
        got = f"{counts} tilts"
        raise InputError("slats", "tilts", got, f"give {list(groups.last)}: one for each state")
    names, hours = ("sun_direction", "dni"), {"time": time.values}
    sun, dni = (in_order(weather[name], hours, "weather") for name in names)
    shines = dni > 0
    out = np.zeros((time.sizes["time"], len(groups)), int)
    for g, of_group in enumerate(of_groups):
        if not counts[g]:
            continue
        wanted = cut_off_angle(profile_angle(sun, n[g]), spacing, width)
        order = np.argsort(of_group, kind="stable")
        at = np.searchsorted(np.asarray(of_group, float)[order] + TIE, wanted)
        states = 1 + order[np.minimum(at, counts[g] - 1)]
        out[:, g] = np.where(shines & ~np.isnan(wanted), states, 0)
    return states_of(out, time, groups, "cut_off")
