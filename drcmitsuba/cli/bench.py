"""The command `drcmitsuba bench`."""

from __future__ import annotations

from typing import Annotated

import typer

from drcmitsuba.cli.options import Weather
from drcmitsuba.cli.terminal import stages

QUICK = "Fewer sensors, suns and reference paths: about a minute."


def bench(
    quick: Annotated[bool, typer.Option("--quick", help=QUICK)] = False,
    weather: Weather = None,
) -> None:
    """Measure seconds and errors of this program and of Radiance here, as a table in Markdown."""
    from drcmitsuba.annual.bench import bench as measure
    from drcmitsuba.annual.bench.run import QUICK as FEW
    from drcmitsuba.annual.bench.run import WHOLE

    with stages() as stage:
        measured = measure(FEW if quick else WHOLE, weather, stage)
    print(measured.markdown(), end="")
