"""Screens: pixels of sRGB or Display P3 for relative luminances, and what their files say.

A colour beyond the screen's red, green and blue moves towards the grey of its own luminance, and so
keeps its hue, as far as it must. Both spaces have the transfer function of IEC 61966-2-1.

References
----------
.. [1] C. Li et al., "Comprehensive color solutions: CAM16, CAT16, and CAM16-UCS", Color Research
   and Application 42(6), 2017; CIE 248:2022.
.. [2] ICC.1:2022, "Image technology colour management".
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, NamedTuple

import numpy as np
from PIL.PngImagePlugin import PngInfo

from drcmitsuba.picture.exr_header import BT709
from drcmitsuba.picture.picture import Picture, Primaries, to_xyz
from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.errors import InputError

colour = lazy.module("colour")

DISPLAY_P3: Primaries = (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329)
"""Chromaticities of Display P3, whose white is D65."""
Space = Literal["srgb", "display-p3"]
"""Space of a screen's colours."""
White = Literal["daylight", "view"] | float
"""Light that a picture shows as white: D65, the mean of its own, or that of a temperature [K]."""
DIMMEST, COLDEST, BLUEST = 1700.0, 4000.0, 25_000.0
"""Temperatures [K]: Planckian radiators from the first, phases of daylight from the second on."""
VISIBLE = 1 / 255
"""Least change of a channel that counts as moved [–]."""
D50 = (0.9642, 1.0, 0.8249)
"""White of the space to which profiles refer."""
P3_IN_D50 = ((0.51512, 0.24120, -0.00105), (0.29198, 0.69225, 0.04189), (0.15710, 0.06657, 0.78407))
"""X, Y, Z of red, green and blue of Display P3, adapted to D50 as [2] asks."""
COLOURS = (b"rXYZ", b"gXYZ", b"bXYZ")
"""Their names in a profile."""
D65_TO_D50 = (
    (1.04788, 0.02292, -0.05022), (0.02959, 0.99048, -0.01707), (-0.00925, 0.01508, 0.75168)
)  # fmt: skip
"""This adaptation, of Bradford's."""
TRANSFER = (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
"""Parameters of the transfer function as a profile has them."""


class Shown(NamedTuple):
    """A picture on a screen."""

    pixels: np.ndarray
    """Red, green and blue from 0 to 255, uint8, shape (row, column, 3)."""
    moved: float
    """Share of the pixels whose colour is beyond the screen's [–]."""
    white: tuple[float, float]
    """Chromaticity x, y of the light that is white."""


@dataclass(frozen=True)
class Screen:
    """Screen on which a picture is seen, and the light that it shows as white.

    An unfit temperature raises InputError.

    Examples
    --------
    >>> import numpy as np
    >>> from drcmitsuba import picture
    >>> from drcmitsuba.picture import tone
    >>> from drcmitsuba.picture.screen import Screen
    >>> warm = picture.Picture(np.full((4, 4, 3), (900, 700, 500), np.float32))
    >>> tone.exposed(warm, 1000, Screen("display-p3", white="view"))[0, 0]
    array([223, 223, 223], dtype=uint8)
    """

    space: Space = "srgb"
    white: White = "daylight"

    def __post_init__(self) -> None:
        if not isinstance(self.white, str) and not DIMMEST <= self.white <= BLUEST:
            remedy = f"give {DIMMEST:g} to {BLUEST:g} K, daylight or view"
            raise InputError("screen", "white", f"{self.white:g} K", remedy)

    @property
    def primaries(self) -> Primaries:
        """Chromaticities of red, green, blue and white."""
        return BT709 if self.space == "srgb" else DISPLAY_P3

    @property
    def of_png(self) -> dict[str, Any]:
        """Arguments of Pillow by which a PNG states the space: a chunk `sRGB`, or a profile."""
        if self.space == "display-p3":
            return {"icc_profile": display_p3()}
        stated = PngInfo()
        stated.add(b"sRGB", b"\0")  # perceptual
        return {"pnginfo": stated}

    def show(self, picture: Picture, relative: np.ndarray) -> Shown:
        """Show a picture.

        Parameters
        ----------
        picture : Picture
            Picture; its white counts as D65.
        relative : np.ndarray, shape (row, column)
            Luminances of the pixels over that of white [–]; above 1 they are white.
        """
        luminance = np.maximum(picture.luminance, 1e-30)
        scale = (np.clip(relative, 0, 1) / luminance)[..., None].astype(np.float32)
        colours = picture.rgb * scale
        of_picture = _of_daylight(to_xyz(picture.primaries))
        white = self._white(of_picture @ colours.reshape(-1, 3).mean(axis=0, dtype=float))
        screen = to_xyz(self.primaries)
        matrix = np.linalg.inv(screen) @ self._adaptation(white) @ of_picture
        linear, moved = _inside(colours @ matrix.T.astype(np.float32), screen[1])
        coded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
        x, y = (white / white.sum())[:2]
        return Shown(np.round(255 * coded).astype(np.uint8), moved, (float(x), float(y)))

    def _white(self, mean: np.ndarray) -> np.ndarray:
        """X, Y and Z of the light that is white; `mean` are those of the picture as shown."""
        if self.white == "view" and mean.min() > 0:
            return mean / mean[1]
        if isinstance(self.white, str):
            return to_xyz(BT709).sum(axis=1)
        temperature = colour.temperature
        of = "CIE Illuminant D Series" if self.white >= COLDEST else "Kang 2002"
        x, y = temperature.CCT_to_xy(self.white, method=of)
        return np.array([x / y, 1, (1 - x - y) / y])

    def _adaptation(self, white: np.ndarray) -> np.ndarray:
        """Matrix by which light of this white becomes D65, that of CAT16 [1]_."""
        if self.white == "daylight":
            return np.eye(3)
        of = colour.adaptation.matrix_chromatic_adaptation_VonKries
        return np.asarray(of(white, to_xyz(BT709).sum(axis=1), transform="CAT16"))


SRGB = Screen()
"""Screen of sRGB on which D65 is white."""


def parsed_white(text: str) -> White:
    """White that a text names: "daylight", "view" or a temperature as "4000"; else InputError."""
    if text == "daylight" or text == "view":
        return text  # type: ignore[return-value]
    try:
        return float(text.removesuffix("K"))
    except ValueError:
        remedy = "give daylight, view or a temperature in K, as 4000"
        raise InputError("command line", "--white", repr(text), remedy) from None


def _of_daylight(matrix: np.ndarray) -> np.ndarray:
    """Matrix to X, Y, Z with the picture's white moved to D65."""
    white = to_xyz(BT709).sum(axis=1)
    return np.asarray(matrix * (white / matrix.sum(axis=1))[:, None])


def _inside(linear: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, float]:
    """Colours (row, column, 3), those beyond 0 to 1 moved towards their greys; and their share.

    The array is changed. `weights` are those of luminance. Colours brighter than white become white
    and do not count.
    """
    low, high = (
        f(f(linear[..., 0], linear[..., 1]), linear[..., 2]) for f in (np.minimum, np.maximum)
    )
    beyond = (low < 0) | (high > 1)
    some = linear[beyond]
    Y = some @ weights.astype(np.float32)
    grey, least = np.clip(Y, 0, 1), np.float32(1e-12)
    above, below = np.maximum(high[beyond] - Y, least), np.maximum(Y - low[beyond], least)
    kept = np.minimum(np.minimum((1 - grey) / above, grey / below), 1)
    moved = ((1 - kept) * np.maximum(above, below) > VISIBLE) & (grey < 1 - VISIBLE)
    linear[beyond] = np.clip(grey[:, None] + kept[:, None] * (some - Y[:, None]), 0, 1)
    return linear, float(moved.sum() / beyond.size)


@cache
def display_p3() -> bytes:
    """Profile of Display P3 (ICC, version 4): its primaries, and the transfer function of sRGB."""

    def numbers(kind: bytes, *values: float) -> bytes:
        fixed = (round(value * 65536) for value in values)
        return kind + bytes(4) + b"".join(struct.pack(">i", value) for value in fixed)

    def text(words: str) -> bytes:
        said = words.encode("utf-16-be")
        return b"mluc" + bytes(4) + struct.pack(">II4sII", 1, 12, b"enUS", len(said), 28) + said

    curve = b"para" + bytes(4) + struct.pack(">HH", 3, 0) + numbers(b"", *TRANSFER)[4:]
    tags = {
        b"desc": text("Display P3"), b"cprt": text("CC0"), b"wtpt": numbers(b"XYZ ", *D50),
        b"chad": numbers(b"sf32", *np.ravel(D65_TO_D50)),
        **{k: numbers(b"XYZ ", *v) for k, v in zip(COLOURS, P3_IN_D50, strict=True)},
        **dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), curve),
    }  # fmt: skip
    at, entries, body = 132 + 12 * len(tags), b"", b""
    for key, value in tags.items():
        entries += key + struct.pack(">II", at + len(body), len(value))
        body += value + bytes(-len(value) % 4)
    size = at + len(body)
    head = struct.pack(">I4sI", size, bytes(4), 0x04300000) + b"mntrRGB XYZ "
    head += struct.pack(">6H", 2026, 1, 1, 0, 0, 0) + b"acsp" + bytes(28)
    head += numbers(b"", *D50)[4:] + bytes(48)
    return head + struct.pack(">I", len(tags)) + entries + body
