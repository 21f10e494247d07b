"""What the metrics ask for, and how finely they are drawn."""

from __future__ import annotations

from dataclasses import dataclass

from scipy.special import stdtrit

from drcmitsuba.case.metrics import Metrics

DRAWS = 600
"""Draws of every metric."""
LEVEL = 0.95
"""Of the intervals."""
TAIL = (1 - LEVEL) / 2
"""Probability beyond each end of them."""
BEYOND = 2.5e-4
"""Entries that pass a threshold with less than this probability are taken not to."""


def t_factor(replicates: int, level: float = LEVEL) -> float:
    """Half the width of an interval of E in standard errors: Student's t(1/2 + level/2, n − 1)."""
    return float(stdtrit(replicates - 1, 0.5 + level / 2))


@dataclass(frozen=True)
class Rules:
    """What the metrics ask for.

    Parameters
    ----------
    metrics : Metrics
        Thresholds of sDA and ASE.
    shade_threshold, shade_area : float
        When the shade closes: share of the sensors with at least so much direct sun [lx].
    step_hours : float
        Length of the intervals [h].
    """

    metrics: Metrics
    shade_threshold: float
    shade_area: float
    step_hours: float
