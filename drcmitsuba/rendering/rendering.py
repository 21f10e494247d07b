"""A rendered picture, with its standard error, and its files."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import Literal

import numpy as np

from drcmitsuba.annual.adaptive_sampling import of_hours
from drcmitsuba.case.groups import OPEN, State
from drcmitsuba.picture import exr, hdr, tone
from drcmitsuba.picture.false_colour import false_colour, save_png
from drcmitsuba.picture.picture import Picture
from drcmitsuba.picture.screen import SRGB, Screen, Shown
from drcmitsuba.report import style
from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.content_key import content_key
from drcmitsuba.runtime.errors import InputError

images = lazy.module("matplotlib.image")

Tone = Literal["human", "exposure", "false"]
"""Ways to a picture for a screen: as the eye would see it, by an exposure, in false colours."""

Scale = tuple[float, float]
"""Ends of a scale of luminances [cd/m²]."""

Source = Literal["all", "sky", "sun"]
"""Light of a picture: of sky and sun, of the sky and the ground alone, or of the sun alone."""

NEGLIGIBLE = 1e-3
"""Share of a pixel's luminance below which a negative channel is no matter [–]."""
LONGEST = 80
"""Largest number of characters of a view's name in a file's name."""
NAMES = {"srgb": "sRGB", "display-p3": "Display P3"}
"""Names of the spaces of screens."""


def check_scale(scale: Scale | None, tone: Tone) -> None:
    """Refuse a scale out of order, or one for a tone that adapts to each picture as the eye does.

    Raises
    ------
    InputError
        The scale is unfit.
    """
    if scale is None:
        return
    if not 0 < scale[0] < scale[1] < np.inf:
        got = f"{scale[0]:g} to {scale[1]:g}"
        raise InputError("rendering", "scale", got, "give 0 < least < most [cd/m²]")
    if tone == "human":
        remedy = 'give tone "false" or "exposure"'
        raise InputError("rendering", "scale", 'tone "human" has no scale', remedy)


def file_name(view: str) -> str:
    """Part of a file's name for a view, whose own name may come from any model.

    A name that has other characters than words, hyphens and single spaces, or more than 80, ends
    with six digits of its key: views share no file unless they differ only by underscores in place
    of spaces.
    """
    words = re.sub(r"[^\w-]+", "_", view)
    if words == view.replace(" ", "_") and 0 < len(words) <= LONGEST:
        return words
    return f"{words[: LONGEST - 7]}_{content_key(view)[:6]}"


@dataclass(frozen=True, eq=False, repr=False)
class Rendering:
    """Picture of a view at an instant; shows itself in Jupyter."""

    picture: Picture
    """Luminances [cd/m²], with the view in the coordinates of the case."""
    error: np.ndarray
    """Standard error of the luminance of each pixel [cd/m²], shape (row, column)."""
    disk: np.ndarray
    """Luminance by the sun's disk, seen straight or in planar mirrors, which has no error [cd/m²],
    shape (row, column)."""
    freedom: int
    """Degrees of freedom of the error: one less than the replicates, or rounds, that scatter."""
    case: str
    """Name of the case."""
    view: str
    """Name of the view."""
    state: State
    """State of the façade."""
    time: np.datetime64
    """Instant, local standard time."""
    source: Source = "all"
    """Light that the picture shows."""
    notes: tuple[str, ...] = ()
    """Remarks on the hour."""

    @cached_property
    def half_width(self) -> float:
        """Half a 95 % interval of the luminance of a pixel over it [%].

        The root mean square of all pixels, weighted by the luminance; the sun's disk, seen
        straight or in planar mirrors, is left out. 0 where it is dark.
        """
        L = self.picture.luminance - self.disk
        return float(of_hours(L.reshape(-1, 1), self.error.reshape(-1, 1), self.freedom + 1)[0])

    @property
    def name(self) -> str:
        """Name of the files, such as `desk_03-21_1030`."""
        day, clock = str(self.time.astype("datetime64[m]")).split("T")
        source = "" if self.source == "all" else f"_{self.source}"
        return f"{file_name(self.view)}_{day[5:]}_{clock.replace(':', '')}{source}"

    @property
    def is_dark(self) -> bool:
        """Whether no light reaches the eye."""
        return not (self.picture.rgb > 0).any()

    def save(
        self, folder: str | Path, tone: Tone = "human", pixels: Literal["float", "half"] = "float",
        scale: Scale | None = None, screen: Screen = SRGB,
        remark: Callable[[str], None] = lambda text: None, name: str | None = None,
    ) -> list[Path]:  # fmt: skip
        """Write the picture as `.exr` with its error, `.hdr` and `.png`, each whole or not at all.

        Parameters
        ----------
        folder : str or Path
            Folder, which is made.
        tone : {"human", "exposure", "false"}
            How the PNG shows luminances; its name ends with the tone unless that is "human".
        pixels : {"float", "half"}
            Values of the `.exr`.
        scale : tuple of two float, optional
            Luminances [cd/m²] at the ends of the false colours; an exposure shows the second as
            white. By default they follow from each picture.
        screen : Screen
            Space of the colours of a PNG that is not in false ones, and what it shows as white.
        remark : callable
            Takes remarks on colours that a file cannot hold, and on its white.
        name : str, optional
            Name of the files without ending; by default `name`.

        Returns
        -------
        list of Path
            Files.

        Raises
        ------
        InputError
            The scale is not in order above 0, or the tone has none.
        """
        check_scale(scale, tone)
        folder = Path(folder)
        png = ".png" if tone == "human" else f"_{tone}.png"
        files = [folder / f"{name or self.name}{ending}" for ending in (".exr", ".hdr", png)]
        exr.save(self.picture, files[0], pixels, self.error)
        hdr.save(self.picture, files[1])
        if self.is_dark:
            save_png(np.zeros(self.picture.rgb.shape, np.uint8), files[2], screen)
        elif tone == "false":
            least, most = scale or (None, None)
            drawn = false_colour(self.picture, least=least, most=most, title=self._title)
            style.save(drawn, files[2])
        else:
            shown = self._shown(tone, None if scale is None else scale[1], screen)
            save_png(shown.pixels, files[2], screen)
            for text in self._remarks(shown, screen):
                remark(text)
        return files

    @property
    def _title(self) -> str:
        when = str(self.time.astype("datetime64[m]"))[5:].replace("T", " ")
        facade = "" if self.state == OPEN else f", façade {self.state}"
        source = "" if self.source == "all" else f", {self.source} alone"
        return f"{self.case}, {self.view}, {when}{facade}{source}"

    def _shown(self, how: Tone, white: float | None, screen: Screen) -> Shown:
        """The picture, which is not dark, on a screen."""
        by_eye = how != "exposure"
        relative = tone.brightness(self.picture) if by_eye else tone.exposure(self.picture, white)
        return screen.show(self.picture, relative)

    def _remarks(self, shown: Shown, screen: Screen) -> Iterator[str]:
        """Remarks on colours that the files cannot hold, and on the white of the screen."""
        when = str(self.time.astype("datetime64[m]"))[5:].replace("T", " ")
        lowest, L = self.picture.rgb.min(axis=-1), self.picture.luminance
        below = (lowest < -NEGLIGIBLE * L) & (L > 0)
        if below.any():
            most = float((-lowest[below] / L[below]).max())
            share = f"{100 * below.mean():.2g} % of the pixels are too colourful for BT.709"
            yield f"{when}: {share}; .hdr has 0 for channels down to {-100 * most:.2g} % of L"
        if shown.moved > 0:
            share = f"{100 * shown.moved:.2g} % of the pixels are too bright or too colourful"
            yield f"{when}: {share} for {NAMES[screen.space]}; .png has them closer to grey"
        if screen.white != "daylight":
            x, y = shown.white
            yield f"{when}: .png shows light of x {x:.3f}, y {y:.3f} as white"

    def _repr_png_(self) -> bytes:
        """Picture as the eye would see it."""
        pixels = np.zeros(self.picture.rgb.shape, np.uint8)
        if not self.is_dark:
            pixels = tone.human(self.picture)
        stream = BytesIO()
        images.imsave(stream, pixels, format="png", pil_kwargs=SRGB.of_png)
        return stream.getvalue()

    def __repr__(self) -> str:
        rows, columns = self.picture.shape
        lit = self.picture.luminance
        size = f"{columns} by {rows} pixels, mean {lit.mean():.0f} cd/m²"
        return f"<Rendering of {self._title}: {size}>"
