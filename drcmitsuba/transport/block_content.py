"""Digests of all that the coefficients of some sensors depend on, whatever else has changed.

Paths say what sensors see of diffuse surfaces: their weights hold all reflectances on the way. What
straight light meets are the shapes of opaque surfaces, and panes and mirrors with their materials.
So a block of a building stays sound when a surface changes that none of its paths has met.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.model.materials import Lambertian
from drcmitsuba.runtime.content_key import content_key
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.gather.blocks import Gathered
from drcmitsuba.transport.interreflection.solved_cells import Transfer

_MIX = 0x9E3779B97F4A7C15


@dataclass(frozen=True)
class BlockContent:
    """Content of blocks that share a scene's straight light."""

    straight: str
    """Digest of what straight light meets."""

    @classmethod
    def of(cls, base: Deposit, labels: list[str], sun_samples: int) -> BlockContent:
        """Content for bins with these labels; parameters as for `coefficients.estimate_blocks`."""
        scene = base.scene
        its = labels, sun_samples, base.suns, base.diameter, base.subdivision
        return cls(content_key(_met_by_straight_light(scene), scene.effects.to_dict(), its))

    def of_sensors(
        self, base: Deposit, gathered: Gathered, transfer: Transfer | None,
        points: np.ndarray, normals: np.ndarray,
    ) -> str:  # fmt: skip
        """Digest of all that sensors with these paths depend on; "" where some are not stored."""
        if not gathered.is_stored:
            return ""
        cells, drawn = gathered.cells, gathered.drawn
        paths = [
            _digest(met.row, met.cell, dr.reinterpret_array(mi.UInt32, met.weight))
            for met in gathered.kept.values()
        ]
        if transfer is not None:
            paths += [
                _digest(one.source, one.cell, dr.reinterpret_array(mi.UInt32, one.weight))
                for one in transfer.bounces
            ]
        stand = cells.keys.numpy(), drawn.p.numpy(), drawn.n.numpy()
        within = gathered.within, None if drawn.within is None else drawn.within.numpy()
        sensors = points, normals, base.accuracy.sampling
        return content_key(self.straight, paths, stand, within, sensors)


def _met_by_straight_light(scene: Scene) -> tuple[Any, ...]:
    """Shapes of diffuse surfaces, and all about the others."""
    matt = [part for part in scene.parts if type(part.material) is Lambertian]
    rest = [part for part in scene.parts if type(part.material) is not Lambertian]
    shapes = [np.insert(part.quads.reshape(-1, 12), 0, part.closed, axis=1) for part in matt]
    quads = np.concatenate([np.zeros((0, 13)), *shapes])
    others = [(part.material, part.quads, part.component, part.closed) for part in rest]
    return quads[np.lexsort(quads.T)], others, scene.channel, scene.ports


def _digest(*columns: mi.UInt32) -> int:
    """Number that follows from rows of whole numbers, whatever their order."""
    if not dr.width(columns[0]):
        return 0
    mixed = mi.UInt64(_MIX)
    for column in columns:
        for _ in range(2):  # a low bit reaches the high ones, and these the low ones again
            mixed = (mixed ^ mi.UInt64(column)) * mi.UInt64(_MIX)
            mixed ^= mixed >> 29
    return int(dr.sum(mixed)[0])
