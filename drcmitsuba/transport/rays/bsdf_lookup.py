"""Properties of surfaces by the number of their BSDF in Dr.Jit's registry, and paths in solids."""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.model.materials import DielectricMaterial
from drcmitsuba.runtime.flat_arrays import flat_indices
from drcmitsuba.scene.scene import Scene


def number(bsdf: mi.BSDFPtr) -> mi.UInt32:
    """Number of a BSDF in Dr.Jit's registry."""
    return dr.reinterpret_array(mi.UInt32, bsdf)


def numbers(scene: Scene) -> list[int]:
    """Numbers of the BSDFs of a scene's parts."""
    return [int(number(mi.BSDFPtr(part.bsdf))[0]) for part in scene.parts]


def table(scene: Scene, values: Sequence[float], dtype: type[np.number]) -> np.ndarray:
    """Values of the parts of a scene, by the numbers of their BSDFs."""
    at = numbers(scene)
    out = np.zeros(max(at) + 1, dtype)
    out[at] = values
    return out


def bsdfs(scene: Scene, part: mi.UInt32) -> mi.BSDFPtr:
    """BSDFs of parts of a scene by their indices."""
    every = flat_indices(np.array(numbers(scene), np.uint32))
    return dr.reinterpret_array(mi.BSDFPtr, dr.gather(mi.UInt32, every, part))


def absorption(scene: Scene) -> mi.Float | None:
    """Absorption [1/m] of the solid behind a BSDF; None where nothing absorbs."""
    solids = [part.material for part in scene.parts]
    values = [m.absorption if isinstance(m, DielectricMaterial) else 0.0 for m in solids]
    return mi.Float(table(scene, values, np.float32)) if any(values) else None


def share_left(inside: mi.Float, way: mi.Vector3f) -> mi.Float:
    """Share of the light that a solid of absorption `inside` [1/m] leaves after a way [m]."""
    return dr.select(inside > 0, dr.exp(-inside * dr.norm(way)), 1)


def absorption_after(
    absorption: mi.Float, bsdf: mi.BSDFPtr, bs: mi.BSDFSample3f, inside: mi.Float, active: mi.Bool
) -> mi.Float:
    """Absorption [1/m] of the solid that a sample of a BSDF leads into, from one of `inside`."""
    crossed = active & (bs.eta != 1)
    into = dr.gather(mi.Float, absorption, number(bsdf), crossed & (bs.wo.z < 0))
    return dr.select(crossed, into, inside)
