"""Films as design variables: their cost, and how well their year agrees with the simulation.

    python -m tests.bench.film_design [CASE]

prints the seconds of a `FilmYear`, of its illuminances and of their derivatives, and E of the
case's own film by W·A·L beside that of an ordinary simulation with another seed.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from time import perf_counter
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba import load_case
from drcmitsuba.annual import simulation
from drcmitsuba.case.case import Case
from drcmitsuba.design.film import Leaves, MeasuredFilm, Mix, ParametricFilm
from drcmitsuba.design.film_year import FilmYear
from drcmitsuba.metrics import accumulate
from drcmitsuba.runtime import backend
from drcmitsuba.sky.daylight import Daylight, daylight

REPEATS = 5


def seconds(work: Callable[[], Any]) -> float:
    """Least of several runs, the first, which compiles, left out."""
    taken = []
    for _ in range(REPEATS + 1):
        dr.sync_thread()
        start = perf_counter()
        dr.eval(work())
        dr.sync_thread()
        taken.append(perf_counter() - start)
    return min(taken[1:])


def costs(year: FilmYear, name: str, build: Callable[..., Any], values: list[mi.Float]) -> None:
    """Print the seconds of the mean E, its derivatives by all parameters, and all E's by one."""

    def loss(given: list[mi.Float]) -> mi.Float:
        return dr.mean(year.illuminance(build(*given)).array)

    def reverse() -> list[mi.Float]:
        given = [mi.Float(v) for v in values]
        dr.enable_grad(given)
        dr.backward(loss(given))
        return [dr.grad(v) for v in given]

    def forward() -> mi.Float:
        given = [mi.Float(v) for v in values]
        dr.enable_grad(given[0])
        dr.set_grad(given[0], 1.0)
        return dr.forward_to(year.illuminance(build(*given)).array)

    primal = seconds(lambda: loss(values))
    both = [seconds(work) for work in (reverse, forward)]
    count = sum(dr.width(v) for v in values)
    print(
        f"{name}: primal {primal:.3f} s; with all {count} derivatives, reverse, {both[0]:.3f} s "
        f"({both[0] / primal:.1f} ×); by one, forward, {both[1]:.3f} s ({both[1] / primal:.1f} ×)"
    )


def agreement(case: Case, light: Daylight, year: FilmYear, film: MeasuredFilm) -> None:
    """Print E of the case's own film beside that of an ordinary simulation."""
    other = case.model_copy(
        update={"accuracy": case.accuracy.model_copy(update={"seed": case.accuracy.seed + 1})}
    )
    start = perf_counter()
    C = simulation.transport(other, "open", light.suns, light.sky.attrs["latitude"])
    taken = perf_counter() - start
    theirs = accumulate.replicates(C, light.sky, np.arange(C.sizes["sensor"]))
    ours, n = year.replicates(film), len(theirs)
    mean = theirs.mean()
    off = ours.mean(axis=0) - theirs.mean(axis=0)
    expected = (ours.var(axis=0, ddof=1) + theirs.var(axis=0, ddof=1)) / n
    totals = [a.mean(axis=(1, 2)) for a in (ours, theirs)]
    own = np.sqrt(sum(t.var(ddof=1) for t in totals) / n) / mean
    print(
        f"Beside a simulation ({taken:.1f} s): mean E {off.mean() / mean:+.2%} ± {own:.2%}; RMS "
        f"{np.sqrt((off**2).mean()) / mean:.2%}, by the standard errors of both "
        f"{np.sqrt(expected.mean()) / mean:.2%}"
    )


def main() -> None:
    backend.select()
    case = load_case(sys.argv[1] if len(sys.argv) > 1 else "classroom/reference/o3")
    light = daylight(case)
    film = MeasuredFilm(next(m.file for m in case.materials.values() if m.type == "bsdf"))
    for which in ("first", "again"):
        start = perf_counter()
        year = FilmYear.of(case, light)
        print(f"FilmYear, {which}: {perf_counter() - start:.1f} s", *year.transfer.shape)
    start = perf_counter()
    dr.eval(film.answer(year.bins))
    dr.sync_thread()
    print(f"look-up of {film.file.name}: {perf_counter() - start:.2f} s")
    agreement(case, light, year, film)
    numbers = [mi.Float(v) for v in (0.6, 0.8, 5.0, 10.0)]
    costs(year, "parametric film", ParametricFilm, numbers)
    mixed = ParametricFilm(0.6)
    costs(year, "mix with it", lambda s: Mix(film, mixed, s), [mi.Float(0.4)])
    costs(year, "leaves", lambda v: Leaves(film, v), [film.values])


if __name__ == "__main__":
    main()
