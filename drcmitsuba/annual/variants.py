"""Several façades of one room from one simulation."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr

from drcmitsuba.annual.attributes import attributes
from drcmitsuba.annual.result import Result, summed_up
from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import SHADED
from drcmitsuba.case.reading import load_case
from drcmitsuba.case.sun import Adaptive
from drcmitsuba.metrics import illuminance
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.evaluate_metrics import evaluate_metrics, may_close
from drcmitsuba.plan import Plan, notes, plan
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Stage, silent
from drcmitsuba.sky.daylight import Daylight, daylight_and_year
from drcmitsuba.transport import facade_basis


def load_variants(path: str, names: Sequence[str]) -> list[Case]:
    """Load a case, a TOML file or a shipped one, and its variants in the same folder.

    `names` are the names of the variants' files, without their ending.

    Raises
    ------
    InputError
        A case is unfit, or a name comes twice or holds a folder.
    """
    first = Path(path)
    every = [first.stem, *names]
    for name in names:
        if not name or Path(name).name != name or every.count(name) > 1:
            got = f"{name!r}"
            raise InputError("command line", "--variants", got, "name files beside the case, once")
    ending = first.suffix if first.is_file() else ""  # shipped cases have none
    return [load_case(path), *(load_case(str(first.with_name(name + ending))) for name in names)]


@dataclass(frozen=True)
class SharedBasis:
    """Façade basis of several cases, each of which gets its result from it."""

    cases: Sequence[Case]
    light: Daylight
    basis: facade_basis.Basis
    shares: list[np.ndarray]
    """Composition of each case, shape (tile, material)."""
    remarks: list[list[str]]
    """Notes on the films and the shade of each case."""
    run: Run

    @classmethod
    def of(
        cls, cases: Sequence[Case], stage: Stage = silent, light: Daylight | None = None
    ) -> SharedBasis:
        """Simulate the façade basis of cases that differ in their façades only.

        Parameters
        ----------
        cases : sequence of Case
            Cases with windows in one side of the room.
        stage : callable, optional
        light : Daylight, optional
            Daylight of the cases; by default computed.

        Raises
        ------
        InputError
            The cases cannot share a basis: they differ in more than façades, are coloured, have a
            target or an adaptive sun, or need more memory than `facade_basis.MOST_BYTES`.
        """
        backend.select()
        first = cases[0]
        for case in cases:
            case.refuse_components("a comparison of façades")
            case.refuse_groups("a comparison of façades")
        if first.accuracy.sensor_goal is not None:
            got = "a target for several façades at once"
            raise InputError(first.source, "accuracy.target", got, "leave it out, or evaluate each")
        if isinstance(first.sun, Adaptive):
            raise InputError(first.source, "sun.model", "adaptive", "take another one for variants")
        run = replace(Run.of(first), stage=stage)
        with run.timed("sky"):
            remarks = [notes(case) for case in cases]  # reads the films' files, which may be unfit
            light = daylight_and_year(first) if light is None else light
            wall, tiles, palette, shares = facade_basis.of_variants(cases)
        with run.timed("façade basis") as done:
            basis = facade_basis.compute(
                wall, tiles, palette, light.suns, first.accuracy,
                subdivision=first.sky.subdivision, progress=done,
            )  # fmt: skip
        return cls(cases, light, basis, shares, remarks, run)

    def simulated(self, number: int, judged: Case | None = None) -> Simulated:
        """Compute C of one of the cases, for its own rules of the metrics or those of another."""
        case = self.cases[number] if judged is None else judged
        run = replace(
            self.run, seconds=dict(self.run.seconds), ray_counter=Counter(self.run.ray_counter)
        )
        with run.timed(case.name):
            planned = plan(case, self.light)
            run = replace(run, enabled_effects=planned.scope)
            coefficients, direct = coefficients_of(self.basis, self.shares[number], planned)
        return Simulated(planned, coefficients, direct, self.remarks[number], run)


@dataclass(frozen=True)
class Simulated:
    """C of one case of a basis, from which another thread may take the result."""

    planned: Plan
    coefficients: Coefficients
    direct: xr.Dataset
    remarks: list[str]
    run: Run

    def result(self) -> Result:
        """Evaluate the metrics."""
        case, light = self.planned.facts.case, self.planned.facts.light
        start = time.perf_counter()
        evaluated = evaluate_metrics(case, light, self.coefficients, self.direct)
        self.run.seconds[case.name] += round(time.perf_counter() - start, 3)
        return summed_up(self.planned, self.coefficients, evaluated, self.run, self.remarks)


def evaluate_variants(
    cases: Sequence[Case], stage: Stage = silent, judged: Sequence[Case] | None = None
) -> Iterator[Result]:
    """Evaluate several façades of one room from one façade basis.

    Parameters
    ----------
    cases : sequence of Case
        Cases that differ in their façades only, with windows in one side of the room.
    stage : callable, optional
    judged : sequence of Case, optional
        The same cases with other rules for the metrics, such as no shade; default: `cases`.

    Yields
    ------
    Result
        Result of each case; its seconds include those of the shared façade basis.

    Raises
    ------
    InputError
        As `SharedBasis.of`.

    Notes
    -----
    Variants share their light paths: the difference of two has a smaller error than either one.
    """
    shared = SharedBasis.of(cases, stage)
    for number, case in enumerate(judged or cases):
        yield shared.simulated(number, case).result()


def coefficients_of(
    basis: facade_basis.Basis, share: np.ndarray, planned: Plan
) -> tuple[Coefficients, xr.Dataset]:
    """C of a façade, shaded only for hours in which the shade may close, and its direct sun."""
    case, light = planned.facts.case, planned.facts.light
    is_open = basis.coefficients(share)
    marked = attributes(case, light, planned.scope)
    coefficients = Coefficients(is_open.assign_attrs(marked))
    every = illuminance.direct_sun(coefficients, light.every.sky)
    direct = every if light.year is None else every.isel(time=light.rows)
    if planned.simulated.shading is None or not may_close(case, light.step_hours, every).any():
        return coefficients, direct
    shaded = basis.coefficients(share @ basis.palette.closing)
    return Coefficients(coefficients.open, {SHADED: shaded}), direct
