"""Trade-off: error and seconds of a case under many settings, against a reference.

run
    `tradeoff`: from a case to a `Tradeoff`; evaluation of one setting in a process of its own.
settings
    List of settings; films with fewer levels.
reference
    Illuminance for some hours of the year, to which settings are compared.
path_tracing, finer_samples
    The reference by the integrator `coefficient`; of a case with mirrors or clear solids, by the
    program's own estimator with far more samples.
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
