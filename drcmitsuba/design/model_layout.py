"""Layout of a search over a model: which panes may take the film, and which walls get windows.

Panes of one material that face one direction are a tile, whose area the film shares with what the
model draws there; they keep their size and place. Outer walls that `[design]` means are cut into
tiles (`scene.tiled_walls`), each of which wall, clear glass and film share, as in a room of boxes.

    case ─ TiledWalls ─► drawn, clear, film: three variants of one model
         ─ SharedFacades ─► openings and fills ─► light by element ─► FacadeYear ─► FacadeProblem
    optimum ─ built ─► the model with its windows and transmittances, a case of its own
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import mitsuba as mi
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from drcmitsuba.annual.light_with_surfaces import simulate_sets
from drcmitsuba.annual.result import Result, evaluate
from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.case.design import Design
from drcmitsuba.design import pictures
from drcmitsuba.design.facade_glare import EyesOfCase, LitOpenings, TraceEyes, eyes_of
from drcmitsuba.design.facade_maps import Panes, Strips
from drcmitsuba.design.facade_tiles import FacadeParts, TiledLight
from drcmitsuba.design.facade_year import FacadeYear
from drcmitsuba.design.free_transmittances import free_transmittances, with_transmittances
from drcmitsuba.design.goal import Goal, Minimised
from drcmitsuba.design.model_openings import SearchedOpenings, meant_panes
from drcmitsuba.design.model_windows import WindowArea, panes_of
from drcmitsuba.design.optimise import FacadeOptimum, Search
from drcmitsuba.design.parameters import Factor, Parameter
from drcmitsuba.design.problem import FacadeProblem
from drcmitsuba.design.requirement import asked_of
from drcmitsuba.design.wall_picture import wall_picture
from drcmitsuba.model.window_table import COLUMNS, rows_of
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Stage, silent
from drcmitsuba.runtime.random_streams import Stream, case_seed
from drcmitsuba.runtime.toml import choose, shortened
from drcmitsuba.scene.panes_in_state import refuse_surfaces
from drcmitsuba.scene.tiled_walls import WallPane
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.daylight import daylight as daylight_of

WINDOWS = "windows.csv"
"""Name of the table of new windows."""


@dataclass(frozen=True)
class ModelLayout:
    """Contents of `[design]` for a model."""

    openings: SearchedOpenings
    design: Design
    allowed: WindowArea | None = None
    """Area of new windows; None where panes are searched."""

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
        if design.parameters == "window" and "parameters" in design.model_fields_set:
            got, remedy = "panes and walls of a model are no one window", 'give "strips"'
            raise InputError(case.source, "design.parameters", got, remedy)
        case.refuse_overruled("the search for a façade")
        films = [name for name in case.panes if not case.is_clear(name)]
        if design.film not in films:
            got = f"{shortened(design.film)} is no such material in [materials]"
            raise InputError(case.source, "design.film", got, choose(design.film, films))
        case = case.with_true_suns()
        if design.cuts_walls:
            openings = SearchedOpenings.of_walls(case, design, design.film)
        else:
            openings = SearchedOpenings.of_panes(case, design.film, meant_panes(case, design))
        walls = openings.walls
        allowed = None if walls is None else WindowArea.of(case.source, design, walls)
        layout = cls(openings, design, allowed)
        for factor in layout.factors:
            for name in factor.now:
                openings.refuse_shared(f"design.{factor.parameter.key}", name)
        return layout

    @property
    def case(self) -> Case:
        """The case as drawn."""
        return self.openings.variants[0]

    @property
    def film(self) -> str:
        """Material of the film."""
        return self.openings.film

    @property
    def factors(self) -> tuple[Factor, ...]:
        """Materials whose transmittance is free; errors are those of `free_transmittances`."""
        return free_transmittances(self.case, self.design, self.openings.clear_materials)

    @property
    def search(self) -> Search:
        """Settings of the search."""
        return Search.of(self.design)

    def year(self, stage: Stage = silent, trace_eyes: TraceEyes | None = None) -> FacadeYear:
        """Openings under the daylight of the case's period, as `Layout.year`.

        Errors are those of `FacadeYear.of` and `eyes_of`.
        """
        tiled, daylight = self.light(stage, eyes_of(self.case, trace_eyes))
        return FacadeYear.of(tiled, daylight, tiled.eyes(daylight, stage))

    def light(
        self, stage: Stage = silent, eyes: EyesOfCase | None = None
    ) -> tuple[TiledLight, Daylight]:
        """Light by tile and fill, and the daylight of the case's period."""
        if eyes is not None:
            refuse_surfaces(self.case)
        with stage("sky"):
            daylight = daylight_of(self.case)
            asked_of(self.case, daylight)  # refused before any light is traced
            self.openings.groups(daylight.sky["time"])
        run = replace(Run.of(self.case), stage=stage)
        channels, scope = self.openings.light(self.case, daylight, run)
        tiled = self.openings.tiled(channels, daylight.sky["time"])
        simulate_sets(channels, np.stack([*map(tiled.still, range(1 + len(tiled.closings)))]), run)
        if eyes is not None:
            facades = self.openings.facades
            lit = LitOpenings(facades.case, facades.panes, scope, eyes)
            tiled = replace(tiled, openings=lit)
        return tiled, daylight

    def light_as_drawn(self, stage: Stage = silent) -> tuple[TiledLight, Daylight]:
        """Light by tile and fill with all replicates, as `Layout.light_as_drawn`."""
        return self.light(stage)

    def as_drawn(self, tiled: TiledLight) -> np.ndarray:
        """Composition as the model is drawn, shape (tile, material)."""
        walls = len(tiled.tiles) - len(self.openings.panes)
        column = np.repeat([0, 1], [walls, len(tiled.tiles) - walls])
        return np.eye(len(tiled.materials))[column]

    def parts(self, tiled: TiledLight) -> FacadeParts:
        """Tiles in words and areas."""
        return self.openings.parts()

    def composed(self, tiled: TiledLight, share: np.ndarray) -> Case:
        """Case with panes in all tiles, by whose rules compositions are judged."""
        return self.openings.variants[1]

    def problem(self, year: FacadeYear) -> FacadeProblem:
        """Optimisation problem of a year."""
        window, area = Parameter.fixed("window", 1.0), None
        panes = Panes(year.tiles, year.materials, self.openings.clear, self.film)
        whole = 0
        if self.allowed is not None:
            whole = len(self.openings.panes)
            count = panes.count - whole
            window, area = self.allowed.parameter(count), self.allowed.limits
            if area is not None:
                glazed = float(year.tiles.area[count:].sum())
                area = (area[0] + glazed, area[1] + glazed)
        of: Minimised = "panes" if area is not None and area[0] < area[1] else "film"
        goal = Goal.of(self.case, year, self.film, area, of)
        film = Parameter("film", 0.0, 1.0, 0.5, panes.count)
        return FacadeProblem(year, Strips(panes, window, film, whole), goal, self.factors)

    def known(self, problem: FacadeProblem) -> list[np.ndarray]:
        """Designs that are evaluated first: the film nowhere and everywhere, and in parts.

        In panes, it is in one tile alone; in walls, above, below and in the middle.
        """
        if self.openings.walls is not None:
            bottom, top = problem.year.tiles.bounds[:, 2:].T
            at = ((bottom + top) / 2 - bottom.min()) / (top.max() - bottom.min())
            return problem.films_by_height(at)
        tiles = len(problem.year.tiles)
        films = [np.zeros(tiles), np.ones(tiles), *(np.eye(tiles) if tiles > 1 else ())]
        return [problem.of_fractions({"film": film}) for film in films]

    @property
    def notes(self) -> tuple[str, ...]:
        """No note."""
        return ()

    @property
    def cuts_tiles(self) -> bool:
        """Whether mixed tiles are cut where an optimum is evaluated afresh; panes are not."""
        return self.openings.walls is not None

    def afresh(self, optimum: FacadeOptimum, stage: Stage = silent) -> Result:
        """Evaluate an optimum by the light of other paths: its noise took no part in the search.

        New windows are drawn into the model; panes take the film by their shares.
        """
        built = self.built(optimum)
        if not self.openings.panes:
            return evaluate(built, stage)
        seed = case_seed(self.case.accuracy.seed, Stream.FRESH_SEED)
        case = built.with_tables(accuracy=built.accuracy.model_copy(update={"seed": seed}))
        with stage("sky"):
            light = daylight_of(case)
        openings, composition = self._panes_of(case, optimum)
        film = composition[:, optimum.problem.year.materials.index(self.film)]
        facades = openings.facades
        _, as_drawn, covered = facades.drawn
        rows = dict(as_drawn)
        for g, share in zip(openings.searched, film, strict=True):
            rows[g] = ((1 - share) * as_drawn[g] + share * covered[g]).astype(np.float32)
        facades = replace(facades, drawn=(rows,), members=facades.members[:1])
        shared = replace(openings.simulated(case, light, stage), facades=facades)
        return shared.evaluate(0)

    def glare_afresh(self, optimum: FacadeOptimum, stage: Stage = silent) -> Any:
        """`GlareYear` of an optimum at the views of the case, as `afresh`."""
        problem = optimum.problem
        eyes, daylight = problem.year.eyes, problem.year.daylight
        assert eyes is not None
        assert daylight is not None
        built = self.built(optimum)
        if not self.openings.panes:
            return eyes.of_case(built, stage)
        _, E = problem.illuminance(problem.values(mi.Float(optimum.best.x)))
        openings, composition = self._panes_of(built, optimum)
        tiled, facades = openings.tiled((), daylight.sky["time"]), openings.facades
        states, groups = np.arange(len(E.states)), problem.measure.groups
        if groups is not None and tiled.groups is not None:
            states = tiled.groups.places_of(groups)  # walls without a window have no group
        last = len(tiled.closings)
        shares = np.stack([tiled.shares(composition, min(int(k), last)) for k in states])
        of_hours = shares[problem.measure.states(E)]
        return eyes.in_facades(facades.case, facades.panes, of_hours, stage)

    def _panes_of(self, built: Case, optimum: FacadeOptimum) -> tuple[SearchedOpenings, np.ndarray]:
        """Panes of the case of an optimum that take the film, and their composition."""
        panes = self.openings.panes
        openings = SearchedOpenings.of_panes(built, self.film, tuple(map(str, panes)))
        return openings, optimum.best.share[-len(panes) :]

    def built(self, optimum: FacadeOptimum) -> Case:
        """Case of an optimum with its transmittances, and with new windows in its walls."""
        walls, case = self.openings.walls, self.case
        if walls is not None:
            case = walls.with_windows(walls.windows(self._panes(optimum.best.share)))
        return with_transmittances(case, optimum.problem.factors, optimum.values)

    def tables(self, share: np.ndarray) -> dict[str, pd.DataFrame]:
        """Tables of a composition by the names of their files: its new windows, for `[model]`."""
        if self.openings.walls is None:
            return {}
        rows = rows_of(self.openings.walls.windows(self._panes(share)))
        return {WINDOWS: pd.DataFrame(rows, columns=COLUMNS)}

    def pictures(self, optimum: FacadeOptimum, title: str) -> dict[str, Figure]:
        """Pictures by the names of their files: windows in their walls, shares of film by panes."""
        year, share = optimum.problem.year, optimum.best.share
        walls, panes, made = self.openings.walls, self.openings.panes, dict[str, Figure]()
        if walls is not None:
            drawn, fills = self._panes(share), self.openings.fills[1:]
            made["facade.png"] = wall_picture(walls, drawn, fills, title)
        if panes:
            name = "facade.png" if walls is None else "panes.png"
            film = share[-len(panes) :, year.materials.index(self.film)]
            areas = year.tiles.area[-len(panes) :]
            made[name] = pictures.panes([*map(str, panes)], areas, film, self.film, title)
        return made

    def _panes(self, share: np.ndarray) -> list[WallPane]:
        """Panes of a composition (tile, material) in its walls."""
        walls, openings = self.openings.walls, self.openings
        assert walls is not None
        return panes_of(walls, share[: len(walls.tiles)], openings.fills, self.film)
