"""Sky patches of Tregenza and their Reinhart subdivisions; labels, solid angles and look-up.

Directions: x east, y north, z up; patch azimuths run from north, clockwise by east. Patch rows
start at the horizon; the first patch of a row is centred on north; the last bin is the zenith cap.
Bin 0 is the ground: the hemisphere below the horizon.

References
----------
.. [1] P. R. Tregenza, "Subdivision of the sky hemisphere for luminance measurements",
   Lighting Research and Technology 19(1), 1987.
.. [2] D. Bourgeois, C. F. Reinhart, G. Ward, "Standard daylight coefficient model for dynamic
   daylighting simulations", Building Research & Information 36(1), 2008.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import drjit as dr
import numpy as np

TREGENZA_ROWS = (30, 30, 24, 24, 18, 12, 6)


@dataclass(frozen=True)
class Patches:
    """The ground and the sky patches of a Reinhart subdivision.

    Parameters
    ----------
    subdivision : int
        Reinhart's factor MF, 1 to 6; 1 is Tregenza's 145 patches.
    """

    subdivision: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.subdivision <= 6:
            raise ValueError(f"subdivision: {self.subdivision}; give a whole number from 1 to 6")

    @cached_property
    def rows(self) -> np.ndarray:
        """Number of patches in each row from the horizon up, the zenith cap last."""
        mf = self.subdivision
        return np.append(np.repeat(np.array(TREGENZA_ROWS) * mf, mf), 1)

    @property
    def row_height(self) -> float:
        """Height of a row [rad]; the zenith cap has half of it as its half angle."""
        return np.pi / 2 / (7 * self.subdivision + 0.5)

    @cached_property
    def row_start(self) -> np.ndarray:
        """Bin of the first patch of each row."""
        return 1 + np.concatenate([[0], np.cumsum(self.rows)[:-1]])

    def __len__(self) -> int:
        """Count the bins, the ground included: 146 for Tregenza's sky."""
        return 1 + int(self.rows.sum())

    @cached_property
    def labels(self) -> list[str]:
        """Label of every bin: `ground`, `sky_001`, …"""
        n = len(self)
        width = max(3, len(str(n - 1)))
        return ["ground", *(f"sky_{i:0{width}d}" for i in range(1, n))]

    @cached_property
    def bounds(self) -> np.ndarray:
        """Lowest and highest altitude, first and last azimuth of bins [rad], shape (bin, 4)."""
        out = [(-np.pi / 2, 0.0, 0.0, 2 * np.pi)]
        for row, n in enumerate(self.rows):
            low = row * self.row_height
            high = np.pi / 2 if n == 1 else low + self.row_height
            width = 2 * np.pi / n
            out += [(low, high, (k - 0.5) * width, (k + 0.5) * width) for k in range(n)]
        return np.array(out)

    @cached_property
    def solid_angles(self) -> np.ndarray:
        """Solid angle of every bin [sr], shape (bin,)."""
        low, high, west, east = self.bounds.T
        return (np.sin(high) - np.sin(low)) * (east - west)

    @cached_property
    def projected_solid_angles(self) -> np.ndarray:
        """Solid angle projected on the horizontal, ∫|cos θ| dΩ [sr], shape (bin,)."""
        low, high, west, east = self.bounds.T
        return abs(np.sin(high) ** 2 - np.sin(low) ** 2) / 2 * (east - west)

    @cached_property
    def directions(self) -> np.ndarray:
        """Unit vector to the centre of every bin, shape (bin, 3)."""
        low, high, west, east = self.bounds.T
        altitude, azimuth = (low + high) / 2, (west + east) / 2
        altitude[0], altitude[-1] = -np.pi / 2, np.pi / 2
        return np.stack(
            [
                np.cos(altitude) * np.sin(azimuth),
                np.cos(altitude) * np.cos(azimuth),
                np.sin(altitude),
            ],
            axis=-1,
        )


def patch_index(d, subdivision: int = 1):
    """Number of the bin that holds a direction.

    Parameters
    ----------
    d : drjit Vector3f
        Unit directions in the sky's frame.
    subdivision : int
        Reinhart's factor MF.

    Returns
    -------
    drjit UInt32
        Number of the patch; 0 (the ground) below the horizon.
    """
    patches = Patches(subdivision)
    UInt32, Float = dr.uint32_array_t(type(d.x)), type(d.x)
    # In float32, asin is inexact near 1 (the zenith cap); atan2 is exact at both ends.
    altitude = dr.atan2(d.z, dr.sqrt(dr.fma(d.x, d.x, d.y * d.y)))
    # NaN, which `dr.clip` would keep and whose whole part may be any number, counts as 0.
    row = UInt32(dr.fmin(dr.fmax(altitude * (1 / patches.row_height), 0), len(patches.rows) - 1))
    count = dr.gather(Float, Float(patches.rows.astype(np.float32)), row)
    start = dr.gather(UInt32, UInt32(patches.row_start.astype(np.uint32)), row)
    turn = dr.atan2(d.x, d.y) * (0.5 / np.pi)
    k = UInt32(dr.fmin(dr.fmax(dr.select(turn < 0, turn + 1, turn) * count + 0.5, 0), count))
    k = dr.select(k >= UInt32(count), 0, k)
    return dr.select(d.z < 0, 0, start + k)
