"""A value with its 95 % confidence interval, as `metrics.json` holds every number."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Interval:
    """A value and its 95 % confidence interval, all in the unit of the value."""

    value: float
    low: float
    high: float

    def within(self, least: float, most: float) -> Interval:
        """Interval of a metric that is from `least` to `most`."""
        return Interval(self.value, max(least, self.low), min(most, self.high))

    def to_dict(self) -> dict[str, float]:
        """Return `{"value", "low", "high"}` as in `metrics.json`."""
        return {"value": self.value, "low": self.low, "high": self.high}
