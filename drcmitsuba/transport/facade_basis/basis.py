"""A façade basis, and the coefficients of any composition from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from drcmitsuba.runtime import lazy
from drcmitsuba.schema import mean_and_error, positions
from drcmitsuba.transport.coefficient_arrays import with_values, without_values
from drcmitsuba.transport.facade_basis.facade import BITS, HITS, MOST_ELEMENTS, Palette, Tiles
from drcmitsuba.transport.gather.marked_paths import MarkedVertices

sparse = lazy.module("scipy.sparse")


class Returned(MarkedVertices):
    """Vertices of paths that met the façade from inside, see `facade.Meetings` for their marks."""

    def weighed(self, share: np.ndarray) -> np.ndarray:
        """Weights times the shares of the elements that the paths met, shape (vertex,)."""
        factor = np.concatenate([[1.0], share.ravel()]).astype(np.float32)
        weight = self.weight
        for i in range(HITS):
            weight = weight * factor[(self.mark >> (BITS * i)) & MOST_ELEMENTS]
        return weight


@dataclass(frozen=True)
class Basis:
    """Coefficients of every element of a façade.

    Parameters
    ----------
    points : np.ndarray, shape (sensor, 3)
        Positions of the sensors [m].
    labels : tuple of str
        Bins: ground, sky patches, and the suns before the façade.
    suns : tuple of str
        All suns; C of the suns behind the façade is 0.
    elements : np.ndarray of int, shape (element,)
        tile · materials + material of every element that lets light in.
    straight_elements : np.ndarray of int
        Elements that straight light passes.
    total : np.ndarray, shape (element, group, bin, sensor)
        C of a tile filled with one material, without light that the façade sends back [sr].
    scattering_elements : np.ndarray of int
        Elements that scatter light.
    straight : np.ndarray, shape (straight element, group, bin, sensor)
        Part of `total` that comes straight [sr].
    scattered : np.ndarray or None, shape (scattering element, group, bin, sensor)
        Part of `total` that an element scattered and that met no other surface [sr]; None with a
        single group.
    grouped : np.ndarray, shape (element, group, bin, block)
        Mean D of blocks of cells [sr].
    returned : Returned
        Vertices of paths that met the façade.
    """

    tiles: Tiles
    palette: Palette
    points: np.ndarray
    labels: tuple[str, ...]
    suns: tuple[str, ...]
    elements: np.ndarray
    straight_elements: np.ndarray
    scattering_elements: np.ndarray
    total: np.ndarray
    straight: np.ndarray
    scattered: np.ndarray | None
    grouped: np.ndarray
    returned: Returned

    @property
    def nbytes(self) -> int:
        """Memory of the arrays [bytes]."""
        arrays = (self.total, self.straight, self.scattered, self.grouped, *self.returned)
        return sum(a.nbytes for a in arrays if a is not None)

    def sent_back(self, share: np.ndarray) -> np.ndarray:
        """C of light that the façade sent back at least once, (group, bin, sensor) [sr]."""
        groups, sensors = self.total.shape[1], self.total.shape[3]
        blocks = self.grouped.shape[3]
        weight = self.returned.weighed(share)
        G = sparse.csr_matrix(
            (weight, (self.returned.row, self.returned.block)), (groups * sensors, blocks)
        ).toarray().reshape(groups, sensors, blocks)  # fmt: skip
        D = _mixed(share.ravel()[self.elements], self.grouped)
        return np.stack([d @ g.T for d, g in zip(D, G, strict=True)])

    def totals(self, share: np.ndarray) -> np.ndarray:
        """Compute C of a composition.

        Parameters
        ----------
        share : np.ndarray, shape (tile, material)
            Shares of the tiles' area; rows sum to 1.

        Returns
        -------
        np.ndarray, shape (group, bin, sensor)
            C [sr].
        """
        return _mixed(share.ravel()[self.elements], self.total) + self.sent_back(share)

    def coefficients(self, share: np.ndarray) -> xr.Dataset:
        """Coefficients of one state of a composition, as from `coefficients.compute`.

        The bins are ground, sky patches and all suns. A basis needs two groups or more.
        """
        total = self.totals(share)
        assert self.scattered is not None, "kept with two groups or more"
        straight = _mixed(share.ravel()[self.straight_elements], self.straight)
        direct = straight + _mixed(share.ravel()[self.scattering_elements], self.scattered)
        parts = {"straight": straight, "direct": direct, "interreflected": total - direct}
        sky = [label for label in self.labels if not label.startswith("sun_")]
        labels = [*sky, *self.suns]
        column = positions(labels, self.labels, missing=-1)

        def whole(values: np.ndarray) -> np.ndarray:
            """Reorder (…, bin, sensor) to (…, sensor, all bins)."""
            out = np.moveaxis(values, -2, -1)[..., column]
            out[..., column < 0] = 0
            return out

        data: dict[str, np.ndarray] = {}
        for name, values in parts.items():
            data[name], data[f"{name}_se"] = map(whole, mean_and_error(values))
        return with_values(without_values(labels, self.points), data, whole(total))


def _mixed(weights: np.ndarray, arrays: np.ndarray) -> np.ndarray:
    """Σ weight · array over the first axis."""
    used = np.flatnonzero(weights)
    if len(used) == 0:
        return np.zeros(arrays.shape[1:], np.float32)
    out = weights[used[0]] * arrays[used[0]]
    product = np.empty_like(out)
    for i in used[1:]:
        np.multiply(weights[i], arrays[i], out=product)
        out += product
    return out
