"""Trade-off: error and seconds of a case under many settings, against an unbiased reference.

run
    `tradeoff`: from a case to a `Tradeoff`; evaluation of one setting in a process of its own.
settings
    List of settings; films with fewer levels.
reference
    Illuminance by the integrator `coefficient`, for some hours of the year.
errors
    Errors of a setting without the reference's own noise; the row of a setting.
table
    `Tradeoff`: table and picture.
"""

from __future__ import annotations

from drcmitsuba.annual.tradeoff.errors import Row
from drcmitsuba.annual.tradeoff.run import tradeoff
from drcmitsuba.annual.tradeoff.table import Tradeoff

__all__ = ["Row", "Tradeoff", "tradeoff"]
