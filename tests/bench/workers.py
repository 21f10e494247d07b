"""Seconds of a year with 1, 2, … workers on this machine, and by the model of the documentation.

    python -m tests.bench.workers [--sensors 8100] [--counts 1,2] [--further 4,8,16,32,64]

from the repository's root; prints Markdown. The case is `classroom/reference/existing` with a finer
grid. The model takes seconds that one process measured with the threads of one worker:

    seconds(n) = own + start + Σ_states (shared + max over workers of Σ seconds of its blocks)

`own` is what the command needs where all blocks are stored, `start` the start of n workers,
`shared` what each worker computes before its first block. `further` rows are simulated: each worker
is a machine like one of two workers here, and the folder of blocks costs no time.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter, time

import drjit as dr
import numpy as np

from drcmitsuba.annual.block_parts import StatePart
from drcmitsuba.annual.workers import opened
from drcmitsuba.blocks.block_folder import BlockFolder
from drcmitsuba.blocks.part import EVERY_BLOCK, BlockPart
from drcmitsuba.case.groups import OPEN, SHADED
from drcmitsuba.case.reading import load_case
from drcmitsuba.runtime import backend
from drcmitsuba.sky.daylight import daylight
from tests import ROOT
from tests.bench.__main__ import machine, table


@dataclass(frozen=True)
class Costs:
    """Seconds of the steps of an evaluation in blocks."""

    own: float
    shared: list[float]
    """Seconds before the first block, by state."""
    blocks: list[np.ndarray]
    """Seconds of each block, by state."""

    def seconds(self, workers: int, start: float) -> float:
        """Seconds of the command with some workers, which take `start` seconds to start."""
        parts = [BlockPart(i, workers) for i in range(1, workers + 1)]
        slowest = [
            shared + max(sum(s for i, s in enumerate(blocks) if p.holds(i)) for p in parts)
            for shared, blocks in zip(self.shared, self.blocks, strict=True)
        ]
        return self.own + start + sum(slowest)


def state_costs(path: str, folder: str, threads: int) -> tuple[list[float], list[np.ndarray]]:
    """Seconds before the first block, and of each block, in this process by state."""
    backend.select()
    dr.set_thread_count(threads)
    case = load_case(path)
    shared, blocks = [], []
    for state in (OPEN, SHADED):
        at = Path(folder) / state
        at.mkdir()
        began = time()
        suns = daylight(case.with_dark_hours()).suns  # as for any cache
        part = StatePart(case, state, suns, 1, BlockFolder.cache(at), EVERY_BLOCK)
        part.make(lambda share: None)
        ends = np.sort([file.stat().st_mtime for file in at.rglob("*.zip")])
        each = np.diff(ends)
        # The first block is as long as the others, but for the last, which may be smaller.
        first = float(np.median(each[:-1]))
        shared.append(float(ends[0] - began - first))
        blocks.append(np.array([first, *each]))
    return shared, blocks


def evaluated(case: Path, folder: Path, workers: int | None) -> float:
    """Seconds of the command."""
    command = [sys.executable, "-m", "drcmitsuba.cli", "evaluate", str(case)]
    command += ["-o", str(folder / f"results_{workers}"), "--memory", "1 MiB"]
    command += ["--cache", str(folder / f"cache_{workers or 1}")]
    command += ["--workers", str(workers)] if workers else []
    began = perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return perf_counter() - began


def started(workers: int) -> float:
    """Seconds until some workers are ready."""
    began = perf_counter()
    with opened(workers):
        return perf_counter() - began


def numbers(text: str) -> list[int]:
    return [int(n) for n in text.split(",")]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sensors", type=int, default=8100, help="about as many sensors")
    parser.add_argument("--counts", type=numbers, default=[1, 2], help="workers that are run")
    parser.add_argument("--further", type=numbers, default=[4, 8, 16, 32, 64], help="simulated")
    options = parser.parse_args()
    print(f"{machine()}; {backend.select()}\n", flush=True)
    n, cores = round(options.sensors**0.5), os.cpu_count() or 1
    spawn = multiprocessing.get_context("spawn")
    rows, costs, start = [], None, 0.0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        case = folder / "case.toml"
        text = (ROOT / "scenes/classroom/reference/existing.toml").read_text()
        finer = f"count = [{n}, {n}]\nspacing = {6.9 / (n - 1):.6f}"
        case.write_text(text.replace("count = [24, 24]\nspacing = 0.3", finer))
        for count in options.counts:
            at = folder / f"alone_{count}"
            at.mkdir()
            with ProcessPoolExecutor(1, spawn) as one:
                threads = max(1, cores // count)
                shared, blocks = one.submit(state_costs, str(case), str(at), threads).result()
            measured, start = evaluated(case, folder, count), started(count)
            own = evaluated(case, folder, None) if costs is None else costs.own
            costs = Costs(own, shared, blocks)
            model = costs.seconds(count, start)
            rows.append([count, f"{measured:.1f}", f"{model:.1f}", f"{model / measured:.2f}"])
            print(f"{count} workers of {threads} threads: own {own:.1f} s, start {start:.1f} s, "
                  f"shared {np.round(shared, 1)} s, blocks {[np.round(b, 1) for b in blocks]} s\n",
                  flush=True)  # fmt: skip
    first = costs.seconds(1, start)
    for count in options.further:
        model = costs.seconds(count, start)
        rows.append([count, "–", f"{model:.1f}", f"{first / model:.1f} times 1 worker"])
    table(["workers", "measured [s]", "model [s]", "model / measured"], rows)


if __name__ == "__main__":
    main()
