"""What accuracy costs in time: a case under many settings, against an unbiased reference.

tradeoff
    From a case to a `Tradeoff`, which shows and saves itself.
settings
    The design: which settings are tried. coarser: films with fewer levels.
reference
    Illuminance by `coefficient`, for some hours of the year.
deviation
    Errors without the reference's own noise.
evaluation, process
    One setting, evaluated in a process of its own.
row, table, picture
    What was found, for the eye.
"""

from __future__ import annotations

from drcmitsuba.annual.tradeoff.row import Row
from drcmitsuba.annual.tradeoff.run import tradeoff
from drcmitsuba.annual.tradeoff.table import Tradeoff

__all__ = ["Row", "Tradeoff", "tradeoff"]
