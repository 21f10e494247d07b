"""Smooth twins of the metrics under the metrics' names; each stands beside its metric.

step
    Soft comparison value ≥ threshold, from `smooth_step`.
sda, msda
    Twins of daylight autonomy, from `autonomy`.
ase, mse
    Twins of sunlight exposure, from `sunlight`.
da, cda, udi
    Twins of the metrics of single points, from `point_autonomy` and `useful_daylight`.
mean_hours, worst_point_hours
    Twins of the hours of a room, from `lit_hours`.
shade_closed, applied
    Twin of the rule of the shade, and the illuminance that follows from it, from `shade`.
"""

from drcmitsuba.metrics.autonomy import smooth_msda as msda
from drcmitsuba.metrics.autonomy import smooth_sda as sda
from drcmitsuba.metrics.lit_hours import smooth_mean_hours as mean_hours
from drcmitsuba.metrics.lit_hours import smooth_worst_point_hours as worst_point_hours
from drcmitsuba.metrics.point_autonomy import smooth_cda as cda
from drcmitsuba.metrics.point_autonomy import smooth_da as da
from drcmitsuba.metrics.shade import applied
from drcmitsuba.metrics.shade import smooth_shade_closed as shade_closed
from drcmitsuba.metrics.smooth_step import step
from drcmitsuba.metrics.sunlight import smooth_ase as ase
from drcmitsuba.metrics.sunlight import smooth_mse as mse
from drcmitsuba.metrics.useful_daylight import smooth_udi as udi

__all__ = [
    "applied",
    "ase",
    "cda",
    "da",
    "mean_hours",
    "msda",
    "mse",
    "sda",
    "shade_closed",
    "step",
    "udi",
    "worst_point_hours",
]
