"""Light of a case: from weather, period and sky model to the luminances L[time, bin]."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba import schema, sky, weather
from drcmitsuba.case import Case, CieTable, PerezSky, PeriodTable, SunshineTable
from drcmitsuba.errors import InputError
from drcmitsuba.period import EVALDRC, LM83, Period, read_timestamps


@dataclass(frozen=True)
class Daylight:
    """Sky and suns of the case's time stamps.

    Parameters
    ----------
    sky : xr.Dataset
        From `sky.radiance`, with the coordinate `clock`.
    sun : xr.Dataset
        From `sky.sun_position`.
    step_hours : float
        Length of the intervals [h].
    source : str
        Where the weather is from.
    notes : tuple of str
        What the reader of the weather changed.
    """

    sky: xr.Dataset
    sun: xr.Dataset
    step_hours: float
    source: str
    notes: tuple[str, ...] = ()


@contextmanager
def _of(case: Case, table: str) -> Iterator[None]:
    """Name the case file and its table in what is wrong with them."""
    try:
        yield
    except InputError as error:
        field = f"{table}.{error.field}"
        raise InputError(case.source, field, error.got, error.remedy) from None


def period(table: PeriodTable) -> Period:
    """Period of a case; keys beside `calendar` override it."""
    days = {"EvalDRC": EVALDRC, "LM-83": LM83}[table.calendar].days_per_week
    return Period(
        months=table.months,
        hours=table.hours,
        days_per_week=table.days_per_week or days,
        daylight_saving=table.daylight_saving,
    )


def sky_model(case: Case) -> sky.SkyModel:
    """Sky model of a case."""
    table = case.sky
    if isinstance(table, PerezSky):
        values = sky.PatchMeans() if table.patch_values == "mean" else sky.PatchCentres()
        return sky.Perez(patch_values=values)
    if isinstance(table, CieTable):
        return sky.CieSky(table.type, table.diffuse_horizontal_illuminance)
    assert isinstance(table, SunshineTable)
    return sky.Sunshine(table.probability, seed=table.seed)


def _weather(case: Case) -> weather.Weather:
    """Weather of a case: its file, a year without weather at its site, or the default."""
    if case.weather.file is not None:
        return weather.read(case.path(case.weather.file))
    if case.site is None or isinstance(case.sky, PerezSky):
        default = weather.default()
        at = f"latitude {default.site.latitude:g}, longitude {default.site.longitude:g}"
        note = f"no weather file: the typical year of {default.site.name} ({at}) is used"
        if case.site is not None:
            note += ", not [site]: a Perez sky takes place and weather from the weather file"
        return replace(default, notes=(note, *default.notes))
    site = weather.Site(**case.site.model_dump())
    hours = np.arange("2015-01-01", "2016-01-01", dtype="datetime64[h]").astype("datetime64[ns]")
    empty = xr.Dataset(coords={"time": hours}, attrs={"sun_time": "middle"})
    return weather.Weather(f"{site.name}, no weather file", site, 1.0, empty, ())


def daylight(case: Case) -> Daylight:
    """Weather, sun positions and luminances of the case's time stamps: L[time, bin].

    Raises
    ------
    InputError
        The weather file, the period or the time stamps are unfit, or no time stamp is left.
    """
    w = _weather(case)
    starts = w.data["time"].values
    sun_time = w.data.attrs.get("sun_time", "middle")
    if case.period.timestamps is None:
        with _of(case, "period"):
            times, clock = period(case.period).select(starts, w.step)
        rows = np.searchsorted(starts, times)
    else:
        file = case.path(case.period.timestamps)
        times = clock = read_timestamps(file)
        sun_time = "instant"
        rows = np.searchsorted(starts, times, side="right") - 1
        step = np.timedelta64(round(w.step * 3600), "s")
        outside = (rows < 0) | (times >= starts[rows] + step)
        if outside.any():
            raise InputError(
                file, "time", f"{times[outside][0]} is not in the weather",
                "give time stamps within the weather file",
            )  # fmt: skip
        if len(np.unique(times.astype("datetime64[m]"))) < len(times):
            raise InputError(
                file, "time", "two time stamps in one minute", "give one a minute at most"
            )
    with _of(case, "sky"):
        model = sky_model(case)
    data = w.data.isel(time=rows).assign_coords(time=times)
    sun = sky.sun_position(times, w.step, w.site, sun_time)
    light = sky.radiance(
        data, sun, model=model,
        ground_reflectance=case.outside.ground_reflectance,
        sun_diameter=case.outside.sun_diameter,
        patches=Patches(case.sky.subdivision),
    ).assign_coords(clock=("time", clock))  # fmt: skip
    light.attrs |= {
        "latitude": w.site.latitude,
        "longitude": w.site.longitude,
        "timezone": w.site.timezone,
        "sun_time": sun_time,
    }
    return Daylight(light, sun, w.step, w.source, w.notes)


def luminances(light: Daylight) -> xr.Dataset:
    """L[time, bin] with every sun as a bin of its own, as it lies on disk."""
    dense = light.sky["sky"].values.astype(np.float32)
    up = np.flatnonzero(light.sky["sun_bin"].values != "")
    suns = np.zeros((len(dense), len(up)), np.float32)
    suns[up, np.arange(len(up))] = light.sky["sun"].values[up]
    labels = [*light.sky["bin"].values, *light.sky["sun_bin"].values[up]]
    data = xr.Dataset(
        {"L": (("time", "bin"), np.concatenate([dense, suns], axis=1))},
        coords={"time": light.sky["time"].values, "bin": np.array(labels, dtype=object)},
        attrs={**light.sky.attrs, "step_hours": light.step_hours, "weather": light.source},
    )
    data = data.assign_coords(
        clock=("time", light.sky["clock"].values),
        sun_bin=("time", light.sky["sun_bin"].values.astype(object)),
    )
    return schema.describe(data)


def from_luminances(data: xr.Dataset) -> xr.Dataset:
    """Invert `luminances`: sky (time, bin), sun (time) and sun_bin (time)."""
    labels = data["bin"].values.astype(str)
    is_sun = np.char.startswith(labels, "sun_")
    position = {label: i for i, label in enumerate(labels)}
    bins = data["sun_bin"].values.astype(str)
    L = data["L"].values
    sun = np.array([L[i, position[b]] if b else 0.0 for i, b in enumerate(bins)])
    out = xr.Dataset(
        {"sky": (("time", "bin"), L[:, ~is_sun]), "sun": ("time", sun)},
        coords={"time": data["time"].values, "bin": labels[~is_sun]},
        attrs=data.attrs,
    )
    return out.assign_coords(clock=("time", data["clock"].values), sun_bin=("time", bins))
