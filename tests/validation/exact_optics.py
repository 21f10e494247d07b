"""Exact answers for light by way of plane mirrors, dielectric slabs and prisms.

Fresnel's reflectance r is the mean of both polarisations at every surface, as Mitsuba's
`dielectric` and Radiance's have it: photons forget their polarisation. Real light does not; a slab
of n = 1.5 that it meets at 60° transmits 1.4 % more of it than `slab` says, at 75° 3.7 % more.
Directions are those in which the light goes, unit vectors. Nothing of the package is used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


def fresnel(cosine: np.ndarray, ior: float) -> np.ndarray:
    """Reflectance of a smooth surface, mean of both polarisations; 1 beyond the critical angle.

    Parameters
    ----------
    cosine : np.ndarray
        Of the angle of incidence, > 0.
    ior : float
        Refractive index beyond the surface over that before it.
    """
    c = np.asarray(cosine, float)
    squared = 1 - (1 - c**2) / ior**2
    t = np.sqrt(np.maximum(squared, 0))
    across, along = (c - ior * t) / (c + ior * t), (ior * c - t) / (ior * c + t)
    return np.where(squared > 0, (across**2 + along**2) / 2, 1.0)


def reflected(direction: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Direction after a mirror."""
    d, n = np.asarray(direction, float), np.asarray(normal, float)
    return d - 2 * (d * n).sum(axis=-1, keepdims=True) * n


def refracted(direction: np.ndarray, normal: np.ndarray, ior: float) -> np.ndarray:
    """Direction beyond a surface, by Snell's law.

    Parameters
    ----------
    direction, normal : np.ndarray, shape (3,)
        The normal on either side.
    ior : float
        Refractive index beyond the surface over that before it.

    Raises
    ------
    ValueError
        All light is reflected.
    """
    d, n = np.asarray(direction, float), np.asarray(normal, float)
    n = n if d @ n < 0 else -n
    cosine = -(d @ n)
    squared = 1 - (1 - cosine**2) / ior**2
    if squared <= 0:
        raise ValueError(
            f"total reflection at an incidence of {np.degrees(np.arccos(cosine)):.1f}°"
        )
    return d / ior + (cosine / ior - np.sqrt(squared)) * n


@dataclass(frozen=True)
class Shares:
    """Where the light goes: shares of what arrives, their sum is 1."""

    transmitted: float
    reflected: float
    absorbed: float


def slab(cosine: float, ior: float, thickness: float = 0.0, absorption: float = 0.0) -> Shares:
    """Plane-parallel slab in air with all its inter-reflections.

    With r of either surface (it is the same from within) and e = exp(−κ d / cos θ') of one way
    through, T = (1 − r)² e / (1 − r² e²), R = r + (1 − r)² r e² / (1 − r² e²). All transmitted
    light goes on in the direction that it had, all reflected light as from a mirror.

    Parameters
    ----------
    cosine : float
        Of the angle of incidence.
    ior : float
    thickness, absorption : float
        d [m] and κ [1/m].
    """
    r = float(fresnel(np.asarray(cosine), ior))
    inside = np.sqrt(1 - (1 - cosine**2) / ior**2)
    e = float(np.exp(-absorption * thickness / inside))
    many = 1 / (1 - (r * e) ** 2)
    through, back = (1 - r) ** 2 * e * many, r + (1 - r) ** 2 * r * e**2 * many
    return Shares(through, back, 1 - through - back)


def shift(cosine: float, ior: float, thickness: float) -> float:
    """By how much a slab moves a ray to the side, across the ray [m].

    d sin(θ − θ') / cos θ'; light reflected 2 k times within lies another 2 k d tan θ' further on
    along the slab.
    """
    sine = np.sqrt(1 - cosine**2)
    inside = np.sqrt(1 - (sine / ior) ** 2)
    return float(thickness * (sine - cosine * sine / ior / inside))


def side_prism(ior: float, leg: float = 0.0, absorption: float = 0.0) -> Shares:
    """Right-angle prism with the light at right angles on one leg: out of the other, turned by 90°.

    Its hypotenuse reflects everything (n > √2). Every ray is one leg long inside, wherever it
    enters, and what the second leg reflects returns the same way: a slab as thick as the leg is.
    "Reflected" goes back out of the first leg.

    Raises
    ------
    ValueError
        The refractive index is too small for total reflection at 45°.
    """
    if ior <= 2**0.5:
        raise ValueError(f"no total reflection at 45° with n = {ior:g}: needs more than √2")
    return slab(1.0, ior, leg, absorption)


def roof_prism(ior: float, hypotenuse: float = 0.0, absorption: float = 0.0) -> Shares:
    """The same prism with the light at right angles on its hypotenuse: nothing gets through.

    Both legs reflect everything, and the light comes back to the hypotenuse after as long a way as
    that is, parallel to how it came: R = r + (1 − r)² e / (1 − r e).

    Raises
    ------
    ValueError
        The refractive index is too small for total reflection at 45°.
    """
    if ior <= 2**0.5:
        raise ValueError(f"no total reflection at 45° with n = {ior:g}: needs more than √2")
    r, e = float(fresnel(np.ones(()), ior)), float(np.exp(-absorption * hypotenuse))
    back = r + (1 - r) ** 2 * e / (1 - r * e)
    return Shares(0.0, back, 1 - back)


@dataclass(frozen=True)
class Mirror:
    """Plane rectangular mirror that throws the image of a sun on a wall.

    Parameters
    ----------
    quad : np.ndarray, shape (4, 3)
        Its corners in order [m].
    reflectance : float
    """

    quad: np.ndarray
    reflectance: float

    @property
    def normal(self) -> np.ndarray:
        n = np.cross(self.quad[1] - self.quad[0], self.quad[3] - self.quad[0])
        return n / np.linalg.norm(n)

    def spot(self, direction: np.ndarray, point: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """Corners (4, 3) on a wall, by its point and normal, of the light of the sun's centre."""
        out = reflected(direction, self.normal)
        way = ((point - self.quad) @ normal) / (out @ normal)
        if (way <= 0).any():
            raise ValueError("the mirror does not throw its light on that wall")
        return self.quad + way[:, None] * out

    def flux(self, direction: np.ndarray, diameter: float) -> float:
        """Flux that leaves the mirror for a sun of radiance 1 that it sees all of [m² sr]."""
        return self.reflectance * area(self.quad) * seen(direction, self.normal, diameter)

    def irradiance(self, direction: np.ndarray, normal: np.ndarray, diameter: float) -> float:
        """On a wall, where it is fully lit, of a sun of radiance 1 [sr]: ρ π sin²(δ/2) cos θ."""
        return self.reflectance * seen(reflected(direction, self.normal), normal, diameter)

    def share_seen(
        self, points: np.ndarray, direction: np.ndarray, diameter: float, count: int = 256
    ) -> np.ndarray:
        """Part of the sun that points see in the mirror: 1 in its core, 0 outside its penumbra.

        Parameters
        ----------
        points : np.ndarray, shape (point, 3)
        direction : np.ndarray, shape (3,)
            Of the light of the sun's centre.
        diameter : float
            [°].
        count : int
            Directions over the disk, its rim among them; in the core and beyond the penumbra the
            answer is exact, between them it is off by some 1/√count.
        """
        back = -reflected(on_rim(direction, diameter, count), self.normal)
        facing = self.quad[0] - points
        way = (facing @ self.normal)[:, None] / (back @ self.normal)
        hit = points[:, None] + way[..., None] * back - self.quad[0]
        inside = way > 0
        for edge in (self.quad[1] - self.quad[0], self.quad[3] - self.quad[0]):
            along = hit @ edge / (edge @ edge)
            inside &= (along >= 0) & (along <= 1)
        return inside.mean(axis=1)


def on_rim(centre: np.ndarray, diameter: float, count: int) -> np.ndarray:
    """Directions over a disk of so many degrees, those of its rim among them, (count, 3)."""
    centre = np.asarray(centre, float) / np.linalg.norm(centre)
    east = np.cross(np.eye(3)[np.argmin(abs(centre))], centre)
    east /= np.linalg.norm(east)
    i = np.arange(count)
    rings = int(np.sqrt(count))
    sine = np.sqrt((i % rings + 1) / rings) * np.sin(np.radians(diameter / 2))
    angle = np.pi * (3 - 5**0.5) * i
    flat = np.cos(angle)[:, None] * east + np.sin(angle)[:, None] * np.cross(centre, east)
    return np.sqrt(1 - sine**2)[:, None] * centre + sine[:, None] * flat


def seen(direction: np.ndarray, normal: np.ndarray, diameter: float) -> float:
    """∫ cos θ dΩ over a sun that is above a surface's horizon with all its disk [sr]."""
    cosine = abs(float(np.dot(direction, normal)))
    half = np.radians(diameter / 2)
    assert cosine > np.sin(half), "the sun sets on this surface"
    return float(np.pi * np.sin(half) ** 2 * cosine)


def area(polygon: np.ndarray) -> float:
    """Area of a plane polygon (corner, 3) [m²]."""
    fan = polygon[1:] - polygon[0]
    return float(np.linalg.norm(np.cross(fan[:-1], fan[1:]).sum(axis=0)) / 2)
