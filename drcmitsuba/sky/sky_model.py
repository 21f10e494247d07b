"""Luminances L[time, bin] of sky patches, ground and sun under one sky model."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.schema import describe
from drcmitsuba.sky.quadrature import SkyLight


class SkyModel(Protocol):
    """Sky and direct light of each time: `Perez`, `CieSky`, `Sunshine`, or one's own."""

    def luminances(self, data: xr.Dataset, sun: xr.Dataset, patches: Patches) -> SkyLight:
        """Sky patches, diffuse horizontal and direct normal illuminance of each time.

        Parameters
        ----------
        data : xarray.Dataset
            `dni`, `dhi` [W/m²], and where known `dew_point` [°C, NaN where missing], on `time`; CIE
            skies do not use it.
        sun : xarray.Dataset
            As from `sun_position`, on the same `time`.
        patches : Patches

        Returns
        -------
        SkyLight
        """


def radiance(
    data: xr.Dataset,
    sun: xr.Dataset,
    *,
    model: SkyModel,
    ground_reflectance: float = 0.2,
    sun_diameter: float = 0.5,
    patches: Patches | None = None,
) -> xr.Dataset:
    """Luminance of every bin at each time: the L of E = C·L.

    Parameters
    ----------
    data : xarray.Dataset
        Weather on `time`: `dni`, `dhi` [W/m²], `dew_point` [°C, NaN where missing].
    sun : xarray.Dataset
        As from `sun_position`, on the same `time`.
    model : Perez, CieSky or Sunshine
        The sky.
    ground_reflectance : float
        Reflectance ρ of the ground, 0 to 1.
    sun_diameter : float
        Angular diameter of the sun [deg].
    patches : Patches, optional
        Subdivision of the sky; Tregenza's 145 patches if not given.

    Returns
    -------
    xarray.Dataset
        `sky` (time, bin) [cd/m²]: ground and patches, `bin` their labels, so that Σ L ∫cos θ dΩ
        over the patches is `diffuse_horizontal_illuminance`; `sun` (time) [cd/m²]: L Ω is
        `direct_normal_illuminance`; these two (time) [lx]; coordinate `sun_bin` (time): label of
        the sun, "sun_2015-03-21T10:00", wherever its centre is above the horizon, whatever the
        weather; "" elsewhere.

    Raises
    ------
    InputError
        The times differ, an irradiance is missing or negative, or a number is out of its range.

    Notes
    -----
    The ground is a Lambertian plane: L = ρ/π (diffuse + direct normal · cos Z). A direct irradiance
    with the sun's centre below the horizon is dropped.

    Examples
    --------
    >>> import drcmitsuba
    >>> import numpy as np
    >>> from drcmitsuba import sky
    >>> weather = drcmitsuba.weather.default()
    >>> time = np.array(["2015-03-20T12"], "datetime64[ns]")
    >>> sun = sky.sun_position(time, 1.0, weather.site)
    >>> L = sky.radiance(weather.data.sel(time=time), sun, model=sky.Perez())
    >>> L["sky"].shape
    (1, 146)
    """
    _check(data, sun, ground_reflectance, sun_diameter)
    patches = Patches() if patches is None else patches
    sky, diffuse, direct = model.luminances(data, sun, patches)
    cos_zenith = np.maximum(sun["direction"].sel(axis="z").to_numpy(), 0)
    ground = ground_reflectance / np.pi * (diffuse + direct * cos_zenith)
    light = xr.Dataset(
        {
            "sky": (("time", "bin"), np.column_stack([ground, sky])),
            "sun": ("time", direct / disk_solid_angle(sun_diameter)),
            "direct_normal_illuminance": ("time", direct),
            "diffuse_horizontal_illuminance": ("time", diffuse),
        },
        coords={
            "time": data["time"].to_numpy(),
            "bin": patches.labels,
            "sun_bin": ("time", sun_labels(sun)),
        },
        attrs={"ground_reflectance": ground_reflectance, "sun_diameter": sun_diameter},
    )
    return describe(light)


def sun_labels(sun: xr.Dataset) -> np.ndarray:
    """Label of each time's sun, "sun_2015-03-21T10:00"; "" where its centre is not up."""
    labels = np.char.add("sun_", np.datetime_as_string(sun["time"].to_numpy(), unit="m"))
    return np.where(sun["solar_zenith"].to_numpy() < 90, labels, "")


def _check(
    data: xr.Dataset, sun: xr.Dataset, ground_reflectance: float, sun_diameter: float
) -> None:
    """Refuse times, irradiances and numbers that no sky follows from."""
    if not np.array_equal(data["time"].to_numpy(), sun["time"].to_numpy()):
        raise InputError("sky", "time", "other times than the sun's", "give both the same times")
    for name in ("dni", "dhi"):
        if name not in data:
            continue
        values = data[name].to_numpy()
        wrong = np.flatnonzero(~((values >= 0) & (values < np.inf)))
        if len(wrong):
            when = np.datetime_as_string(data["time"].to_numpy()[wrong[0]], unit="m")
            got = f"{values[wrong[0]]} W/m2 at {when}"
            raise InputError("weather", name, got, "give a number of W/m2 from 0")
    if not 0 <= ground_reflectance <= 1:
        got, remedy = str(ground_reflectance), "give a share from 0 to 1"
        raise InputError("sky", "ground_reflectance", got, remedy)
    if not 0 < sun_diameter <= 10:
        raise InputError("sky", "sun_diameter", f"{sun_diameter} deg", "give degrees from 0 to 10")
