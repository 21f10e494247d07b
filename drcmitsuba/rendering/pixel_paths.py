"""Light paths of some pixels, by element; and the numbers of rays of a picture.

An *element* is an opening with one of its fills. Its number in a path counts from 1; 0 stands for
what is seen beside all openings. Where no opening has several fills, paths have no such numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import drjit as dr
import mitsuba as mi

from drcmitsuba.runtime.errors import InputError


@dataclass(frozen=True)
class Sampling:
    """Numbers of rays of a picture.

    Examples
    --------
    >>> from drcmitsuba import rendering
    >>> rendering.Sampling(samples=10, sky=32).rounded(replicates=4).samples
    12
    """

    samples: int = 8
    """Rays from the eye in each pixel, a multiple of the number of replicates."""
    paths: int = 16
    """Rays from each surface that a ray shows to other surfaces."""
    sky: int = 8
    """Rays from each such surface to the sky."""
    panes: int = 16
    """Points on scattering panes, and as many directions to them, for each such surface."""

    def __post_init__(self) -> None:
        for name, most in (("samples", 1 << 16), ("paths", 256), ("sky", 256), ("panes", 256)):
            if not 1 <= (got := getattr(self, name)) <= most:
                raise InputError("sampling", name, str(got), f"give 1 to {most}")

    def nbytes(self, columns: int, fills: int) -> int:
        """Size of the light paths of a pixel [bytes], at most.

        There are `columns` looks at panes, and so many `fills` of openings at most.
        """
        marked = 8 * self.paths if fills > 1 else 0
        to_sky = (4 if fills == 1 else 8) + 2 * fills
        each = 112 + 6 * (self.paths + self.panes * columns) + marked + to_sky * self.sky
        return self.samples * each

    def rounded(self, replicates: int) -> Sampling:
        """Return the same with as many samples as replicates, or a multiple."""
        return replace(self, samples=-(-self.samples // replicates) * replicates)


@dataclass(frozen=True)
class PixelPaths:
    """Light paths of some pixels; a `slot` is pixel · replicates + replicate."""

    first: int
    """First slot of these pixels."""
    slots: int
    """Number of slots."""
    outside_slot: mi.UInt32
    outside_d: mi.Vector3f
    outside: mi.Float
    outside_sun: mi.Float
    outside_element: mi.UInt32
    """Rays that leave the scene: direction, weight, share of the sun's light that counts, and
    element."""
    rough_slot: mi.UInt32
    rough_part: mi.UInt32
    rough_p: mi.Vector3f
    rough_n: mi.Vector3f
    rough_d: mi.Vector3f
    rough: mi.Float
    rough_element: mi.UInt32
    """Rough mirrors that rays meet: parts of the scenes, points [m], normals, directions from the
    eye, weight of what they show of the sun, and element."""
    pane_slot: mi.UInt32
    pane_at: mi.UInt32
    pane: mi.Float
    pane_element: mi.UInt32
    """Rays that meet a scattering pane: entry of the glow's tables, weight, and element."""
    slot: mi.UInt32
    p: mi.Vector3f
    n: mi.Vector3f
    weight: mi.Float
    element: mi.UInt32
    """Surfaces that rays show: points [m], normals, weight of E/π, and element."""
    gather_surface: mi.UInt32
    gather_cell: mi.UInt32
    gather: mi.Float16
    """Rays to other surfaces: index of the surface, cell, and irradiance per irradiance. Rays that
    end at once are as many for each surface, and need no index."""
    gather_marked: mi.UInt32
    gather_mark: mi.UInt32
    """Those of these rays that met openings, and the elements that they met, see `OpeningMarks`."""
    sky_bin: mi.UInt32
    sky_opening: mi.UInt32
    sky: mi.Float16
    """Rays to the sky, as many for each surface: bin, number from 1 of the opening that they pass,
    0 for none, and irradiance [sr] by each fill in turn (fill, surface, ray)."""
    look_at: mi.UInt32
    look: mi.Float16
    """Looks at panes (column, surface, ray), fill by fill: entry of the glow's tables and
    irradiance [sr]."""

    def arrays(self) -> dict[str, Any]:
        """Return the arrays by their names."""
        return {f.name: getattr(self, f.name) for f in fields(self)[2:]}

    @property
    def nbytes(self) -> int:
        """Size in memory [bytes]."""
        return sum(_bytes(array) for array in self.arrays().values())


def _bytes(array: Any) -> int:
    """Size of an array in memory [bytes]."""
    if dr.depth_v(array) > 1:
        return sum(map(_bytes, array))
    return dr.width(array) * dr.itemsize_v(array) if dr.width(array) else 0
