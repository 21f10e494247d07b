"""How much more smooth surfaces mirror at grazing incidence, by Radiance's estimate."""

from __future__ import annotations

import math

import numpy as np

STEEPNESS = 5.85
"""Exponent of the estimate F(θ) = exp(−5.85 cos θ) − exp(−5.85) of Fresnel's formulas [–]."""
AT_NORMAL = math.exp(-STEEPNESS)
"""Its second term [–]: F vanishes at normal incidence."""


def more_at_grazing(cosine: np.ndarray) -> np.ndarray:
    """F(θ) [–], by which the plugin `polished` mirrors more, by the cosine of the incidence."""
    return np.asarray(np.exp(-STEEPNESS * cosine) - AT_NORMAL)
