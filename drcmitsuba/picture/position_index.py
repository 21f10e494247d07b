"""Position index: how much brighter a glare source may be beside the line of sight.

Above the line of sight it is Guth's, as the IES handbook has it [1]_; below it is that of Iwata and
Tokura [2]_ in the form in which `evalglare` has it since its version 2. With the angle σ to the
line of sight and the angle τ from the vertical above it [deg],

P = exp((35.2 − 0.31889 τ − 1.22 exp(−2τ/9)) 10⁻³ σ + (21 + 0.26667 τ − 0.002963 τ²) 10⁻⁵ σ²) above,
P = exp(6.49·10⁻³ β + 21·10⁻⁵ β²), tan β = tan σ · (1 + 0.3225 cos² τ)^½ below.

References
----------
.. [1] M. S. Rea (ed.), "The IESNA lighting handbook", 9th edition, 2000.
.. [2] T. Iwata, M. Tokura, "Position index for a glare source located below the line of vision",
   Lighting Research & Technology 29(3), 1997.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import drjit as dr
import numpy as np

LARGEST = 16.0
"""Largest position index [–]."""


def position_index(local: Any) -> Any:
    """Position index of directions.

    Parameters
    ----------
    local : np.ndarray, shape (..., 3), or Dr.Jit vector
        Unit vectors: their parts to the right, up and along the line of sight.

    Returns
    -------
    np.ndarray or Dr.Jit array
        P from 1 to 16 [–].
    """
    if isinstance(local, dr.ArrayBase):
        (right, up, forward), to = local, _ON_DEVICE
    else:
        (right, up, forward), to = np.moveaxis(np.asarray(local, float), -1, 0), _IN_NUMPY
    aside = to.hypot(right, up)
    sigma = to.degrees(to.atan2(aside, forward))
    tau = to.degrees(to.atan2(abs(right), up))
    a = 35.2 - 0.31889 * tau - 1.22 * to.exp(-2 * tau / 9)
    b = 21 + 0.26667 * tau - 0.002963 * tau**2
    above = a * 1e-3 * sigma + b * 1e-5 * sigma**2
    stretched = aside * to.sqrt(1 + 0.3225 * to.cos(tau * (np.pi / 180)) ** 2)
    beta = to.degrees(to.atan2(stretched, forward))
    below = 6.49e-3 * beta + 21e-5 * beta**2
    return to.minimum(to.exp(to.where(up >= 0, above, below)), LARGEST)


_IN_NUMPY = SimpleNamespace(
    hypot=np.hypot, atan2=np.arctan2, degrees=np.degrees, exp=np.exp, sqrt=np.sqrt, cos=np.cos,
    where=np.where, minimum=np.minimum,
)  # fmt: skip
_ON_DEVICE = SimpleNamespace(
    hypot=dr.hypot, atan2=dr.atan2, degrees=dr.rad2deg, exp=dr.exp, sqrt=dr.sqrt, cos=dr.cos,
    where=dr.select, minimum=dr.minimum,
)  # fmt: skip
