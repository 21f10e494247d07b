"""Rule by which a year's glare sources are found and rated."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from drcmitsuba.picture.glare import EVALGLARE, LARGEST_FACTOR, DgpConstants
from drcmitsuba.runtime.errors import InputError


@dataclass(frozen=True)
class Rule:
    """Rule by which glare sources are found and rated; the defaults are those of `evalglare`.

    Examples
    --------
    >>> from drcmitsuba.glare_year import Rule
    >>> float(Rule().dgp(3000.0, 0.0).round(3))
    0.335
    """

    threshold: float = 2000.0
    """Luminance above which pixels are bright [cd/m²], or up to 100 a multiple of the mean
    luminance of the view."""
    opening: float = 0.2
    """Opening angle within which bright pixels are one source [rad]."""
    peak: float = 50_000.0
    """Luminance above which pixels are sources of their own [cd/m²], infinite for none."""
    constants: DgpConstants = EVALGLARE
    """Constants of the equation of DGP."""
    low_light: bool = False
    """Whether DGP is lowered in dim scenes, as `Glare.dgp` does."""

    def __post_init__(self) -> None:
        for name in ("threshold", "opening", "peak"):
            if not getattr(self, name) > 0:
                got = str(getattr(self, name))
                raise InputError("glare", name, got, "give a number above 0")
        if not np.isfinite(self.threshold):
            raise InputError("glare", "threshold", f"{self.threshold}", "give a finite number")
        if not self.opening <= 1:
            raise InputError("glare", "opening", f"{self.opening}", "give at most 1 rad")

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON; an infinite peak is None."""
        return {**asdict(self), "peak": self.peak if np.isfinite(self.peak) else None}

    @property
    def least(self) -> float:
        """Luminance below which nothing is bright, whatever the mean [cd/m²]."""
        return self.threshold if self.threshold > LARGEST_FACTOR else 0.0

    def dgp(self, illuminance: np.ndarray, sums: np.ndarray) -> np.ndarray:
        """DGP from E_v [lx] and Σ L² ω / P², which broadcast."""
        c = self.constants
        contrast = np.log10(1 + sums / np.maximum(illuminance, 1e-9) ** 1.87)
        value = c.illuminance * illuminance + c.contrast * contrast + c.offset
        if self.low_light:
            value = value / (1 + np.exp(4 - 0.024 * illuminance))
        return np.clip(value, 0, 1)
