"""Straight sun by tiles as they are built: cut into panes of one material each.

A search mixes the materials of a tile, so that a third of glass lets a third of the sun through to
every sensor. Built, the tile has a pane of glass, and some sensors have the whole sun: other hours
exceed a threshold. Sun that reaches a sensor by a tile passes it at one height, give or take half a
sun, which tells the pane. Hard numbers follow that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drcmitsuba.design.facade_tiles import Tiles
from drcmitsuba.design.realise import LEAST_PANE, cut_tiles
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.scene.geometry import normals
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.elements.straight_pairs import NO_MIRROR, StraightPairs

THIN = 1e-5
"""Least height of the part of a sun that passes a tile [m]."""


@dataclass(frozen=True, eq=False)
class CutTiles:
    """Tiles of an upright façade, each of which is cut into panes one above the other."""

    tiles: Tiles
    materials: tuple[str, ...]
    """Names of the materials, the columns of a composition."""
    film: str
    quads: np.ndarray
    """Corners of a pane of every element, those of the tiles with each of their materials first,
    fronts into the room, in the traced frame [m], shape (element, 4, 3)."""
    points: np.ndarray
    """Positions of the sensors in the traced frame [m], shape (sensor, 3)."""
    suns: Suns

    def passed(self, pairs: StraightPairs, labels: Sequence[str]) -> StraightPairs:
        """Tell the heights at which suns pass tiles on their way to sensors.

        Parameters
        ----------
        pairs : StraightPairs
            Pairs whose elements are the tiles with each of their materials, then others.
        labels : sequence of str, shape (bin,)
            Labels of the bins.
        """
        bin_, sensor = np.divmod(pairs.place.numpy().astype(np.int64), pairs.shape[1])
        element = pairs.element.numpy()
        tile = element // len(self.materials)
        number = {label: i for i, label in enumerate(self.suns.labels)}
        sun = np.array([number.get(label, -1) for label in labels])[bin_]
        here = np.flatnonzero((tile < len(self.tiles)) & (sun >= 0))
        p = self._seen_from(self.points[sensor[here]], pairs.mirror.numpy()[here])
        tile, d, quads = tile[here], self.suns.directions[sun[here]], self.quads[element[here]]
        n = normals(quads)
        t = ((quads[:, 0] - p) * n).sum(axis=1) / (d * n).sum(axis=1)
        foot, head = self.tiles.bounds[tile, 2:].T
        height = foot + p[:, 2] + t * d[:, 2] - quads[..., 2].min(axis=1)
        half = 0.5 * t * np.radians(self.suns.diameter) / np.hypot(d[:, 0], d[:, 1])
        lower, upper = np.full((2, len(sensor)), np.nan)
        # Of a sun at an edge of the tile, C has what passes within.
        lower[here] = np.clip(height - half, foot, head - THIN)
        upper[here] = np.clip(height + half, lower[here] + THIN, head)
        return replace(pairs, lower=flat(lower), upper=flat(upper))

    def _seen_from(self, p: np.ndarray, mirror: np.ndarray) -> np.ndarray:
        """Places p (pair, 3) [m], or their images in the panes of elements that mirror light."""
        out, mirrored = p.copy(), np.flatnonzero(mirror != NO_MIRROR)
        pane = self.quads[mirror[mirrored]]
        n = normals(pane)
        height = ((p[mirrored] - pane[:, 0]) * n).sum(axis=1, keepdims=True)
        out[mirrored] -= 2 * height * n
        return out

    def spans(self, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper edge of each material in every tile [m], shape (tile, material); 0 where
        there is none, and of walls.
        """
        low, high = np.zeros((2, *share.shape))
        names, bottom = [*self.materials], self.tiles.bounds[:, 2]
        for left in np.unique(self.tiles.bounds[:, 0]):
            column = np.flatnonzero(self.tiles.bounds[:, 0] == left)
            column = column[np.argsort(bottom[column])]
            every = cut_tiles(self.tiles, share, column, names, self.film, LEAST_PANE)
            for tile, pieces in zip(column, every, strict=True):
                for foot, head, name in pieces:
                    if name != "wall":
                        low[tile, names.index(name)], high[tile, names.index(name)] = foot, head
        return low, high
