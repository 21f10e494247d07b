"""DAYSIM's suns: the full solar hours of five days, blended in declination and hour [1]_.

References
----------
.. [1] C. F. Reinhart, S. Herkel, "The simulation of annual daylight illuminance distributions: a
   state-of-the-art comparison of six RADIANCE-based methods", Energy and Buildings 32(2), 2000.
"""

from __future__ import annotations

import numpy as np

from drcmitsuba.sky.sun import declination_and_hour, direction_of_hour
from drcmitsuba.sky.sun_models.blend import Blend, Suns

_DAYS = np.array([355, 52, 80, 111, 172])
DECLINATIONS = np.degrees(0.4093 * np.sin(2 * np.pi / 368 * (_DAYS - 81)))
"""Declinations of the sun [deg] on 21 December, 21 February, 21 March, 21 April, 21 June."""
LOWEST = 2.0
"""Suns stand at least this high [deg]; the first and last of a day are moved there."""


def _hours_of_day(latitude: float, declination: float) -> np.ndarray:
    """Hour angles [deg] of a day's suns: full solar hours, the first and last at `LOWEST`."""
    phi, delta = np.radians(latitude), np.radians(declination)
    cosine = (np.sin(np.radians(LOWEST)) - np.sin(phi) * np.sin(delta)) / (
        np.cos(phi) * np.cos(delta)
    )
    if cosine >= 1:
        return np.zeros(0)  # the sun does not rise to that height
    if cosine <= -1:  # the sun does not set
        return 15.0 * np.arange(-12, 13)  # midnight on both ends
    last = np.degrees(np.arccos(cosine))
    moved = round(last / 15)  # the full hour nearest to sunset, and its like in the morning
    return np.concatenate([[-last], 15.0 * np.arange(1 - moved, moved), [last]])


def _between(values: np.ndarray, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lower node and share of the upper one, clamped to the first and the last node."""
    lower = np.clip(np.searchsorted(nodes, values, "right") - 1, 0, max(len(nodes) - 2, 0))
    if len(nodes) == 1:
        return lower, np.zeros(len(values))
    share = (values - nodes[lower]) / (nodes[lower + 1] - nodes[lower])
    return lower, np.clip(share, 0, 1)


def between_daysim_suns(
    directions: np.ndarray, up: np.ndarray, latitude: float, diameter: float
) -> tuple[Suns, Blend]:
    """Blend each sun from the four of DAYSIM's suns about it.

    The suns stand at full solar hours on five days. A sun between two days is blended by its
    declination, a sun between two hours by its hour angle. There are 65 suns at mid latitudes,
    `sun_daysim_01` …, and four bins in a blend. A day whose sun stays below 2° has none; the
    nearest day with suns stands in for it. The latitude of the place is in degrees north.
    """
    hours = [_hours_of_day(latitude, d) for d in DECLINATIONS]
    days = np.flatnonzero([len(h) > 0 for h in hours])
    first = np.cumsum([0, *(len(h) for h in hours)])
    labels = np.array([f"sun_daysim_{i + 1:02d}" for i in range(first[-1])], dtype=object)
    places = [
        direction_of_hour(latitude, np.full(len(hours[d]), DECLINATIONS[d]), hours[d]) for d in days
    ]
    bins = np.full((len(up), 4), "", dtype=object)
    weights = np.zeros((len(up), 4))
    declination, hour_angle = declination_and_hour(latitude, directions)
    at, share = _between(declination, DECLINATIONS[days])
    for upper in (0, 1):
        for row, d in enumerate(days):
            mine = up & (np.minimum(at + upper, len(days) - 1) == row)
            lower, later = _between(hour_angle[mine], hours[d])
            of_day = share[mine] if upper else 1 - share[mine]
            second = np.minimum(lower + 1, len(hours[d]) - 1)
            bins[mine, 2 * upper] = labels[first[d] + lower]
            bins[mine, 2 * upper + 1] = labels[first[d] + second]
            weights[mine, 2 * upper] = of_day * (1 - later)
            weights[mine, 2 * upper + 1] = of_day * later
    return Suns(tuple(labels), np.concatenate(places), diameter), Blend(bins, weights)
