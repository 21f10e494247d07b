"""Colour channels of a BSDF from its luminance and chromaticity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from drcmitsuba_plugins.klems_basis import KlemsMatrix
from drcmitsuba_plugins.tensor import TensorTree

# From CIE XYZ to linear red, green, blue (ITU-R BT.709, white D65). Chromaticities of BSDF files
# are relative to equal-energy white, as those of Radiance: a neutral material has X = Y = Z.
_D65 = (0.95047, 1.0, 1.08883)
_RGB = (
    np.array(
        [
            [3.2404542, -1.5371385, -0.4985314],
            [-0.9692660, 1.8760108, 0.0415560],
            [0.0556434, -0.2040259, 1.0572252],
        ]
    )
    * _D65
)


def mixed(
    luminance: TensorTree | KlemsMatrix,
    chromaticity: dict[str, TensorTree | KlemsMatrix],
    mix: tuple[float, ...],
) -> TensorTree | KlemsMatrix:
    """Sum of the channels red, green and blue of a component, each times a weight.

    Parameters
    ----------
    luminance : TensorTree or KlemsMatrix
    chromaticity : dict
        CIE 1976 u′ and v′ as 'u', 'v' (trees), or the values X and Z (Klems); a missing one counts
        as neutral.
    mix : tuple of 3 floats, or of one
        Weights; a sum below 0 counts as 0. One weight multiplies the luminance alone.

    Returns
    -------
    TensorTree or KlemsMatrix
        f [1/sr] relative to the light's white: a neutral material has the same in all channels.
    """
    known = {"X", "Z"} if isinstance(luminance, KlemsMatrix) else {"u", "v"}
    if len(mix) == 1 or not known <= chromaticity.keys():
        return replace(luminance, value=sum(mix) * luminance.value)
    if isinstance(luminance, KlemsMatrix):
        xyz = [chromaticity["X"].value, luminance.value, chromaticity["Z"].value]
        return replace(luminance, value=_mixed(mix, xyz))
    y, u, v = refined([luminance, chromaticity["u"], chromaticity["v"]])
    v_safe = np.maximum(v.value, 1e-6)
    x_value = y.value * 9 * u.value / (4 * v_safe)
    z_value = y.value * (12 - 3 * u.value - 20 * v.value) / (4 * v_safe)
    return replace(y, value=_mixed(mix, [x_value, y.value, z_value]))


def _mixed(mix: tuple[float, ...], xyz: list[np.ndarray]) -> np.ndarray:
    """Weighted sum of the linear channels of X, Y, Z, which are clipped to their gamut."""
    channels = (sum(w * part for w, part in zip(row, xyz, strict=True)) for row in _RGB)
    return np.maximum(sum(w * np.maximum(c, 0) for w, c in zip(mix, channels, strict=True)), 0)


def refined(trees: list[TensorTree]) -> list[TensorTree]:
    """Trees of equal values over their common refinement: all have the same leaves."""
    rank, depth = trees[0].rank, max(t.depth for t in trees)
    starts = [t.start << rank * (depth - t.depth) for t in trees]
    start = np.unique(np.concatenate(starts))
    gap = np.diff(np.append(start, np.int64(1) << rank * depth))
    level = depth - np.round(np.log2(gap) / rank).astype(int)
    return [
        TensorTree(rank, depth, start, level, t.value[np.searchsorted(s, start, "right") - 1])
        for t, s in zip(trees, starts, strict=True)
    ]
