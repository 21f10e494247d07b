"""How much more smooth surfaces mirror at grazing incidence, by Radiance's estimate."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

STEEPNESS = 5.85
"""Exponent of the estimate F(θ) = exp(−5.85 cos θ) − exp(−5.85) of Fresnel's formulas [–]."""
AT_NORMAL = math.exp(-STEEPNESS)
"""Its second term [–]: F vanishes at normal incidence."""


def more_at_grazing(cosine: Any, exp: Callable[[Any], Any] = np.exp) -> Any:
    """F(θ) [–], by which the plugin `polished` mirrors more, by the cosine of the incidence.

    `exp` is the exponential function of the library whose array the cosines are.
    """
    return exp(-STEEPNESS * cosine) - AT_NORMAL
