"""E of a result as tables of text: DAYSIM's .ill, and CSV; six digits."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import xarray as xr

from drcmitsuba.runtime import storage
from drcmitsuba.schema import luminance


def _rows(E: xr.Dataset, separator: str) -> Iterator[str]:
    """Yield the illuminances [lx] of every time stamp as text, the shade applied."""
    values = luminance(E["total"]).transpose("time", "sensor")
    form = separator.join(["%.6g"] * values.sizes["sensor"])
    for row in values.values:
        yield form % tuple(row.tolist())


def _hours(E: xr.Dataset) -> np.ndarray:
    """Time at which the sun is taken: the middle of the interval, or the stamp itself."""
    step = 0.0 if E.attrs.get("sun_time") == "instant" else float(E.attrs.get("step_hours", 1.0))
    return E["time"].values + np.timedelta64(round(step * 1800), "s")


def save_ill(E: xr.Dataset, path: str | Path) -> None:
    """Write E as DAYSIM does: month, day, hour and E [lx] of every sensor, a row for a time stamp.

    Parameters
    ----------
    E : xr.Dataset
        `total` (time, sensor) [lx].
    path : str or Path
        The hour is the middle of the interval, in local standard time.

    Examples
    --------
    >>> import drcmitsuba
    >>> from pathlib import Path
    >>> from drcmitsuba.export.tables import save_ill
    >>> result = drcmitsuba.evaluate("office.toml")
    >>> save_ill(result.illuminance[["total"]], Path("office.ill"))
    """
    times = _hours(E).astype("datetime64[s]")
    months = times.astype("datetime64[M]")
    days = times.astype("datetime64[D]")
    month = months.astype(int) % 12 + 1
    day = (days - months.astype("datetime64[D]")).astype(int) + 1
    hour = (times - days).astype(int) / 3600
    stamps = zip(month, day, hour, _rows(E, " "), strict=True)
    storage.save_lines((f"{m} {d} {h:.3f} {row}\n" for m, d, h, row in stamps), path)


def save_csv(E: xr.Dataset, path: str | Path) -> None:
    """Write E as CSV: sensors and their positions in four rows, then a row for a time stamp.

    Parameters
    ----------
    E : xr.Dataset
        `total` (time, sensor) [lx], and `x`, `y`, `z` (sensor) [m].
    path : str or Path
        Time stamps are starts of intervals in local standard time.

    Examples
    --------
    >>> import drcmitsuba
    >>> from pathlib import Path
    >>> from drcmitsuba.export.tables import save_csv
    >>> result = drcmitsuba.evaluate("office.toml")
    >>> save_csv(result.illuminance[["total"]], Path("office.csv"))
    """

    def lines() -> Iterator[str]:
        yield ",".join(["time", *(f"sensor_{i}" for i in range(E.sizes["sensor"]))]) + "\n"
        for axis in "xyz":
            yield ",".join([f"{axis} [m]", *(f"{v:.9g}" for v in E[axis].values)]) + "\n"
        stamps = np.datetime_as_string(E["time"].values, unit="m")
        for time, row in zip(stamps, _rows(E, ","), strict=True):
            yield f"{time},{row}\n"

    storage.save_lines(lines(), path)
