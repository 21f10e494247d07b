"""Seconds of another façade of known elements, metrics and intervals with it.

    python -m tests.bench.known_elements [CASE] [--sensors 24 71] [--times 3]

A grid of so many sensors along each edge is laid over that of the case. Each façade is summed from
what all of them share, and, beside it, by the coefficients of the façade. Seconds of the processor
are those of all threads: on a machine with other work they say more than the clock.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from drcmitsuba import elements, load_case
from drcmitsuba.annual.elements import Elements
from drcmitsuba.case.case import Case
from drcmitsuba.case.sensors import Sensors
from tests.bench.__main__ import machine, table


def with_sensors(case: Case, count: int) -> Case:
    """The case with so many sensors along each edge of its grid."""
    grid = case.sensors
    assert isinstance(grid, Sensors)
    spacing = grid.count[0] * grid.spacing / count
    finer = grid.model_copy(update={"count": (count, count), "spacing": spacing})
    return case.with_tables(sensors=finer)


def choices(known: Elements) -> dict[str, Mapping[str, Any]]:
    """As drawn, another fill, and shares of two."""
    opening = known.openings[0]
    first, *_, last = known.fills[opening]
    mixed = {opening: {first: 0.4, last: 0.6}}
    return {"as drawn": {}, last: {opening: last}, f"{first} and {last}": mixed}


def spent(work: Callable[[], Any], times: int) -> tuple[float, float]:
    """Medians of the clock's seconds and the processor's."""
    taken = np.empty((times, 2))
    for row in taken:
        start = time.perf_counter(), time.process_time()
        work()
        row[:] = time.perf_counter() - start[0], time.process_time() - start[1]
    clock, processor = np.median(taken, axis=0)
    return float(clock), float(processor)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("case", nargs="?", default="classroom/reference/o3")
    parser.add_argument("--sensors", type=int, nargs="+", default=[24], help="along each edge")
    parser.add_argument("--times", type=int, default=5)
    options = parser.parse_args()
    print(f"{machine()}\n")
    rows = []
    for count in options.sensors:
        known = elements(with_sensors(load_case(options.case), count))
        by_coefficients = replace(known)
        vars(by_coefficients)["_light"] = None
        for name, choice in choices(known).items():
            known.evaluate(choice)  # what all façades share, and kernels
            ours = spent(partial(known.evaluate, choice), options.times)
            theirs = spent(partial(by_coefficients.evaluate, choice), 2)
            numbers = (*ours, *theirs, theirs[1] / ours[1])
            rows.append([str(count**2), name, *(f"{number:.2f}" for number in numbers)])
    table(["sensors", "façade", "s", "processor s", "by C s", "processor s", "ratio"], rows)


if __name__ == "__main__":
    main()
