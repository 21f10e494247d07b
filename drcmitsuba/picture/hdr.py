"""Radiance pictures (`.hdr`, `.pic`): RGBE and XYZE, flat, with repeats or with runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drcmitsuba.model import source_file
from drcmitsuba.picture import hdr_header, rgbe
from drcmitsuba.picture.picture import EFFICACY, LARGEST, MOST_PIXELS, Picture, to_xyz
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import InputError


def read(file: Path) -> Picture:
    """Read a picture of Radiance.

    The luminance is 179 · (0.265 R + 0.670 G + 0.065 B) over the exposure; COLORCORR is divided
    out, too.

    Parameters
    ----------
    file : Path
        Picture of at most 33 million pixels.

    Raises
    ------
    InputError
        The file is missing, too large, or no whole picture.
    """
    raw = source_file.read_bytes(file, MOST_PIXELS * 5)
    header = hdr_header.read(raw, file)
    values = rgbe.decode(raw, header.end, header.scanlines, header.width, file)
    del raw
    factor = (EFFICACY / header.exposure / header.correction).astype(np.float32)
    if header.form == hdr_header.XYZE:
        to_rgb = np.linalg.inv(to_xyz(header.primaries)).astype(np.float32)
    for line in values:
        if header.form == hdr_header.XYZE:
            line[:] = line @ to_rgb.T
        with np.errstate(over="ignore"):  # refused below
            line *= factor
    try:
        return Picture(
            header.upright(values), header.view, header.primaries, header.exposure, header.captured
        )
    except InputError as error:
        raise InputError(file, error.field, error.got, error.remedy) from None


def save(picture: Picture, file: Path, exposure: float = 1.0) -> None:
    """Write a picture as Radiance does, in runs of bytes; never leaves half a file.

    Parameters
    ----------
    picture : Picture
        Picture; negative values become 0.
    file : Path
        File that is written.
    exposure : float
        Factor by which the values are multiplied, which the header states [–]. Viewers that do not
        tone-map show white at 1, which is 179 cd/m² over the exposure.

    Examples
    --------
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from drcmitsuba import picture
    >>> from drcmitsuba.picture import hdr
    >>> grey = picture.Picture(np.full((4, 6, 3), 500, np.float32))
    >>> hdr.save(grey, Path("grey.hdr"), exposure=0.1)
    >>> hdr.read(Path("grey.hdr")).exposure
    0.1
    """
    if not 1e-15 <= exposure <= LARGEST:
        raise InputError("picture", "exposure", f"{exposure}", f"give 1e-15 to {LARGEST:g}")
    with storage.whole(file) as temporary, temporary.open("wb") as stream:
        stream.write(hdr_header.text(picture, exposure).encode())
        for top in range(0, len(picture.rgb), rgbe.BLOCK):
            values = picture.rgb[top : top + rgbe.BLOCK].astype(np.float64)
            stream.write(rgbe.encode(values * (exposure / EFFICACY)))
