"""Projections of a picture: from an angle to the centre of the view to a distance in the picture.

The distance ρ of a direction from the picture's centre follows from its angle θ [rad] to the centre
of the view alone. Radiance's names of the projections are options of `-vt` [1]_.

=================  ==========  ==================  ==========================
kind               Radiance    ρ                   largest angle across [deg]
=================  ==========  ==================  ==========================
`perspective`      `-vtv`      tan θ               below 180
`hemispherical`    `-vth`      sin θ               180
`equidistant`      `-vta`      θ                   360
`equisolid`        none        2 sin(θ/2)          360
`stereographic`    `-vts`      2 tan(θ/2)          below 360
=================  ==========  ==================  ==========================

References
----------
.. [1] "rpict", "rvu", manual pages of Radiance.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np


class Projection(NamedTuple):
    """Distance from the centre, its inverse, and the angles at which both are defined."""

    distance: Callable[[np.ndarray], np.ndarray]
    """ρ of θ [rad]."""
    angle: Callable[[np.ndarray], np.ndarray]
    """θ [rad] of ρ; ρ is at most `distance(widest)`."""
    widest: float
    """Largest θ [rad]."""


_ALMOST = 1 - 1e-6
"""Tangents stay finite at this fraction of their largest angle."""

PROJECTIONS = {
    "perspective": Projection(np.tan, np.arctan, np.pi / 2 * _ALMOST),
    "hemispherical": Projection(np.sin, np.arcsin, np.pi / 2),
    "equidistant": Projection(np.positive, np.positive, np.pi),
    "equisolid": Projection(lambda a: 2 * np.sin(a / 2), lambda r: 2 * np.arcsin(r / 2), np.pi),
    "stereographic": Projection(
        lambda a: 2 * np.tan(a / 2), lambda r: 2 * np.arctan(r / 2), np.pi * _ALMOST
    ),
}
"""Projections by their kind."""
