"""Metrics: illuminance E = C·L, and sDA, ASE, msDA, MSE and the rule of the shade.

autonomy
    sDA and msDA of any DataArray (time, sensor), and their smooth twins.
sunlight
    ASE and MSE, and their smooth twins.
shade
    When the shade closes, and its smooth twin.
smooth
    The smooth twins by the metrics' names.
thresholds, smooth_step
    Counts above thresholds that all families share, exact and smooth.
confidence
    `Interval`, a value with its 95 % interval.
coefficients_by_state
    `Coefficients`: C of the open and the shaded state.
accumulate
    E from coefficients C and luminances L.
illuminance
    E of a case's period, the shade applied.
intervals
    95 % intervals of the metrics.
evaluate_metrics
    From coefficients to illuminance, metrics and their intervals.

References
----------
.. [1] IES LM-83-12, "Approved method: IES spatial daylight autonomy (sDA) and annual sunlight
   exposure (ASE)", 2012.
.. [2] C. Bauer, S. Wittkopf, "Annual daylight simulations with EvalDRC", Journal of Facade Design
   and Engineering 3, 2015.
"""

from drcmitsuba.metrics import smooth
from drcmitsuba.metrics.autonomy import autonomy_stamps, msda, sda
from drcmitsuba.metrics.confidence import Interval
from drcmitsuba.metrics.shade import closing_sensors, shade_closed
from drcmitsuba.metrics.sunlight import ase, exposure_stamps, mse
from drcmitsuba.metrics.thresholds import months

__all__ = [
    "Interval",
    "ase",
    "autonomy_stamps",
    "closing_sensors",
    "exposure_stamps",
    "months",
    "msda",
    "mse",
    "sda",
    "shade_closed",
    "smooth",
]
