"""Writer of BSDF files: LBNL's XML with tensor trees, as Radiance reads it."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from drcmitsuba_plugins.bsdf_file import BsdfFile
from drcmitsuba_plugins.bsdf_text import text

from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import InputError


def save(file: BsdfFile, path: str | Path, *, thickness: float = 0.0) -> None:
    """Write tensor trees as a BSDF file that Radiance and `bsdf_file.read` load.

    Parameters
    ----------
    file : BsdfFile
        Tensor trees to write; the notes become comments.
    path : str or Path
        File that is replaced only after the whole text is written.
    thickness : float
        Thickness of the pane for the header [m]; its width and height are 1 m.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    path = Path(path)
    content = text(file, thickness)
    try:
        path.parent.stat()  # saving would make the folder
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        storage.save_text(content, path)
    except OSError as error:
        raise InputError(path, "file", str(error.strerror), "choose a writable folder") from None
