"""Illuminance of a state of a façade of known elements, which is summed where it is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drcmitsuba.metrics.year_replicates import SummedReplicates, YearReplicates
from drcmitsuba.transport.elements.weighed_year import WeighedYear


@dataclass(frozen=True, eq=False)
class WeighedReplicates(SummedReplicates):
    """E of a state at all hours of a year by element."""

    year: WeighedYear

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of replicates, hours and sensors."""
        return self.year.shape

    def statistics(self, hours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard error by a kernel."""
        return self.year.statistics(None if len(hours) == self.shape[1] else hours)

    def at(self, hour: np.ndarray, sensor: np.ndarray) -> np.ndarray:
        """E of pairs, by a kernel."""
        return self.year.at(hour, sensor)

    def of_means(self, weights: np.ndarray, hours: np.ndarray) -> np.ndarray:
        """Sums of the means of every element."""
        return self.year.of_means(weights, hours)

    def joined(
        self, others: Sequence[YearReplicates], part: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard error by a kernel that reads the elements of all states once."""
        parts = [self.year, *(o.year for o in others if isinstance(o, WeighedReplicates))]
        assert len(parts) == 1 + len(others)
        return WeighedYear.joined(parts, part).statistics()

    def whole(self) -> np.ndarray:
        """All numbers."""
        return self.year.replicates()
