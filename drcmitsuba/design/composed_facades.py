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
from drcmitsuba.transport.facade_basis import Basis, BasisYear


@dataclass(frozen=True, eq=False)
class Facades:
    """Façades of one case.

    Parameters
    ----------
    layout : Layout
        Contents of `[design]`.
    basis : Basis
        Façade basis with all replicates.
    light : Daylight
        Daylight of the case's period.
    """

    layout: Layout
    basis: Basis
    light: Daylight

    @classmethod
    def of(cls, case: Case, stage: Stage = silent) -> Facades:
        """Simulate the façade basis of a case with `[design]`.

        Raises
        ------
        InputError
            The search for a façade cannot hold the case: it has no `[design]`, tilts lamellae, is
            of a model, has components, groups or other materials, or its basis is too large.
        """
        if case.design is not None and case.design.component is not None:
            got = "the tilt of lamellae is searched, not a façade"
            raise InputError(case.source, "design.component", got, "name a film in its place")
        if isinstance(case.sun, Adaptive):  # its mesh would follow one composition
            case = case.with_tables(sun=TrueSun())
        layout = Layout.of(case)
        heights = present_facade.heights(layout)
        backend.select()
        return cls(layout, *layout.basis(heights, stage=stage))

    @cached_property
    def present(self) -> np.ndarray:
        """Composition as the façade is, shape (tile, material)."""
        basis = self.basis
        return present_facade.composition(self.layout, basis.tiles, basis.palette.names)

    @cached_property
    def problem(self) -> FacadeProblem:
        """Parameters of the façade; transmittances stay as they are."""
        year = BasisYear.of(self.basis, self.light)
        return replace(self.layout.problem(year), factors=())

    def evidence(self, share: np.ndarray) -> Evidence:
        """Evidence of a composition (tile, material): E with its C and L."""
        layout, basis, light = self.layout, self.basis, self.light
        tiles, names = basis.tiles, basis.palette.names
        built = realise(layout.case, layout.side, tiles, share, names, layout.film)
        share = np.asarray(share, np.float32)
        coefficients, direct = coefficients_of(basis, share, plan(built, light))
        E = illuminance(coefficients, light.sky, direct)
        E.attrs["step_hours"] = light.step_hours
        return Evidence(E, coefficients, light.sky, drawing(built), layout.case.source)


def coefficients_of(
    basis: Basis, share: np.ndarray, planned: Plan
) -> tuple[Coefficients, xr.Dataset]:
    """C of a façade, shaded only for hours in which the shade may close, and its direct sun."""
    case, light = planned.facts.case, planned.facts.light
    is_open = basis.coefficients(share)
    marked = attributes(case, light, planned.scope)
    coefficients = Coefficients(is_open.assign_attrs(marked))
    every = direct_sun(coefficients, light.every.sky)
    direct = every if light.year is None else every.isel(time=light.rows)
    if planned.simulated.shading is None or not may_close(case, light.step_hours, every).any():
        return coefficients, direct
    shaded = basis.coefficients(share @ basis.palette.closing)
    return Coefficients(coefficients.open, {SHADED: shaded}), direct
