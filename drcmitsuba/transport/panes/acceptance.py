"""Light that counts at the outer faces of panes whose transmittance depends on the incidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.sampling import clamped_index

from drcmitsuba.model.materials import DiffuserMaterial
from drcmitsuba.runtime.flat_arrays import flat, flat_indices


@dataclass(frozen=True)
class Acceptance:
    """How much light counts at the faces of panes, by its incidence: T(θ)/T at outer ones."""

    table: mi.Float
    """T(θ)/T of every group of panes at equal steps of cos θ, flat (group, step)."""
    steps: int
    group: mi.UInt32
    """Group of every face."""
    outer: mi.Bool
    """Whether a face is an outer one."""

    @classmethod
    def of(cls, materials: Sequence[DiffuserMaterial], owner: np.ndarray) -> Acceptance | None:
        """Acceptance of the faces of patches by their owners; None where T is the same anywhere."""
        shares = [np.ravel(material.transmittance) for material in materials]
        steps = max((len(share) for share in shares), default=1)
        if steps == 1:
            return None
        c = np.linspace(0, 1, steps)
        rows = [
            np.interp(c, np.linspace(0, 1, len(share)), share) / material.scattered
            if len(share) > 1 and material.scattered > 0 else np.ones(steps)
            for share, material in zip(shares, materials, strict=True)
        ]  # fmt: skip
        of_face = np.repeat(owner, 2)
        return cls(
            flat(rows), steps, flat_indices(of_face), mi.Bool(np.arange(len(of_face)) % 2 == 1)
        )

    def at(self, face: mi.UInt32, cosine: mi.Float, active: mi.Bool) -> mi.Float:
        """T(θ)/T of light on faces [–]."""
        is_outer = active & dr.gather(mi.Bool, self.outer, face, active)
        x = dr.clip(cosine, 0, 1) * (self.steps - 1)
        i = clamped_index(x, self.steps - 1)
        at = dr.gather(mi.UInt32, self.group, face, is_outer) * self.steps + i
        low = dr.gather(mi.Float, self.table, at, is_outer)
        high = dr.gather(mi.Float, self.table, at + 1, is_outer)
        return dr.select(is_outer, dr.lerp(low, high, x - mi.Float(i)), 1)
