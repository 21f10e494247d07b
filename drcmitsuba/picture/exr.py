"""OpenEXR pictures: half or float, with luminance, view and time of the picture in the header."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Literal

import numpy as np

from drcmitsuba.model import source_file
from drcmitsuba.picture import exr_header
from drcmitsuba.picture.picture import EFFICACY, MOST_PIXELS, Picture
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import InputError

HALF_WHITE = 32768.0
"""Largest value of a file of halves, which end at 65504."""


def _package() -> Any:
    """Return the package OpenEXR, which only these files need."""
    try:
        import OpenEXR
    except ImportError:
        raise InputError(
            "OpenEXR", "package", "not installed", "pip install OpenEXR, or use .hdr files"
        ) from None
    return OpenEXR


def read(file: Path) -> Picture:
    """Read a picture of OpenEXR.

    Values are luminances over `whiteLuminance` [cd/m²]. Where the file does not state it, they are
    radiances [W/(m² sr)] times EXPOSURE, as in Radiance's pictures.

    Parameters
    ----------
    file : Path
        File with the channels R, G and B, or Y, of at most 400 MB of pixels.

    Raises
    ------
    InputError
        The file is missing, too large, no whole picture, or has neither channels.
    """
    with source_file.opened(file, MOST_PIXELS * 16) as stream:
        header = exr_header.read(stream.read(exr_header.LONGEST), file)
    names = "RGB" if {"R", "G", "B"} <= header.channels.keys() else "Y"
    if not set(names) <= header.channels.keys():
        got = ", ".join(sorted(header.channels)) or "none"
        raise InputError(file, "channels", got, "give a file with R, G and B, or Y")
    values = _values(file, names)
    scale = header.white or EFFICACY / header.exposure
    with np.errstate(over="ignore"):  # refused below
        for line in values:
            line *= np.float32(scale)
    try:
        return Picture(values, header.view, header.primaries, EFFICACY / scale, header.captured)
    except InputError as error:
        raise InputError(file, error.field, error.got, error.remedy) from None


def _values(file: Path, names: str) -> np.ndarray:
    """Values (row, column, 3) of channels."""
    openexr = _package()
    try:
        with openexr.File(str(file), separate_channels=True, num_threads=1) as opened:
            channels = [opened.channels()[name].pixels for name in names]
            values = np.empty((*channels[0].shape, 3), np.float32)
            for i in range(3):
                values[..., i] = channels[i % len(channels)]
            return values
    except Exception:  # its errors have no common type, and name no place in the file
        got = "they break off or cannot be decoded"
        raise InputError(file, "pixels", got, "give a whole .exr file") from None


def save(
    picture: Picture, file: Path, pixels: Literal["float", "half"] = "float",
    error: np.ndarray | None = None,
) -> None:  # fmt: skip
    """Write a picture as OpenEXR; never leaves half a file.

    The channels R, G and B are in units of luminance over the header's `whiteLuminance` [cd/m²].
    The header has `chromaticities`, `capDate`, and as in Radiance's pictures VIEW and EXPOSURE.

    Parameters
    ----------
    picture : Picture
        Picture.
    file : Path
        File that is written.
    pixels : {"float", "half"}
        Type of the values. Halves have three digits; `whiteLuminance` is 1 cd/m² or, for brighter
        pictures, the power of two with which the largest value is below 32,768.
    error : np.ndarray, shape (row, column), optional
        Standard error of the luminance [cd/m²], for a channel `error` in the same units.

    Examples
    --------
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from drcmitsuba import picture
    >>> from drcmitsuba.picture import exr
    >>> grey = picture.Picture(np.full((4, 6, 3), 500, np.float32))
    >>> exr.save(grey, Path("grey.exr"), pixels="half")
    >>> float(exr.read(Path("grey.exr")).luminance[0, 0])
    500.0
    """
    openexr = _package()
    white, rgb = 1.0, np.ascontiguousarray(picture.rgb, np.float32)
    if pixels == "half":
        white = 2.0 ** max(0, math.ceil(math.log2(max(1.0, float(np.abs(rgb).max())) / HALF_WHITE)))
        rgb = (rgb / np.float32(white)).astype(np.float16)
    channels = {"RGB": rgb}
    if error is not None:
        channels["error"] = np.ascontiguousarray(error / white, rgb.dtype)
    header = {
        "type": openexr.scanlineimage,
        "compression": openexr.ZIP_COMPRESSION,
        "whiteLuminance": white,
        "EXPOSURE": EFFICACY / white,
        "chromaticities": tuple(map(float, picture.primaries)),
    }
    if picture.view is not None:
        header["VIEW"] = picture.view.options()
    if picture.captured:
        header["capDate"] = picture.captured
    with storage.whole(file) as temporary, openexr.File(header, channels) as made:
        made.write(str(temporary))
