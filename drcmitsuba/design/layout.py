"""Layout of a façade: from the table `[design]` of a case to tiles and the problem."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any, cast

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from drcmitsuba.annual.chosen_facade import light_of_channels
from drcmitsuba.annual.result import Result, evaluate
from drcmitsuba.case.case import Case
from drcmitsuba.case.design import Design
from drcmitsuba.case.facade import Facade
from drcmitsuba.design import pictures, present_facade
from drcmitsuba.design.cut_tiles import CutTiles
from drcmitsuba.design.facade_glare import EyesOfCase, LitOpenings, TraceEyes, eyes_of
from drcmitsuba.design.facade_maps import Panes, Strips, Window
from drcmitsuba.design.facade_tiles import FacadeParts, TiledLight, groups_of
from drcmitsuba.design.facade_year import FacadeYear
from drcmitsuba.design.free_transmittances import free_transmittances, with_transmittances
from drcmitsuba.design.goal import Goal, Minimised
from drcmitsuba.design.optimise import FacadeOptimum, Search
from drcmitsuba.design.parameters import Map, Parameter
from drcmitsuba.design.problem import FacadeProblem
from drcmitsuba.design.realise import realise
from drcmitsuba.design.requirement import asked_of
from drcmitsuba.model.materials import GlazingMaterial
from drcmitsuba.plan import plan
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Stage, silent
from drcmitsuba.runtime.toml import Side, shortened
from drcmitsuba.scene.fills import effects_of
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.tiled_facades import TiledFacades, refuse_structures_in_strips
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.daylight import daylight as daylight_of

ROWS = 6
POINTS = 64
"""Number of points along each edge of a tile by which its shares are counted."""


@dataclass(frozen=True)
class Layout:
    """Contents of `[design]`, its defaults taken from the case.

    Parameters
    ----------
    clear, film : str
        Material that the shade covers, and material that it does not cover.
    length : float
        Length of the façade [m].
    band : (float, float)
        Lowest and highest edge of panes [m].
    rows, segments : int
        Number of tiles one above the other, and side by side.
    wwr : (float, float)
        Least and largest area of the openings over the façade's area, frames included.
    """

    case: Case
    design: Design
    side: Side
    clear: str
    film: str
    length: float
    band: tuple[float, float]
    rows: int
    segments: int
    wwr: tuple[float, float]

    @classmethod
    def of(cls, case: Case) -> Layout:
        """Read the layout from a case.

        Raises
        ------
        InputError
            The case has no `[design]`, no default follows from its façade, or a transmittance
            cannot be free, see `free_transmittances`.
        """
        design = case.design
        if design is None:
            remedy = 'add [design] with film = "…", a material of [materials]'
            raise InputError(case.source, "design", "no such table", remedy)
        case.refuse_overruled("the search for a façade")
        refuse_structures_in_strips(case, "evaluate the case, or search its tilt")
        if case.room is None:
            raise InputError(case.source, "design", "there is no room", "add a [room]")
        assert design.film is not None  # with a component in its place, one stands
        side = cast(Side, design.side or case.glazed[0])  # `check_facade` refuses other directions
        facade = case.facade.get(side, Facade())
        if facade.frame > 0:
            got = f"frames of {facade.frame:g} m, which the search does not know"
            remedy = "set frame = 0, and take the frames' share off the glass"
            raise InputError(case.source, f"facade.{side}.frame", got, remedy)
        clear = design.clear or _clear(case, facade)
        free_transmittances(case, design, (clear,))
        length, height = case.room.wall(side)
        panes = [s for s in facade.strips if s.material != "wall"]
        band = design.band or (min(s.bottom for s in panes), max(s.top for s in panes))
        covered = sum((s.top - s.bottom) * len(s.segments or range(facade.segments)) for s in panes)
        now = covered / (height * facade.segments)
        most = (band[1] - band[0]) / height
        wwr = (now, now) if design.wwr == "fixed" else design.wwr
        if wwr[0] > most + 1e-9:
            got = f"a window-to-wall ratio of {wwr[0]:.3g}, the band has {most:.3g}"
            raise InputError(case.source, "design.band", got, "give a wider band or a lower wwr")
        rows = design.rows or ROWS
        if design.row_height is not None:
            rows = min(100, max(1, round((band[1] - band[0]) / design.row_height)))
        return cls(
            case=case,
            design=design,
            side=side,
            clear=clear,
            film=design.film,
            length=length,
            band=band,
            rows=rows,
            segments=design.segments or facade.segments,
            wwr=(wwr[0], min(wwr[1], most)),
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """Say what of the façade the search does not keep, and where the band cuts its windows."""
        asked, (low, high), notes = self.design.wwr, self.band, list[str]()
        for strip in self.case.facade.get(self.side, Facade()).strips:
            if strip.material == "wall":
                continue
            where = f"facade.{self.side}: {shortened(strip.material)}, {strip.bottom:g} to "
            where += f"{strip.top:g} m, does not stay"
            apart = present_facade.APART
            if strip.bottom < low - apart or strip.top > high + apart:
                where += " in part" * (strip.top > low + apart and strip.bottom < high - apart)
                notes.append(f"{where}: beyond the band from {low:g} to {high:g} m all is wall")
            elif strip.material not in (self.clear, self.film):
                notes.append(f"{where}: tiles are wall, {self.clear} or {self.film}")
        if asked != "fixed" and asked[1] > self.wwr[1] + 1e-9:
            notes.append(
                f"design.wwr: {asked[1]:g} is asked for at most, and the band from {low:g} to "
                f"{high:g} m holds {self.wwr[1]:.3g}; a wider band holds more"
            )
        return tuple(notes)

    @property
    def heights(self) -> np.ndarray:
        """Edges of the rows, from the bottom up, shape (rows + 1,) [m]."""
        return np.linspace(*self.band, self.rows + 1)

    def year(self, stage: Stage = silent, trace_eyes: TraceEyes | None = None) -> FacadeYear:
        """Façade under the daylight of the case's period.

        Parameters
        ----------
        stage : callable
        trace_eyes : callable, optional
            `drcmitsuba.glare_year.EyesOfSearch.of`, where `[design]` asks for hours of glare.

        Raises
        ------
        InputError
            The weather is unfit, or a search cannot represent the case.
        """
        tiled, daylight = self.light(self.heights, 1, stage, eyes_of(self.case, trace_eyes))
        year = FacadeYear.of(tiled, daylight, tiled.eyes(daylight, stage))
        assert tiled.quads is not None
        points, _ = prepared(self.case).receivers.at()
        parts = tiled.tiles, tiled.materials, self.film, tiled.quads, points, daylight.suns
        return year.with_cut_tiles(CutTiles(*parts))

    def light(
        self, heights: np.ndarray, kept: int | None = None, stage: Stage = silent,
        eyes: EyesOfCase | None = None,
    ) -> tuple[TiledLight, Daylight]:  # fmt: skip
        """Light by tiles between heights [m], and the daylight of the case's period.

        True suns replace an adaptive sun model, whose mesh would follow one composition. `kept` and
        errors are those of `transport.elements.compute`.
        """
        case = self.case.with_true_suns()
        with stage("sky"):
            daylight = daylight_of(case)
            asked_of(case, daylight)  # refused before any light is traced
        fills = ("wall", self.clear, self.film)
        tiled = TiledFacades.of_grid(case, self.side, heights, self.segments, fills)
        effects = effects_of(tiled.panes, plan(case, daylight).of_any_facade, tiled.case)
        groups = groups_of(tiled, case, daylight.sky["time"])  # refused likewise
        with stage("light by tile") as done:
            channels = light_of_channels(
                tiled.case, tiled.panes, daylight.suns, case.accuracy, effects, done, kept
            )
        tiles, openings = self.segments * (len(heights) - 1), None
        if eyes is not None:
            openings = LitOpenings(tiled.case, tiled.panes, effects, eyes)
        return TiledLight.of(tiled, tiles, channels, groups, openings), daylight

    def light_as_drawn(self, stage: Stage = silent) -> tuple[TiledLight, Daylight]:
        """Light by tiles of one material each as the façade is, with all replicates.

        Errors are those of `present_facade.heights` and `light`.
        """
        panes, edges = (self.clear, self.film), self.heights
        edges = present_facade.heights(self.case, self.side, panes, edges, self.segments)
        return self.light(edges, stage=stage)

    def as_drawn(self, tiled: TiledLight) -> np.ndarray:
        """Composition as the façade is, shape (tile, material)."""
        return present_facade.composition(self.case, self.side, tiled.tiles, tiled.materials)

    def parts(self, tiled: TiledLight) -> FacadeParts:
        """Tiles in words and areas."""
        assert self.case.room is not None
        glass: dict[str, float] = {}
        for side, facade in self.case.facade.items():
            length = self.case.room.wall(side)[0]
            for strip in facade.strips:
                part = len(strip.segments or range(facade.segments)) / facade.segments
                area = (strip.top - strip.bottom) * part * length
                glass[strip.material] = glass.get(strip.material, 0.0) + area
        count = len(tiled.tiles)
        wall = self.length * self.case.room.size[2]
        return FacadeParts(
            wall, (tiled.materials,) * count, ("",) * count, np.ones(count, bool), glass
        )

    def composed(self, tiled: TiledLight, share: np.ndarray) -> Case:
        """Case of a composition (tile, material), by whose rules it is judged."""
        return realise(self.case, self.side, tiled.tiles, share, tiled.materials, self.film)

    @property
    def search(self) -> Search:
        """Settings of the search."""
        return Search.of(self.design)

    @property
    def cuts_tiles(self) -> bool:
        """Whether mixed tiles are cut where an optimum is evaluated afresh."""
        return True

    def afresh(self, optimum: FacadeOptimum, stage: Stage = silent) -> Result:
        """Evaluate an optimum as a case of its own."""
        return evaluate(self.built(optimum), stage)

    def glare_afresh(self, optimum: FacadeOptimum, stage: Stage = silent) -> Any:
        """`GlareYear` of an optimum as a case of its own, at the views of the case."""
        eyes = optimum.problem.year.eyes
        assert eyes is not None
        return eyes.of_case(self.built(optimum), stage)

    def tables(self, share: np.ndarray) -> dict[str, pd.DataFrame]:
        """Tables of a composition by the names of their files; of a box its shares tell all."""
        return {}

    def pictures(self, optimum: FacadeOptimum, title: str) -> dict[str, Figure]:
        """Pictures of an optimum by the names of their files."""
        year, share = optimum.problem.year, optimum.best.share
        picture = pictures.facade(year.tiles, share, year.materials, self.film, title)
        return {"facade.png": picture}

    def built(self, optimum: FacadeOptimum) -> Case:
        """Case of an optimum, with its transmittances where these were free."""
        year, share = optimum.problem.year, optimum.best.share
        case = realise(self.case, self.side, year.tiles, share, year.materials, self.film)
        return with_transmittances(case, optimum.problem.factors, optimum.values)

    def problem(self, year: FacadeYear) -> FacadeProblem:
        """Optimisation problem of a year."""
        assert self.case.room is not None
        wall = self.length * self.case.room.size[2]
        part = self.wwr[0] * self.case.room.size[2] / (self.band[1] - self.band[0])
        fills = part >= 1 - 1e-6
        by_strips = self.design.parameters == "strips"
        area = (self.wwr[0] * wall, self.wwr[1] * wall) if by_strips and not fills else None
        of: Minimised = "panes" if self.wwr[0] < self.wwr[1] else "film"
        goal = Goal.of(self.case, year, self.film, area, of)
        panes = Panes(year.tiles, year.materials, self.clear, self.film)
        facade = (
            self._strips(panes, 1.0 if fills else part) if by_strips else self._window(panes, wall)
        )
        factors = free_transmittances(self.case, self.design, (self.clear,))
        return FacadeProblem(year, facade, goal, factors)

    def known(self, problem: FacadeProblem) -> list[np.ndarray]:
        """Designs that are evaluated first, so that no search ends below them.

        The façade as it is, as far as its panes are those of the search, for a window if its edges
        are those of tiles. Single tiles: a film nowhere, everywhere, above, below and in the
        middle. A window given by few numbers: a coarse grid of these numbers.

        Returns
        -------
        list of np.ndarray, shape (free,)
            Free values as fractions of their ranges, 0 to 1.
        """
        tiles, materials = problem.year.tiles, problem.year.materials
        share = present_facade.composition(self.case, self.side, tiles, materials, POINTS)
        own = problem.of_values(problem.facade.values_of(share))
        if self.design.parameters == "window":
            grid = np.linspace(0, 1, 3 if problem.size == 3 else 0)
            known = [np.array(x) for x in product(grid, repeat=problem.size)]
            return [own, *known] if np.isin(share, (0, 1)).all() else known
        bottom, top = problem.year.tiles.bounds[:, 2:].T
        at = ((bottom + top) / 2 - self.band[0]) / (self.band[1] - self.band[0])
        return [own, *problem.films_by_height(at)]

    def _strips(self, panes: Panes, part: float) -> Map:
        """Map of single tiles; `part` of the band is window, all of it if 1."""
        window = Parameter("window", 0.0, 1.0, part, panes.count)
        if part == 1:
            window = Parameter.fixed("window", 1.0)
        return Strips(panes, window, Parameter("film", 0.0, 1.0, 0.5, panes.count))

    def _window(self, panes: Panes, wall: float) -> Map:
        assert self.case.room is not None
        low, high = self.band
        highest = max(low, high - self.wwr[0] * self.case.room.size[2])
        if highest - low < 1e-6:
            highest = low
        return Window(
            panes,
            wall,
            sill=Parameter("sill", low, highest, low),
            wwr=Parameter("wwr", *self.wwr, self.wwr[1]),
            dwr=Parameter("dwr", 0.0, 1.0, 0.5),
            position=Parameter("position", 0.0, 1.0, 1.0),
        )


def _clear(case: Case, facade: Facade) -> str:
    """Clear material of a façade; without one, of the case."""
    names = [s.material for s in facade.strips] + list(case.materials)
    for name in names:
        if isinstance(case.materials.get(name), GlazingMaterial):
            return name
    got = "no glazing in [materials]"
    raise InputError(case.source, "design.clear", got, "add one and name it")
