"""Write the page of the calibration; the package says what is compared."""

from __future__ import annotations

import argparse
import datetime
import platform
import time
from pathlib import Path

import mitsuba as mi

from drcmitsuba.runtime import backend
from tests.validation.calibration.comparison import PLACES, Coverage
from tests.validation.calibration.rooms import ROOMS

PAGE = Path(__file__).parents[3] / "docs" / "validation" / "calibration.md"


def table(rooms: dict[str, list[Coverage]], seeds: int) -> str:
    """Page with the coverage of all rooms."""
    today = datetime.date.today().isoformat()
    about = f"""\
Intervals of single sensors and eyes against the path tracer `coefficient`, {seeds} seeds a room, on
{today} ({platform.machine()}, variant `{mi.variant()}`), by quarters of brightness. An entry is the
sky's interreflected light or that of one of thirty suns at one sensor, or DGP of one view at one
hour. *Held* is the share of 95 % intervals that hold the path tracer's value, with its standard
error over the seeds (entries of a seed share their noise, most of all those of an eye) and over the
runs of the path tracer, *bias* the mean of all seeds over it, *stated* the median standard error of
one entry of one seed.
`python -m tests.validation.calibration` writes this page; `tests/validation/calibration` says how
the figures come about."""
    heads = "| room | light | | darkest | second | third | brightest |"
    lines = ["# Calibration of single sensors and eyes", "", about, "", heads, "|---" * 7 + "|"]
    for name, rows in rooms.items():
        for light in dict.fromkeys(row.light for row in rows):
            mine = [row for row in rows if row.light == light]
            held = " | ".join(f"{row.covered:.1%} ± {row.covered_error:.1%}" for row in mine)
            bias = " | ".join(f"{row.bias:+.1%} ± {row.bias_error:.1%}" for row in mine)
            stated = " | ".join(f"{row.stated:.1%}" for row in mine)
            lines += [f"| {name} | {light} | held | {held} |", f"| | | bias | {bias} |"]
            lines.append(f"| | | stated | {stated} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Compare the rooms, print each, and write the page where all are asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rooms", default=",".join(ROOMS))
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--at", default=",".join(PLACES), help="sensors, eyes, or both")
    asked = parser.parse_args()
    backend.select()
    rooms = {}
    for name in asked.rooms.split(","):
        start = time.perf_counter()
        room = ROOMS[name]()
        rooms[name] = [row for at in asked.at.split(",") for row in PLACES[at](room, asked.seeds)]
        print(table({name: rooms[name]}, asked.seeds).split("|---" * 7 + "|\n")[1], end="")
        print(f"{time.perf_counter() - start:.0f} s", flush=True)
    if set(rooms) == set(ROOMS) and asked.at == ",".join(PLACES):
        PAGE.write_text(table(rooms, asked.seeds), encoding="utf-8")


if __name__ == "__main__":
    main()
