"""Seconds of seasons, variants, studies and searches beside those of single evaluations.

    python -m tests.bench.searches [season] [study] [classroom] [model]

from the repository's root, all of them by default; prints Markdown. A command runs as a user starts
it, import and writing included, after a first evaluation that compiles. Seconds of the processor
are those of all its threads: on a machine with other work they say more than the clock.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from drcmitsuba.annual.bench.run import machine
from tests import ROOT
from tests.bench.__main__ import table
from tests.system.every_room import write_models

GLASS = '"generic_exterior_window_vis_0.64"'
CLASSROOM = "classroom/reference/{}"
COMMON = """[model]
files = ["{file}"]
[sensors]
floors = ["{floor}"]
spacing = {spacing}
[materials.{pane}]
type = "glazing"
transmittance = 0.64
[materials.opal]
type = "diffuser"
transmittance = 0.5
[materials.shade]
type = "diffuser"
transmittance = 0.1
[shading]
material = "shade"
"""
ROOMS = COMMON.format(file="rooms.rad", floor="floor", spacing=0.3, pane="pane_2")
FLOOR = "generic_floor_0.20"
MODEL = COMMON.format(file="rooms.hbjson", floor=FLOOR, spacing=0.195, pane=GLASS)
DESIGN = """[materials.glass]
type = "glazing"
transmittance = 0.65
[design]
film = "opal"
clear = "glass"
side = "south"
rows = 5
segments = 2
wwr = [0.1, 0.4]
"""


class Seconds(NamedTuple):
    """Seconds of a command by the clock, and of the processor."""

    clock: float
    processor: float


def seconds(*words: object) -> Seconds:
    """Time a command of the program."""
    start, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "drcmitsuba.cli", *map(str, words)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Seconds(time.perf_counter() - start, used)


def beside(name: str, took: Seconds, one: Seconds, times: int = 1) -> list[str]:
    """Row of a command beside so many evaluations."""
    ratio = f"{took.processor / (times * one.processor):.2f}"
    return [name, f"{took.clock:.0f}", f"{took.processor:.0f}", f"{one.processor:.0f}", ratio]


def evaluated(case: Path | str, folder: Path) -> Seconds:
    """Seconds of an evaluation, after one that compiles."""
    seconds("evaluate", case, "-o", folder / "one")
    return seconds("evaluate", case, "-o", folder / "one")


def of_two_sides(folder: Path) -> list[list[str]]:
    """Season, and 20 variants, of the classroom with windows to the south and to the west."""
    text = (ROOT / "scenes" / "classroom" / "existing.toml").read_text(encoding="utf-8")
    west = '[facade.west]\nstrips = [{{ bottom = 2.0, top = {:.2f}, material = "glass" }}]\n'
    names = [f"v{k}" for k in range(20)]
    for k, name in enumerate(names):
        window = text.replace("top = 3.6", f"top = {3.6 - 0.1 * (k % 5):.2f}")
        (folder / f"{name}.toml").write_text(window + west.format(2.6 + 0.1 * (k // 5)))
    first, others = folder / "v0.toml", ",".join(names[1:])
    one = evaluated(first, folder)
    season = seconds("season", first, "-o", folder / "season")
    variants = seconds("evaluate", first, "--variants", others, "-o", folder / "variants")
    return [
        beside("`season` of a room with windows to two sides", season, one),
        beside("20 variants of it (`evaluate --variants`)", variants, one),
    ]


def of_rows(folder: Path) -> list[list[str]]:
    """Study of 50 façades of a model of two rooms, beside as many evaluations."""
    write_models(folder)
    case, rows = folder / "case.toml", folder / "rows.csv"
    case.write_text(ROOMS)
    values = "\n".join(f"{0.4 + 0.01 * k:.2f}" for k in range(50))
    rows.write_text(f"materials.pane_2.transmittance\n{values}\n")
    (folder / "study.toml").write_text('case = "case.toml"\nrows = "rows.csv"\n')
    one = evaluated(case, folder)
    took = seconds("study", folder / "study.toml", "-o", folder / "study")
    return [beside("study of 50 façades of a model, beside 50 evaluations", took, one, 50)]


def of_classroom(folder: Path) -> list[list[str]]:
    """Search of the classroom's window, and of its 36 tiles."""
    rows = []
    for name in ("sizing", "tiles"):
        case = CLASSROOM.format(name)
        one = evaluated(case, folder)
        took = seconds("optimise", case, "-o", folder / name)
        rows.append(beside(f"`optimise {case}`", took, one))
    return rows


def of_model(folder: Path) -> list[list[str]]:
    """Search of 20 tiles of a model's walls with a thousand sensors."""
    write_models(folder)
    case = folder / "case.toml"
    case.write_text(MODEL + DESIGN)
    one = evaluated(case, folder)
    took = seconds("optimise", case, "-o", folder / "design")
    return [beside("`optimise` of a model, 1,000 sensors, 20 tiles", took, one)]


PARTS = {"season": of_two_sides, "study": of_rows, "classroom": of_classroom, "model": of_model}


def main() -> None:
    """Print the table."""
    rows = []
    for part in sys.argv[1:] or PARTS:
        with tempfile.TemporaryDirectory() as folder:
            rows += PARTS[part](Path(folder))
    print(machine(), "\n")
    head = ["command", "clock: s", "processor: s", "one evaluation: s", "ratio"]
    table(head, rows)


if __name__ == "__main__":
    main()
