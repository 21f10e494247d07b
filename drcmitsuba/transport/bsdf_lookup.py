"""Properties of surfaces by the number of their BSDF in Dr.Jit's registry."""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.materials import DielectricMaterial
from drcmitsuba.scene.scene import Scene


def number(bsdf: mi.BSDFPtr) -> mi.UInt32:
    """Number of a BSDF in Dr.Jit's registry."""
    return dr.reinterpret_array(mi.UInt32, bsdf)


def table(scene: Scene, values: Sequence[float], dtype: type[np.number]) -> np.ndarray:
    """Values of the parts of a scene, by the numbers of their BSDFs."""
    at = [int(number(mi.BSDFPtr(part.bsdf))[0]) for part in scene.parts]
    out = np.zeros(max(at) + 1, dtype)
    out[at] = values
    return out


def absorption(scene: Scene) -> mi.Float | None:
    """Absorption [1/m] of the solid behind a BSDF; None where nothing absorbs."""
    solids = [part.material for part in scene.parts]
    values = [m.absorption if isinstance(m, DielectricMaterial) else 0.0 for m in solids]
    return mi.Float(table(scene, values, np.float32)) if any(values) else None
