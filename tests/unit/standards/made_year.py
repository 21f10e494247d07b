"""A year whose illuminance is known: the light of the zenith, times a number of each point."""

import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.metrics import accumulate
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.intervals import t_factor
from drcmitsuba.standards import Evidence

LABELS = np.array(Patches(1).labels, object)
WHOLE = np.arange("2015-01-01", "2016-01-01", dtype="datetime64[h]").astype("datetime64[ns]")
HOUR = (WHOLE - WHOLE.astype("datetime64[D]")).astype("timedelta64[h]").astype(int)
WORKING = WHOLE[(HOUR >= 8) & (HOUR < 18)]
NOON = 10_000.0
"""Luminance of the zenith at noon in midsummer [cd/m²]."""


def zenith(times=WHOLE):
    """Luminance of the zenith (time,) [cd/m²]: higher at noon and in summer, 0 at night."""
    hour = (times - times.astype("datetime64[D]")) / np.timedelta64(1, "h") + 0.5
    day = (times - times[0].astype("datetime64[Y]")) / np.timedelta64(1, "D")
    season = 0.6 - 0.4 * np.cos(2 * np.pi * (day + 10) / 365)
    return NOON * season * np.maximum(np.cos((hour - 12.5) / 12 * np.pi), 0)


def grid_points(count, spacing=0.6, rooms=1):
    """Points of square grids side by side: x, y, z [m] (sensor,), and the grid's name."""
    side = round(count**0.5)
    x, y = np.divmod(np.arange(count), side)
    x = np.concatenate([x * spacing + 20 * room for room in range(rooms)])
    names = np.repeat([f"room {room + 1}" for room in range(rooms)], count)
    return x, np.tile(y * spacing, rooms), np.full(len(x), 0.8), names.astype(object)


def evidence(of_point, error=0.0, *, times=WHOLE, rooms=1, spacing=0.6, shared=0.5, seed=0, n=8):
    """Evidence in which E is `of_point` (sensor,) [sr] times the zenith's luminance.

    `error` is the standard error of each point relative to its value, of which `shared` is common
    to all points. There are `n` replicates.
    """
    of_point = np.asarray(of_point, float)
    rng = np.random.default_rng([seed, 77])
    own, common = rng.standard_normal((n, len(of_point))), rng.standard_normal((n, 1))
    noise = error * np.sqrt(n) * (np.sqrt(1 - shared) * own + np.sqrt(shared) * common)
    C = np.zeros((n, len(of_point), len(LABELS)), np.float32)
    C[:, :, -1] = of_point * (1 + noise)
    x, y, z, names = grid_points(len(of_point) // rooms, spacing, rooms)
    at = {"x": ("sensor", x), "y": ("sensor", y), "z": ("sensor", z)}
    if rooms > 1:
        at["grid"] = ("sensor", names)
    none = np.zeros(C.shape[1:], np.float32)
    is_open = xr.Dataset(
        {
            "replicates": (("replicate", "sensor", "bin"), C),
            "straight": (("sensor", "bin"), none),
            "straight_se": (("sensor", "bin"), none),
        },
        coords={"bin": LABELS, **at},
        attrs={"has_shade": 0},
    )
    L = np.zeros((len(times), len(LABELS)), np.float32)
    L[:, -1] = zenith(times)
    sky = xr.Dataset(
        {"sky": (("time", "bin"), L), "sun": ("time", np.zeros(len(times)))},
        coords={
            "time": times,
            "clock": ("time", times),
            "bin": LABELS,
            "sun_bin": ("time", np.full(len(times), "", object)),
        },
    )
    sky["sun_direction"] = (("time", "axis"), np.zeros((len(times), 3)))
    E = accumulate.illuminance(is_open, [], sky, np.zeros(len(times), int))
    E.attrs = {"has_shade": 0, "step_hours": 1.0, "interval_factor": t_factor(n)}
    arguments = {"rays": None, "seed": seed}
    return Evidence(E, Coefficients(is_open), sky, arguments, "made year")


def median_reached(times, fraction=0.5):
    """Luminance that is reached in a fraction of the hours [cd/m²]."""
    L = np.sort(zenith(times))[::-1]
    return L[int(np.ceil(fraction * len(L))) - 1]
