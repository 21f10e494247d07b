"""Light on the sensors of a case beside that of the path tracer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import ttest_ind

from drcmitsuba.annual import simulation
from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.plan import plan
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.sky.sun_models import Suns
from tests.validation.calibration.comparison import by_paths
from tests.validation.calibration.rooms import WIDE, Room, suns

PARTS = {"ground": slice(0, 1), "sky": slice(1, 146), "suns": slice(146, None)}
"""Bins of every source."""
LEVEL = 1e-4
"""Probability, for each source, of a false alarm in the sum, and of one in any sensor."""
BIAS_OF_SUM, BIAS_OF_SENSOR = 0.005, 0.05
"""Relative deviations below which nothing is wrong: cells smear light, see `docs/limits.md`."""
FAINT = 1e-3
"""Light of a sensor, of that of the brightest, below which it is not compared by itself: cells that
a body cuts send so much into it."""
REPLICATES = 8


@dataclass(frozen=True)
class Agreement:
    """Light of a source on all sensors beside the path tracer's."""

    source: str
    share: float
    """Its coefficients in sum over the sensors and bins, those of the path tracer [sr]."""
    deviation: float
    """Relative deviation of the sum from the path tracer's."""
    error: float
    """Standard error of both in the deviation."""
    p: float
    """Probability of a deviation of the sum as large by chance."""
    worst: float
    """Relative deviation of the sensor whose deviation is the least probable."""
    p_worst: float
    """Probability that any sensor deviates as much by chance (Šidák)."""

    @property
    def is_wrong(self) -> bool:
        """Whether neither chance nor the cells explain a deviation."""
        of_sum = self.p < LEVEL and abs(self.deviation) > BIAS_OF_SUM
        return of_sum or (self.p_worst < LEVEL and abs(self.worst) > BIAS_OF_SENSOR)


@dataclass(frozen=True)
class Sample:
    """A case as the path tracer has it, and the light on its sensors by another way."""

    case: Case
    suns: Suns
    light: Callable[[], np.ndarray]
    """Function that computes coefficients [sr], shape (replicate, sensor, bin)."""


def planned(case: Case) -> Sample:
    """Light of a case by its plan."""
    some = Suns(tuple(f"sun_{i}" for i in range(10)), around(), WIDE)
    case = with_replicates(case)

    def light() -> np.ndarray:
        scope = replace(plan(case, daylight(case)).scope, suns=True, sun_visibility=None)
        C = simulation.transport(case, "open", some, 46.0, run=Run.of(case, scope))
        return np.asarray(C["replicates"].values)

    return Sample(case, some, light)


def with_replicates(case: Case) -> Case:
    """The case with `REPLICATES`, by which its light is judged."""
    own = case.accuracy.model_copy(update={"replicates": REPLICATES})
    return case.with_tables(accuracy=own)


def compared(sample: Sample, paths: int) -> list[Agreement]:
    """Compare the light of each source that shines in.

    `paths` is the number of paths of the path tracer from a sensor in each of its runs.
    """
    points, normals = sensor_points(sample.case)
    room = Room(sample.case, WIDE)
    ours, rows = sample.light(), []
    theirs = by_paths(room, sample.suns, points, normals, paths).sum(axis=1)[:, 0]
    for source, bins in PARTS.items():
        a, b = ours[..., bins].sum(axis=2), theirs[..., bins].sum(axis=2)
        if b.sum() > 0 or a.sum() > 0:
            rows.append(agreement(source, a, b))
    return rows


def around() -> np.ndarray:
    """Every third of the suns of the calibration, turned about the zenith by turns, shape (10, 3).

    So suns shine on every side.
    """
    x, y, z = suns()[::3].T
    angle = np.arange(len(x)) * 2.4
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * x - s * y, s * x + c * y, z], axis=1)


def agreement(source: str, a: np.ndarray, b: np.ndarray) -> Agreement:
    """Agreement of replicates (replicate, sensor) of either side."""
    sums = a.sum(axis=1), b.sum(axis=1)
    whole = max(sums[1].mean(), 1e-30)  # a leak has no truth to be divided by
    error = np.sqrt(sum(x.var(ddof=1) / len(x) for x in sums)) / whole
    mean = np.maximum(a.mean(axis=0), b.mean(axis=0))
    a, b = (x[:, mean > FAINT * mean.max()] for x in (a, b))
    varies = (np.ptp(a, axis=0) > 0) | (np.ptp(b, axis=0) > 0)
    p = (a.mean(axis=0) == b.mean(axis=0)).astype(float)  # where neither varies
    p[varies] = ttest_ind(a[:, varies], b[:, varies], axis=0, equal_var=False).pvalue
    worst = int(np.argmin(p))
    mine, others = (x[:, worst].mean() for x in (a, b))
    return Agreement(
        source, float(whole), float(sums[0].mean() / whole - 1), float(error),
        float(ttest_ind(*sums, equal_var=False).pvalue), float(mine / max(others, 1e-30) - 1),
        float(1 - (1 - p[worst]) ** p.size),
    )  # fmt: skip
