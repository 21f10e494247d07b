"""The table `[metrics]` of a case: thresholds of the annual and monthly metrics."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drcmitsuba.runtime.toml import Fraction, Illuminance, Table


class Metrics(Table):
    """Thresholds of sDA and ASE, which msDA and MSE share."""

    sda_threshold: Illuminance = 300.0
    """Illuminance that counts as enough daylight, shade applied [lx]."""
    sda_fraction: Fraction = 0.5
    """Fraction of the hours with enough daylight from which on a point counts [–]."""
    ase_threshold: Illuminance = 1000.0
    """Direct sun that counts as too much, no shade [lx]."""
    ase_hours: Annotated[float, Field(gt=0, le=1e6)] = 250.0
    """Hours of too much sun from which on a point counts [h]."""
