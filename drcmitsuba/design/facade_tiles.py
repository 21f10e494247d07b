"""Tiles of a searched façade, and the elements that fill them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import xarray as xr

from drcmitsuba.annual.simulation import joined_channels
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, SHADED, GroupStates
from drcmitsuba.design.facade_glare import LitOpenings, TracedEyes
from drcmitsuba.design.facade_groups import FacadeGroups
from drcmitsuba.runtime.progress import Stage
from drcmitsuba.scene.materials import shade_covers
from drcmitsuba.scene.panes_in_state import grouped_panes
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.tiled_facades import TiledFacades
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.transport.elements import LightByElement
from drcmitsuba.transport.elements.light_of_surfaces import AnyLight


@dataclass(frozen=True)
class Tiles:
    """Rectangles of a façade, each with one composition."""

    bounds: np.ndarray
    """Left, right, bottom and top from the foot of the wall [m], shape (tile, 4)."""
    names: tuple[str, ...] = ()
    """Names of tiles that are panes or walls of a model."""
    filled: np.ndarray | None = None
    """Share of every rectangle that is the tile's [–], shape (tile,); None for all of it."""

    def __len__(self) -> int:
        """Count the tiles."""
        return len(self.bounds)

    @cached_property
    def area(self) -> np.ndarray:
        """Area of every tile, shape (tile,) [m²]."""
        left, right, bottom, top = self.bounds.T
        return (right - left) * (top - bottom) * (1.0 if self.filled is None else self.filled)


@dataclass(frozen=True)
class FacadeParts:
    """Tiles of a searched façade in the words and areas of a report."""

    area: float
    """Area of the façade, of the walls, or of the panes that are searched [m²]."""
    fills: tuple[tuple[str, ...], ...]
    """Name of each material of every tile, the columns of a composition."""
    places: tuple[str, ...]
    """Place of every tile, such as "Room_1 (south)"; "" in a room of boxes."""
    upright: np.ndarray
    """Whether the heights of a tile are those of the façade, bool, shape (tile,)."""
    glass: Mapping[str, float]
    """Area of all panes as drawn by their material [m²]."""


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
    closings: tuple[np.ndarray, ...]
    """Matrices (element, element) that turn shares into those of each state but the open one, that
    of the shade before all that it covers first."""
    channels: tuple[AnyLight, ...]
    """Light of every colour channel; one of a grey case."""
    groups: FacadeGroups | None = None
    """Groups of panes that close one by one; None where one shade closes."""
    place: np.ndarray | None = None
    """Place of every element in a composition, −1 for one of other panes, int, shape (element,),
    where `as_drawn` has shares of all elements; None where the searched ones come first."""
    group: np.ndarray | None = None
    """Number of every element's group, −1 for none, int, shape (element,); likewise."""
    openings: LitOpenings | None = None
    """Openings that the light was traced by, and the eyes; None where no glare is asked for."""
    quads: np.ndarray | None = None
    """Corners of a pane of every element, fronts into the room, in the traced frame [m], shape
    (element, 4, 3); None of a model."""

    @classmethod
    def of(
        cls, tiled: TiledFacades, tiles: int, channels: tuple[AnyLight, ...],
        groups: FacadeGroups | None = None, openings: LitOpenings | None = None,
    ) -> TiledLight:  # fmt: skip
        """Put light to tiles.

        Parameters
        ----------
        tiled : TiledFacades
            Tiles of a grid, from `TiledFacades.of_grid`.
        tiles : int
            Number of tiles of the grid, which come first.
        channels : tuple of AnyLight
            Light of all tiles in every colour channel.
        groups : FacadeGroups, optional
            Groups of panes that close one by one, see `groups_of`; by default one shade closes.
        openings : LitOpenings, optional
        """
        (drawn,) = tiled.drawn
        others = [drawn[g] for g in range(tiles, len(tiled.fills))]
        elements, places = tiled.panes.states.starts[-1], [*_places(tiled, groups)]
        panes = grouped_panes(tiled.case, groups=tiled.panes)
        quads = {each.group: each.quads[0] for each in panes}  # a tile of the grid is a rectangle
        return cls(
            tiles=Tiles(np.array([tile[0] for tile in tiled.rectangles[:tiles]])),
            materials=tiled.fills[0],
            names=tuple(name for names in tiled.fills for name in names),
            as_drawn=np.concatenate([np.zeros(0, np.float32), *others]),
            is_open=tiled.is_open,
            closings=closing_matrices(elements, places, groups),
            channels=channels,
            groups=groups,
            group=None if groups is None else group_of_elements(elements, places),
            openings=openings,
            quads=np.array([quads[g] for g, names in enumerate(tiled.fills) for _ in names]),
        )

    def eyes(self, daylight: Daylight, stage: Stage) -> TracedEyes | None:
        """Eyes, and what they see by the same elements; None where no glare is asked for."""
        lit = self.openings
        if lit is None:
            return None
        return lit.eyes.traced(
            lit.case, lit.panes, daylight, lit.effects, self.is_open, self.closings, stage
        )

    def shares(self, composition: np.ndarray, state: int = 0) -> np.ndarray:
        """Shares of all elements, shape (element,).

        Parameters
        ----------
        composition : np.ndarray, shape (tile, material)
            Shares of the tiles' area, the shade open; rows sum to 1.
        state : int
            0 with everything open, 1 with the shade before all that it covers, more for further
            states of `groups`, in their order.
        """
        given = np.asarray(composition, np.float32)
        if self.place is None:
            shares = np.append(given, self.as_drawn)
        else:
            shares = np.where(self.place < 0, self.as_drawn, given.ravel()[self.place])
        return shares @ self.closings[state - 1] if state else shares

    def scaled(self, scale: Mapping[str, float]) -> TiledLight:
        """Light with factors of what comes in by some materials: other transmittances."""
        if not scale:
            return self
        factors = np.array([scale.get(name, 1.0) for name in self.names])
        return replace(self, channels=tuple(light.scaled(factors) for light in self.channels))

    def coefficients(self, composition: np.ndarray, state: int = 0) -> xr.Dataset:
        """Coefficients of a composition [sr]; arguments as for `shares`."""
        shares = self.shares(composition, state)
        return joined_channels([light.coefficients(shares) for light in self.standing(state)])

    def standing(self, state: int) -> tuple[LightByElement, ...]:
        """Light of every channel by the surfaces that stand in a state, as for `shares`."""
        still = self.still(state)
        return tuple(light.standing(still) for light in self.channels)

    def still(self, state: int) -> np.ndarray:
        """Shares of all elements in empty tiles, shape (element,); `state` as for `shares`."""
        return self.shares(np.zeros((len(self.tiles), len(self.materials))), state)


def groups_of(tiled: TiledFacades, case: Case, time: xr.DataArray) -> FacadeGroups | None:
    """Groups of panes of a case whose façade is cut into tiles; None where one shade closes.

    Without `[groups]`, those tiles form a group that face one direction and may be clear.
    """
    states = prepared(case).groups.states
    if not case.groups:
        clear = dict.fromkeys(
            facing
            for g, ((facing, *_), names) in enumerate(
                zip(tiled.panes.facings, tiled.fills, strict=True)
            )
            if any(shade_covers(tiled.panes.material(None, g, k)) for k in range(len(names)))
        )
        if case.shading is None or case.shading.groups == "together" or len(clear) < 2:
            return None
        states = GroupStates((*clear,), ((OPEN, SHADED),) * len(clear))
    return FacadeGroups.of_case(case, states, time)


class Place(NamedTuple):
    """Element that a group of panes changes."""

    element: int
    group: int
    """Number of the group; 0 where one shade closes."""
    further: tuple[int, ...]
    """Element that stands in its place in each state of the group after the first."""


def closing_matrices(
    elements: int, places: Sequence[Place], groups: FacadeGroups | None
) -> tuple[np.ndarray, ...]:
    """Matrices of `TiledLight.closings`; without groups, the one state is that of the shade."""
    matrices = []
    for row in [None] if groups is None else groups.indices[1:].tolist():
        matrix = np.eye(elements, dtype=np.float32)
        for element, group, further in places:
            index = 1 if row is None else row[group]
            if index:
                matrix[element, element] = 0
                matrix[element, further[index - 1]] = 1
        matrices.append(matrix)
    return tuple(matrices)


def group_of_elements(elements: int, places: Sequence[Place]) -> np.ndarray:
    """Group of every element, −1 for none, int, shape (element,)."""
    out = np.full(elements, -1)
    for place in places:
        out[place.element] = place.group
    return out


def _places(tiled: TiledFacades, groups: FacadeGroups | None) -> Iterator[Place]:
    """Yield the elements of tiles that a group, or the shade, changes."""
    starts, own = tiled.panes.states.starts, tiled.grouped
    names_of = None if groups is None else groups.rule.groups.names
    for g, (first, names) in enumerate(zip(starts, tiled.fills, strict=False)):
        for k in range(len(names)):
            if own is not None:
                if (member := own[g][k]) is not None:
                    further = tuple(first + f for f in member.fills)
                    yield Place(first + k, member.group, further)
            elif tiled.shade in names[1:] and shade_covers(tiled.panes.material(None, g, k)):
                number = 0 if names_of is None else names_of.index(tiled.panes.facings[g][0])
                yield Place(first + k, number, (first + names.index(tiled.shade, 1),))
