"""Electric light that daylight saves: dimming to a set point, its power and energy.

References
----------
.. [1] EnergyPlus Engineering Reference, "Daylighting calculations: lighting controls" (continuous,
   continuous/off and stepped).
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import xarray as xr

from drcmitsuba.metrics import thresholds
from drcmitsuba.metrics.grids import sensors_by_grid
from drcmitsuba.runtime.errors import InputError


def zone_illuminance(
    illuminance: xr.DataArray, zones: Mapping[str, np.ndarray] | None = None
) -> xr.DataArray:
    """Mean illuminance of the points of every zone.

    Parameters
    ----------
    illuminance : DataArray (time, sensor)
        Daylight with the shade in use [lx].
    zones : mapping of str to indices, optional
        Sensors of every zone; by default every grid is one, or all sensors.

    Returns
    -------
    DataArray (time, zone)
        E [lx].

    Raises
    ------
    InputError
        Values that are not finite, or a zone without sensors, or with others than there are.

    Examples
    --------
    >>> import numpy as np
    >>> import xarray as xr
    >>> from drcmitsuba import controls
    >>> E = xr.DataArray([[100.0, 300.0, 800.0]], dims=("time", "sensor"))
    >>> controls.zone_illuminance(E, {"deep": np.array([0, 1]), "window": np.array([2])}).values
    array([[200., 800.]])
    """
    E = thresholds.checked(illuminance, "illuminance")
    every = sensors_by_grid(illuminance) or {"all": np.arange(E.shape[1])}
    of_zone = dict(every if zones is None else zones)
    parts = []
    for name, sensors in of_zone.items():
        try:
            parts.append(E[:, np.asarray(sensors, int) if np.size(sensors) == 0 else sensors])
        except IndexError:
            remedy = f"give indices from 0 to {E.shape[1] - 1}, or a mask of all sensors"
            raise InputError("zones", "sensors", f"no such sensors, {name!r}", remedy) from None
    parts = [some.reshape(len(E), -1) for some in parts]
    if not parts or not all(some.size for some in parts):
        raise InputError("zones", "sensors", "a zone without sensors", "give each at least one")
    values = [some.mean(axis=1, dtype=float) for some in parts]
    names = np.array([*of_zone], dtype=object)
    coords = {k: c for k, c in illuminance.coords.items() if c.dims == ("time",)}
    return xr.DataArray(
        np.stack(values, axis=1), {**coords, "zone": names}, ("time", "zone"),
        "illuminance", {"units": "lx"},
    )  # fmt: skip


def continuous_dimming(
    daylight: xr.DataArray, set_point: float = 500.0, least_light: float = 0.2,
    least_power: float = 0.3,
) -> xr.DataArray:  # fmt: skip
    """Power of lamps that are dimmed to a set point, and stay on at their least [1].

    f = max(0, 1 − E / set point) of the light is wanted; the power falls linearly from 1 at f = 1
    to `least_power` at f = `least_light`, and no further.

    Parameters
    ----------
    daylight : DataArray (time, zone)
        From `zone_illuminance` [lx].
    set_point : float
        Illuminance that daylight and lamps give together [lx].
    least_light, least_power : float
        Fractions of light and power to which lamps can be dimmed [–].

    Returns
    -------
    DataArray (time, zone)
        Fraction of the full power [–].

    Raises
    ------
    InputError
        A set point of 0, fractions out of range, values that are not finite.

    Examples
    --------
    >>> import xarray as xr
    >>> from drcmitsuba import controls
    >>> values = [[0.0], [250.0], [600.0]]
    >>> daylight = xr.DataArray(values, {"zone": ["all"]}, dims=("time", "zone"))
    >>> controls.continuous_dimming(daylight, set_point=500.0).values.ravel().round(3)
    array([1.   , 0.562, 0.3  ])
    """
    f = _wanted(daylight, set_point)
    for name, value in (("least_light", least_light), ("least_power", least_power)):
        if not 0 <= value < 1:
            raise InputError("dimming", name, f"{value}", "give a fraction below 1")
    power = least_power + (1 - least_power) * (f - least_light) / (1 - least_light)
    return _power(daylight, np.maximum(power, least_power))


def dimming_to_off(
    daylight: xr.DataArray, set_point: float = 500.0, least_light: float = 0.2,
    least_power: float = 0.3,
) -> xr.DataArray:  # fmt: skip
    """Power as by `continuous_dimming`, but off where daylight alone reaches the set point [1].

    Parameters, errors and result are those of `continuous_dimming`.

    Examples
    --------
    >>> import xarray as xr
    >>> from drcmitsuba import controls
    >>> values = [[0.0], [250.0], [600.0]]
    >>> daylight = xr.DataArray(values, {"zone": ["all"]}, dims=("time", "zone"))
    >>> controls.dimming_to_off(daylight, set_point=500.0).values.ravel().round(3)
    array([1.   , 0.562, 0.   ])
    """
    power = continuous_dimming(daylight, set_point, least_light, least_power)
    return power.where(_wanted(daylight, set_point) > 0, 0.0)


def stepped_dimming(
    daylight: xr.DataArray, set_point: float = 500.0, steps: int = 2
) -> xr.DataArray:
    """Power of lamps that are switched in equal steps [1].

    ⌈f · steps⌉ / steps with f = max(0, 1 − E / set point): one step is a switch.

    Parameters
    ----------
    daylight, set_point
        As for `continuous_dimming`.
    steps : int
        Number of steps, 1 to 100.

    Returns
    -------
    DataArray (time, zone)
        Fraction of the full power [–].

    Raises
    ------
    InputError
        As `continuous_dimming`; steps out of range.

    Examples
    --------
    >>> import xarray as xr
    >>> from drcmitsuba import controls
    >>> values = [[0.0], [250.0], [600.0]]
    >>> daylight = xr.DataArray(values, {"zone": ["all"]}, dims=("time", "zone"))
    >>> controls.stepped_dimming(daylight, set_point=500.0, steps=2).values.ravel()
    array([1. , 0.5, 0. ])
    """
    if not isinstance(steps, int | np.integer) or not 1 <= steps <= 100:
        raise InputError("dimming", "steps", f"{steps}", "give a whole number from 1 to 100")
    f = _wanted(daylight, set_point)
    # Rounding: E of 250 lx is half of 500 lx, whatever the twelfth digit says.
    return _power(daylight, np.ceil(np.round(f * steps, 9)) / steps)


def lighting_energy(
    power: xr.DataArray, density: float, areas: Mapping[str, float],
    step_hours: float = 1.0, occupied: np.ndarray | None = None,
) -> xr.Dataset:  # fmt: skip
    """Energy of electric light, and what daylight saves of it.

    Parameters
    ----------
    power : DataArray (time, zone)
        Fraction of the full power, from a function of dimming [–].
    density : float
        Installed power of the lamps [W/m²].
    areas : mapping of str to float
        Floor area of every zone [m²].
    step_hours : float
        Length of the interval that one time stamp stands for [h].
    occupied : np.ndarray of bool, shape (time,), optional
        Time stamps at which light is wanted; by default all.

    Returns
    -------
    xr.Dataset (zone,)
        `energy` and `saved` [kWh]; `hours_saved`, full hours of the lamps that are saved, and
        `hours_off`, hours without any electric light [h].

    Raises
    ------
    InputError
        A zone without an area, fractions out of 0 to 1, other numbers out of range.

    Examples
    --------
    >>> import xarray as xr
    >>> from drcmitsuba import controls
    >>> values = [[0.0], [250.0], [600.0]]
    >>> daylight = xr.DataArray(values, {"zone": ["all"]}, dims=("time", "zone"))
    >>> power = controls.dimming_to_off(daylight, set_point=500.0)
    >>> controls.lighting_energy(power, 10.0, {"all": 20.0})["hours_off"].values
    array([1.])
    """
    missing = [str(zone) for zone in power["zone"].values if str(zone) not in areas]
    if missing:
        got = f"none for zone {missing[0]!r}"
        raise InputError("lighting", "areas", got, "give the floor area of each zone in m²")
    floor = np.array([float(areas[str(zone)]) for zone in power["zone"].values])
    step = thresholds.not_negative("step_hours", step_hours)
    fraction = power.transpose("time", "zone").values
    if not ((fraction >= 0) & (fraction <= 1)).all():
        raise InputError("lighting", "power", "not from 0 to 1", "give fractions of the power")
    if not ((floor >= 0) & (floor < math.inf)).all():
        raise InputError("lighting", "areas", f"{floor.min():g} m²", "give areas above 0")
    wanted = np.ones(len(fraction), bool) if occupied is None else np.asarray(occupied, bool)
    if wanted.shape != (len(fraction),):
        got = f"the shape {wanted.shape}"
        raise InputError("lighting", "occupied", got, f"give {len(fraction)} truth values")
    used = fraction[wanted]
    full = thresholds.not_negative("density", density) * floor / 1000  # kW
    on, all_hours = used.sum(axis=0) * step, len(used) * step
    values = {
        "energy": (full * on, "kWh"),
        "saved": (full * (all_hours - on), "kWh"),
        "hours_saved": (all_hours - on, "h"),
        "hours_off": ((used == 0).sum(axis=0) * step, "h"),
    }
    variables = {name: ("zone", v, {"units": unit}) for name, (v, unit) in values.items()}
    return xr.Dataset(variables, {"zone": power["zone"]})


def _wanted(daylight: xr.DataArray, set_point: float) -> np.ndarray:
    """Fraction of the lamps' light that is wanted (time, zone) [–]."""
    if not 0 < set_point < math.inf:
        raise InputError("dimming", "set_point", f"{set_point}", "give an illuminance above 0 lx")
    E = daylight.transpose("time", "zone").values
    if not np.isfinite(E).all():
        raise InputError("dimming", "daylight", "NaN or infinite", "give finite illuminances")
    return np.clip(1 - E / set_point, 0, 1)


def _power(daylight: xr.DataArray, fraction: np.ndarray) -> xr.DataArray:
    out = daylight.transpose("time", "zone").copy(data=fraction)
    out.name, out.attrs = "power", {"units": "1", "long_name": "fraction of the full power"}
    return out
