"""Electric light of spaces: what daylight lacks to the target of each in its hours."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.controls.electric_light import dimming_to_off, lighting_energy
from drcmitsuba.metrics.space_tasks import in_use
from drcmitsuba.metrics.space_years import SpaceYears
from drcmitsuba.metrics.spaces import SensorsOfSpace

Dimming = Callable[[xr.DataArray, float], xr.DataArray]
"""Function of daylight (time, zone) and a set point [lx] that gives the fraction of the power."""
Light = dict[str, np.ndarray]
"""Hours and energy of electric light in all variants of daylight, shape (variant,) each."""
DIGITS = 9
"""Decimals that are kept: an hour less an hour is 0."""


def with_electric_light(
    numbers: Mapping[str, Any], years: SpaceYears, spaces: Sequence[SensorsOfSpace],
    times: xr.Dataset, step_hours: float, dimming: Dimming = dimming_to_off,
) -> dict[str, Any]:  # fmt: skip
    """Metrics with the electric light of every space, of the storeys and of the building.

    Parameters
    ----------
    numbers : mapping
        Metrics with the rows `spaces`, from `evaluate_metrics.summarise`.
    years : SpaceYears
        Daylight of the spaces.
    spaces : sequence of SensorsOfSpace
        Spaces in the order of these rows.
    times : xr.Dataset
        Array with the time stamps.
    step_hours : float
        Length of the interval that one time stamp stands for [h].
    dimming : callable
        Way in which the lamps are dimmed; by default they are off where daylight is enough.

    Returns
    -------
    dict
        The metrics; every row has `electric_light`: `hours` of use [h], and with intervals full
        hours of the lamps that daylight saves (`hours_saved`), hours without any electric light
        (`hours_off`) [h], and `energy` [kWh] where the power of the lamps is known. Of storeys and
        of the building hours are means by floor area, and the energy is the sum where it is known
        of each space.
    """
    rows = numbers.get("spaces", [])
    if not rows:
        return dict(numbers)
    lights = [
        _light(space, years.daylight[..., k], row["target"], times, step_hours, dimming)
        for k, (row, space) in enumerate(zip(rows, spaces, strict=True))
    ]
    areas = np.array([space.floor_area for space in spaces])

    def of(row: Mapping[str, Any], chosen: np.ndarray) -> dict[str, Any]:
        light = _joined([lights[k] for k in chosen], areas[chosen])
        return {**row, "electric_light": _told(light, years)}

    every = np.arange(len(spaces))
    out = {
        **numbers,
        "spaces": [of(row, every[k : k + 1]) for k, row in enumerate(rows)],
        "building": of(numbers["building"], every),
    }
    if "storeys" in numbers:
        storey = np.array([space.storey for space in spaces])
        out["storeys"] = [
            of(row, np.flatnonzero(storey == row["name"])) for row in numbers["storeys"]
        ]
    return out


def _light(
    space: SensorsOfSpace, daylight: np.ndarray, target: float, times: xr.Dataset,
    step_hours: float, dimming: Dimming,
) -> Light:  # fmt: skip
    """Electric light of a space in all variants of its daylight (variant, time) [lx]."""
    variants = np.arange(len(daylight)).astype(str)
    zones = xr.DataArray(daylight.T.astype(float), {"zone": variants}, ("time", "zone"))
    wanted = in_use(space, times, step_hours)
    area = dict.fromkeys(variants.tolist(), space.floor_area)
    used = lighting_energy(dimming(zones, target), space.power or 0.0, area, step_hours, wanted)
    light = {"hours": np.full(len(variants), step_hours * wanted.sum())}
    light |= {name: used[name].values for name in ("hours_saved", "hours_off")}
    return light if space.power is None else {**light, "energy": used["energy"].values}


def _joined(lights: Sequence[Light], areas: np.ndarray) -> Light:
    """Electric light of several spaces: mean hours by floor area, and the sum of the energy."""
    out = {
        name: np.average([light[name] for light in lights], axis=0, weights=areas)
        for name in ("hours", "hours_saved", "hours_off")
    }
    if all("energy" in light for light in lights):
        out["energy"] = np.sum([light["energy"] for light in lights], axis=0)
    return out


def _told(light: Light, years: SpaceYears) -> dict[str, Any]:
    """Hours of use, and the other numbers with their intervals."""
    hours, most = light["hours"].item(0), np.inf
    out: dict[str, Any] = {"hours": hours}
    for name in ("hours_saved", "hours_off", "energy"):
        if name in light:
            interval = years.interval(light[name]).within(0.0, most if name == "energy" else hours)
            out[name] = {end: round(value, DIGITS) for end, value in interval.to_dict().items()}
    return out
