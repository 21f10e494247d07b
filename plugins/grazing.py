"""How much more smooth surfaces mirror at grazing incidence, by Radiance's estimate."""

import math

STEEPNESS = 5.85
"""Exponent of the estimate F(θ) = exp(−5.85 cos θ) − exp(−5.85) of Fresnel's formulas [–]."""
AT_NORMAL = math.exp(-STEEPNESS)
"""Its second term [–]: F vanishes at normal incidence."""
