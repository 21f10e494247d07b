"""Direct sun at the edges of shadows.

Direct sun is drawn anew for every sensor and sun, and most of it is certain: seen or not seen. At
the edge of a shadow, a mean μ with standard error s is worth κ = (μ/s)² rays that saw the sun; the
sun that is seen is then Gamma distributed, E* = s²/μ · Γ(κ + 2/3). The 2/3 is the prior of the part
of a disk that a straight edge leaves, B(2/3, 2/3): for a small part a the edge is a^(2/3) deep in
the disk. By the same prior some pairs of sun and sensor without a hit hide a small part of
the sun: as many as `hidden_share` says, other ones in every draw, since nobody knows which.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drcmitsuba.metrics.intervals.rules import BEYOND, DRAWS
from drcmitsuba.runtime import lazy

special = lazy.module("scipy.special")

EDGE = 2 / 3
"""Parameter of the prior B(2/3, 2/3): part of the sun that is seen on the edge of a shadow."""
BLOCK = 4096
"""Number of entries drawn at once."""
BYTES = -(-DRAWS // 8)
"""Number of bytes that hold the draws of an entry."""


def hidden_share(rays: int) -> float:
    """Number of pairs on the edge of a shadow without a hit for each pair with hits and misses.

    A Beta(2/3, 2/3) part of the sun is missed by all `rays` with
    p = B(2/3, rays + 2/3) / B(2/3, 2/3), and likewise seen by all.
    """
    g = math.lgamma
    p = math.exp(g(rays + EDGE) + g(2 * EDGE) - g(rays + 2 * EDGE) - g(EDGE))
    return p / (1 - 2 * p)


def _exceeds(mean: np.ndarray, error: np.ndarray, threshold: float) -> np.ndarray:
    """Probability that direct sun reaches a threshold, for entries with hits."""
    p = (mean >= threshold).astype(float)
    doubtful = (abs(mean - threshold) < 8 * error) | ((mean < 7 * error) & (mean > 0))
    mu, s = mean[doubtful].astype(float), error[doubtful].astype(float)
    kappa = (mu / s) ** 2
    p[doubtful] = special.gammaincc(kappa + EDGE, threshold * mu / s**2)
    return p


@dataclass(frozen=True)
class SunDraws:
    """Entries of the direct sun that are in doubt, and whether they reach the thresholds."""

    time: np.ndarray
    sensor: np.ndarray
    """Indices of the entries, shape (entry,)."""
    exposed: np.ndarray
    closing: np.ndarray
    """Whether they reach the threshold of ASE, and that of the shade, in every draw: bits, uint8,
    shape (entry, draw / 8); see `unpacked`."""

    def at(self, hours: np.ndarray) -> SunDraws:
        """Entries of some time stamps, indices in rising order, int, shape (chosen,)."""
        kept = np.isin(self.time, hours)
        time, exposed = np.searchsorted(hours, self.time[kept]), self.exposed[kept]
        closing = exposed if self.closing is self.exposed else self.closing[kept]
        return SunDraws(time, self.sensor[kept], exposed, closing)


def unpacked(bits: np.ndarray) -> np.ndarray:
    """Draws of bits (entry, draw / 8), 0 or 1, uint8, shape (entry, draw)."""
    return np.unpackbits(bits, axis=1, count=DRAWS)


def draw_sun(
    mean: np.ndarray, error: np.ndarray, limits: tuple[float, float], rays: int | None, seed: int,
    first: int = 0,
) -> SunDraws:  # fmt: skip
    """Draw the direct sun near its thresholds; `rays` and `seed` as for `intervals.draw`.

    `mean` and `error` are the direct sun and its standard error (time, sensor) [lx], `limits` the
    thresholds of ASE and of the shade [lx]. Each block of sensors has its own random numbers, by
    the number of its `first` sensor.
    """
    rng = np.random.default_rng([seed, 1] if first == 0 else [seed, 1, first])
    sunny = np.flatnonzero(mean.max(axis=1, initial=0) > 0)  # few of a year's hours
    own = mean if len(sunny) == len(mean) else mean[sunny]
    row, sensor = np.divmod(np.flatnonzero(own > 0), mean.shape[1])
    mu, s = own[row, sensor], error[sunny[row], sensor]
    different = list(dict.fromkeys(limits))  # those of LM-83 are the same: one array serves both
    p = np.stack([_exceeds(mu, s, limit) for limit in different])
    doubtful = ((p > BEYOND) & (p < 1 - BEYOND)).any(axis=0)
    time, sensor, p = sunny[row[doubtful]], sensor[doubtful], p[:, doubtful]
    passed = [np.empty((len(time), BYTES), np.uint8) for _ in different]
    for start in range(0, len(time), BLOCK):
        here = slice(start, start + BLOCK)
        u = rng.random((len(time[here]), DRAWS), np.float32)
        for out, row in zip(passed, p, strict=True):
            out[here] = np.packbits(u < row[here, None], axis=1)
    # One miss makes s = μ / rays; the height of the sun within its disk makes far less of it.
    dark = None
    if rays is not None:
        dark = _hidden(own, different, rays, int((mu < 1.2 * rays * s).sum()), rng)
    if dark is not None:
        hidden_row, hidden_sensor, hidden = dark
        time, sensor = np.append(time, sunny[hidden_row]), np.append(sensor, hidden_sensor)
        passed = [np.vstack(pair) for pair in zip(passed, hidden, strict=True)]
    exposed, closing = (passed[different.index(limit)] for limit in limits)
    return SunDraws(time, sensor, exposed, closing)


def _hidden(
    mean: np.ndarray, limits: list[float], rays: int, edges: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]] | None:
    """Draw pairs without a hit that hide a part of the sun: any that are dark in a sunny hour.

    `mean` is the direct sun of sunny hours (hour, sensor) [lx].
    """
    is_dark = mean == 0
    dark, of_hour = np.flatnonzero(is_dark), np.count_nonzero(is_dark, axis=1)
    expected = edges * hidden_share(rays)
    if len(dark) == 0 or expected == 0:
        return None
    full = mean.max(axis=1)
    # The part that a pair hides is drawn by its tail: u < p(limit), as for the others. The pairs of
    # an hour have the same one.
    tails = [special.gammaincc(EDGE, limit * rays / np.maximum(full, 1e-9)) for limit in limits]
    largest = np.max(tails, axis=0)
    total = np.cumsum(of_hour * largest)
    counts = rng.poisson(expected * total[-1] / len(dark), DRAWS)
    if counts.sum() == 0:
        return None
    at = np.maximum(rng.random(counts.sum()), np.finfo(float).tiny) * total[-1]
    hour = np.searchsorted(total, at)  # never one without dark pairs
    left = (total[hour] - at) / largest[hour]  # pairs of the hour that come after the one
    picked = np.cumsum(of_hour)[hour] - 1 - np.minimum(left.astype(int), of_hour[hour] - 1)
    in_draw = np.repeat(np.arange(DRAWS), counts)
    u = rng.random(len(picked)) * largest[hour]
    entries, row = np.unique(picked, return_inverse=True)
    passed = []
    for tail in tails:
        out, hides = np.zeros((len(entries), BYTES), np.uint8), u < tail[hour]
        draw = in_draw[hides]
        bits = (128 >> draw % 8).astype(np.uint8)  # as packbits orders them
        np.bitwise_or.at(out, (row[hides], draw // 8), bits)
        passed.append(out)
    return *np.divmod(dark[entries], mean.shape[1]), passed
