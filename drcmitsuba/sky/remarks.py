"""Remarks on the period of a case that its metrics alone do not show."""

from __future__ import annotations

import numpy as np
import xarray as xr

from drcmitsuba.case.case import Case

DARK_SHARE = 0.05
"""Share of time stamps without daylight above which a remark is made."""


def period_notes(case: Case, sky: xr.Dataset, step_hours: float) -> tuple[str, ...]:
    """Remarks on a period that is no whole year, and on hours without daylight.

    Parameters
    ----------
    case : Case
    sky : xr.Dataset
        From `sky.radiance`: `sky` (time, bin), `sun` (time) [cd/m²].
    step_hours : float
        Length of the intervals [h].

    Returns
    -------
    tuple of str
    """
    notes = []
    stamps, months, limit = sky.sizes["time"], len(case.period.months), case.metrics.ase_hours
    if case.period.timestamps is not None or months < 12:
        part = f"{stamps * step_hours:g} h in {months} of 12 months"
        if case.period.timestamps is not None:
            part = f"{stamps} time stamps"
        notes.append(f"the period is {part}, no year: the {limit:g} h of ASE are not scaled to it")
    dark = int(((sky["sun"].values <= 0) & ~np.any(sky["sky"].values > 0, axis=1)).sum())
    if dark > DARK_SHARE * stamps:
        notes.append(f"{dark} of {stamps} time stamps have no daylight; sDA and msDA count them")
    return tuple(notes)
