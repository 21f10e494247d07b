"""Colours and lines that the pictures share; PNG files, which are written whole.

Figures do not use pyplot: no global state changes, no window opens, and any thread can draw them.
Colour-blind readers can tell the colours apart [1]_.

References
----------
.. [1] M. Okabe, K. Ito, "Color universal design: how to make figures and presentations that are
   friendly to colorblind people", 2008.
"""

from __future__ import annotations

import base64
import textwrap
import warnings
from collections.abc import Mapping
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from PIL import Image

from drcmitsuba.report.standing import DrawnParts
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.background import Behind
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress

BLUE, ORANGE, GREY, INK = "#0072B2", "#D55E00", "#5A5A5A", "#222222"
COLOURS = "viridis"
"""Colours of values: their lightness grows evenly, so that they are legible in grey, too."""
METRICS = {"sDA": BLUE, "msDA": BLUE, "ASE": ORANGE, "MSE": ORANGE}
"""Colours of the metrics' bars and lines."""


def halo(linewidth: float, colour: str) -> list[withStroke]:
    """Line of another colour around a line or text, so that it shows on any ground."""
    return [withStroke(linewidth=linewidth, foreground=colour)]


LINES: dict[str, dict[str, Any]] = {
    "room": {"color": INK, "linewidth": 1.8, "solid_joinstyle": "miter"},
    "furniture": {"color": "white", "linewidth": 1.0, "path_effects": halo(2.4, INK)},
    "surroundings": {"color": GREY, "linewidth": 1.2, "linestyle": (0, (4, 2))},
    "glazing": {"color": "#56B4E9", "linewidth": 4, "solid_capstyle": "butt"},
    "contour": {"color": INK, "linewidth": 0.9, "path_effects": halo(2.2, "white")},
    "limit": {"color": ORANGE, "linewidth": 2.0, "path_effects": halo(3.6, "white")},
}
"""Lines of a plan by their name in the legend."""
OTHERS = (".pdf", ".svg", ".jpg", ".jpeg", ".tif", ".tiff", ".eps", ".ps", ".gif", ".webp")
"""Endings of formats that no figure is written in."""
DPI, SHOWN_DPI = 150, 100
"""Resolution of files, and of figures that Jupyter or the report shows [1/inch]."""
LETTER = 0.62
"""Width of a bold letter over its size [–]."""
NAME = {"parse_math": False}  # dollars in a case's name do not begin a formula


def new_axes(size: tuple[float, float], **settings: Any) -> Axes:
    """Return the only axes of a new figure of a width and height [inch]."""
    return Figure(figsize=size, layout="constrained").add_subplot(**settings)


def head(ax: Axes, title: str, caption: str = "", above: float = 5.0) -> None:
    """Write the title and, in small letters below it, the caption, from [pt] above the axes on."""
    width = ax.get_figure(root=True).get_figwidth() * ax.get_position().width / 0.8
    small = textwrap.wrap(caption, max(20, int(width / 0.075)))
    heading = textwrap.wrap(title, max(20, int(width / 0.1)))
    pad = above + 2 + 11.5 * len(small)
    ax.set_title("\n".join(heading), loc="left", fontsize=11, weight="bold", y=1, pad=pad, **NAME)
    ax.annotate(
        "\n".join(small), (0, 1), (0, above), "axes fraction", "offset points", va="bottom",
        fontsize=8.5, color=GREY, linespacing=1.15, **NAME,
    )  # fmt: skip


def letters(text: str, width: float, largest: float) -> float:
    """Size of letters [pt] in which the longest line of a text is at most `width` wide [inch]."""
    longest = max(map(len, text.split("\n")))
    return min(largest, 72 * width / (LETTER * max(longest, 1)))


def pixels_of(figure: Figure, dpi: int, drawn: DrawnParts | None = None) -> np.ndarray:
    """Draw a figure: red, green, blue and opacity, uint8, shape (row, column, 4).

    Characters of a case's name that the font lacks become boxes. Standing parts that were `drawn`
    before are not drawn again.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph", UserWarning)
        return (DrawnParts() if drawn is None else drawn).pixels(figure, dpi)


def write(pixels: np.ndarray, file: Path | IO[bytes], dpi: int = DPI) -> None:
    """Write pixels as PNG, without their opacity: a figure's paper is opaque."""
    picture = Image.fromarray(pixels).convert("RGB")
    picture.save(file, format="PNG", compress_level=3, dpi=(dpi, dpi))


def png(figure: Figure) -> bytes:
    """Return a figure as PNG, as Jupyter shows it."""
    buffer = BytesIO()
    write(pixels_of(figure, SHOWN_DPI), buffer, SHOWN_DPI)
    return buffer.getvalue()


def html_image(figure: Figure, text: str) -> str:
    """Return a figure as an image of HTML; `text` stands in its place where no image is shown."""
    picture = base64.b64encode(png(figure)).decode()
    return f'<img alt="{text}" src="data:image/png;base64,{picture}">'


def tidy(ax: Axes, colour: str = "#EEEEEE", linewidth: float = 0.8, axis: str = "both") -> None:
    """Draw light lines behind the values, and no frame above and beside them."""
    ax.grid(axis=axis, color=colour, linewidth=linewidth)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)


def save(figure: Figure, path: str | Path) -> Path:
    """Write a figure as PNG, whole or not at all, and return its path.

    An older file is replaced once the new one is complete.

    Raises
    ------
    InputError
        The path has the ending of another format.

    Examples
    --------
    >>> import drcmitsuba
    >>> from drcmitsuba.report import plots
    >>> result = drcmitsuba.evaluate("office.toml")
    >>> mean = result.illuminance["total"].mean("time", keep_attrs=True)
    >>> path = plots.save(plots.plan(mean), "plan.png")
    """
    if (ending := Path(path).suffix.lower()) in OTHERS:
        remedy = "name it .png, or call the figure's own savefig"
        raise InputError(path, "ending", f"{ending}, of another format than PNG", remedy)
    return _save(pixels_of(figure, DPI), Path(path))


def save_all(
    figures: Mapping[str, Figure], folder: Path, progress: Progress = lambda share: None,
    drawn: DrawnParts | None = None,
) -> list[Path]:  # fmt: skip
    """Write figures by file name as `save` does, and return their paths.

    A picture is compressed in a thread while the next one is drawn. Parts that were `drawn` before,
    of figures of another folder, are not drawn again.
    """
    saving, drawn = Behind(), DrawnParts() if drawn is None else drawn
    with saving.opened():
        for number, (name, figure) in enumerate(figures.items(), start=1):
            saving.do(partial(_save, pixels_of(figure, DPI, drawn), folder / name))
            progress(number / len(figures))
    return [folder / name for name in figures]


def _save(pixels: np.ndarray, path: Path) -> Path:
    with storage.whole(path) as part:
        write(pixels, part)
    return path
