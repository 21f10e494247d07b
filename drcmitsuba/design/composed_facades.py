"""Façades of one case from one simulation: any composition with all its evidence."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import xarray as xr

from drcmitsuba.annual.attributes import attributes
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import SHADED
from drcmitsuba.case.sun import Adaptive, TrueSun
from drcmitsuba.design import present_facade
from drcmitsuba.design.facade_tiles import TiledLight
from drcmitsuba.design.facade_year import FacadeYear
from drcmitsuba.design.layout import Layout
from drcmitsuba.design.problem import FacadeProblem
from drcmitsuba.design.realise import realise
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.evaluate_metrics import drawing, may_close
from drcmitsuba.metrics.illuminance import direct_sun, illuminance
from drcmitsuba.plan import Plan, plan
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Stage, silent
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.standards import Evidence


@dataclass(frozen=True, eq=False)
class Facades:
    """Façades of one case.

    Parameters
    ----------
    layout : Layout
        Contents of `[design]`.
    tiled : TiledLight
        Light by tile with all replicates.
    light : Daylight
        Daylight of the case's period.
    """

    layout: Layout
    tiled: TiledLight
    light: Daylight

    @classmethod
    def of(cls, case: Case, stage: Stage = silent) -> Facades:
        """Simulate the light by tile of a case with `[design]`.

        Raises
        ------
        InputError
            The search for a façade cannot hold the case: it has no `[design]`, tilts lamellae, is
            of a model, has groups, components in its strips or other materials, or takes more
            memory than there is.
        """
        if case.design is not None and case.design.component is not None:
            got = "the tilt of lamellae is searched, not a façade"
            raise InputError(case.source, "design.component", got, "name a film in its place")
        if isinstance(case.sun, Adaptive):  # its mesh would follow one composition
            case = case.with_tables(sun=TrueSun())
        layout = Layout.of(case)
        case.refuse_groups("the cheapest change of a façade", layout.side)
        heights = present_facade.heights(layout)
        backend.select()
        return cls(layout, *layout.light(heights, stage=stage))

    @cached_property
    def present(self) -> np.ndarray:
        """Composition as the façade is, shape (tile, material)."""
        return present_facade.composition(self.layout, self.tiled.tiles, self.tiled.materials)

    @cached_property
    def problem(self) -> FacadeProblem:
        """Parameters of the façade; transmittances stay as they are."""
        year = FacadeYear.of(self.tiled, self.light)
        return replace(self.layout.problem(year), factors=())

    def evidence(self, share: np.ndarray) -> Evidence:
        """Evidence of a composition (tile, material): E with its C and L."""
        layout, tiled, light = self.layout, self.tiled, self.light
        tiles, names = tiled.tiles, tiled.materials
        built = realise(layout.case, layout.side, tiles, share, names, layout.film)
        coefficients, direct = coefficients_of(tiled, share, plan(built, light))
        E = illuminance(coefficients, light.sky, direct)
        E.attrs["step_hours"] = light.step_hours
        return Evidence(E, coefficients, light.sky, drawing(built), layout.case.source)


def coefficients_of(
    tiled: TiledLight, share: np.ndarray, planned: Plan
) -> tuple[Coefficients, xr.Dataset]:
    """C of a façade, shaded only for hours in which the shade may close, and its direct sun."""
    case, light = planned.facts.case, planned.facts.light
    is_open = tiled.coefficients(share)
    marked = attributes(case, light, planned.scope)
    coefficients = Coefficients(is_open.assign_attrs(marked))
    every = direct_sun(coefficients, light.every.sky)
    direct = every if light.year is None else every.isel(time=light.rows)
    if planned.simulated.shading is None or not may_close(case, light.step_hours, every).any():
        return coefficients, direct
    shaded = tiled.coefficients(share, closed=True)
    return Coefficients(coefficients.open, {SHADED: shaded}), direct
