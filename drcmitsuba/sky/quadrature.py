"""From a continuous sky to one luminance per patch, and its scale."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.runtime.threads import in_threads

Luminance = Callable[["slice | np.ndarray", np.ndarray, np.ndarray], np.ndarray]
"""Luminance of some times at (cos ζ, cos γ), which broadcast with a (time, 1) parameter:
ζ from the zenith, γ from the sun [rad]. Its first argument selects the times. Nodes at one altitude
share their cos ζ: cos γ (azimuth, time, node) has a dimension more than cos ζ."""

BLOCK = 16_000
"""Values in flight at once in a thread: 125 KiB stay in the cache, and below the size from which
the C library fetches memory anew for every array, which made this five times slower."""


class SkyLight(NamedTuple):
    """Luminances and illuminances of a sky model at each time."""

    sky: np.ndarray
    """Luminance of the sky patches, without the ground [cd/m²], shape (time, patch)."""
    diffuse_horizontal: np.ndarray
    """Diffuse horizontal illuminance [lx], shape (time,)."""
    direct_normal: np.ndarray
    """Direct normal illuminance [lx], shape (time,); 0 while the sun's centre is not up."""


@dataclass(frozen=True)
class PatchCentres:
    """Luminance and cosine at the centre of each patch, as `gendaymtx` takes them.

    A sky scaled with these integrates to 0.9945 = cos 6° of its target over Tregenza's patches,
    so this serves to compare with Radiance, not to design with.
    """

    def __call__(self, luminance: Luminance, sun: np.ndarray, patches: Patches) -> np.ndarray:
        """Value of each patch, shape (time, patch), no ground; `sun` (time, 3) are unit vectors."""
        nodes = patches.directions[None, 1:, None]
        return _integrate(luminance, sun, nodes, np.ones(nodes.shape[:-1]))

    def horizontal(self, patches: Patches) -> np.ndarray:
        """Illuminance by a unit luminance of each patch: Ω cos θ at the centre [sr], (patch,)."""
        return (patches.solid_angles * patches.directions[:, 2])[1:]


@dataclass(frozen=True)
class PatchMeans:
    """Mean luminance of each patch, ∫ l dΩ / Ω, by Gauss nodes in sin(altitude) and azimuth."""

    far: tuple[int, int] = (4, 5)
    """Nodes in altitude and in azimuth of each patch. The row above the horizon takes twice as many
    in altitude, since exp(b / cos ζ) is steep there."""
    near: tuple[int, int] = (10, 10)
    """The same for patches whose centre is within 1.5 row heights of the sun, where exp(dγ) of the
    circumsolar glow has its cusp."""

    def __call__(self, luminance: Luminance, sun: np.ndarray, patches: Patches) -> np.ndarray:
        """Value of each patch, shape (time, patch)."""
        altitude, azimuth = self.far
        low = patches.bounds[1:, 0] < 1e-6
        values = np.empty((len(sun), len(low)))
        for row, count in ((low, 2 * altitude), (~low, altitude)):
            nodes, weights = gauss_nodes(patches, count, azimuth)
            values[:, row] = _integrate(luminance, sun, nodes[:, row], weights[:, row])
        nodes, weights = gauss_nodes(patches, *self.near)
        close = sun @ patches.directions[1:].T > np.cos(1.5 * patches.row_height)
        time, patch = np.nonzero(close)

        def integrate(block: slice) -> None:
            t, p = time[block], patch[block]
            cos_gamma = np.einsum("atni,ti->atn", nodes[:, p], sun[t])
            value = luminance(t, nodes[0, p, :, 2], cos_gamma)
            values[t, p] = np.einsum("atn,atn->t", value, weights[:, p])

        in_threads(integrate, _blocks(len(time), weights[:, 0].size))
        return values

    def horizontal(self, patches: Patches) -> np.ndarray:
        """∫ cos θ dΩ [sr], shape (patch,)."""
        return patches.projected_solid_angles[1:]


@dataclass(frozen=True, eq=False)
class AtDirections:
    """Luminance of the patches, then of the continuous sky itself in some directions."""

    patch_values: PatchCentres | PatchMeans
    """Way to the patches' luminances, which alone decide on the scale of the sky."""
    directions: np.ndarray
    """Unit vectors above the horizon, shape (direction, 3)."""

    def __call__(self, luminance: Luminance, sun: np.ndarray, patches: Patches) -> np.ndarray:
        """Value of each patch and each direction, shape (time, patch + direction)."""
        values = self.patch_values(luminance, sun, patches)
        nodes = self.directions[None, :, None]
        return np.hstack([values, _integrate(luminance, sun, nodes, np.ones(nodes.shape[:-1]))])

    def horizontal(self, patches: Patches) -> np.ndarray:
        """Weights of the patches [sr], and 0 for every direction, shape (patch + direction,)."""
        weights = self.patch_values.horizontal(patches)
        return np.append(weights, np.zeros(len(self.directions)))


PatchValues = PatchCentres | PatchMeans | AtDirections
"""Way to one luminance per patch, and the weights of the patches in a horizontal illuminance."""
PATCH_MEANS = PatchMeans()
"""The default of every sky model."""


def gauss_nodes(patches: Patches, altitude: int, azimuth: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions and weights of the mean over each sky patch.

    Shapes (azimuth, patch, altitude, 3) and (azimuth, patch, altitude). The zenith cap takes equal
    steps around it: it has no ends for Gauss nodes to crowd at.
    """
    low, high, west, east = patches.bounds[1:].T[..., None]
    x, weight_z = np.polynomial.legendre.leggauss(altitude)
    z = np.sin(low) + (np.sin(high) - np.sin(low)) * (x + 1) / 2
    x, weight_turn = np.polynomial.legendre.leggauss(azimuth)
    turn = west + (east - west) * (x + 1) / 2
    weight_turn = np.tile(weight_turn, (len(turn), 1))
    turn[-1], weight_turn[-1] = 2 * np.pi * np.arange(azimuth) / azimuth, 2 / azimuth

    z, turn = np.broadcast_arrays(z, turn.T[:, :, None])
    r = np.sqrt(1 - z * z)
    nodes = np.stack([r * np.sin(turn), r * np.cos(turn), z], axis=-1)
    return nodes, weight_turn.T[:, :, None] * weight_z / 4


def scale_to(values: np.ndarray, illuminance: np.ndarray, horizontal: np.ndarray) -> np.ndarray:
    """Scale patch values so that Σ L · horizontal is the illuminance of each time [lx].

    A sky without any light of its own becomes uniform, as in `gendaymtx`.
    """
    total = values @ horizontal
    values = np.where(total[:, None] > 0, values, 1.0)
    total = np.where(total > 0, total, horizontal.sum())
    return values * (illuminance / total)[:, None]


def _integrate(
    luminance: Luminance, sun: np.ndarray, nodes: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    """Σ weight × luminance over the nodes of each patch, shape (time, patch)."""
    azimuths, patches, altitudes = weights.shape
    cos_zenith = nodes[0, :, :, 2].ravel()
    across = np.ascontiguousarray(np.moveaxis(nodes.reshape(azimuths, -1, 3), -1, 1))
    weights = weights.reshape(azimuths, 1, -1)
    values = np.empty((len(sun), patches))

    def integrate(block: slice) -> None:
        value = luminance(block, cos_zenith, sun[block] @ across)
        value *= weights
        values[block] = value.sum(axis=0).reshape(-1, patches, altitudes).sum(axis=-1)

    in_threads(integrate, _blocks(len(sun), weights.size))
    return values


def _blocks(count: int, width: int) -> list[slice]:
    """Slices of `count` rows of `width` values that stay below BLOCK values each."""
    rows = max(1, BLOCK // width)
    return [slice(i, i + rows) for i in range(0, count, rows)]
