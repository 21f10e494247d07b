"""Colours and lines that the pictures share, and files that are written whole.

Figures do not use pyplot: no global state changes, no window opens, and any thread can draw them.
Colour-blind readers can tell the colours apart [1]_.

References
----------
.. [1] M. Okabe, K. Ito, "Color universal design: how to make figures and presentations that are
   friendly to colorblind people", 2008.
"""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import IO, Any

from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

BLUE, ORANGE, GREY, INK = "#0072B2", "#D55E00", "#5A5A5A", "#222222"


def _halo(linewidth: float, colour: str) -> list[withStroke]:
    return [withStroke(linewidth=linewidth, foreground=colour)]


LINES: dict[str, dict[str, Any]] = {
    "room": {"color": INK, "linewidth": 1.8, "solid_joinstyle": "miter"},
    "furniture": {"color": "white", "linewidth": 1.0, "path_effects": _halo(2.4, INK)},
    "surroundings": {"color": GREY, "linewidth": 1.2, "linestyle": (0, (4, 2))},
    "glazing": {"color": "#56B4E9", "linewidth": 4, "solid_capstyle": "butt"},
    "limit": {"color": ORANGE, "linewidth": 2.0, "path_effects": _halo(3.6, "white")},
}
"""Lines of a plan by their name in the legend."""
NAME = {"parse_math": False}  # dollars in a case's name do not begin a formula


def write(figure: Figure, file: Path | IO[bytes], dpi: int) -> None:
    """Write a figure as PNG; characters of a case's name that the font lacks become boxes."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph", UserWarning)
        figure.savefig(file, format="png", dpi=dpi)


def save(figure: Figure, path: str | Path) -> Path:
    """Write a figure as PNG, whole or not at all.

    Parameters
    ----------
    figure : Figure
    path : path
        File to write; an older one is replaced once the new one is complete.

    Returns
    -------
    Path
        The file.
    """
    target = Path(path)
    part = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        write(figure, part, dpi=150)
        part.replace(target)
    finally:
        part.unlink(missing_ok=True)
    return target
