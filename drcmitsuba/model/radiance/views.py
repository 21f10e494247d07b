"""Radiance's views and sensors: `.vf` files of `rview` options, `.pts` files of rays."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np

from drcmitsuba.model.model import SensorGrid, View
from drcmitsuba.model.radiance.text import FileLine, decoded, is_number, read_bytes
from drcmitsuba.runtime.errors import InputError

MOST_BYTES = 1 << 26
"""Largest size of a file [byte]."""
MOST_POINTS = 250_000
"""Largest number of sensors of a file."""
MOST_VIEWS = 1000
"""Largest number of views of a file."""
LARGEST = 1e9
"""Largest magnitude of a coordinate [m]."""
_NUMBERS = {
    "-vp": 3, "-vd": 3, "-vu": 3, "-vh": 1, "-vv": 1, "-vo": 1, "-va": 1, "-vs": 1, "-vl": 1,
}  # fmt: skip
"""Options of a view with their number of numbers; the last four cut and shift a picture."""

_VIEW = re.compile(r"(?:^|\s)-v[a-z]")


def read_views(path: Path) -> tuple[View, ...]:
    """Read the views of a file.

    Parameters
    ----------
    path : Path
        Lines with `rview` options; other words and options, such as `rvu`, `VIEW=` and `-x 512`,
        and lines without `-v` options are passed over.

    Returns
    -------
    tuple of View
        Views in turn, with Radiance's defaults: perspective, 45° by 45°, z up. They have the file's
        name, with a number where there are several.

    Raises
    ------
    InputError
        An option is unfit, or there is no view.
    """
    text = decoded(read_bytes(path, MOST_BYTES))
    lines = [
        (number, line) for number, line in enumerate(text.splitlines(), 1) if _VIEW.search(line)
    ]
    if not lines or len(lines) > MOST_VIEWS:
        got = f"{len(lines)} lines with views"
        raise InputError(
            path, "views", got, f"give 1 to {MOST_VIEWS}, such as -vp 1 2 1.2 -vd 0 1 0"
        )
    views = []
    for i, (number, line) in enumerate(lines, 1):
        name = path.stem if len(lines) == 1 else f"{path.stem} {i}"
        views.append(_view(line, name, FileLine(path, number)))
    return tuple(views)


def view_options(line: str, place: FileLine) -> dict[str, Any]:
    """Options of a view in a line by their name; those left out have Radiance's defaults.

    Parameters
    ----------
    line : str
        Options of `rview`; other words and options are passed over.
    place : Place
        Line of a file, for messages.

    Returns
    -------
    dict of str to str or tuple of float
        Letter of `-vt`, and the numbers of the other options.

    Raises
    ------
    InputError
        An option is unknown, or a value is unfit.
    """
    try:
        words = shlex.split(line)
    except ValueError as error:
        raise place.error("view", str(error), "close the quotes") from None
    given: dict[str, Any] = {
        "-vt": "v", "-vp": (0, 0, 0), "-vd": (0, 1, 0), "-vu": (0, 0, 1),
        "-vh": (45,), "-vv": (45,), "-vs": (0,), "-vl": (0,),
    }  # fmt: skip
    at = 0
    while at < len(words):
        option = words[at]
        if not option.startswith("-v"):
            at += 1
            continue
        if option.startswith("-vt"):
            given["-vt"] = option[3:]
            at += 1
            continue
        if option not in _NUMBERS:
            got = f"{option!r} in a view"
            raise place.error("view", got, "write -vt -vp -vd -vu -vh -vv and their values")
        values = words[at + 1 : at + 1 + _NUMBERS[option]]
        fit = len(values) == _NUMBERS[option] and all(is_number(v) for v in values)
        if not fit or not all(abs(float(v)) <= LARGEST for v in values):
            got = f"{option} {' '.join(values)}"
            raise place.error("view", got, f"give {_NUMBERS[option]} finite numbers")
        given[option] = tuple(float(v) for v in values)
        at += 1 + len(values)
    if given["-vt"] not in tuple("vhascl"):
        raise place.error("view", f"-vt{given['-vt']}", "give one of v, h, a, s, c and l")
    across = np.linalg.norm(np.cross(given["-vd"], given["-vu"]))
    if not across > 1e-9 * np.linalg.norm(given["-vd"]) * np.linalg.norm(given["-vu"]):
        raise place.error("view", "-vd along -vu, or of no length", "give another up vector")
    angles = (*given["-vh"], *given["-vv"])
    if not min(angles) > 0:
        raise place.error("view", f"-vh {angles[0]:g} -vv {angles[1]:g}", "give sizes above 0")
    return given


def _view(line: str, name: str, place: FileLine) -> View:
    """View that a line states."""
    given = view_options(line, place)
    angles = (*given["-vh"], *given["-vv"])
    for option in ("-vs", "-vl", "-vo", "-va"):
        if (value := given.get(option, (0,))[0]) != 0:
            got = f"{option} {value:g}, which shifts or cuts the picture"
            raise place.error("view", got, "leave it out")
    return View(
        name=name, kind=given["-vt"], position=tuple(map(float, given["-vp"])),  # type: ignore[arg-type]
        direction=tuple(map(float, given["-vd"])), up=tuple(map(float, given["-vu"])),  # type: ignore[arg-type]
        angles=angles,
    )  # fmt: skip


def read_points(path: Path) -> SensorGrid:
    """Read the sensors of a file.

    Parameters
    ----------
    path : Path
        Lines of x y z dx dy dz, as `rtrace` takes them; lines that begin with # are passed over.

    Returns
    -------
    Grid
        Sensors with unit normals, of the file's name.

    Raises
    ------
    InputError
        A line has another number of values, a value is not finite, a normal has no length, or there
        are no sensors or more than 250,000.
    """
    raw = read_bytes(path, MOST_BYTES)
    rows: list[list[float]] = []
    numbers: list[int] = []
    for number, line in enumerate(raw.splitlines(), 1):
        words = line.split()
        if not words or words[0].startswith(b"#"):
            continue
        place = FileLine(path, number)
        if len(words) != 6 or not all(is_number(word) for word in words):
            got = decoded(line[:80])
            raise place.error("sensor", got, "write six numbers, x y z dx dy dz")
        if len(rows) == MOST_POINTS:
            raise place.error("sensor", f"more than {MOST_POINTS}", "give fewer")
        rows.append([float(word) for word in words])
        numbers.append(number)
    if not rows:
        raise InputError(path, "sensors", "none", "write lines of x y z dx dy dz")
    values = np.array(rows)
    length = np.linalg.norm(
        np.where(np.abs(values[:, 3:]) <= LARGEST, values[:, 3:], np.nan), axis=1
    )
    wrong = ~((np.abs(values) <= LARGEST).all(axis=1) & (length > 1e-9))
    if wrong.any():
        i = int(np.argmax(wrong))
        got = " ".join(f"{v:g}" for v in values[i])
        remedy = "give finite numbers and a normal with a length"
        raise FileLine(path, numbers[i]).error("sensor", got, remedy)
    return SensorGrid(name=path.stem, points=values[:, :3], normals=values[:, 3:] / length[:, None])
