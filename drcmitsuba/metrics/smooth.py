"""Smooth twins of the metrics under the metrics' names; each stands beside its metric.

step
    Soft comparison value ≥ threshold, from `smooth_step`.
sda, msda
    Twins of daylight autonomy, from `autonomy`.
ase, mse
    Twins of sunlight exposure, from `sunlight`.
shade_closed, applied
    Twin of the rule of the shade, and the illuminance that follows from it, from `shade`.
"""

from drcmitsuba.metrics.autonomy import smooth_msda as msda
from drcmitsuba.metrics.autonomy import smooth_sda as sda
from drcmitsuba.metrics.shade import applied
from drcmitsuba.metrics.shade import smooth_shade_closed as shade_closed
from drcmitsuba.metrics.smooth_step import step
from drcmitsuba.metrics.sunlight import smooth_ase as ase
from drcmitsuba.metrics.sunlight import smooth_mse as mse

__all__ = ["applied", "ase", "msda", "mse", "sda", "shade_closed", "step"]
