"""The command `drcmitsuba lights`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from rich.markup import escape
from rich.table import Table

from drcmitsuba.cli.options import CaseName, Output, Weather, load, option
from drcmitsuba.cli.terminal import show, stages
from drcmitsuba.runtime.errors import InputError


def lights(
    case: CaseName,
    point: Annotated[
        list[str], option("X,Y", "Point [m]; its nearest sensor is taken. Give more than one.")
    ],
    output: Output = Path("results"),
    weather: Weather = None,
) -> None:
    """Show who lights points: which window, sky, sun or ground, after how many bounces.

    In a folder with an evaluation of the case the states of its façade count hour by hour, and a
    report of the folder shows the points; elsewhere every state counts all the time.
    """
    import drcmitsuba

    points = [_numbers(text) for text in point]
    loaded = load(case, weather)
    known = output if (output / "illuminance.nc").is_file() else None
    with stages() as stage:
        found = drcmitsuba.lights(loaded, points, results=known, stage=stage)
        with stage("writing"):
            found.save(output)
    shares = 100 * found.shares
    for sensor in shares["sensor"].values.tolist():
        mine = shares.sel(sensor=sensor)
        x, y = float(mine["x"]), float(mine["y"])
        table = Table(
            "window", "sun direct %", "sun reflected %", "sky direct %", "sky reflected %",
            "ground %", title=f"sensor {sensor} at ({x:.2f}, {y:.2f}) m", title_justify="left",
        )  # fmt: skip
        for window in mine["window"].values:
            of = mine.sel(window=window)
            if float(of.sum()) < 0.005:
                continue
            parts = [
                v
                for source in ("sun", "sky")
                for v in (of.sel(source=source)[0], of.sel(source=source)[1:].sum())
            ]
            parts.append(of.sel(source="ground").sum())
            table.add_row(escape(str(window)), *(f"{float(v):.1f}" for v in parts))
        show(table)
    print(f"results are in {output}")


def _numbers(text: str) -> list[float]:
    """Numbers of a point "x,y" or "x,y,z"."""
    try:
        return [float(v) for v in text.split(",")]
    except ValueError:
        got = f"{text!r} is no point"
        raise InputError("command line", "--point", got, "give --point x,y in metres") from None
