"""Direction into which a redirecting film sends light, and the lobe about this direction."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np


def concentration(spread):
    """Concentration κ = 1/σ² of a lobe whose spread σ [deg] is that of a Gaussian in each plane."""
    return 1 / dr.square(spread * (np.pi / 180))


def von_mises_fisher(kappa, a, b):
    """Density [1/sr] of a von Mises–Fisher lobe about a at b; by the chord, exact in float32."""
    norm = kappa * dr.inv_two_pi / (1 - dr.exp(-2 * kappa))
    return norm * dr.exp(-0.5 * kappa * dr.squared_norm(a - b))


def folded(w):
    """Direction with its z reversed: what would leave behind the pane leaves before it."""
    return mi.Vector3f(w.x, w.y, -w.z)


def redirected(light, tilt):
    """Direction that light is redirected to.

    Parameters
    ----------
    light : mi.Vector3f
        To the source, in the pane's frame (+y up), on the side z > 0.
    tilt : mi.Float
        [deg].

    Returns
    -------
    mi.Vector3f
        On the other side of the pane, whose z counts as positive as well; up to the tilt.
    """
    s, c = dr.sincos(tilt * (np.pi / 180))
    # The ray goes on along (−x, −y, z); mirrored upward that is (−x, y, z).
    return mi.Vector3f(-light.x, c * light.y + s * light.z, c * light.z - s * light.y)


def redirected_from(leaving, tilt):
    """Direction to the light that is redirected to `leaving`; the inverse of `redirected`."""
    s, c = dr.sincos(tilt * (np.pi / 180))
    return mi.Vector3f(-leaving.x, c * leaving.y - s * leaving.z, c * leaving.z + s * leaving.y)
