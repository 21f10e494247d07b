"""Luminances L of the bins of C: sky, ground and suns of every time stamp.

Bins are matched by label, exactly. The sun of a time stamp is one bin, or a few bins that stand for
it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.schema import UnknownLabelsError, positions
from drcmitsuba.sky.sun_models import Blend, mesh

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

sparse = lazy.module("scipy.sparse")

SAME_SUBDIVISION = "compute sky and coefficients with the same subdivision"


def positions_of(coefficients: xr.Dataset, labels: np.ndarray, remedy: str) -> np.ndarray:
    """Positions of bins by label; InputError where one is not among the coefficients' bins."""
    try:
        return positions(labels, coefficients["bin"].values)
    except UnknownLabelsError as error:
        got = f"no {error.labels[0]!r} ({len(error.labels)} bins missing)"
        raise InputError("coefficients", "bin", got, remedy) from None


def sun_luminances(coefficients: xr.Dataset, sky: xr.Dataset) -> csr_matrix:
    """Luminances (time, bin) [cd/m²] of the bins that stand for the sun in the sky's sun model."""
    times = np.flatnonzero(sky["sun"].values > 0)
    known = list(map(str, coefficients["bin"].values))
    if sky.attrs.get("sun_model") == "adaptive":
        directions = sky["sun_direction"].values[times]
        blend = mesh.blend(directions, np.ones(len(times), bool), known)
        lost = int((blend.weights.sum(axis=1) < 0.5).sum())
        if lost:
            raise InputError(
                "coefficients", "bin", f"no mesh of suns about {lost} of the sky's suns",
                "compute coefficients with the adaptive sun model",
            )  # fmt: skip
    elif "blend_bin" in sky:
        blend = Blend(sky["blend_bin"].values[times], sky["blend_weight"].values[times])
    else:
        blend = Blend.own(sky["sun_bin"].values[times])
    rows, k = np.nonzero(blend.weights)
    remedy = "compute coefficients for the time stamps and the sun model of this sky"
    bins = positions_of(coefficients, blend.bins[rows, k], remedy)
    values = blend.weights[rows, k] * sky["sun"].values[times[rows]]
    shape = (sky.sizes["time"], len(known))
    return sparse.csr_matrix((values.astype(np.float32), (times[rows], bins)), shape)


def source_luminances(coefficients: xr.Dataset, sky: xr.Dataset) -> csr_matrix:
    """Luminances L (time, bin) [cd/m²] of the bins of C: sky, ground, and suns of the sun model."""
    patches = positions_of(coefficients, sky["bin"].values, SAME_SUBDIVISION)
    chosen = np.ones(len(patches), np.float32), (np.arange(len(patches)), patches)
    at_bins = sparse.csr_matrix(chosen, (len(patches), coefficients.sizes["bin"]))
    by_patch = sparse.csr_matrix(sky["sky"].values.astype(np.float32))
    return by_patch @ at_bins + sun_luminances(coefficients, sky)


def factors(coefficients: xr.Dataset, sky: xr.Dataset) -> list[tuple[xr.DataArray, csr_matrix]]:
    """Factors of E = Σ C·L, by which other programs multiply.

    Parameters
    ----------
    coefficients, sky : xr.Dataset
        As for `accumulate.by_source`; the coefficients may have a dim `channel`.

    Returns
    -------
    list of (xr.DataArray, csr_matrix)
        Mean C (sensor, bin) [sr] and L (time, bin) [cd/m²]; a second pair for the straight light
        of an adaptive sun, whose bins are the time stamps' own suns.
    """
    pairs = [(coefficients["replicates"].mean("replicate"), source_luminances(coefficients, sky))]
    if "sun_straight" in coefficients:
        own, shining = own_suns(coefficients, sky)
        pairs.append((own["straight"], sun_luminances(own, shining)))
    return pairs


def own_suns(coefficients: xr.Dataset, sky: xr.Dataset) -> tuple[xr.Dataset, xr.Dataset]:
    """Straight C of the time stamps' own suns, beside those of the mesh, and the sky with them."""
    own = coefficients[["sun_straight", "sun_straight_se"]]
    own = own.rename(sun="bin", sun_straight="straight", sun_straight_se="straight_se")
    return own, sky.assign_attrs(sun_model="true_sun")
