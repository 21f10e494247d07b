"""Files of known shares, as `drcmitsuba lights` writes them beside an evaluation."""

import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches

EXPOSURE = {"glass (south)": [10.0, 40.0, 30.0], "film <b>": [5.0, 10.0, 5.0]}
"""Light by source: ground, sky, sun [lx h], of the first sensor; a quarter of it is direct."""


def write_lights(folder, sensors=(0, 12), **attributes):
    """Write the file for some sensors of the evaluation in a folder."""
    with xr.open_dataset(folder / "illuminance.nc", engine="h5netcdf") as E:
        settings, at = E.attrs["settings"], {a: E[a].values[list(sensors)] for a in "xy"}
    patches, suns = Patches(), np.array([[0.0, -0.6, 0.8], [0.6, 0.0, 0.8]])
    light = np.array([*EXPOSURE.values()])[None, :, :, None, None]
    share = np.array([0.25, 0.5, 0.25, 0, 0, 0])[:, None]
    exposure = light * share * np.ones(len(sensors))
    directions = np.concatenate([patches.directions, suns])
    C = np.full((1, len(EXPOSURE), 6, len(sensors), len(directions)), 1e-3)
    data = {
        "by_window": (("state", "window", "bounces", "sensor", "bin"), C),
        "exposure": (("state", "window", "source", "bounces", "sensor"), exposure),
        "solid_angle": ("bin", np.append(patches.solid_angles, [6e-5, 6e-5])),
        "direction": (("bin", "axis"), directions),
    }
    coords = {
        "window": [*EXPOSURE], "source": ["ground", "sky", "sun"], "sensor": list(sensors),
        "bin": [*patches.labels, "sun_1", "sun_2"], **{a: ("sensor", at[a]) for a in "xy"},
    }  # fmt: skip
    attributes = {"by_evaluation": 1, "subdivision": 1, "settings": settings, **attributes}
    made = xr.Dataset(data, coords, attributes)
    made.to_netcdf(folder / "lights.nc", engine="h5netcdf")
    return made


def write_light_of_sensors(folder):
    """Write the file for all sensors: of the nth one, the film has the n-fold light."""
    with xr.open_dataset(folder / "illuminance.nc", engine="h5netcdf") as E:
        settings, count = E.attrs["settings"], E.sizes["sensor"]
    light = np.array([*EXPOSURE.values()])[None, :, :, None, None] * np.ones(count)
    light[:, 1] *= np.arange(count)
    share = np.array([0.25, 0.5, 0.25])[:, None]
    made = xr.Dataset(
        {"exposure": (("state", "window", "source", "bounces", "sensor"), light * share)},
        {"window": [*EXPOSURE], "source": ["ground", "sky", "sun"], "sensor": np.arange(count)},
        {"by_evaluation": 1, "settings": settings},
    )
    made.to_netcdf(folder / "light_of_sensors.nc", engine="h5netcdf")
    return made
