"""Metrics: illuminance E = C·L, and sDA, ASE, msDA, MSE and the rule of the shade.

hard, smooth
    Metrics as the standards define them, on any DataArray (time, sensor); their smooth twins.
accumulate
    E from coefficients and luminances.
intervals
    95 % intervals of the metrics.
evaluate_metrics
    From coefficients to illuminance, metrics and their intervals.
"""

from drcmitsuba.metrics.hard import (
    Interval,
    ase,
    autonomous,
    closing_sensors,
    exposed,
    months,
    msda,
    mse,
    sda,
    shade_closed,
)

__all__ = [
    "Interval",
    "ase",
    "autonomous",
    "closing_sensors",
    "exposed",
    "months",
    "msda",
    "mse",
    "sda",
    "shade_closed",
]
