"""Daylight of a case: weather, period and sky model give sky, suns and remarks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba import sky
from drcmitsuba.case.case import Case
from drcmitsuba.case.sky import CieTable, PerezSky, SunshineTable
from drcmitsuba.case.sun import Adaptive, Daysim, FivePhase, ThreePhase
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import is_file
from drcmitsuba.sky import sun_models, weather
from drcmitsuba.sky.consistency import notes_on
from drcmitsuba.sky.period import period, read_timestamps, whole_year
from drcmitsuba.sky.remarks import period_notes, place_notes
from drcmitsuba.sky.sun_models import Blend, Suns

YEAR = 8760.0
"""Hours of a year [h]."""


@dataclass(frozen=True)
class Daylight:
    """Sky and suns of the case's time stamps.

    Parameters
    ----------
    sky : xr.Dataset
        From `sky.radiance`, with the coordinate `clock`; `sun_direction` (time, axis), and, unless
        the sun is adaptive, `blend_bin` and `blend_weight` (time, blend): a `suns.Blend`.
    sun : xr.Dataset
        From `sky.sun_position`.
    suns : Suns
        Suns whose coefficients are needed; an adaptive sun needs those of the time stamps.
    step_hours : float
        Length of the intervals [h].
    source : str
        Weather file, or the name of a site without one.
    notes : tuple of str
        Changes that the reader of the weather made, and remarks on the period.
    year : Daylight, optional
        All hours of the year, where these time stamps are some of them: `suns` are those of the
        year, and standards count its hours.
    """

    sky: xr.Dataset
    sun: xr.Dataset
    suns: Suns
    step_hours: float
    source: str
    notes: tuple[str, ...] = ()
    year: Daylight | None = None

    @property
    def every(self) -> Daylight:
        """Daylight of all time stamps that are simulated: the year's, or its own."""
        return self if self.year is None else self.year

    @property
    def rows(self) -> np.ndarray:
        """Indices of its time stamps among those of `every`, int, shape (time,)."""
        return np.searchsorted(self.every.sky["time"].values, self.sky["time"].values)

    def times(self) -> Daylight:
        """Its time stamps without luminances, for what knows illuminances."""
        return replace(self, sky=self.sky.drop_vars([*self.sky.data_vars, "sun_bin"]))

    def with_true_suns(self) -> Daylight:
        """Daylight whose suns stand for themselves where they belong to an adaptive sun."""
        if self.sky.attrs["sun_model"] != "adaptive":
            return self
        return replace(self, sky=self.sky.assign_attrs(sun_model="true_sun"))

    def alone(self) -> Daylight:
        """Daylight without the year; its suns are still those of the year."""
        return replace(self, year=None)


@contextmanager
def _of(case: Case, table: str) -> Iterator[None]:
    """Name the case file and its table in errors."""
    try:
        yield
    except InputError as error:
        field = f"{table}.{error.field}"
        raise InputError(case.source, field, error.got, error.remedy) from None


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


def weather_of(case: Case) -> weather.Weather:
    """Weather of a case: its file, a year without weather at its site, or the default."""
    if case.weather.file is not None:
        path = case.path(case.weather.file)
        if not (path.is_dir() or is_file(path, case.source, "weather.file")):
            remedy = "give its path relative to the case file, or name another one by --weather"
            got = f"{path.absolute()}: no such file"
            raise InputError(case.source, "weather.file", got, remedy)
        return weather.read(path)
    if case.site is None or isinstance(case.sky, PerezSky):
        default = weather.default()
        at = f"latitude {default.site.latitude:g}, longitude {default.site.longitude:g}"
        note = f"no weather file: the typical year of {default.site.name} ({at}) is used"
        if case.site is not None:
            note += ", not [site]: a Perez sky takes place and weather from the weather file"
        return replace(default, notes=(note, *default.notes))
    site = weather.Site(**case.site.model_dump())
    empty = xr.Dataset(coords={"time": whole_year(1.0)}, attrs={"sun_time": "middle"})
    return weather.Weather(f"{site.name}, no weather file", site, 1.0, empty, site.notes)


class _Stamps(NamedTuple):
    """Time stamps, and the rows of the weather that they take."""

    times: np.ndarray
    clock: np.ndarray
    rows: np.ndarray
    sun_time: str
    step: float
    """Length of the interval that each counts as [h]."""


def _stamps(case: Case, w: weather.Weather, times: np.ndarray | None) -> _Stamps:
    """Time stamps of a case, or instants that are given; InputError where the weather has none."""
    starts = w.data["time"].values
    if times is None and case.period.timestamps is None:
        with _of(case, "period"):
            times, clock = period(case.period).select(starts, w.step)
        sun_time = w.data.attrs.get("sun_time", "middle")
        return _Stamps(times, clock, np.searchsorted(starts, times), sun_time, w.step)
    source: object = "command line"
    if times is None:
        assert case.period.timestamps is not None
        source = case.path(case.period.timestamps)
        times = read_timestamps(source)
    rows = np.searchsorted(starts, times, side="right") - 1
    step = np.timedelta64(round(w.step * 3600), "s")
    outside = (rows < 0) | (times >= starts[rows] + step)
    if outside.any():
        got = f"{times[outside][0]} is not in the weather"
        raise InputError(source, "time", got, "give time stamps within the weather file")
    if len(np.unique(times.astype("datetime64[m]"))) < len(times):
        got = "two time stamps in one minute"
        raise InputError(source, "time", got, "give one a minute at most")
    return _Stamps(times, times, rows, "instant", min(w.step, _least_gap(times)))


def _rows(w: weather.Weather, rows: np.ndarray, times: np.ndarray) -> xr.Dataset:
    """Weather of time stamps, with the `start` of the interval that each lies in."""
    data = w.data.isel(time=rows)
    return data.assign_coords(start=("time", data["time"].values), time=times)


def _least_gap(times: np.ndarray) -> float:
    """Least gap between time stamps of one day [h]."""
    in_order = np.sort(times)
    days = in_order.astype("datetime64[D]")
    gaps = np.diff(in_order)[days[1:] == days[:-1]] / np.timedelta64(1, "h")
    return float(gaps.min(initial=np.inf))


def sky_luminance(case: Case, time: np.datetime64, directions: np.ndarray) -> np.ndarray:
    """Luminance of the continuous sky at an instant.

    Parameters
    ----------
    case : Case
    time : np.datetime64
        Instant in the weather's year, local standard time.
    directions : np.ndarray, shape (direction, 3)
        Unit vectors above the horizon.

    Returns
    -------
    np.ndarray, shape (direction,)
        Luminance [cd/m²], scaled as the patches of `daylight` are.
    """
    w, times = weather_of(case), np.array([time])
    stamps = _stamps(case, w, times)
    data = _rows(w, stamps.rows, times)
    sun = sky.sun_position(times, w.step, w.site, stamps.sun_time)
    model: Any = sky_model(case)
    patches = Patches(case.sky.subdivision)
    model = replace(model, patch_values=sky.AtDirections(model.patch_values, directions))
    return np.asarray(model.luminances(data, sun, patches).sky[0, len(patches) - 1 :])


def daylight(case: Case, times: np.ndarray | None = None) -> Daylight:
    """Weather, sun positions and luminances of the case's time stamps: L[time, bin].

    Parameters
    ----------
    case : Case
    times : np.ndarray of datetime64, optional
        Instants in place of the case's time stamps, local standard time of the nominal year.

    Returns
    -------
    Daylight

    Raises
    ------
    InputError
        The weather file, the period or the time stamps are unfit, or no time stamp is left.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba.sky.daylight import daylight
    >>> light = daylight(drcmitsuba.load_case("office.toml"))
    >>> light.sky["sky"].dims
    ('time', 'bin')
    >>> light.step_hours
    1.0
    """
    w = weather_of(case)
    light = _of_stamps(case, w, _stamps(case, w, times))
    return replace(light, notes=_notes(case, w, light.sky, light.step_hours))


def daylight_and_year(case: Case) -> Daylight:
    """Daylight of the case's time stamps as `daylight`, with the year whose hours standards count.

    There is a year where the time stamps are some hours of all twelve months, and the weather has
    all hours. A part of a year, and a user's own time stamps, stay by themselves.
    """
    w = weather_of(case)
    own, starts = _stamps(case, w, None), w.data["time"].values
    whole = abs(len(starts) * w.step - YEAR) < w.step / 2
    seasonal = case.period.timestamps is not None or len(case.period.months) < 12
    if seasonal or not whole or len(own.times) == len(starts):
        light = _of_stamps(case, w, own)
        return replace(light, notes=_notes(case, w, light.sky, light.step_hours))
    year = _of_stamps(case, w, _stamps(case.with_tables(period=case.period.of_year()), w, None))
    sky, sun = (data.isel(time=own.rows) for data in (year.sky, year.sun))
    return replace(year, sky=sky, sun=sun, notes=_notes(case, w, sky, w.step), year=year)


def _notes(case: Case, w: weather.Weather, light: xr.Dataset, step: float) -> tuple[str, ...]:
    """Remarks on the weather, the place and the period of a sky; a time stamp is a `step` [h]."""
    of_period = period_notes(case, light, w, step)
    return (*w.notes, *notes_on(w), *place_notes(case, w.site), *of_period)


def _of_stamps(case: Case, w: weather.Weather, stamps: _Stamps) -> Daylight:
    """Sky and suns of some time stamps, without remarks."""
    times, clock, rows, sun_time, step = stamps
    with _of(case, "sky"):
        model = sky_model(case)
    data = _rows(w, rows, times)
    sun = sky.sun_position(times, w.step, w.site, sun_time)
    light = sky.radiance(
        data, sun, model=model,
        ground_reflectance=case.outside.ground_reflectance,
        sun_diameter=case.outside.sun_diameter,
        patches=Patches(case.sky.subdivision),
    ).assign_coords(clock=("time", clock))  # fmt: skip
    if case.effects.dark_hours == "auto":  # a sun without radiance lights nothing
        shining = np.where(light["sun"].values > 0, light["sun_bin"].values, "")
        light = light.assign_coords(sun_bin=("time", shining))
    light.attrs |= {
        "latitude": w.site.latitude,
        "longitude": w.site.longitude,
        "timezone": w.site.timezone,
        "sun_time": sun_time,
        "sun_model": case.sun.model,
    }
    light["sun_direction"] = (("time", "axis"), sun["direction"].values)
    sources, blend = _sun_sources(case, light, sun)
    if blend is not None:
        light["blend_bin"] = (("time", "blend"), blend.bins)
        light["blend_weight"] = (("time", "blend"), blend.weights)
    return Daylight(light, sun, sources, step, w.source)


def _sun_sources(case: Case, light: xr.Dataset, sun: xr.Dataset) -> tuple[Suns, Blend | None]:
    """Suns that a case's sun model calls for, and their blend at each time stamp."""
    directions, labels = light["sun_direction"].values, light["sun_bin"].values
    up, diameter = labels != "", case.outside.sun_diameter
    own = Suns.of(sun, diameter).only(labels)
    if isinstance(case.sun, ThreePhase):
        patches = Patches(case.sky.subdivision)
        return Suns.none(), sun_models.spread_over_patches(directions, up, patches, diameter)
    if isinstance(case.sun, FivePhase):
        return sun_models.moved_to_patch(directions, up, diameter)
    if isinstance(case.sun, Daysim):
        return sun_models.between_daysim_suns(directions, up, light.attrs["latitude"], diameter)
    if isinstance(case.sun, Adaptive):
        return own, None
    return own, Blend.own(labels)
