"""Seconds of a year by bands, beside the same year by luminance and by three channels.

    python -m tests.bench.colour [CASE] [--times 3]

from the repository's root; prints Markdown. Every evaluation runs again and again in one process,
without files, after a first run that compiles; the ratios are to luminance alone.
"""

from __future__ import annotations

import argparse
import time
from typing import get_args

import numpy as np

from drcmitsuba.annual.bench.run import machine
from drcmitsuba.annual.result import evaluate
from drcmitsuba.case.case import Case
from drcmitsuba.case.colour import Bands, Colour
from drcmitsuba.case.reading import load_case
from drcmitsuba.runtime import backend
from tests.bench.__main__ import table


def seconds(case: Case, times: int) -> float:
    """Median time of an evaluation after a first one [s]."""
    evaluate(case)
    spent = []
    for _ in range(times):
        start = time.perf_counter()
        evaluate(case)
        spent.append(time.perf_counter() - start)
    return float(np.median(spent))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("case", nargs="?", default="classroom/existing")
    parser.add_argument("--times", type=int, default=3)
    given = parser.parse_args()
    backend.select()
    case, rows, first = load_case(given.case), [], 0.0
    every = [bands for part in get_args(Bands) for bands in (get_args(part) or (part,))]
    for bands in (b for b in every if b != "auto"):
        spent = seconds(case.with_tables(colour=Colour(bands=bands)), given.times)
        first = first or spent
        rows.append([str(bands), f"{spent:.2f}", f"{spent / first:.2f}"])
    print(machine(), f"\n\n## Bands of `{given.case}`, without files\n")
    table(["bands", "seconds", "ratio to luminance"], rows)


if __name__ == "__main__":
    main()
