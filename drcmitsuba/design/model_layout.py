"""Layout of a search over the panes of a model: which of them may take the film.

Panes of one material that face one direction are a tile, whose area the film shares with what the
model draws there. Panes keep their size and place.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

import numpy as np
import xarray as xr

from drcmitsuba.annual.chosen_facade import light_of_channels
from drcmitsuba.annual.result import Result
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.summed_year import accuracy_of
from drcmitsuba.annual.variants import SharedElements, joined_effects
from drcmitsuba.case.case import Case
from drcmitsuba.case.design import Design
from drcmitsuba.case.sun import Adaptive, TrueSun
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
from drcmitsuba.design.optimise import FacadeOptimum, Search
from drcmitsuba.design.parameters import Parameter
from drcmitsuba.design.problem import FacadeProblem, Goal
from drcmitsuba.metrics.evaluate_metrics import rules
from drcmitsuba.model.model import areas
from drcmitsuba.plan import notes, plan
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Stage, silent
from drcmitsuba.runtime.random_streams import Stream, case_seed
from drcmitsuba.runtime.toml import choose, shortened
from drcmitsuba.scene.like_panes import LikePanes, like_panes
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.shared_facades import SharedFacades
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.daylight import daylight as daylight_of

CLEAR = "as drawn"
"""Name of what the model draws in its panes."""
OF_BOXES = (
    "clear", "band", "rows", "row_height", "segments", "wwr", "glazing_transmittance", "shade_vlt",
)  # fmt: skip
"""Keys of `[design]` that cut a wall into tiles, or change its glass."""


@dataclass(frozen=True)
class ModelLayout:
    """Contents of `[design]` for a model."""

    case: Case
    design: Design
    film: str
    every: tuple[LikePanes, ...]
    """All panes to the outside by material and direction."""
    searched: tuple[int, ...]
    """Indices of the panes that may take the film."""
    facades: SharedFacades
    """The model as drawn, and with the film in all of these panes."""

    @classmethod
    def of(cls, case: Case) -> ModelLayout:
        """Read the layout from a case of a model.

        Raises
        ------
        InputError
            There is no `[design]`, no pane is meant, or the search asks for what panes of a model
            have not.
        """
        design = case.design
        if design is None or design.film is None:
            got = "no film is named"
            raise InputError(case.source, "design.film", got, "name a material of [materials]")
        case.refuse_overruled("the search for a façade")
        for key in OF_BOXES:
            if key in design.model_fields_set:
                got = "the panes of a model keep their size, place and glass"
                raise InputError(case.source, f"design.{key}", got, "leave it out")
        films = [name for name in case.panes if not case.is_clear(name)]
        if design.film not in films:
            got = f"{shortened(design.film)} is no such material in [materials]"
            raise InputError(case.source, "design.film", got, choose(design.film, films))
        if isinstance(case.sun, Adaptive):  # its mesh would follow one composition
            case = case.with_tables(sun=TrueSun())
        every = tuple(like_panes(case))
        searched = tuple(g for g, panes in enumerate(every) if _is_meant(design, panes))
        if not searched:
            known = ", ".join(map(str, every)) or "there are none"
            got, remedy = "no clear pane is meant", f"name some of the panes: {known}"
            raise InputError(case.source, "design.panes", got, remedy)
        covered = _with_film(case, design.film, [every[g] for g in searched])
        facades = SharedFacades.of([case, covered])
        return cls(case, design, design.film, every, searched, facades)

    @property
    def search(self) -> Search:
        """Settings of the search."""
        return Search.of(self.design)

    def year(self, stage: Stage = silent) -> FacadeYear:
        """Panes under the daylight of the case's period; errors are those of `FacadeYear.of`."""
        with stage("sky"):
            light = daylight_of(self.case)
        shared = self._light(self.case, light, stage)
        return FacadeYear.of(self._tiled(shared, light.sky["time"]), light)

    def problem(self, year: FacadeYear) -> FacadeProblem:
        """Optimisation problem of a year."""
        goal = Goal(
            rules=rules(self.case, year.step_hours),
            film=self.film,
            aim=self.design.objective,
            film_cost=self.design.film_cost,
            ase_limit=self.design.ase_limit,
        )
        panes = Panes(year.tiles, year.materials, CLEAR, self.film)
        film = Parameter("film", 0.0, 1.0, 0.5, panes.count)
        return FacadeProblem(year, Strips(panes, Parameter.fixed("window", 1.0), film), goal)

    def known(self, problem: FacadeProblem) -> list[np.ndarray]:
        """Designs that are evaluated first: the film nowhere, everywhere, and in one tile alone."""
        size = problem.size
        return [np.zeros(size), np.ones(size), *(np.eye(size) if size > 1 else ())]

    def afresh(self, optimum: FacadeOptimum, stage: Stage = silent) -> Result:
        """Evaluate an optimum by the light of other paths: its noise took no part in the search."""
        seed = case_seed(self.case.accuracy.seed, Stream.FRESH_SEED)
        accuracy = self.case.accuracy.model_copy(update={"seed": seed})
        case = self.case.with_tables(accuracy=accuracy)
        with stage("sky"):
            light = daylight_of(case)
        film = optimum.best.share[:, optimum.problem.year.materials.index(self.film)]
        as_drawn, covered = self.facades.drawn
        rows = dict(as_drawn)
        for g, share in zip(self.searched, film, strict=True):
            rows[g] = ((1 - share) * as_drawn[g] + share * covered[g]).astype(np.float32)
        facades = replace(self.facades, drawn=(rows,), members=self.facades.members[:1])
        shared = replace(self._light(case, light, stage), cases=[case], facades=facades)
        return shared.simulated(0).result()

    def _light(self, case: Case, light: Daylight, stage: Stage) -> SharedElements:
        """Light of all panes with all of their fills."""
        run = replace(Run.of(case), stage=stage)
        accuracy = accuracy_of(case, run)
        covered = _with_film(case, self.film, [self.every[g] for g in self.searched])
        scope = joined_effects([plan(each, light).scope for each in (case, covered)])
        scope = replace(scope, solved_cells=False)  # gradients follow paths
        facades = self.facades
        with run.timed("light by pane") as done:
            channels = light_of_channels(
                facades.case, facades.panes, light.suns, accuracy, scope, done
            )
        return SharedElements([case], light, facades, scope, channels, [notes(case)], run)

    def _tiled(self, shared: SharedElements, time: xr.DataArray) -> TiledLight:
        """Light as tiles of a façade have it."""
        states, (as_drawn, covered) = self.facades.panes.states, self.facades.drawn
        starts, count = states.starts, states.starts[-1]
        place, still, is_open = (
            np.full(count, -1),
            np.zeros(count, np.float32),
            np.zeros(count, bool),
        )
        names = [""] * count
        for g, row in as_drawn.items():
            clear, film = (starts[g] + int(r.argmax()) for r in (row, covered[g]))
            still[clear], is_open[clear], names[clear] = 1, True, CLEAR
            if g in self.searched:
                tile = self.searched.index(g)
                still[clear], place[clear], place[film] = 0, 3 * tile + 1, 3 * tile + 2
                is_open[film], names[film] = True, self.film
        groups = self._groups(time)
        by_element = {place.element: place for place in self._places()}
        places = [] if groups is None else [*by_element.values()]
        several = groups is not None and len(groups.rule.groups) > 1
        return TiledLight(
            tiles=self._tiles(),
            materials=("wall", CLEAR, self.film),
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
        """Searched panes side by side, each as a rectangle of 1 m height with its area."""
        size = []
        for g in self.searched:
            panes = self.every[g]
            assert panes.quads is not None
            size.append(areas(self.case.building.layers[panes.layer].quads[panes.quads]).sum())
        right = np.cumsum(size)
        left, zero = right - size, np.zeros(len(size))
        bounds = np.stack([left, right, zero, zero + 1], axis=1)
        return Tiles(bounds, tuple(str(self.every[g]) for g in self.searched))

    def _groups(self, time: xr.DataArray) -> FacadeGroups | None:
        """Groups of panes that close; None where nothing ever does."""
        case, states = self.case, prepared(self.case).groups.states
        if not any(states.closable):
            return None
        return FacadeGroups.of_case(case, states, time)

    def _places(self) -> Iterator[Place]:
        """Yield the elements that a group, or the shade, changes."""
        starts, shade = self.facades.panes.states.starts, self.case.shading
        of_panes = prepared(self.case).groups
        for drawn, members in zip(self.facades.drawn, self.facades.members, strict=True):
            for g, row in drawn.items():
                panes, element = self.every[g], starts[g] + int(row.argmax())
                assert panes.quads is not None
                if self.case.groups and g in members:
                    further = tuple(starts[g] + f for f in members[g].fills)
                    yield Place(element, members[g].group, further)
                elif shade is not None and not self.case.groups and drawn is self.facades.drawn[0]:
                    number = int(of_panes.of_quads[panes.layer][panes.quads[0]])
                    if panes.clear and number >= 0:
                        names = self.facades.panes.states.states[g]
                        yield Place(element, number, (starts[g] + names.index(shade.material, 1),))


def _with_film(case: Case, film: str, searched: Sequence[LikePanes]) -> Case:
    """Case with a film in all searched panes."""
    materials = dict.fromkeys((panes.name for panes in searched), case.materials[film])
    return case.with_tables(materials={**case.materials, **materials})


def _is_meant(design: Design, panes: LikePanes) -> bool:
    """Whether `[design]` names panes: by default all clear ones."""
    named = not design.panes or any(fnmatchcase(panes.name, p) for p in design.panes)
    return panes.clear and named and design.side in (None, panes.facing)
