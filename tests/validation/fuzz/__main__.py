"""Compare random cases: `python -m tests.validation.fuzz [--seeds 0 20] [--minutes 30]`.

Prints a row for every case and source, as Markdown; the exit code is 1 where one of them is wrong.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from tests.validation.fuzz.agreement import Sample, compared, planned
from tests.validation.fuzz.boxes import random_box
from tests.validation.fuzz.buildings import random_building
from tests.validation.fuzz.choices import random_choice

KINDS: dict[str, Callable[[np.random.Generator], Sample]] = {
    "box": lambda rng: planned(random_box(rng)),
    "building": lambda rng: planned(random_building(rng)),
    "choice": random_choice,
}
"""Function that draws a sample, by kind."""
HEAD = "| case | source | deviation of the sum | worst sensor | probability | |"


def drawn(kind: str, seed: int) -> Sample:
    """Sample of a kind and a seed, the same on every machine."""
    return KINDS[kind](np.random.default_rng([seed, list(KINDS).index(kind)]))


def main() -> int:
    """Compare, and say what is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", default=",".join(KINDS), help="box, building, choice, or some")
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 20), metavar=("FIRST", "END"))
    parser.add_argument("--paths", type=int, default=1024, help="paths from a sensor, of 16 runs")
    parser.add_argument("--minutes", type=float, default=30.0, help="no case begins after them")
    asked, start, wrong = parser.parse_args(), time.monotonic(), 0
    backend.select()
    print(HEAD, "|---" * 6 + "|", sep="\n", flush=True)
    for seed in range(*asked.seeds):
        for kind in asked.kinds.split(","):
            if time.monotonic() - start > 60 * asked.minutes:
                return int(wrong > 0)
            try:
                rows = compared(drawn(kind, seed), asked.paths)
            except InputError as error:
                print(f"| {kind} {seed} | refused | {error} | | | |", flush=True)
                continue
            for row in rows:
                wrong += row.is_wrong
                told = "wrong" if row.is_wrong else ""
                print(
                    f"| {kind} {seed} | {row.source} | {row.deviation:+.2%} ± {row.error:.2%} "
                    f"| {row.worst:+.1%} | {row.p_worst:.1e} | {told} |",
                    flush=True,
                )  # fmt: skip
    return int(wrong > 0)


if __name__ == "__main__":
    raise SystemExit(main())
