"""Views of a case as pictures show them: their place, their size, and instants by name."""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import datetime

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.picture.picture import MOST_PIXELS
from drcmitsuba.picture.view import PictureView, of_model
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.geometry import origin, rotation
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.sky.period import NOMINAL_YEAR

Size = int | tuple[int, int]
"""Number of columns, or of columns and rows, of a picture."""
Instant = str | np.datetime64 | datetime
"""Local standard time: a text such as "03-21 10:30", or a time of NumPy, pandas or Python."""
COLUMNS = 512
"""Number of columns of a picture unless another is given."""
_INSTANT = re.compile(r"(?:\d{4}-)?(\d\d-\d\d)[T ](\d\d:\d\d(?::\d\d)?)", re.ASCII)


def instant_of(when: Instant) -> np.datetime64:
    """Instant that is given; a text, or a time of pandas or Python, names one of the nominal year.

    Raises
    ------
    InputError
        There is no date and time, or one with a time zone.
    """
    if isinstance(when, np.datetime64) and not np.isnat(when):
        return when.astype("datetime64[ns]")
    if isinstance(when, datetime) and when == when and when.tzinfo is None:  # NaT is not itself
        when = f"{when:%m-%d %H:%M:%S}"
    match = _INSTANT.fullmatch(when.strip()) if isinstance(when, str) else None
    try:
        if match:
            return np.datetime64(f"{NOMINAL_YEAR}-{match[1]}T{match[2]}", "ns")
    except ValueError:
        pass
    remedy = "give month, day and local standard time, as 03-21 10:30"
    raise InputError("command line", "--time", " ".join(repr(when).split())[:60], remedy)


def picture_view(case: Case, name: str | None) -> tuple[str, PictureView]:
    """View of a case by its name, or its only one, in the coordinates of the case.

    Raises
    ------
    InputError
        There is no such view, or its place is unfit.
    """
    every = {view.name: view for view in prepared(case).views}
    if not every:
        remedy = "add a table [views.NAME] with position and direction"
        raise InputError(case.source, "views", "none", remedy)
    if name is None and len(every) == 1:
        (name,) = every
    if name is None or name not in every:
        got = "none" if name is None else repr(name)
        raise InputError("command line", "--view", got, f"give one of {', '.join(every)}")
    return name, of_model(every[name])


def shape_of(view: PictureView, size: Size) -> tuple[int, int]:
    """Rows and columns of a picture of a size; pixels are square unless both are given.

    Raises
    ------
    InputError
        There are no pixels, or more than 33 million, or the size is no whole numbers.
    """
    wide, high = view.half_size
    whole = np.atleast_1d(np.array(size, object))
    if whole.size not in (1, 2) or not all(isinstance(n, int | np.integer) for n in whole.flat):
        raise InputError("picture", "size", repr(size), "give columns, or columns and rows")
    columns, *of_rows = map(int, whole.flat)
    rows = of_rows[0] if of_rows else max(1, round(columns * high / wide))
    if not (columns >= 1 and rows >= 1 and columns * rows <= MOST_PIXELS):
        got = f"{columns} by {rows} pixels"
        raise InputError("picture", "size", got, f"give 1 to {MOST_PIXELS} pixels in all")
    return rows, columns


def with_square_pixels(
    case: Case, name: str, view: PictureView, rows: int, columns: int
) -> PictureView:
    """View of square pixels: the one angle of a perspective in `[views]` is that across it."""
    table = case.views.get(name)
    if table is None or isinstance(table.angle, tuple) or view.kind != "perspective":
        return view
    up = np.degrees(2 * np.arctan(view.half_size[0] * rows / columns))
    return replace(view, angles=(view.angles[0], float(up)))


def in_the_scene(case: Case, view: PictureView) -> PictureView:
    """View in the frame in which the scene of a case is traced."""
    turn = rotation(case).T
    position = (np.array(view.position) - origin(case)) @ turn
    direction, up = (np.array(v) @ turn for v in (view.direction, view.up))
    return replace(view, position=_triple(position), direction=_triple(direction), up=_triple(up))


def _triple(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z
