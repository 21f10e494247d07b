"""Openings of a model that a search fills: panes that may take a film, and tiles of its walls.

case ─ TiledWalls ─► drawn, clear, film: three variants of one model
─ SharedFacades ─► openings and fills ─► light by element ─► TiledLight
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import xarray as xr

from drcmitsuba.annual.light_with_surfaces import light_with_surfaces
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.variants import SharedElements, joined_effects
from drcmitsuba.case.case import Case
from drcmitsuba.case.design import Design
from drcmitsuba.design.facade_groups import FacadeGroups
from drcmitsuba.design.facade_tiles import (
    FacadeParts,
    Place,
    TiledLight,
    Tiles,
    closing_matrices,
    group_of_elements,
)
from drcmitsuba.design.model_windows import CLEAR, clear_of, tiled_walls, tiles_of, with_fill
from drcmitsuba.model.model import areas
from drcmitsuba.plan import notes, plan
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Stage
from drcmitsuba.runtime.toml import choose, fits, shortened
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.like_panes import NO_GROUP, LikePanes, like_panes
from drcmitsuba.scene.pane_groups import further_materials
from drcmitsuba.scene.panes_of_model import panes_of_model
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.shared_facades import SharedFacades
from drcmitsuba.scene.tiled_walls import TiledWalls
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.transport.elements.light_of_surfaces import AnyLight


@dataclass(frozen=True)
class SearchedOpenings:
    """Openings of a model with the fills that a search weighs."""

    variants: tuple[Case, Case, Case]
    """The case as drawn, with clear panes in all that is searched, and with the film there; the
    first two are one where panes are searched."""
    film: str
    clear: str
    """Name of the fill that is not the film: a material, or `CLEAR`."""
    every: tuple[LikePanes, ...]
    """All panes and tiles to the outside by material and direction."""
    searched: tuple[int, ...]
    """Indices of the panes or tiles that are searched."""
    facades: SharedFacades
    """Openings and fills of the variants."""
    walls: TiledWalls | None = None
    """Walls that are cut into tiles; None where panes are searched."""

    @classmethod
    def of_panes(cls, case: Case, film: str, names: Collection[str]) -> SearchedOpenings:
        """Panes of some names, as from `meant_panes`."""
        every = tuple(like_panes(case))
        searched = tuple(g for g, panes in enumerate(every) if str(panes) in names)
        covered = with_fill(case, film, [every[g].name for g in searched])
        facades = SharedFacades.of([case, case, covered])
        return cls((case, case, covered), film, CLEAR, every, searched, facades)

    @classmethod
    def of_walls(cls, case: Case, design: Design, film: str) -> SearchedOpenings:
        """Tiles of the walls that `[design]` names, then the panes that it names, if any.

        Errors are those of `TiledWalls.of` and `meant_panes`; a material of these panes cannot be
        that of new windows.
        """
        clear, walls = clear_of(case, design), tiled_walls(case, design)
        names = meant_panes(case, design) if design.panes or design.groups else ()
        panes = {panes.layer: panes for panes in like_panes(walls.case)}
        old = [panes.name for panes in like_panes(case) if str(panes) in names]
        if clear in old:
            got = f"{shortened(clear)} is a material of the panes that are searched, too"
            raise InputError(case.source, "design.clear", got, "give new windows another one")
        tiles = {walls.case.building.layers[i].name: panes[i] for i in walls.layers}
        glazed, covered = (with_fill(walls.case, name, tiles, tiles) for name in (clear, film))
        covered = with_fill(covered, film, old)
        every = tuple(like_panes(glazed))
        at = {panes.layer: g for g, panes in enumerate(every)}
        facades = SharedFacades.of([walls.case, glazed, covered])
        searched = [at[i] for i in walls.layers]
        searched += [g for g, panes in enumerate(every) if str(panes) in names]
        variants = walls.case, glazed, covered
        return cls(variants, film, clear, every, tuple(searched), facades, walls)

    @property
    def panes(self) -> tuple[LikePanes, ...]:
        """Panes that are searched, whose tiles come last."""
        count = 0 if self.walls is None else len(self.walls.tiles)
        return tuple(self.every[g] for g in self.searched[count:])

    @property
    def fills(self) -> tuple[str, str, str]:
        """Names of the columns of a composition; panes are never wall."""
        return "wall", self.clear, self.film

    def light(
        self, case: Case, light: Daylight, run: Run
    ) -> tuple[tuple[AnyLight, ...], EnabledEffects]:
        """Light of all openings with all of their fills, and the effects that it holds.

        Of the surfaces that states bring, only those of the drawn states stand.
        """
        accuracy = run.accuracy(case)
        filled = [each.with_tables(accuracy=case.accuracy) for each in self.variants[1:]]
        scope = joined_effects([plan(each, light).scope for each in filled])
        facades = self.facades
        with run.timed("light by pane") as done:
            channels = light_with_surfaces(
                facades.case, facades.panes, facades.bringing, light.suns, accuracy, scope, done
            )
        return channels, scope

    def simulated(self, case: Case, light: Daylight, stage: Stage) -> SharedElements:
        """Light by the samples of a case, from which it is evaluated."""
        run = replace(Run.of(case), stage=stage)
        channels, scope = self.light(case, light, run)
        planned, remarks = [plan(case, light)], [notes(case)]
        return SharedElements(light, self.facades, planned, scope, channels, remarks, run)

    @property
    def clear_materials(self) -> tuple[str, ...]:
        """Names of the clear materials that the film shares tiles with."""
        of_walls = () if self.walls is None else (self.clear,)
        return (*of_walls, *dict.fromkeys(panes.name for panes in self.panes))

    @cached_property
    def names(self) -> tuple[tuple[str, ...], ...]:
        """Names of every element's material; fills of equal values are one and have several."""
        names = [dict[str, None]() for _ in range(self._count)]
        for g, column, element in self._standing():
            own = column == 1 and not self._is_tile(g)
            names[element][self.every[g].name if own else self.fills[column]] = None
        for place, materials in self._closings():
            for element, name in zip(place.further, materials, strict=False):
                names[element][name] = None  # those of a model's own states have none
        return tuple(map(tuple, names))

    def refuse_shared(self, field: str, material: str) -> None:
        """Refuse a material whose light is not that of elements of its own.

        Raises
        ------
        InputError
            No pane takes the material, it stands within rooms, or another one has its values.
        """
        case = self.variants[0]
        panes, own = panes_of_model(case.building), [n for n in self.names if material in n]
        inside = {case.building.layers[i].name for i in panes.layer[~panes.outside]}
        others = [name for names in own for name in names if name != material]
        if not own:
            got, remedy = f"no pane takes {shortened(material)}", "leave it out"
        elif material in inside:
            got = f"{shortened(material)} stands within rooms, too"
            remedy = "give panes to the outside a material of their own"
        elif others:
            got = f"{shortened(material)} and {shortened(others[0])} are the same"
            remedy = "give one of them other values"
        else:
            return
        raise InputError(case.source, field, got, remedy)

    def parts(self) -> FacadeParts:
        """Tiles of walls and panes in words and areas."""
        layers, walls, glass = self.variants[1].building.layers, self.walls, dict[str, float]()
        places = [] if walls is None else [walls.walls[tile.wall] for tile in walls.tiles]
        named = [f"{wall.space} ({wall.facing})" for wall in places]
        fills = [("wall", self.clear, self.film)] * len(named)
        fills += [("wall", panes.name, self.film) for panes in self.panes]
        for g, panes in enumerate(self.every):
            if not self._is_tile(g):
                area = float(areas(layers[panes.layer].quads[panes.quads]).sum())
                glass[panes.name] = glass.get(panes.name, 0.0) + area
        upright = np.arange(len(fills)) < len(named)
        area = float(self.tiles.area.sum()) if walls is None else walls.area
        return FacadeParts(area, tuple(fills), (*named, *map(str, self.panes)), upright, glass)

    def tiled(self, channels: tuple[AnyLight, ...], time: xr.DataArray) -> TiledLight:
        """Light as tiles of a façade have it."""
        count = self._count
        place, still = np.full(count, -1), np.zeros(count, np.float32)
        is_open = np.zeros(count, bool)
        tile_of = {g: tile for tile, g in enumerate(self.searched)}
        for g, column, element in self._standing():
            is_open[element] = True
            if g in tile_of:
                place[element] = 3 * tile_of[g] + column
            else:
                still[element] = 1
        for place_of_surfaces, _ in self._bringing():
            still[place_of_surfaces.element] = 1
        groups = self.groups(time)
        by_element = {place.element: place for place, _ in self._closings()}
        places = [] if groups is None else [*by_element.values()]
        several = groups is not None and len(groups.rule.groups) > 1
        return TiledLight(
            tiles=self.tiles,
            materials=self.fills,
            names=tuple(names[0] if names else "" for names in self.names),
            as_drawn=still,
            is_open=is_open,
            closings=closing_matrices(count, places, groups),
            channels=channels,
            groups=groups,
            group=group_of_elements(count, places) if several else None,
            place=place,
        )

    @property
    def _count(self) -> int:
        """Number of elements."""
        return self.facades.panes.states.starts[-1]

    def _is_tile(self, g: int) -> bool:
        """Whether an opening is a tile of a wall."""
        return self.walls is not None and self.every[g].layer in self.walls.layers

    def _standing(self) -> Iterator[tuple[int, int, int]]:
        """Yield panes or tile, column and element of what may stand while all is open.

        Panes are no wall, and those that are not searched stay as drawn.
        """
        starts = self.facades.panes.states.starts
        for g in range(len(self.every)):
            for column, rows in enumerate(self.facades.drawn):
                if column == 1 or (g in self.searched and (column or self._is_tile(g))):
                    yield g, column, starts[g] + int(rows[g].argmax())

    @property
    def tiles(self) -> Tiles:
        """Tiles of walls, and of panes."""
        layers = self.variants[1].building.layers
        size = [areas(layers[panes.layer].quads[panes.quads]).sum() for panes in self.panes]
        return tiles_of(
            self.walls, np.array(size), tuple(str(self.every[g]) for g in self.searched)
        )

    def groups(self, time: xr.DataArray) -> FacadeGroups | None:
        """Groups of panes that close; None where nothing ever does; errors as of `FacadeGroups`."""
        case = self.variants[1]
        states = prepared(case).groups.states
        if not any(states.closable):
            return None
        return FacadeGroups.of_case(case, states, time)

    def _closings(self) -> Iterator[tuple[Place, tuple[str, ...]]]:
        """Yield the elements that a group, or the shade, changes, and what into, by name."""
        case, starts = self.variants[1], self.facades.panes.states.starts
        shade, closing, groups = case.shading, prepared(case).groups, [*case.groups.values()]
        variants = zip(self.facades.drawn, self.facades.members, strict=True)
        yield from self._bringing()
        for number, (drawn, members) in enumerate(variants):
            for g, row in drawn.items():
                panes, element = self.every[g], starts[g] + int(row.argmax())
                if groups and g in members:
                    group = members[g].group
                    further = tuple(starts[g] + f for f in members[g].fills)
                    yield Place(element, group, further), further_materials(case, groups[group])
                elif shade is not None and not groups and number == 1:
                    group = closing.of_panes(panes)
                    if panes.clear and group >= 0:
                        names = self.facades.panes.states.states[g]
                        closed = starts[g] + names.index(shade.material, 1)
                        yield Place(element, group, (closed,)), (shade.material,)

    def _bringing(self) -> Iterator[tuple[Place, tuple[str, ...]]]:
        """Yield, as `_closings`, the elements of groups whose states bring surfaces."""
        starts, members = self.facades.panes.states.starts, self.facades.members[1]
        for g in self.facades.bringing:
            further = tuple(starts[g] + f for f in members[g].fills)
            yield Place(starts[g], members[g].group, further), ()


def meant_panes(case: Case, design: Design) -> tuple[str, ...]:
    """Clear panes that `[design]` names, by default all, as "name (direction)".

    Raises
    ------
    InputError
        There are none.
    """
    for name in design.groups:
        if name not in case.groups:
            got = f"there is no group {shortened(name)}"
            raise InputError(case.source, "design.groups", got, choose(name, list(case.groups)))
    every = tuple(like_panes(case))
    meant = tuple(
        str(panes)
        for panes in every
        if panes.clear
        and design.side in (None, panes.facing)
        and (not design.panes or fits(panes.name, design.panes))
        and (not design.groups or _group(case, panes) in design.groups)
    )
    if not meant:
        known = ", ".join(map(str, every)) or "there are none"
        got, remedy = "no clear pane is meant", f"name some of the panes: {known}"
        raise InputError(case.source, "design.panes", got, remedy)
    return meant


def _group(case: Case, panes: LikePanes) -> str:
    """Name of the group of `[groups]` that panes belong to, "" for none."""
    groups = prepared(case).groups
    number = groups.of_panes(panes)
    return groups.states.names[number] if case.groups and number != NO_GROUP else ""
