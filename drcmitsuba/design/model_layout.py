"""Layout of a search over a model: which panes may take the film, or which walls get windows.

Panes of one material that face one direction are a tile, whose area the film shares with what the
model draws there; they keep their size and place. Outer walls that `[design]` means are cut into
tiles (`scene.tiled_walls`), each of which wall, clear glass and film share, as in a room of boxes.

    case ─ TiledWalls ─► drawn, clear, film: three variants of one model
         ─ SharedFacades ─► openings and fills ─► light by element ─► FacadeYear ─► FacadeProblem
    optimum ─ panes_of ─► the model with these windows, a case of its own
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure

from drcmitsuba.annual.chosen_facade import light_of_channels
from drcmitsuba.annual.result import Result, evaluate
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.summed_year import accuracy_of
from drcmitsuba.annual.variants import SharedElements, joined_effects
from drcmitsuba.case.case import Case
from drcmitsuba.case.design import Design
from drcmitsuba.case.sun import Adaptive, TrueSun
from drcmitsuba.design import pictures
from drcmitsuba.design.facade_groups import FacadeGroups
from drcmitsuba.design.facade_maps import Panes, Strips
from drcmitsuba.design.facade_tiles import (
    Place,
    TiledLight,
    Tiles,
    closing_matrices,
    group_of_elements,
)
from drcmitsuba.design.facade_year import FacadeYear
from drcmitsuba.design.layout import films_by_height
from drcmitsuba.design.model_windows import (
    CLEAR,
    WindowArea,
    bounds_of,
    clear_of,
    panes_of,
    tiled_walls,
    with_fill,
)
from drcmitsuba.design.optimise import FacadeOptimum, Search
from drcmitsuba.design.parameters import Parameter
from drcmitsuba.design.problem import FacadeProblem, Goal
from drcmitsuba.design.wall_picture import wall_picture
from drcmitsuba.metrics.evaluate_metrics import rules
from drcmitsuba.model.model import areas
from drcmitsuba.model.windows import COLUMNS, rows_of
from drcmitsuba.plan import notes, plan
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Stage, silent
from drcmitsuba.runtime.random_streams import Stream, case_seed
from drcmitsuba.runtime.toml import choose, shortened
from drcmitsuba.scene.like_panes import LikePanes, like_panes
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.shared_facades import SharedFacades
from drcmitsuba.scene.tiled_walls import TiledWalls, WallPane
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.daylight import daylight as daylight_of

WINDOWS = "windows.csv"
"""Name of the table of new windows."""
FIXED = ("glazing_transmittance", "shade_vlt")
"""Keys of `[design]` that change the glass, which a model keeps."""


@dataclass(frozen=True)
class ModelLayout:
    """Contents of `[design]` for a model."""

    variants: tuple[Case, Case, Case]
    """The case as drawn, with clear panes in all that is searched, and with the film there; the
    first two are one where panes are searched."""
    design: Design
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
    allowed: WindowArea | None = None
    """Area of the windows in them."""

    @classmethod
    def of(cls, case: Case) -> ModelLayout:
        """Read the layout from a case of a model.

        Raises
        ------
        InputError
            There is no `[design]`, no pane or wall is meant, or the search asks for what a model
            has not.
        """
        design = case.design
        if design is None or design.film is None:
            got = "no film is named"
            raise InputError(case.source, "design.film", got, "name a material of [materials]")
        case.refuse_overruled("the search for a façade")
        for key in FIXED:
            if key in design.model_fields_set:
                got = "the panes of a model keep their glass"
                raise InputError(case.source, f"design.{key}", got, "leave it out")
        films = [name for name in case.panes if not case.is_clear(name)]
        if design.film not in films:
            got = f"{shortened(design.film)} is no such material in [materials]"
            raise InputError(case.source, "design.film", got, choose(design.film, films))
        if isinstance(case.sun, Adaptive):  # its mesh would follow one composition
            case = case.with_tables(sun=TrueSun())
        if design.cuts_walls:
            return cls._of_walls(case, design, design.film)
        every = tuple(like_panes(case))
        searched = tuple(g for g, panes in enumerate(every) if _is_meant(design, panes))
        if not searched:
            known = ", ".join(map(str, every)) or "there are none"
            got, remedy = "no clear pane is meant", f"name some of the panes: {known}"
            raise InputError(case.source, "design.panes", got, remedy)
        covered = with_fill(case, design.film, {every[g].name: "" for g in searched})
        facades = SharedFacades.of([case, case, covered])
        return cls((case, case, covered), design, design.film, CLEAR, every, searched, facades)

    @classmethod
    def _of_walls(cls, case: Case, design: Design, film: str) -> ModelLayout:
        clear = clear_of(case, design)
        walls = tiled_walls(case, design)
        panes = {panes.layer: panes for panes in like_panes(walls.case)}
        tiles = {walls.case.building.layers[i].name: panes[i].facing for i in walls.layers}
        glazed, covered = (with_fill(walls.case, name, tiles) for name in (clear, film))
        every = tuple(like_panes(glazed))
        at = {panes.layer: g for g, panes in enumerate(every)}
        facades = SharedFacades.of([walls.case, glazed, covered])
        searched = tuple(at[i] for i in walls.layers)
        variants = (walls.case, glazed, covered)
        allowed = WindowArea.of(case.source, design, walls)
        return cls(variants, design, film, clear, every, searched, facades, walls, allowed)

    @property
    def case(self) -> Case:
        """The case as drawn."""
        return self.variants[0]

    @property
    def search(self) -> Search:
        """Settings of the search."""
        return Search.of(self.design)

    def year(self, stage: Stage = silent) -> FacadeYear:
        """Openings under the daylight of the case's period; errors are those of `FacadeYear.of`."""
        return FacadeYear.of(*self.light(stage))

    def light(self, stage: Stage = silent) -> tuple[TiledLight, Daylight]:
        """Light by tile and fill, and the daylight of the case's period."""
        with stage("sky"):
            daylight = daylight_of(self.case)
        shared = self._light(self.case, daylight, stage)
        return self._tiled(shared, daylight.sky["time"]), daylight

    def problem(self, year: FacadeYear) -> FacadeProblem:
        """Optimisation problem of a year."""
        window, area = Parameter.fixed("window", 1.0), None
        panes = Panes(year.tiles, year.materials, self.clear, self.film)
        if self.allowed is not None:
            window, area = self.allowed.parameter(panes.count), self.allowed.limits
        goal = Goal(
            rules=rules(self.case, year.step_hours),
            film=self.film,
            aim=self.design.objective,
            film_cost=self.design.film_cost,
            ase_limit=self.design.ase_limit,
            window_area=area,
        )
        film = Parameter("film", 0.0, 1.0, 0.5, panes.count)
        return FacadeProblem(year, Strips(panes, window, film), goal)

    def known(self, problem: FacadeProblem) -> list[np.ndarray]:
        """Designs that are evaluated first: the film nowhere and everywhere, and in parts.

        In panes, it is in one tile alone; in walls, above, below and in the middle.
        """
        if self.walls is not None:
            bottom, top = problem.year.tiles.bounds[:, 2:].T
            at = ((bottom + top) / 2 - bottom.min()) / (top.max() - bottom.min())
            return films_by_height(problem, at)
        size = problem.size
        return [np.zeros(size), np.ones(size), *(np.eye(size) if size > 1 else ())]

    def afresh(self, optimum: FacadeOptimum, stage: Stage = silent) -> Result:
        """Evaluate an optimum by the light of other paths: its noise took no part in the search.

        New windows are drawn into the model; panes take the film by their shares.
        """
        if self.walls is not None:
            return evaluate(self.built(optimum), stage)
        seed = case_seed(self.case.accuracy.seed, Stream.FRESH_SEED)
        accuracy = self.case.accuracy.model_copy(update={"seed": seed})
        case = self.case.with_tables(accuracy=accuracy)
        with stage("sky"):
            light = daylight_of(case)
        film = optimum.best.share[:, optimum.problem.year.materials.index(self.film)]
        _, as_drawn, covered = self.facades.drawn
        rows = dict(as_drawn)
        for g, share in zip(self.searched, film, strict=True):
            rows[g] = ((1 - share) * as_drawn[g] + share * covered[g]).astype(np.float32)
        facades = replace(self.facades, drawn=(rows,), members=self.facades.members[:1])
        shared = replace(self._light(case, light, stage), cases=[case], facades=facades)
        return shared.simulated(0).result()

    def built(self, optimum: FacadeOptimum) -> Case:
        """Case of an optimum whose new windows are drawn into the walls."""
        assert self.walls is not None
        return self.walls.with_windows(self.walls.windows(self._panes(optimum)))

    def tables(self, optimum: FacadeOptimum) -> dict[str, pd.DataFrame]:
        """Tables of an optimum by the names of their files: its new windows, for `[model]`."""
        if self.walls is None:
            return {}
        rows = rows_of(self.walls.windows(self._panes(optimum)))
        return {WINDOWS: pd.DataFrame(rows, columns=COLUMNS)}

    def picture(self, optimum: FacadeOptimum, title: str) -> Figure:
        """Picture of an optimum: its windows in their walls, or the share of the film by panes."""
        year, share = optimum.problem.year, optimum.best.share
        if self.walls is not None:
            panes = self._panes(optimum)
            return wall_picture(self.walls, panes, (self.clear, self.film), title)
        return pictures.facade(year.tiles, share, year.materials, self.film, title)

    def _panes(self, optimum: FacadeOptimum) -> list[WallPane]:
        """Panes of an optimum in its walls."""
        assert self.walls is not None
        share, materials = optimum.best.share, optimum.problem.year.materials
        return panes_of(self.walls, share, materials, self.film)

    def _light(self, case: Case, light: Daylight, stage: Stage) -> SharedElements:
        """Light of all openings with all of their fills."""
        run = replace(Run.of(case), stage=stage)
        accuracy = accuracy_of(case, run)
        filled = [each.with_tables(accuracy=case.accuracy) for each in self.variants[1:]]
        scope = joined_effects([plan(each, light).scope for each in filled])
        scope = replace(scope, solved_cells=False)  # gradients follow paths
        facades = self.facades
        with run.timed("light by pane") as done:
            channels = light_of_channels(
                facades.case, facades.panes, light.suns, accuracy, scope, done
            )
        return SharedElements([case], light, facades, scope, channels, [notes(case)], run)

    def _tiled(self, shared: SharedElements, time: xr.DataArray) -> TiledLight:
        """Light as tiles of a façade have it."""
        states, columns = self.facades.panes.states, ("wall", self.clear, self.film)
        starts, count = states.starts, states.starts[-1]
        place, still = np.full(count, -1), np.zeros(count, np.float32)
        is_open, names = np.zeros(count, bool), [""] * count
        tile_of = {g: tile for tile, g in enumerate(self.searched)}
        for g in range(len(self.every)):
            fills = [starts[g] + int(rows[g].argmax()) for rows in self.facades.drawn]
            still[fills[0]] = g not in tile_of
            for column, (fill, name) in enumerate(zip(fills, columns, strict=True)):
                if column == 0 and self.walls is None:
                    continue  # panes are no wall
                is_open[fill], names[fill] = True, name if g in tile_of else CLEAR
                if g in tile_of:
                    place[fill] = 3 * tile_of[g] + column
        groups = self._groups(time)
        by_element = {place.element: place for place in self._places()}
        places = [] if groups is None else [*by_element.values()]
        several = groups is not None and len(groups.rule.groups) > 1
        return TiledLight(
            tiles=self._tiles(),
            materials=columns,
            names=tuple(names),
            as_drawn=still,
            is_open=is_open,
            closings=closing_matrices(count, places, groups),
            channels=shared.channels,
            groups=groups,
            group=group_of_elements(count, places) if several else None,
            place=place,
        )

    def _tiles(self) -> Tiles:
        """Tiles of walls side by side; searched panes likewise, each of 1 m height by its area."""
        names = tuple(str(self.every[g]) for g in self.searched)
        if self.walls is not None:
            return bounds_of(self.walls, names)
        size = []
        for g in self.searched:
            panes = self.every[g]
            assert panes.quads is not None
            size.append(areas(self.case.building.layers[panes.layer].quads[panes.quads]).sum())
        right = np.cumsum(size)
        left, zero = right - size, np.zeros(len(size))
        return Tiles(np.stack([left, right, zero, zero + 1], axis=1), names)

    def _groups(self, time: xr.DataArray) -> FacadeGroups | None:
        """Groups of panes that close; None where nothing ever does."""
        case = self.variants[1]
        states = prepared(case).groups.states
        if not any(states.closable):
            return None
        return FacadeGroups.of_case(case, states, time)

    def _places(self) -> Iterator[Place]:
        """Yield the elements that a group, or the shade, changes."""
        case, starts = self.variants[1], self.facades.panes.states.starts
        shade, of_panes = case.shading, prepared(case).groups
        variants = zip(self.facades.drawn, self.facades.members, strict=True)
        for number, (drawn, members) in enumerate(variants):
            for g, row in drawn.items():
                panes, element = self.every[g], starts[g] + int(row.argmax())
                assert panes.quads is not None
                if case.groups and g in members:
                    further = tuple(starts[g] + f for f in members[g].fills)
                    yield Place(element, members[g].group, further)
                elif shade is not None and not case.groups and number == 1:
                    group = int(of_panes.of_quads[panes.layer][panes.quads[0]])
                    if panes.clear and group >= 0:
                        names = self.facades.panes.states.states[g]
                        closed = starts[g] + names.index(shade.material, 1)
                        yield Place(element, group, (closed,))


def _is_meant(design: Design, panes: LikePanes) -> bool:
    """Whether `[design]` names panes: by default all clear ones."""
    named = not design.panes or any(fnmatchcase(panes.name, p) for p in design.panes)
    return panes.clear and named and design.side in (None, panes.facing)
