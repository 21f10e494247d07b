"""Thresholds of the metrics, and number and level of their draws."""

from __future__ import annotations

from dataclasses import dataclass, field

from drcmitsuba.case.groups import GroupStates
from drcmitsuba.case.metrics import Metrics
from drcmitsuba.case.schedule import Schedule
from drcmitsuba.metrics.facade_states import ShadeRule
from drcmitsuba.runtime import lazy

special = lazy.module("scipy.special")

DRAWS = 600
"""Draws of every metric."""
LEVEL = 0.95
"""Confidence level of the intervals."""
TAIL = (1 - LEVEL) / 2
"""Probability beyond each end of an interval."""
BEYOND = 2.5e-4
"""Probability of passing a threshold below which an entry counts as failing."""


def t_factor(replicates: int, level: float = LEVEL) -> float:
    """Half the width of an interval of E in standard errors: Student's t(1/2 + level/2, n − 1)."""
    return float(special.stdtrit(replicates - 1, 0.5 + level / 2))


@dataclass(frozen=True)
class Rules:
    """Thresholds of the metrics and of the shade."""

    metrics: Metrics
    """Thresholds of sDA and ASE."""
    shade_threshold: float
    shade_area: float
    """The shade closes when the fraction `shade_area` of a grid's sensors gets at least
    `shade_threshold` of direct sun [lx]."""
    step_hours: float
    """Length of the interval that a time stamp stands for [h]."""
    groups: GroupStates = field(default_factory=GroupStates.of_shade)
    """Groups of panes that close one by one."""
    schedule: Schedule = field(default_factory=Schedule)
    """States of the groups that follow a schedule."""

    @property
    def shade(self) -> ShadeRule:
        """Rule of the shade."""
        return ShadeRule(self.groups, self.shade_threshold, self.shade_area, self.schedule)
