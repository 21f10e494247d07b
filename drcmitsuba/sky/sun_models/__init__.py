"""Sun models: which light sources stand for the sun of every time stamp.

blend
    `Suns` that coefficients are computed for, and the `Blend` of them at each time stamp.
nearest
    The sun in the patches of the sky: spread over four (three-phase), moved to one (five-phase).
daysim
    The hours of five days of the year.
mesh
    Suns on a mesh over the sky, finer where it must be.
"""

from __future__ import annotations

from drcmitsuba.sky.sun_models.blend import Blend, Suns
from drcmitsuba.sky.sun_models.daysim import between_daysim_suns
from drcmitsuba.sky.sun_models.nearest import moved_to_patch, spread_over_patches

__all__ = [
    "Blend",
    "Suns",
    "between_daysim_suns",
    "moved_to_patch",
    "spread_over_patches",
]
