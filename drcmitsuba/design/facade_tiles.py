"""Tiles of a searched façade, and the elements that fill them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr

from drcmitsuba.annual.simulation import joined_channels
from drcmitsuba.case.case import Case
from drcmitsuba.runtime.toml import Side
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
        cls, case: Case, side: Side, heights: np.ndarray, segments: int, fills: tuple[str, ...],
        light: Callable[[TiledFacades], tuple[LightByElement, ...]],
    ) -> TiledLight:  # fmt: skip
        """Cut a side of a case by a grid; arguments as for `TiledFacades.of_grid`.

        `light` gives the light of the tiles, channel by channel. Errors are those of `of_grid`,
        and of `light`.
        """
        tiled = TiledFacades.of_grid(case, side, heights, segments, fills)
        (drawn,), tiles = tiled.drawn, segments * (len(heights) - 1)
        grid = [tile[0] for tile in tiled.rectangles[:tiles]]
        others = [drawn[g] for g in range(tiles, len(tiled.fills))]
        as_drawn = np.concatenate([np.zeros(0, np.float32), *others])
        of_grid = np.tile([name in fills for name in tiled.fills[0]], tiles)
        shade = None if case.shading is None else case.shading.material
        return cls(
            tiles=Tiles(np.array(grid)),
            materials=tiled.fills[0],
            names=tuple(name for names in tiled.fills for name in names),
            as_drawn=as_drawn,
            is_open=np.append(of_grid, as_drawn > 0),
            closing=_closing(tiled, shade),
            channels=light(tiled),
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


def _closing(tiled: TiledFacades, shade: str | None) -> np.ndarray:
    """Matrix of `TiledLight.closing`."""
    starts = tiled.panes.states.starts
    matrix = np.eye(starts[-1], dtype=np.float32)
    for g, (first, names) in enumerate(zip(starts, tiled.fills, strict=False)):
        if shade not in names[1:]:
            continue
        for k in range(len(names)):
            material = tiled.panes.material(None, g, k)
            if shade_covers(material):
                matrix[first + k, first + k] = 0
                matrix[first + k, first + names.index(shade, 1)] = 1
    return matrix
