"""Annual metrics of melanopic light at sensors and views, with their intervals.

References
----------
.. [1] T. M. Brown et al., "Recommendations for daytime, evening, and nighttime indoor light
   exposure to best support physiology, sleep, and wakefulness in healthy adults", PLoS Biology 20
   (3), 2022: at least 250 lx of melanopic equivalent daylight illuminance at the eye by day.
.. [2] WELL Building Standard v2, L03: a threshold at the eye for four hours that begin by noon.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba.colour.appearance import Appearance
from drcmitsuba.colour.bands import Bands
from drcmitsuba.runtime.toml import Sure

HALF = 0.5
"""Share of the hours from which on a sensor counts [–]."""
NOON = 12
"""Hour by which a time with enough light has to begin [h]; [2]."""
LONG = 4.0
"""Length of this time [h]; [2]."""

EVERY = 100.0 - 1e-9
"""Share of the days that a rule asks for [%]."""


@dataclass(frozen=True)
class MorningRule:
    """Rule that asks for melanopic light at an eye on every day, for `LONG` hours by noon."""

    title: str
    threshold: float
    """Melanopic equivalent daylight illuminance [lx]."""
    source: str
    sure: Sure


RULES = (
    MorningRule(
        "WELL v2 L03, 1 point", 136.0, "WELL v2, L03, as consultants quote it", "second-hand"
    ),
    MorningRule(
        "WELL v2 L03, 3 points", 250.0, "WELL v2, L03, as consultants quote it", "second-hand"
    ),
)
"""Rules whose verdicts every view has."""


def melanopic_metrics(
    spectral: xr.Dataset, illuminance: xr.Dataset, threshold: float, step_hours: float
) -> dict[str, Any]:
    """Metrics of melanopic light, as `metrics.json` holds them.

    Parameters
    ----------
    spectral : xr.Dataset
        From `annual.spectral_year` [lx].
    illuminance : xr.Dataset
        `total` (time, sensor) [lx].
    threshold : float
        Melanopic equivalent daylight illuminance that counts as enough [lx].
    step_hours : float
        Length of a time stamp [h].

    Returns
    -------
    dict
        `autonomy` [%]: mean over the sensors of the share of time stamps with enough light;
        `sensors` [%]: share of the sensors with enough in half of the time stamps; `ratio` [–]:
        melanopic light per illuminance, of the sums of both; colour of the mean light; and for
        every view the same, with `mornings` [%]: share of the days with enough for four hours that
        begin by noon, and `rules`: that share at the threshold of each of `RULES`, and whether it
        is met: "yes", "no", or "open" where the interval holds both. `low` and `high` are of all
        hours shifted by their intervals together.
    """
    factor = float(spectral.attrs["interval_factor"])
    half = factor * spectral["melanopic_se"].values
    M = spectral["melanopic"].values
    shares = [100 * (M + s * half >= threshold).mean(axis=0) for s in (0, -1, 1)]
    whole = _bounds([share.mean() for share in shares])
    half_hours = _bounds([100 * (share >= 100 * HALF).mean() for share in shares])
    spectrum = spectral["spectrum"].values @ _weights(illuminance["total"].values)
    out = {
        "threshold": threshold,
        "autonomy": whole,
        "sensors": half_hours,
        **_colour(M, illuminance["total"].values, spectrum, spectral),
    }
    if "view" not in spectral.dims:
        return out
    clock = spectral["clock"] if "clock" in spectral.coords else spectral["time"]
    views = {}
    for i, name in enumerate(spectral["view"].values):
        at = spectral.isel(view=i)
        M, E = at["melanopic_at_views"].values, at["illuminance_at_views"].values
        half = factor * at["melanopic_at_views_se"].values
        light = [M, M - half, M + half]

        def days(limit: float, light: list[np.ndarray] = light) -> dict[str, float]:
            return _bounds([mornings(each >= limit, clock, step_hours) for each in light])

        views[str(name)] = {
            "autonomy": _bounds([100 * (each >= threshold).mean() for each in light]),
            "mornings": days(threshold),
            "rules": {rule.title: _verdict(rule, days(rule.threshold)) for rule in RULES},
            **_colour(M, E, at["spectrum_at_views"].values, spectral),
        }
    return out | {"views": views}


def _verdict(rule: MorningRule, days: dict[str, float]) -> dict[str, Any]:
    """Verdict on a rule from the share of days that meet it."""
    met = "yes" if days["low"] >= EVERY else "no" if days["high"] < EVERY else "open"
    about = {"threshold": rule.threshold, "source": rule.source, "sure": rule.sure}
    return {"met": met, "mornings": days, **about}


def mornings(enough: np.ndarray, clock: xr.DataArray, step_hours: float) -> float:
    """Share of the days [%] with enough light for `LONG` hours on end that begin by noon.

    Parameters
    ----------
    enough : np.ndarray of bool, shape (time,)
    clock : xr.DataArray (time,)
        Time on the clock at the beginning of each time stamp.
    step_hours : float
        Length of a time stamp [h].
    """
    day = clock.values.astype("datetime64[D]")
    hour = (clock.values - day) / np.timedelta64(1, "h")
    need, days = max(1, round(LONG / step_hours)), np.unique(day)
    met = 0
    for one in days:
        here = np.flatnonzero(day == one)
        length = np.zeros(len(here), int)  # time stamps on end from each one
        for i in range(len(here) - 1, -1, -1):
            follows = i + 1 < len(here) and hour[here[i + 1]] - hour[here[i]] < 1.5 * step_hours
            length[i] = (1 + (length[i + 1] if follows else 0)) if enough[here[i]] else 0
        met += bool(((length >= need) & (hour[here] <= NOON)).any())
    return 100 * met / len(days)


def _weights(E: np.ndarray) -> np.ndarray:
    """Share of each sensor in the light of all, (sensor,), from E (time, sensor) [lx]."""
    of_sensor = E.sum(axis=0)
    return np.asarray(of_sensor / max(of_sensor.sum(), 1e-9))


def _bounds(values: list[float]) -> dict[str, float]:
    """Value with its interval from the value, the least and the largest."""
    return dict(zip(("value", "low", "high"), map(float, values), strict=True))


def _colour(
    M: np.ndarray, E: np.ndarray, spectrum: np.ndarray, spectral: xr.Dataset
) -> dict[str, float | None]:
    """Melanopic ratio and appearance of the mean light."""
    if not E.sum() > 0:
        return {}
    light = Appearance.of(spectrum, Bands(tuple(spectral["wavelength"].values.tolist())))
    return {
        "ratio": float(M.sum() / E.sum()), "cct": light.cct, "duv": light.duv,
        "fidelity": light.fidelity, "gamut": light.gamut,
    }  # fmt: skip
