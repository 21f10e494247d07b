"""Luminances L[time, bin] of all bins, suns among them: as E = C·L takes them, and on disk."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from drcmitsuba import schema
from drcmitsuba.runtime import storage
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.sun_models import Blend

BLOCK = 1024
"""Time stamps of L that are held at once where it is written."""
SUN_VARIABLES = ("sun", "sun_direction", "blend_bin", "blend_weight")
"""Variables of the sun beside L on disk; an adaptive sun has no blend."""


def sources(light: xr.Dataset) -> np.ndarray:
    """Labels of all bins that stand for the suns of some time stamps, their own among them."""
    return np.unique([*blended(light).bins.ravel(), *light["sun_bin"].values.astype(object)])


def blended(light: xr.Dataset) -> Blend:
    """Blend of each time stamp's sun; an adaptive sun has none, since its blend depends on C."""
    if "blend_bin" in light:
        return Blend(light["blend_bin"].values, light["blend_weight"].values)
    return Blend(*np.zeros((2, light.sizes["time"], 0), object))


def without_year(light: Daylight) -> Daylight:
    """Daylight of its own time stamps and their suns alone."""
    return at_rows(light, slice(None))


def at_rows(light: Daylight, rows: slice | np.ndarray) -> Daylight:
    """Daylight of some of its own time stamps, by their indices (time,), and their suns alone."""
    sky, sun = light.sky.isel(time=rows), light.sun.isel(time=rows)
    return replace(light, sky=sky, sun=sun, suns=light.suns.only(sources(sky)), year=None)


def luminances(light: Daylight, times: slice = slice(None)) -> xr.Dataset:
    """L[time, bin] [cd/m²] of some time stamps, with suns as bins, so that E = C·L.

    Where the sun is adaptive, it has no bin: there is only its luminance `sun` and `sun_direction`.
    """
    here = light.sky.isel(time=times)
    suns = light.suns.labels if "blend_bin" in here else ()
    labels = np.array([*map(str, here["bin"].values), *suns], dtype=object)
    L = np.zeros((here.sizes["time"], len(labels)), np.float32)
    L[:, : here.sizes["bin"]] = here["sky"].values
    blend = blended(here)
    for bins, weights in zip(blend.bins.T, blend.weights.T, strict=True):
        rows = np.flatnonzero(weights)
        columns = schema.positions(bins[rows], labels)
        L[rows, columns] += (weights * here["sun"].values)[rows]
    data = xr.Dataset(
        {"L": (("time", "bin"), L)}, coords={"time": here["time"].values, "bin": labels}
    )
    data = data.assign({name: here[name] for name in SUN_VARIABLES if name in here})
    data.attrs = {**light.sky.attrs, "step_hours": light.step_hours, "weather": light.source}
    data = data.assign_coords(
        clock=("time", here["clock"].values),
        sun_bin=("time", here["sun_bin"].values.astype(object)),
    )
    return schema.describe(data)


def save_luminances(light: Daylight, path: Path, channels: xr.DataArray | None = None) -> None:
    """Write `luminances` as a zarr folder block by block, whole or not at all.

    L is the same in all colour `channels`, the names of which may be given.
    """
    blocks = range(0, light.sky.sizes["time"], BLOCK)
    parts = (luminances(light, slice(start, start + BLOCK)) for start in blocks)
    if channels is not None:
        parts = (part.assign(L=part["L"].expand_dims(channel=channels)) for part in parts)
    storage.save_zarr(parts, path)


def from_luminances(data: xr.Dataset) -> xr.Dataset:
    """Invert `luminances`: sky (time, bin), sun (time), sun_bin (time) and the blend."""
    labels = data["bin"].values.astype(str)
    is_sky = ~np.char.startswith(labels, "sun_")
    L = data["L"].isel(bin=is_sky).values
    out = data[[name for name in SUN_VARIABLES if name in data]]
    out = out.drop_vars("bin", errors="ignore").load()
    blend = blended(out)
    for bins, weights in zip(blend.bins.T, blend.weights.T, strict=True):
        rows = np.flatnonzero((weights != 0) & np.isin(bins.astype(str), labels[is_sky]))
        # The sun that is spread over patches is taken out of them again.
        columns = schema.positions(bins[rows], labels[is_sky])
        L[rows, columns] -= (weights * out["sun"].values)[rows]
    out["sky"] = (("time", "bin"), np.maximum(L, 0))
    return out.assign_coords(bin=labels[is_sky])


def bright_hours(sky: xr.Dataset) -> np.ndarray:
    """Time stamps at which the sky or the sun is bright, bool (time,)."""
    patches = sky["sky"].transpose("time", "bin").values
    return np.asarray((patches > 0).any(axis=1) | (sky["sun"].values > 0))
