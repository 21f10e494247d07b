"""Who lights every point of a façade's plan: `light_of_sensors.nc`, shares for the script."""

from __future__ import annotations

from pathlib import Path
from typing import TypedDict

import numpy as np
import xarray as xr

from drcmitsuba.report.document.packing import Packed, packed
from drcmitsuba.report.document.table import text
from drcmitsuba.report.lights import MOST_STATES, REMEDY, of_period, read_lights
from drcmitsuba.runtime.errors import InputError

FILE = "light_of_sensors.nc"
DIMS = ("state", "window", "source", "bounces", "sensor")
MOST = {"state": MOST_STATES, "window": 64, "bounces": 32}
"""Largest sizes of the dims."""
PER_UNIT = 1000
"""Shares are in tenths of a per cent."""


class PackedLight(TypedDict):
    """Light of points as a page holds it."""

    windows: list[str]
    shares: Packed
    """Share of each point's light [‰], (window, part, point): sun and sky each straight and
    reflected, then the ground."""


def light_of_sensors(folder: Path, E: xr.Dataset) -> xr.Dataset | None:
    """Read what `drcmitsuba lights` wrote without a point; None where there is none.

    Raises
    ------
    InputError
        The file is damaged, too large, or of another evaluation than the illuminance E.
    """
    path = folder / FILE
    if not path.exists():
        return None
    most = {**MOST, "sensor": E.sizes["sensor"]}
    data = read_lights(path, E, {"exposure": DIMS}, most)
    is_whole = np.array_equal(data["sensor"].values, np.arange(E.sizes["sensor"]))
    if not is_whole or float(data["exposure"].min()) <= -1e-3:
        raise InputError(path, "exposure", "it holds no light of all sensors", REMEDY)
    return data


def shares(lights: xr.Dataset, shown: np.ndarray) -> PackedLight:
    """Shares of the windows, sources and bounces in the light of points for the script.

    Parameters
    ----------
    lights : xr.Dataset
        From `light_of_sensors`.
    shown : np.ndarray of int, shape (point,)
        Sensors to show.
    """
    year = of_period(lights).isel(sensor=shown).transpose("source", "bounces", "window", "sensor")
    sun, sky, ground = (year.sel(source=name).values for name in ("sun", "sky", "ground"))
    parts = [sun[0], sun[1:].sum(axis=0), sky[0], sky[1:].sum(axis=0), ground.sum(axis=0)]
    light = np.maximum(np.stack(parts, axis=1), 0)  # (window, part, point)
    share = light / np.maximum(light.sum(axis=(0, 1)), 1e-30)
    names = [text(name) for name in lights["window"].values]
    return {"windows": names, "shares": packed(np.rint(PER_UNIT * share).astype(int))}
