"""Cost of an evaluation in advance: rays, seconds, memory, disk, and the share of every effect.

pilot_paths
    How long the paths of a pilot's sensors are, and how many cells those of all sensors meet.
pilot
    Transport itself on few sensors, suns and photons, with its rays counted.
work, summed
    Amounts of work by effect and unit; those where a year is a sum over groups of panes.
cost
    Seconds of a unit of work, and the forecast; whether an evaluation is too short for one.
size
    Bytes on disk and in memory.
"""

from drcmitsuba.plan.forecast.cost import Forecast, forecast, is_short
from drcmitsuba.plan.forecast.work import Work, work

__all__ = ["Forecast", "Work", "forecast", "is_short", "work"]
