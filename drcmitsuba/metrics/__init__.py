"""Metrics: illuminance E = C·L, and what of it is counted: each metric is defined here once.

autonomy
    sDA and msDA of any DataArray (time, sensor), and their smooth twins.
sunlight
    ASE and MSE, and their smooth twins.
point_autonomy, useful_daylight
    DA, cDA and UDI of single points, and their smooth twins.
lit_hours
    Hours in which a room is lit, by its mean and at its worst-lit point, and their smooth twins.
light_exposure
    Light exposure [lx·h], uniformity, hours in direct sun by day.
provision
    Daylight hours and daylight provision of EN 17037.
view_out
    View out of EN 17037 as far as geometry tells: width, outside distance, layers, level.
daylight_factor
    Daylight factor under an overcast sky.
shade
    When the shade closes, and its smooth twin.
smooth
    The smooth twins by the metrics' names.
thresholds, smooth_step
    Counts above thresholds that all families share, exact and smooth.
confidence
    `Interval`, a value with its 95 % interval.
facade_states, watched_groups
    State of the façade at every time stamp; groups of panes that a space watches by its sensors.
coefficients_by_state
    `Coefficients`: C of the open and the shaded state.
bin_luminances, source_sums, accumulate
    Luminances L of the bins of C; sums by sky and sun on the device; E from both.
year_replicates
    E of a state by each replicate: held, or summed where it is asked for.
illuminance
    E of a case's period, the shade applied.
space_rows, spaces, space_tasks, space_years
    Spaces as rows of an attribute, and with their sensors; autonomy at the targets of their uses;
    both by replicates of E.
metrics_of_spaces
    Metrics by space, by storey and of the building, by area.
grids, sensor_areas
    Sensors by grid; spacing of grids, and the floor that each sensor stands for.
sensor_counts
    Counts by sensor and month, which metrics of a year of any size follow from.
intervals
    95 % intervals of the metrics.
evaluate_metrics
    From coefficients to illuminance, metrics and their intervals.
stored_arrays
    Reading of earlier results, as untrusted input.
later_arrays
    Arrays that are made when their values are first asked for.

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
from drcmitsuba.metrics.daylight_factor import daylight_factor, overcast_luminances
from drcmitsuba.metrics.light_exposure import light_exposure, sunlight_hours, uniformity
from drcmitsuba.metrics.lit_hours import mean_hours, worst_point_hours
from drcmitsuba.metrics.point_autonomy import cda, da, share_of_points
from drcmitsuba.metrics.provision import daylight_hours, median_illuminance, provision
from drcmitsuba.metrics.shade import closing_sensors, shade_closed
from drcmitsuba.metrics.sunlight import ase, exposure_stamps, mse
from drcmitsuba.metrics.thresholds import months
from drcmitsuba.metrics.useful_daylight import udi
from drcmitsuba.metrics.view_out import outside_distance, sight_angle, view_layers, view_level

__all__ = [
    "Interval",
    "ase",
    "autonomy_stamps",
    "cda",
    "closing_sensors",
    "da",
    "daylight_factor",
    "daylight_hours",
    "exposure_stamps",
    "light_exposure",
    "mean_hours",
    "median_illuminance",
    "months",
    "msda",
    "mse",
    "outside_distance",
    "overcast_luminances",
    "provision",
    "sda",
    "shade_closed",
    "share_of_points",
    "sight_angle",
    "smooth",
    "sunlight_hours",
    "udi",
    "uniformity",
    "view_layers",
    "view_level",
    "worst_point_hours",
]
