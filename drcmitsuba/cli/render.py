"""The command `drcmitsuba render`."""

from __future__ import annotations

import re
from collections import Counter
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from drcmitsuba.cli.options import CaseName, Output, Weather, load, option
from drcmitsuba.cli.terminal import show_notes, stages
from drcmitsuba.runtime.errors import InputError


class Tone(str, Enum):
    """Ways to a picture for a screen."""

    human = "human"
    exposure = "exposure"
    false = "false"


class Source(str, Enum):
    """Light of a picture."""

    all = "all"
    sky = "sky"
    sun = "sun"


class ScreenSpace(str, Enum):
    """Spaces of a PNG's colours."""

    srgb = "srgb"
    display_p3 = "display-p3"


class ExrValues(str, Enum):
    """Values of an `.exr`."""

    float = "float"
    half = "half"


def _size(text: str) -> int | tuple[int, int]:
    """Columns, or columns and rows, of a picture."""
    match = re.fullmatch(r"(\d{1,6})(?:x(\d{1,6}))?", text, re.ASCII)
    if match is None:
        raise InputError("command line", "--size", repr(text), "give 512 or 800x600")
    return int(match[1]) if match[2] is None else (int(match[1]), int(match[2]))


def _scale(text: str, tone: Tone) -> tuple[float, float]:
    """Luminances [cd/m²] of a text such as "10,10000"."""
    from drcmitsuba.rendering.rendering import check_scale

    try:
        least, most = (float(number) for number in text.split(","))
    except ValueError:
        remedy = "give least and most [cd/m²], as 10,10000"
        raise InputError("command line", "--scale", repr(text), remedy) from None
    check_scale((least, most), tone.value)
    return least, most


def render(
    case: CaseName,
    view: Annotated[str | None, option("NAME", "View of the case; not needed for one.")] = None,
    time: Annotated[
        list[str] | None, option("TIME", "Local standard time, as 03-21 10:30; or more.", "--time")
    ] = None,
    times: Annotated[
        Path | None, option("FILE", "CSV with a column `time`: one picture for each.")
    ] = None,
    bins: Annotated[
        bool, typer.Option("--bins", help="Coefficient pictures of ground and sky patches.")
    ] = False,
    size: Annotated[str, option("PIXELS", "Columns, or columns x rows.")] = "512",
    tone: Annotated[Tone, option("NAME", "PNG: human, exposure or false (colour).")] = Tone.human,
    scale: Annotated[
        str | None,
        option("LEAST,MOST", "Ends of false colours, white of an exposure [cd/m²], as 10,10000."),
    ] = None,
    white: Annotated[
        str, option("LIGHT", "White of a PNG: daylight, view (its mean light) or kelvin, as 4000.")
    ] = "daylight",
    space: Annotated[
        ScreenSpace, option("NAME", "Colours of a PNG: srgb or display-p3.")
    ] = ScreenSpace.srgb,
    pixels: Annotated[ExrValues, option("NAME", "EXR: float or half.")] = ExrValues.float,
    samples: Annotated[int, option("NUMBER", "Rays in each pixel.")] = 8,
    target: Annotated[
        str | None, option("ERROR", 'Wanted error of a pixel, as "2 %": rounds of rays follow.')
    ] = None,
    time_limit: Annotated[
        float | None, option("SECONDS", "Time for these rounds [s]; 60 by default.")
    ] = None,
    state: Annotated[
        list[str] | None,
        option(
            "NAME", "Façade: open, shaded or, as the shade is in each hour, applied; or several."
        ),
    ] = None,
    source: Annotated[
        Source, option("NAME", "Light shown: all, sky (and ground) or sun alone.")
    ] = Source.all,
    output: Output = Path("results"),
    weather: Weather = None,
) -> None:
    """Render a view: .exr with its standard error, .hdr and .png, in cd/m²."""
    from drcmitsuba.case.groups import APPLIED, OPEN
    from drcmitsuba.picture.screen import SRGB, Screen, parsed_white
    from drcmitsuba.rendering import Sampling, frames, prepare
    from drcmitsuba.rendering.frames import TIME_LIMIT
    from drcmitsuba.rendering.rendering import file_name
    from drcmitsuba.rendering.view_of_case import instant_of
    from drcmitsuba.sky.daylight import weather_of
    from drcmitsuba.sky.period import read_timestamps

    given = [name for name, is_given in (
        ("--time", bool(time)), ("--times", times is not None), ("--bins", bins)
    ) if is_given]  # fmt: skip
    if len(given) != 1:
        got = " and ".join(given) or "none of them"
        raise InputError("command line", "--time, --times, --bins", got, "give one of them")
    if target is None and time_limit is not None:
        got = "given without --target"
        raise InputError("command line", "--time-limit", got, 'give --target, as "2 %"')
    if bins and target is not None:
        remedy = "bins have no hour: give more --samples"
        raise InputError("command line", "--target", "given with --bins", remedy)
    states = list(dict.fromkeys(state or [OPEN]))
    if bins and (APPLIED in states or len(states) > 1):
        got = f"--state {' --state '.join(states)} with --bins"
        raise InputError("command line", "--state", got, "bins have no hour: give open or shaded")
    instants = list(dict.fromkeys(map(instant_of, time or ())))
    if times is not None:
        instants = list(read_timestamps(times))
    wanted, sampling, notes = _size(size), Sampling(samples=samples), dict[str, None]()
    ends = None if scale is None else _scale(scale, tone)
    screen = Screen(space.value, parsed_white(white))
    if screen != SRGB and (bins or tone is Tone.false):
        got = "given with --bins" if bins else f"given with --tone {tone.value}"
        raise InputError("command line", "--white, --space", got, "give --tone human or exposure")
    loaded = load(case, weather)
    files: list[Path] = []
    shown: Counter[str] = Counter()
    with stages() as stage:
        if bins:
            prepared = prepare(
                loaded, view, size=wanted, sampling=sampling, state=states[0], states=states,
                folder=output, stage=stage,
            )  # fmt: skip
            with stage("pictures") as done:
                files += prepared.save_bins(output, done)
        seconds = (TIME_LIMIT if time_limit is None else time_limit) / len(states)
        for one in states:
            for rendering in frames(
                loaded, view, instants, size=wanted, sampling=sampling, state=one, states=states,
                folder=output, source=source.value, target=target, time_limit=seconds, stage=stage,
            ):  # fmt: skip
                told = list(rendering.notes)
                name = rendering.name
                if len(states) > 1 or one != OPEN:  # states stand side by side in a folder
                    name += f"_{file_name(one)}"
                files += rendering.save(
                    output, tone.value, pixels.value, ends, screen, remark=told.append, name=name
                )
                notes |= dict.fromkeys(told)
                shown[rendering.state] += one == APPLIED
    if not bins:
        notes |= dict.fromkeys(weather_of(loaded).notes)
    if APPLIED in states:
        each = ", ".join(f"{name} in {count}" for name, count in shown.items() if count)
        notes |= {f"façade {each} of {len(instants)} pictures": None}
    show_notes(notes)
    count = len(instants) * len(states)
    print(f"{count} pictures are in {output}" if times else "\n".join(map(str, files)))
