"""Pictures in files, of the formats that their first bytes or their endings name."""

from __future__ import annotations

from pathlib import Path

from drcmitsuba.model import source_file
from drcmitsuba.picture import exr, exr_header, hdr
from drcmitsuba.picture.picture import MOST_PIXELS, Picture
from drcmitsuba.runtime.errors import InputError

HDR = (".hdr", ".pic", ".rgbe")
EXR = (".exr",)


def read(file: str | Path) -> Picture:
    """Read a picture of Radiance or OpenEXR.

    Parameters
    ----------
    file : str or Path
        Picture of at most 33 million pixels, whose first bytes tell the format.

    Returns
    -------
    Picture
        Values in units of luminance [cd/m²], with the view of the header.

    Raises
    ------
    InputError
        The file is missing, too large for memory, of another format, or broken.

    Examples
    --------
    >>> import numpy as np
    >>> from drcmitsuba import picture
    >>> view = picture.PictureView("equidistant", direction=(0, 1, 0), angles=(180, 180))
    >>> bright = np.full((60, 60, 3), 500, np.float32)
    >>> bright[12:24, 20:36] = 8000
    >>> office = picture.Picture(bright, view)
    >>> picture.save(office, "office.hdr")
    >>> picture.read("office.hdr").rgb.shape
    (60, 60, 3)
    """
    file = Path(file)
    with source_file.opened(file, MOST_PIXELS * 16) as stream:
        first = stream.read(4)
    if first.startswith(b"#?"):
        return hdr.read(file)
    if first == exr_header.MAGIC:
        return exr.read(file)
    raise InputError(file, "format", repr(first), "give a picture of Radiance or OpenEXR")


def save(picture: Picture, file: str | Path) -> None:
    """Write a picture as Radiance's `.hdr` or as OpenEXR of floats; never leaves half a file.

    `hdr.save` and `exr.save` have the choices of each format.

    Parameters
    ----------
    picture : Picture
        Picture.
    file : str or Path
        File that ends in .hdr, .pic, .rgbe or .exr.

    Raises
    ------
    InputError
        The ending is another one.

    Examples
    --------
    >>> import numpy as np
    >>> from drcmitsuba import picture
    >>> view = picture.PictureView("equidistant", direction=(0, 1, 0), angles=(180, 180))
    >>> bright = np.full((60, 60, 3), 500, np.float32)
    >>> bright[12:24, 20:36] = 8000
    >>> office = picture.Picture(bright, view)
    >>> picture.save(office, "office.hdr")
    """
    file = Path(file)
    ending = file.suffix.lower()
    if ending not in (*HDR, *EXR):
        raise InputError(file, "ending", ending or "none", f"end in {', '.join((*HDR, *EXR))}")
    (hdr.save if ending in HDR else exr.save)(picture, file)
