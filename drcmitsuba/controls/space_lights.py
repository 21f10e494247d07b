"""Electric light of spaces: what daylight lacks to the target of each in its hours."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.controls.electric_light import dimming_to_off, lighting_energy
from drcmitsuba.metrics.space_tasks import in_use, summed_daylight
from drcmitsuba.metrics.spaces import SensorsOfSpace, sensors_by_space

Dimming = Callable[[xr.DataArray, float], xr.DataArray]
"""Function of daylight (time, zone) and a set point [lx] that gives the fraction of the power."""
HOURS = ("hours", "hours_saved", "hours_off")
DIGITS = 9
"""Decimals that are kept: an hour less an hour is 0."""


def of_year(numbers: Mapping[str, Any], illuminance: xr.Dataset) -> dict[str, Any]:
    """Metrics with the electric light of spaces as `with_electric_light`, from E of a year [lx]."""
    spaces = sensors_by_space(illuminance)
    daylight = summed_daylight(illuminance, spaces)
    step = float(illuminance.attrs.get("step_hours", 1.0))
    return with_electric_light(numbers, daylight, spaces, illuminance, step)


def with_electric_light(
    numbers: Mapping[str, Any], daylight: np.ndarray, spaces: Sequence[SensorsOfSpace],
    times: xr.Dataset, step_hours: float, dimming: Dimming = dimming_to_off,
) -> dict[str, Any]:  # fmt: skip
    """Metrics with the electric light of every space, of the storeys and of the building.

    Parameters
    ----------
    numbers : mapping
        Metrics with the rows `spaces`, from `evaluate_metrics.summarise`.
    daylight : np.ndarray, shape (time, space)
        Mean illuminance of every space, from `space_tasks.summed_daylight` [lx].
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
        The metrics; every row has `electric_light`: `hours` of use, full hours of the lamps that
        daylight saves (`hours_saved`), hours without any electric light (`hours_off`) [h], and
        `energy` [kWh] where the power of the lamps is known. Of storeys and of the building hours
        are means by floor area, and the energy is the sum where it is known of each space.
    """
    rows = numbers.get("spaces", [])
    if not rows:
        return dict(numbers)
    lit = []
    for row, space, E in zip(rows, spaces, daylight.T, strict=True):
        zone = xr.DataArray(E[:, None], {"zone": [space.name]}, ("time", "zone"))
        wanted = in_use(space, times, step_hours)
        power, area = dimming(zone, row["target"]), {space.name: space.floor_area}
        used = lighting_energy(power, space.power or 0.0, area, step_hours, wanted)
        light = {name: round(used[name].item(), DIGITS) for name in HOURS[1:]}
        light = {HOURS[0]: step_hours * int(wanted.sum()), **light}
        known = {} if space.power is None else {"energy": round(used["energy"].item(), DIGITS)}
        lit.append({**row, "electric_light": light | known})
    out = {**numbers, "spaces": lit, "building": _joined(numbers["building"], lit)}
    if "storeys" in numbers:
        out["storeys"] = [
            _joined(storey, [row for row in lit if row["storey"] == storey["name"]])
            for storey in numbers["storeys"]
        ]
    return out


def _joined(whole: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Row of several spaces with their electric light."""
    lights, areas = [row["electric_light"] for row in rows], [row["floor_area"] for row in rows]
    means = {
        name: float(np.average([light[name] for light in lights], weights=areas)) for name in HOURS
    }
    known = all("energy" in light for light in lights)
    energy = {"energy": sum(light["energy"] for light in lights)} if known else {}
    return {**whole, "electric_light": means | energy}
