r"""Translucent panes with a lobe around the straight direction, as BSDF files of rank 3.

Radiance's `trans` with a roughness α sends the share t_s of the light into the lobe

.. math:: f = t_s \frac{G(δ)}{\sqrt{\cos θ_i \cos θ_o}}, \qquad
    G = \frac{e^{-2 (1 - \cos δ) / α^2}}{π α^2},

with δ the angle from the straight direction. Each lobe is scaled to its share, as Radiance's
samples are. Mirrored light counts as scattered.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from drcmitsuba_plugins.bsdf_file import BsdfFile
from drcmitsuba_plugins.bsdf_text import text
from drcmitsuba_plugins.tensor import TensorTree, to_disk

from drcmitsuba.model.materials import BsdfMaterial
from drcmitsuba.model.written_files import written

CELLS = 64
"""Number of outgoing cells along a side of the square, of 2/64 of the disk's radius each."""
SUB = 4
"""Number of points along a side of a cell whose mean is its value."""
NARROWEST = 0.03
"""Roughness below which a lobe is narrower than a cell, and is widened to it [–]."""


@lru_cache(maxsize=16)
def pane(scattered: float, lobe: float, reflectance: float, roughness: float) -> BsdfMaterial:
    """Pane that transmits a share by a lobe and another one evenly.

    Parameters
    ----------
    scattered : float
        Transmittance of evenly scattered light [–].
    lobe : float
        Transmittance of the lobe around the straight direction [–].
    reflectance : float
        Diffuse reflectance of both sides [–].
    roughness : float
        Width α of the lobe [rad]: its density falls to 1/e at δ = α.
    """
    grid = _lobes(max(roughness, NARROWEST)) * lobe + scattered / np.pi
    matt = TensorTree.constant(reflectance / np.pi, rank=3)
    trees = {"tb": TensorTree.of_grid(grid), "rf": matt, "rb": matt}
    name = f"trans {scattered:.4g} {lobe:.4g} {reflectance:.4g} {roughness:.4g}"
    file = BsdfFile(name, name, "", "TensorTree3", trees)
    path = written(text(file, 0.0).encode(), name)
    return BsdfMaterial(type="bsdf", file=path, straight_through="off")


def _lobes(alpha: float) -> np.ndarray:
    """BSDF of lobes of a share of 1 [1/sr], by incident radius and outgoing square, (n, n, n).

    The half of the radii that no direction has is 0.
    """
    s = (np.arange(CELLS * SUB) + 0.5) / (CELLS * SUB)
    x, y = to_disk(*np.meshgrid(s, s, indexing="ij"))
    z = np.sqrt(np.maximum(1 - x * x - y * y, 0))
    grid = np.zeros((CELLS, CELLS, CELLS))
    for i in range(CELLS // 2):
        radii = 1 - 2 * (i + (np.arange(SUB) + 0.5) / SUB) / CELLS
        for r in radii:
            away = 1 - (r * x + np.sqrt(1 - r * r) * z)  # light at (−r, 0) goes straight to (r, 0)
            f = np.exp(-2 * away / alpha**2) / np.sqrt(np.maximum(z, 1e-3))
            cells = f.reshape(CELLS, SUB, CELLS, SUB).mean(axis=(1, 3))
            grid[i] += cells / cells.sum() * CELLS**2 / np.pi / SUB
    return grid
