"""Converged coefficients of the bench's room, and the errors of an estimate against them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np

from drcmitsuba.annual.bench.room import BINS, NO_SUNS, BenchRoom
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.sky.sun_models import Suns

PATHS = 2048
"""Number of paths from every sensor in a round."""
DENSE: dict[str, Any] = {
    "replicates": 64,
    "paths": 1,
    "sensor_sky_rays": 8192,
    "sensor_sun_samples": 16,
}
"""Samples of the reference's direct part, which has no cells and converges fast."""


@dataclass(frozen=True)
class CoefficientErrors:
    """Relative RMS errors over all (sensor, bin) entries.

    Parameters
    ----------
    total, direct : float
        RMS error over the mean entry of the reference.
    dark : float
        RMS error over the mean, of entries without any direct light: the interreflected part.
    mean : float
        Mean entry over the reference's.
    """

    total: float
    direct: float
    dark: float
    mean: float

    def within(self, other: CoefficientErrors, every: bool) -> bool:
        """At most the other's error over all entries, and if asked in no part of them larger."""
        parts = self.direct <= other.direct and self.dark <= other.dark
        return self.total <= other.total and (not every or parts)


@dataclass(frozen=True)
class KnownCoefficients:
    """Converged coefficients of one kind of source.

    Parameters
    ----------
    direct, interreflected : np.ndarray, shape (sensor, bin)
        [sr].
    own_error : float
        Relative RMS error of the reference itself.
    agreement : str
        Sentence on its direct part, beside the one that the paths have found; may be empty.
    """

    direct: np.ndarray
    interreflected: np.ndarray
    own_error: float
    agreement: str = ""

    @property
    def total(self) -> np.ndarray:
        """Coefficients of all light [sr]."""
        return self.direct + self.interreflected

    def errors(self, total: np.ndarray, direct: np.ndarray) -> CoefficientErrors:
        """Errors of an estimate; nothing is subtracted, bias and the reference's own are in.

        The reference's own error is the same in the errors of all estimates, so that it moves no
        comparison of them.
        """
        dark = self.direct == 0

        def rms(a: np.ndarray, b: np.ndarray) -> float:
            return float(np.sqrt(np.mean((a - b) ** 2)))

        return CoefficientErrors(
            total=rms(total, self.total) / self.total.mean(),
            direct=rms(direct, self.direct) / self.total.mean(),
            dark=rms(total[dark], self.total[dark]) / self.total[dark].mean(),
            mean=float(total.mean() / self.total.mean()),
        )


def trace_halves(
    room: BenchRoom, suns: Suns | None, rounds: int, progress: Progress
) -> tuple[np.ndarray, np.ndarray]:
    """Direct light (sensor, bin), and two independent halves of all, (half, kind, sensor, bin)."""
    first = slice(0, BINS) if suns is None else slice(BINS, None)
    C = room.ours(NO_SUNS if suns is None else suns, **DENSE)
    direct = C["direct"].values[:, first].astype(float)
    plugin, sources = mi.load_dict({"type": "coefficient"}), room.with_sources(suns)
    halves = np.zeros((2, 2, *direct.shape))
    for i in range(rounds):
        halves[i % 2] += plugin.sensors(sources, *room.sensors, PATHS, i).numpy() / (rounds / 2)
        progress((i + 1) / rounds)
    return direct, halves


def known(direct: np.ndarray, halves: np.ndarray) -> KnownCoefficients:
    """Join what `trace_halves` has found.

    Interreflected light is by the plugin `coefficient`, which has no cells and no bias; direct
    light is by a dense run of our own deposit, compared here with the plugin's.
    """
    plain, noise = halves.mean(axis=0), (halves[0] - halves[1]) / 2
    mean = (direct + plain[1]).mean()
    error, apart = (np.sqrt(np.mean(a**2)) / mean for a in (noise[0], plain[0] - direct))
    agreement = (
        f"direct part {direct.mean() / mean:.0%} of the mean, {apart:.1%} RMS from that of paths, "
        f"whose own error is {error:.1%}; sums agree to {plain[0].mean() / direct.mean() - 1:+.3%}"
    )
    return KnownCoefficients(
        direct, plain[1], float(np.sqrt(np.mean(noise[1] ** 2)) / mean), agreement
    )
