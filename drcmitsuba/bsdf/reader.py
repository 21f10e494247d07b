"""BSDF files: XML with tensor trees or Klems matrices; parsed by `bsdf_file` of `plugins`."""

from __future__ import annotations

from pathlib import Path

from drcmitsuba_plugins import bsdf_file
from drcmitsuba_plugins.bsdf_file import BsdfFile

from drcmitsuba.runtime.errors import InputError


def read(path: str | Path) -> BsdfFile:
    """Read a BSDF file: LBNL XML with tensor trees or Klems matrices.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    BsdfFile
        Directions point away from the surface, +z into the room, +y up.

    Raises
    ------
    InputError
        The file is no BSDF file, or its numbers are wrong.

    Examples
    --------
    >>> import drcmitsuba
    >>> film = drcmitsuba.bsdf.read("film.xml")
    >>> type(film).__name__
    'BsdfFile'
    """
    try:
        return bsdf_file.read(path)
    except bsdf_file.BsdfFileError as error:
        raise InputError(error.source, error.field, error.got, error.remedy) from None
