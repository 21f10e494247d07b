"""Tiles of a searched façade, and the elements that fill them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr

from drcmitsuba.annual.simulation import joined_channels
from drcmitsuba.scene.materials import shade_covers
from drcmitsuba.scene.tiled_facades import TiledFacades
from drcmitsuba.transport.elements import LightByElement


@dataclass(frozen=True)
class Tiles:
    """Rectangles of a façade, each with one composition."""

    bounds: np.ndarray
    """Left, right, bottom and top from the foot of the wall [m], shape (tile, 4)."""

    def __len__(self) -> int:
        """Count the tiles."""
        return len(self.bounds)

    @cached_property
    def area(self) -> np.ndarray:
        """Area of every tile, shape (tile,) [m²]."""
        left, right, bottom, top = self.bounds.T
        return (right - left) * (top - bottom)


@dataclass(frozen=True, eq=False)
class TiledLight:
    """Light of a room by tile and material, of which any composition of a façade is put together.

    An *element* is a tile with one of its materials: those of the searched façade come first, tile
    by tile, followed by those of the tiles of the other glazed sides, which stay as drawn.
    """

    tiles: Tiles
    """Tiles of the searched façade."""
    materials: tuple[str, ...]
    """Materials that its tiles may be filled with, the columns of a composition."""
    names: tuple[str, ...]
    """Material of every element."""
    as_drawn: np.ndarray
    """Shares of the elements of other sides, the shade open, shape (other element,)."""
    is_open: np.ndarray
    """Whether an element may have a share while the shade is open, bool, shape (element,)."""
    closing: np.ndarray
    """Matrix (element, element) that turns shares into those with the shade before clear panes."""
    channels: tuple[LightByElement, ...]
    """Light of every colour channel; one of a grey case."""

    @classmethod
    def of(
        cls, tiled: TiledFacades, tiles: int, channels: tuple[LightByElement, ...]
    ) -> TiledLight:
        """Put light to tiles.

        Parameters
        ----------
        tiled : TiledFacades
            Tiles of a grid, from `TiledFacades.of_grid`.
        tiles : int
            Number of tiles of the grid, which come first.
        channels : tuple of LightByElement
            Light of all tiles in every colour channel.
        """
        (drawn,) = tiled.drawn
        others = [drawn[g] for g in range(tiles, len(tiled.fills))]
        return cls(
            tiles=Tiles(np.array([tile[0] for tile in tiled.rectangles[:tiles]])),
            materials=tiled.fills[0],
            names=tuple(name for names in tiled.fills for name in names),
            as_drawn=np.concatenate([np.zeros(0, np.float32), *others]),
            is_open=tiled.is_open,
            closing=_closing(tiled),
            channels=channels,
        )

    def shares(self, composition: np.ndarray, *, closed: bool = False) -> np.ndarray:
        """Shares of all elements, shape (element,).

        Parameters
        ----------
        composition : np.ndarray, shape (tile, material)
            Shares of the tiles' area, the shade open; rows sum to 1.
        closed : bool
            Whether the shade stands before all clear panes.
        """
        shares = np.append(np.asarray(composition, np.float32), self.as_drawn)
        return shares @ self.closing if closed else shares

    def coefficients(self, composition: np.ndarray, *, closed: bool = False) -> xr.Dataset:
        """Coefficients of a composition [sr]; arguments as for `shares`."""
        shares = self.shares(composition, closed=closed)
        return joined_channels([light.coefficients(shares) for light in self.channels])


def _closing(tiled: TiledFacades) -> np.ndarray:
    """Matrix of `TiledLight.closing`."""
    starts = tiled.panes.states.starts
    matrix = np.eye(starts[-1], dtype=np.float32)
    for g, (first, names) in enumerate(zip(starts, tiled.fills, strict=False)):
        if tiled.shade not in names[1:]:
            continue
        for k in range(len(names)):
            material = tiled.panes.material(None, g, k)
            if shade_covers(material):
                matrix[first + k, first + k] = 0
                matrix[first + k, first + names.index(tiled.shade, 1)] = 1
    return matrix
