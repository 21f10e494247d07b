"""From a continuous sky to one luminance per patch, and its scale."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.runtime import backend
from drcmitsuba.runtime.flat_arrays import row_and_column

LuminanceAt = Callable[["mi.Float64", "mi.Float64"], "mi.Float64"]
"""Luminance, in any unit, at (cos ζ, cos γ): ζ from the zenith, γ from the sun [rad]."""
Luminance = Callable[["mi.UInt32"], LuminanceAt]
"""Luminances of the skies of some times, which are given by their indices."""

PAIRS = 1 << 23
"""Largest number of pairs of a time and a patch in a launch for all patches, unless one patch has
more times."""


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
        return _at_nodes(luminance, sun, *_single(patches.directions[1:]))

    def horizontal(self, patches: Patches) -> np.ndarray:
        """Illuminance by a unit luminance of each patch: Ω cos θ at the centre [sr], (patch,)."""
        return (patches.solid_angles * patches.directions[:, 2])[1:]


@dataclass(frozen=True)
class PatchMeans:
    """Mean luminance of each patch, ∫ l dΩ / Ω, by Gauss nodes in sin(altitude) and azimuth."""

    far: tuple[int, int] = (4, 4)
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
            values[:, row] = _at_nodes(luminance, sun, nodes[row], weights[row])
        close = sun @ patches.directions[1:].T > np.cos(1.5 * patches.row_height)
        time, patch = np.nonzero(close)
        near = gauss_nodes(patches, *self.near)
        values[time, patch] = _sums(luminance, sun, near, mi.UInt32(time), mi.UInt32(patch))
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
        return np.hstack([values, _at_nodes(luminance, sun, *_single(self.directions))])

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

    Shapes (patch, node, 3) and (patch, node). The zenith cap takes equal steps around it: it has no
    ends for Gauss nodes to crowd at.
    """
    low, high, west, east = patches.bounds[1:].T[..., None]
    x, weight_z = np.polynomial.legendre.leggauss(altitude)
    z = np.sin(low) + (np.sin(high) - np.sin(low)) * (x + 1) / 2
    x, weight_turn = np.polynomial.legendre.leggauss(azimuth)
    turn = west + (east - west) * (x + 1) / 2
    weight_turn = np.tile(weight_turn, (len(turn), 1))
    turn[-1], weight_turn[-1] = 2 * np.pi * np.arange(azimuth) / azimuth, 2 / azimuth

    z, turn = np.broadcast_arrays(z[:, None], turn[..., None])
    r = np.sqrt(1 - z * z)
    nodes = np.stack([r * np.sin(turn), r * np.cos(turn), z], axis=-1)
    weights = weight_turn[..., None] * weight_z / 4
    return nodes.reshape(len(z), -1, 3), weights.reshape(len(z), -1)


def scale_to(values: np.ndarray, illuminance: np.ndarray, horizontal: np.ndarray) -> np.ndarray:
    """Scale patch values so that Σ L · horizontal is the illuminance of each time [lx].

    A sky without any light of its own becomes uniform, as in `gendaymtx`.
    """
    total = values @ horizontal
    values = np.where(total[:, None] > 0, values, 1.0)
    total = np.where(total > 0, total, horizontal.sum())
    return values * (illuminance / total)[:, None]


def _sums(
    luminance: Luminance, sun: np.ndarray, nodes: tuple[np.ndarray, np.ndarray],
    time: mi.UInt32, patch: mi.UInt32,
) -> np.ndarray:  # fmt: skip
    """Σ weight × luminance over the nodes of pairs of a time and a patch, shape (pair,).

    `nodes` are directions and weights as from `gauss_nodes`.
    """
    if not dr.width(time):
        return np.zeros(0)
    table, count = np.dstack(nodes), dr.opaque(mi.UInt32, nodes[1].shape[1])
    here = dr.gather(mi.Vector3d, mi.Float64(sun.ravel()), time)
    return _sum(luminance(time), here, mi.Float64(table.ravel()), patch * count, count).numpy()


@symbolic
def _sum(
    luminance: LuminanceAt, sun: mi.Vector3d, nodes: mi.Float64, first: mi.UInt32, count: mi.UInt32
) -> mi.Float64:
    """Σ weight × luminance over nodes (x, y, z, weight), from the first one of every thread on."""
    total, node = mi.Float64(0), mi.UInt32(0)
    while node < count:
        x, y, z, weight = dr.gather(mi.Vector4d, nodes, first + node)
        total += weight * luminance(z, x * sun.x + y * sun.y + z * sun.z)
        node += 1
    return total


def _single(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions as nodes of patches that have one each, and their weights 1."""
    return directions[:, None], np.ones((len(directions), 1))


def _at_nodes(
    luminance: Luminance, sun: np.ndarray, directions: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    """Σ weight × luminance over the nodes of each patch at every time, shape (time, patch)."""
    backend.select()
    times, patches = len(sun), len(weights)
    values = np.empty((times, patches))
    step = max(1, PAIRS // max(1, times))
    for start in range(0, patches, step):
        here = slice(start, min(start + step, patches))
        pairs = dr.arange(mi.UInt32, (here.stop - start) * times)
        patch, time = row_and_column(pairs, times)  # threads side by side share their nodes
        sums = _sums(luminance, sun, (directions[here], weights[here]), time, patch)
        values[:, here] = sums.reshape(here.stop - start, times).T
    return values
