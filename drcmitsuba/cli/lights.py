"""The command `drcmitsuba lights`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.markup import escape
from rich.table import Table

from drcmitsuba.cli.options import CaseName, Output, Weather, lengths, load, option
from drcmitsuba.cli.terminal import show, show_notes, stages

if TYPE_CHECKING:
    import xarray as xr


def lights(
    case: CaseName,
    point: Annotated[
        list[str] | None,
        option(
            "X,Y[,Z]", "Point, as in plans [m]; its nearest sensor is taken. Give more than one."
        ),
    ] = None,
    output: Output = Path("results"),
    weather: Weather = None,
) -> None:
    """Show who lights points: which window, sky, sun or ground, after how many bounces.

    In a folder with an evaluation of the case the states of its façade count hour by hour, and a
    report of the folder shows the points; elsewhere every state counts all the time. Without a
    point, the shares of all sensors are written for the report's plan.
    """
    import drcmitsuba
    from drcmitsuba.report.lights import of_period
    from drcmitsuba.runtime.storage import save_netcdf

    points = [lengths(text, (2, 3), "--point", "x,y or x,y,z") for text in point or ()]
    loaded = load(case, weather)
    known = output if (output / "illuminance.nc").is_file() else None
    if not points:
        with stages() as stage:
            every = drcmitsuba.lights_of_sensors(loaded, results=known, stage=stage)
            save_netcdf(every, output / "light_of_sensors.nc")
        light = of_period(every).sum("sensor")
        show(_table("all sensors", 100 * light / light.sum()))
        show_notes(_notes(every))
        print(f"results are in {output}")
        return
    with stages() as stage:
        found = drcmitsuba.lights(loaded, points, results=known, stage=stage)
        with stage("writing"):
            found.save(output)
    shares = 100 * found.shares
    for sensor in shares["sensor"].values.tolist():
        mine = shares.sel(sensor=sensor)
        x, y = float(mine["x"]), float(mine["y"])
        show(_table(f"sensor {sensor} at ({x:.2f}, {y:.2f}) m", mine))
    show_notes(_notes(found.dataset))
    print(f"results are in {output}")


def _notes(light: xr.Dataset) -> list[str]:
    """Notes on the weather and the place, and on hours that are left out."""
    from drcmitsuba.report.lights import hours_left_out

    notes, hours = json.loads(light.attrs["notes"]), hours_left_out(light)
    return [*notes, *[f"{hours:g} h with further states of the façade are left out"] * (hours > 0)]


def _table(title: str, shares: xr.DataArray) -> Table:
    """Table of shares [%] (window, source, bounces)."""
    table = Table(
        "window", "sun direct %", "sun reflected %", "sky direct %", "sky reflected %",
        "ground %", title=title, title_justify="left",
    )  # fmt: skip
    for window in shares["window"].values:
        of = shares.sel(window=window)
        if float(of.sum()) < 0.005:
            continue
        parts = [
            v
            for source in ("sun", "sky")
            for v in (of.sel(source=source)[0], of.sel(source=source)[1:].sum())
        ]
        parts.append(of.sel(source="ground").sum())
        table.add_row(escape(str(window)), *(f"{float(v):.1f}" for v in parts))
    return table
