"""Klems' patches of the hemisphere, and BSDFs as matrices over pairs of them.

References
----------
.. [1] J. H. Klems, "A new method for predicting the solar heat gain of complex fenestration
   systems", ASHRAE Transactions 100(1), 1994.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True)
class KlemsBasis:
    """Rings of patches: `limits` [deg] between rings, `counts` patches in each.

    The first patch of every ring is centred on azimuth 0; azimuth runs counter-clockwise.
    """

    name: str
    limits: tuple[float, ...]
    counts: tuple[int, ...]

    def __len__(self) -> int:
        """Count the patches."""
        return sum(self.counts)

    @cached_property
    def ring(self) -> np.ndarray:
        """Ring of every patch."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    @cached_property
    def first(self) -> np.ndarray:
        """Number of every ring's first patch, shape (ring,)."""
        return np.cumsum((0, *self.counts))[:-1]

    @cached_property
    def projected_solid_angle(self) -> np.ndarray:
        """Projected solid angle of every patch [sr], shape (patch,); the sum is π."""
        c2 = np.cos(np.radians(self.limits)) ** 2
        return (np.pi * (c2[:-1] - c2[1:]) / self.counts)[self.ring]

    @cached_property
    def centres(self) -> np.ndarray:
        """Unit vectors to the patches' centres on the side +z, shape (patch, 3)."""
        limits = np.radians(self.limits)
        theta = (limits[:-1] + limits[1:]) / 2
        theta = np.where(np.arange(len(theta)) == 0, 0.0, theta)[self.ring]
        phi = 2 * np.pi * (np.arange(len(self)) - self.first[self.ring])
        phi = phi / np.array(self.counts)[self.ring]
        sin = np.sin(theta)
        return np.stack([sin * np.cos(phi), sin * np.sin(phi), np.cos(theta)], axis=-1)

    @cached_property
    def opposite(self) -> np.ndarray:
        """Number of the patch opposite in azimuth (a turn by 180°), shape (patch,)."""
        counts = np.array(self.counts)[self.ring]
        first = self.first[self.ring]
        return first + (np.arange(len(self)) - first + counts // 2) % counts

    def patch(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Number of the patch that holds a direction.

        A limit between rings belongs to the inner one on the side +z, to the outer one on the
        side −z, as Radiance rounds.
        """
        theta = np.degrees(np.arctan2(np.hypot(x, y), np.abs(z))) - 1e-9 * np.sign(z)
        ring = np.clip(np.searchsorted(self.limits, theta, "right") - 1, 0, len(self.counts) - 1)
        count = np.array(self.counts)[ring]
        azimuth = 180 / np.pi * np.arctan2(y, x)
        azimuth = np.where(azimuth < 0, azimuth + 360, azimuth)
        return self.first[ring] + (azimuth * count / 360 + 0.5 - 1e-12).astype(int) % count


BASES = {
    basis.name: basis
    for basis in (
        KlemsBasis(
            "LBNL/Klems Full",
            (0, 5, 15, 25, 35, 45, 55, 65, 75, 90),
            (1, 8, 16, 20, 24, 24, 24, 16, 12),
        ),
        KlemsBasis(
            "LBNL/Klems Half", (0, 6.5, 19.5, 32.5, 46.5, 61.5, 76.5, 90), (1, 8, 12, 16, 20, 12, 4)
        ),
        KlemsBasis("LBNL/Klems Quarter", (0, 9, 27, 46, 66, 90), (1, 8, 12, 12, 8)),
    )
}


@dataclass(frozen=True)
class KlemsMatrix:
    """One component of a BSDF over pairs of patches.

    Parameters
    ----------
    incident, outgoing : KlemsBasis
    value : np.ndarray, shape (outgoing, incident)
        f [1/sr].
    """

    incident: KlemsBasis
    outgoing: KlemsBasis
    value: np.ndarray

    def values(self, incident: np.ndarray, outgoing: np.ndarray) -> np.ndarray:
        """BSDF f [1/sr] of pairs of directions (…, 3), both pointing away from the surface."""
        i = self.incident.patch(-incident[..., 0], -incident[..., 1], incident[..., 2])
        return self.value[self.outgoing.patch(*np.moveaxis(outgoing, -1, 0)), i]

    def albedos(self) -> np.ndarray:
        """Directional-hemispherical value of every incident patch, shape (patch,)."""
        return self.outgoing.projected_solid_angle @ self.value

    def hemispherical(self, incident: np.ndarray) -> np.ndarray:
        """Directional-hemispherical transmittance or reflectance of directions (n, 3)."""
        i = self.incident.patch(-incident[:, 0], -incident[:, 1], incident[:, 2])
        return self.albedos()[i]

    def reversed(self) -> KlemsMatrix:
        """Matrix with incident and outgoing directions exchanged."""
        value = self.value[self.outgoing.opposite][:, self.incident.opposite].T
        return KlemsMatrix(self.outgoing, self.incident, value)

    def lambertian(self) -> float:
        """Albedo of the Lambertian part: π · the smallest value of f."""
        return float(np.pi * self.value.min())
