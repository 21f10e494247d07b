"""Luminances of a picture in colours with a legend; pictures as PNG."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.image import imsave
from matplotlib.ticker import LogFormatter, LogLocator

from drcmitsuba.picture.picture import Picture
from drcmitsuba.picture.screen import SRGB, Screen
from drcmitsuba.report.style import NAME, letters
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import InputError

COLOURS = "cividis"
"""Colours that brighten evenly and look alike to the colour-blind."""
DECADES = 3.0
"""Decades of luminance below the brightest that are shown unless they are given."""


def false_colour(
    picture: Picture,
    *,
    least: float | None = None,
    most: float | None = None,
    title: str = "",
) -> Figure:
    """Luminances of a picture in colours, on a scale of logarithms with a legend.

    Parameters
    ----------
    picture : Picture
        Picture; pixels without light, as around a fisheye, are left white.
    least, most : float, optional
        Ends of the scale [cd/m²]; by default the 99.9th percentile and a thousandth of it.
        Triangles at the legend say that luminances lie beyond.
    title : str
        Title, such as case, place and time.

    Returns
    -------
    Figure
        Figure; `report.style.save` writes it.

    Raises
    ------
    InputError
        The ends are not in order above 0.

    Examples
    --------
    >>> import numpy as np
    >>> from drcmitsuba import picture
    >>> view = picture.PictureView("equidistant", direction=(0, 1, 0), angles=(180, 180))
    >>> bright = np.full((60, 60, 3), 500, np.float32)
    >>> bright[12:24, 20:36] = 8000
    >>> office = picture.Picture(bright, view)
    >>> from drcmitsuba.picture.false_colour import false_colour
    >>> figure = false_colour(office, least=100, most=10_000, title="Office")
    """
    luminance = picture.luminance.astype(float)
    lit = luminance[luminance > 0]
    if not len(lit):
        raise InputError("false_colour", "picture", "no light", "give a picture with some")
    most = float(np.quantile(lit, 0.999)) if most is None else most
    least = most / 10**DECADES if least is None else least
    if not 0 < least < most < np.inf:
        raise InputError("false_colour", "scale", f"{least:g} to {most:g}", "give 0 < least < most")
    rows, columns = picture.shape
    high = float(np.clip(6 * rows / columns, 2, 12))
    figure = Figure(figsize=(7.4, high + 0.5), layout="constrained")
    ax = figure.add_subplot()
    ax.set_axis_off()
    image = ax.imshow(
        np.where(luminance > 0, luminance, np.nan),
        norm=LogNorm(least, most), cmap=COLOURS, interpolation="nearest",
    )  # fmt: skip
    beyond = {(False, False): "neither", (True, False): "min", (False, True): "max"}
    extend = beyond.get((bool(lit.min() < least), bool(lit.max() > most)), "both")
    bar = figure.colorbar(image, ax=ax, extend=extend, fraction=0.046)
    bar.set_label("Luminance [cd/m²]", fontsize=12)
    bar.locator = LogLocator(10, subs=(1, 2, 5))
    bar.formatter = _Plain()
    bar.minorticks_off()
    bar.ax.tick_params(labelsize=11)
    bar.update_ticks()
    if title:
        ax.set_title(title, fontsize=letters(title, figure.get_figwidth(), 12), **NAME)
    return figure


class _Plain(LogFormatter):
    """Luminances in digits, in place of powers of ten."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        return f"{x:,.10g}"


def save_png(pixels: np.ndarray, file: str | Path, screen: Screen = SRGB) -> None:
    """Write a screen's pixels (row, column, 3) from 0 to 255 as PNG; never leaves half a file.

    The file states the space of its colours.

    Examples
    --------
    >>> import numpy as np
    >>> from drcmitsuba import picture
    >>> view = picture.PictureView("equidistant", direction=(0, 1, 0), angles=(180, 180))
    >>> bright = np.full((60, 60, 3), 500, np.float32)
    >>> bright[12:24, 20:36] = 8000
    >>> office = picture.Picture(bright, view)
    >>> from drcmitsuba.picture import tone
    >>> from drcmitsuba.picture.false_colour import save_png
    >>> save_png(tone.human(office), "office.png")
    """
    with storage.whole(Path(file)) as temporary:
        imsave(temporary, pixels, format="png", pil_kwargs=screen.of_png)
