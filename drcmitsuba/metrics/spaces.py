"""Spaces of a building with the sensors that lie in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.metrics.grids import sensors_by_name
from drcmitsuba.metrics.sensor_areas import area_shares
from drcmitsuba.metrics.space_rows import read_rows


@dataclass(frozen=True)
class SensorsOfSpace:
    """Space with the sensors that lie in it."""

    name: str
    use: str
    storey: str
    floor_area: float
    """[m²]."""
    target: float | None
    """Mean illuminance that its task wants [lx]; None where its use is not known."""
    hours: tuple[int, int] | None
    """First hour of use on the clock, and the end of the last one [h], which may be smaller: past
    midnight; None for all."""
    power: float | None
    """Installed power of its lamps [W/m²]; None where it is not known."""
    sensors: np.ndarray
    """Indices of its sensors, int, shape (own sensor,)."""
    shares: np.ndarray
    """Share of its floor that each of them stands for [–], of the sum 1, shape (own sensor,)."""

    @classmethod
    def of_row(cls, row: Mapping[str, Any]) -> SensorsOfSpace:
        """Space of a row of the attribute `spaces`, without sensors.

        Anything else raises one of `space_rows.DAMAGED`.
        """
        target, hours, power = (row.get(key) for key in ("target", "hours", "power"))
        first, last = (None, None) if hours is None else map(int, hours)
        return cls(
            str(row["name"]), row["use"], row["storey"], float(row["floor_area"]),
            None if target is None else float(target),
            None if first is None or last is None else (first, last),
            None if power is None else float(power), np.empty(0, np.int64), np.empty(0),
        )  # fmt: skip


def sensors_by_space(illuminance: xr.Dataset | xr.DataArray) -> tuple[SensorsOfSpace, ...]:
    """Spaces that have sensors, in the order of the model.

    Parameters
    ----------
    illuminance : xr.Dataset or DataArray
        Array with the dim `sensor`, the attribute `spaces`, and where there are several the
        coordinate `space` (sensor,).

    Returns
    -------
    tuple of SensorsOfSpace
        Empty where the array tells no spaces.

    Raises
    ------
    InputError
        The attribute is no list of spaces.
    """
    told = read_rows(illuminance.attrs, SensorsOfSpace.of_row)
    if len(told) == 1:
        known = {told[0].name: np.arange(illuminance.sizes["sensor"])}
    else:
        known = sensors_by_name(illuminance, "space")
    some = [space for space in told if space.name in known]
    shares = area_shares(illuminance, (known[space.name] for space in some))
    return tuple(
        replace(space, sensors=known[space.name], shares=own)
        for space, own in zip(some, shares, strict=True)
    )
