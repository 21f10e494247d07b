"""The sun in patches of the sky, as the matrix methods of Radiance have it [1]_.

References
----------
.. [1] A. McNeil, E. S. Lee, "A validation of the Radiance three-phase simulation method", Journal
   of Building Performance Simulation 6(1), 2013; A. McNeil, "The five-phase method", LBNL, 2013.
   The weights are those of Radiance's `gendaymtx`.
"""

from __future__ import annotations

import numpy as np
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.runtime import lazy
from drcmitsuba.sky.sun_models.blend import Blend, Suns

spatial = lazy.module("scipy.spatial")

SPREAD = 4
"""Patches that the three-phase method spreads the sun over."""
FIVE_PHASE = 6
"""Reinhart's factor of the patches that the five-phase method moves the sun into."""


def _nearest(directions: np.ndarray, patches: Patches, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Bins of the patches whose centres lie nearest, and the cosines to these."""
    tree = spatial.KDTree(patches.directions[1:])
    chord, nearest = tree.query(directions, k=np.arange(1, count + 1))
    return nearest + 1, 1 - chord**2 / 2


def spread_over_patches(
    directions: np.ndarray, up: np.ndarray, patches: Patches, diameter: float
) -> Blend:
    r"""Spread each sun over the four patches with the nearest centres: three-phase method.

    A patch at angle γ gets the share w / Σw of the sun's light, w = 1 / (1.002 − cos γ). Its weight
    is the share times the ratio of the solid angles of sun and patch.
    """
    bins = np.zeros((len(up), SPREAD), np.int64)
    weights = np.zeros((len(up), SPREAD))
    if up.any():
        bins[up], cosines = _nearest(directions[up], patches, SPREAD)
        near = 1 / (1.002 - cosines)
        share = near / near.sum(axis=1, keepdims=True)
        weights[up] = share * disk_solid_angle(diameter) / patches.solid_angles[bins[up]]
    labels = np.where(up[:, None], np.array(patches.labels, dtype=object)[bins], "")
    return Blend(labels, weights)


def moved_to_patch(directions: np.ndarray, up: np.ndarray, diameter: float) -> tuple[Suns, Blend]:
    """Move each sun to the nearest centre of a patch of Reinhart's MF 6: five-phase method.

    The suns are the centres in use, `sun_mf6_0001` … . The published method moves the sun for its
    direct light only and leaves what is interreflected to the patches of the three-phase method;
    here all light comes from the moved sun.
    """
    patches = Patches(FIVE_PHASE)
    bins = np.zeros(len(up), np.int64)
    if up.any():
        bins[up] = _nearest(directions[up], patches, 1)[0][:, 0]
    used = np.unique(bins[up])
    names = np.array(["", *(f"sun_mf6_{i:04d}" for i in range(1, len(patches)))], dtype=object)
    suns = Suns(tuple(names[used]), patches.directions[used], diameter)
    return suns, Blend.own(np.where(up, names[bins], ""))
