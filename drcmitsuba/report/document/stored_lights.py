"""Who lights the chosen points of a façade: `lights.nc`, tables of shares, sky domes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.report.document.labels import labels
from drcmitsuba.report.document.packing import packed
from drcmitsuba.report.document.table import Cell, Number, PageTable, plain, text
from drcmitsuba.report.lights import MOST_STATES, REMEDY, hours_left_out, of_period, read_lights
from drcmitsuba.runtime.errors import InputError

FILE = "lights.nc"
DIMS = {
    "by_window": ("state", "window", "bounces", "sensor", "bin"),
    "exposure": ("state", "window", "source", "bounces", "sensor"),
    "solid_angle": ("bin",),
    "direction": ("bin", "axis"),
}
MOST = {"state": MOST_STATES, "window": 64, "sensor": 24, "bounces": 32, "bin": 40_000}
"""Largest sizes of the dims."""
MOST_DRAWN = 3
"""Largest number of windows whose domes are drawn, those with the most light."""
MOST_SUNS = 400
"""Largest number of suns in a dome."""
EXPONENT = 0.35
"""Exponent of the colour scale of domes: most of C per solid angle is small."""
LEVELS = 255


def stored_lights(folder: Path, E: xr.Dataset) -> xr.Dataset | None:
    """Read what `drcmitsuba lights -o FOLDER` wrote; None where there is none.

    Raises
    ------
    InputError
        The file is damaged, too large, or of another evaluation than the illuminance E.
    """
    path = folder / FILE
    if not path.exists():
        return None
    data = read_lights(path, E, DIMS, MOST, "x", "y", "bin")
    sensors, subdivision = data["sensor"].values, data.attrs.get("subdivision", 0)
    fits = (
        sensors.dtype.kind in "iu" and sensors.min() >= 0 and sensors.max() < E.sizes["sensor"]
        and subdivision in range(1, 7) and len(Patches(int(subdivision))) <= data.sizes["bin"]
        and (data["solid_angle"] > 0).all()
        and min(float(data[name].min()) for name in ("by_window", "exposure")) > -1e-3
    )  # fmt: skip
    if not fits:
        raise InputError(path, "lights", "it holds no light of sensors", REMEDY)
    return data


def _shares(light: xr.DataArray) -> list[float]:
    """Parts of exposure (source, bounces): sun and sky each direct, reflected; ground [lx h]."""
    parts = [light.sel(source=s).values for s in ("sun", "sky", "ground")]
    sun, sky, ground = parts
    return [sun[0], sun[1:].sum(), sky[0], sky[1:].sum(), ground.sum()]


def table(lights: xr.Dataset, name: str) -> PageTable:
    """Table with a row for each traced point and window: its share in the light of the point."""
    t, rows = labels(), []
    head = ["light_point", "window", "light_sun", "light_sun_reflected", "light_sky"]
    head += ["light_sky_reflected", "light_ground", "light_all"]
    year = of_period(lights)
    for sensor in lights["sensor"].values.tolist():
        mine = year.sel(sensor=sensor)
        whole = max(float(mine.sum()), 1e-30)
        x, y = (float(lights[axis].sel(sensor=sensor)) for axis in "xy")
        at = t["light_at"].format(number=sensor, x=f"{x:.2f}", y=f"{y:.2f}")
        for window in mine["window"].values:
            parts = [100 * part / whole for part in _shares(mine.sel(window=window))]
            if sum(parts) < 0.05:
                continue
            cells: list[Cell] = [(Number(float(v)), " %") for v in (*parts, sum(parts))]
            rows.append((plain(at), plain(window), *cells))
    note = t["light_note"] if lights.attrs["by_evaluation"] else t["light_note_open"]
    if hours := hours_left_out(lights):
        note += " " + t["light_left_out"].format(hours=f"{hours:g}")
    title = t["light_table"].format(facade=name)
    return PageTable(title, tuple(t[key] for key in head), tuple(rows), note)


def domes(lights: xr.Dataset, most: int) -> dict[str, Any]:
    """Points with their sky domes for the script, at most so many.

    Returns
    -------
    dict
        `rows`, the number of patches in each row; `suns`, their places in the dome [‰], x and y;
        `x`, `y` of the points [mm]; `points`: sensor, and for each window its name, share, and
        levels of C per solid angle of ground, patches and suns: after no bounce, after some.
    """
    patches = Patches(int(lights.attrs["subdivision"]))
    count = len(patches)
    suns = np.arange(count, lights.sizes["bin"])
    suns = suns[:: max(1, -(-len(suns) // MOST_SUNS))]
    bins = np.concatenate([np.arange(count), suns])
    d = lights["direction"].values[suns]
    away = np.arccos(np.clip(d[:, 2], -1, 1)) / (np.pi / 2)
    around = np.arctan2(d[:, 0], d[:, 1])
    at = np.stack([away * np.sin(around), away * np.cos(around)])
    year = of_period(lights).sum(["source", "bounces"])
    points = []
    for sensor in lights["sensor"].values.tolist()[:most]:
        C = lights["by_window"].isel(state=0).sel(sensor=sensor) / lights["solid_angle"]
        C = C.isel(bin=bins).values
        seen = np.stack([C[:, 0], C[:, 1:].sum(axis=1)], axis=1)
        largest = max(float(seen.max()), 1e-12)
        level = np.rint(LEVELS * (np.maximum(seen, 0) / largest) ** EXPONENT)
        light = year.sel(sensor=sensor).values
        share = light / max(light.sum(), 1e-30)
        order = [k for k in np.argsort(-share, kind="stable")[:MOST_DRAWN] if share[k] > 5e-4]
        points.append(
            {
                "sensor": sensor,
                "largest": largest,
                "windows": [
                    {
                        "name": text(lights["window"].values[k]),
                        "share": round(100 * float(share[k]), 1),
                        "levels": packed(level[k]),
                    }
                    for k in order
                ],
            }
        )
    return {
        "rows": patches.rows.tolist(), "height": patches.row_height, "count": count,
        "suns": packed(np.rint(1000 * at)), "points": points,
        **{a: (1000 * lights[a].values[:most]).round().astype(int).tolist() for a in "xy"},
    }  # fmt: skip
