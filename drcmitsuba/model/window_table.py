"""The table that lists new windows in a model, as `optimise` writes it and `[model]` reads it."""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drcmitsuba.model.model import areas
from drcmitsuba.model.windows import DEEPEST, SAME_PLANE, NewWindow
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import choose, shortened

CORNERS = tuple(f"{axis}{k}" for k in range(1, 5) for axis in "xyz")
COLUMNS = ("window", "material", *CORNERS, "depth")
"""Columns of a table of windows: a number, a name, corners in the model's coordinates [m], and the
distance of the wall's outer face [m], which may be missing where there is none."""
MAX_BYTES = 1 << 24
"""Largest size of a table [bytes]."""


def rows_of(windows: Sequence[NewWindow]) -> list[dict[str, Any]]:
    """Rows of a table of windows, one for each quad, by `COLUMNS`."""
    return [
        {"window": k, "material": window.name}
        | dict(zip(CORNERS, np.round(quad.ravel(), 6).tolist(), strict=True))
        | {"depth": round(window.depth, 6)}
        for k, window in enumerate(windows)
        for quad in window.quads
    ]


def read_windows(file: Path, known: Sequence[str]) -> list[NewWindow]:
    """Read a table of windows, whose materials are among the `known` names.

    Raises
    ------
    InputError
        The file is too large or no such table, or a material is not known.
    """
    if file.stat().st_size > MAX_BYTES:
        raise InputError(file, "file", "larger than 16 MiB", "give the table of some windows")
    remedy = f"give a CSV file with the columns {', '.join(COLUMNS)}"
    quads: dict[str, list[np.ndarray]] = defaultdict(list)
    names: dict[str, str] = {}
    depths: dict[str, float] = {}
    try:
        with file.open(encoding="utf-8", newline="") as lines:
            for row in csv.DictReader(lines):
                names[row["window"]] = row["material"]
                depths[row["window"]] = float(row.get("depth") or 0)
                numbers = np.array([float(row[column]) for column in CORNERS])
                quads[row["window"]].append(numbers.reshape(4, 3))
    except (KeyError, TypeError, ValueError, csv.Error) as error:
        raise InputError(file, "windows", f"{error}"[:200], remedy) from None
    if not quads:
        raise InputError(file, "windows", "it holds no window", remedy)
    for name in names.values():
        if name not in known:
            got = f"no pane has the material {shortened(name)}"
            raise InputError(file, "material", got, choose(name, known))
    made = [
        NewWindow(name, np.array(quads[number]), f"{file.name}, window {number}", depths[number])
        for number, name in names.items()
    ]
    for window in made:
        if not (np.isfinite(window.quads).all() and (areas(window.quads) > 0).all()):
            raise InputError(file, window.place, "a corner that is no point", "give four corners")
        if window.plane.distance(window.quads.reshape(-1, 3)) > SAME_PLANE:
            raise InputError(file, window.place, "its corners lie in no plane", "split it")
        if not 0 <= window.depth <= DEEPEST:
            got = f"a depth of {window.depth:g} m"
            raise InputError(file, window.place, got, f"give 0 to {DEEPEST:g} m")
    return made
