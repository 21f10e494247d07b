"""The folder in which Dr.Jit keeps compiled kernels, so that a later run need not compile them.

Without it a run is right and takes longer. Dr.Jit says so in the words of its own, for each kernel
that a full disk does not take; here it is one sentence, before the first kernel.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from functools import lru_cache
from pathlib import Path

VARIABLE = "DRJIT_CACHE_DIR"
LEAST = 16 << 20
"""Space on the disk below which kernels are not kept [bytes]; an evaluation writes 1 MiB."""
NOWHERE = str(Path(os.devnull) / "kernels")
"""Place that cannot be made, by which Dr.Jit keeps no kernels."""
OF_THE_DRIVER = "OPTIX_CACHE_MAXSIZE"
"""Variable that, at 0, keeps a GPU's driver from a database there, which it could not make."""


def kernel_folder() -> Path | None:
    """Folder that Dr.Jit chooses; None where it chooses none."""
    if named := os.environ.get(VARIABLE):
        return Path(named)
    if sys.platform == "win32":
        return Path(tempfile.gettempdir()) / "drjit"
    return Path(home) / ".drjit" if (home := os.environ.get("HOME")) else None


def are_kept() -> bool:
    """Whether kernels that are compiled now are there for later runs, as far as was checked."""
    return os.environ.get(VARIABLE) != NOWHERE


def fault() -> str:
    """Why kernels cannot be kept; empty where they can."""
    folder = kernel_folder()
    if folder is None:
        return "HOME is not set"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        return f"{folder}: {error.strerror or error}"
    if not os.access(folder, os.W_OK | os.X_OK):
        return f"{folder}: may not be written"
    free = shutil.disk_usage(folder).free
    if free < LEAST:
        return f"{folder}: {free / 2**20:.1f} MiB are free, and {LEAST >> 20} MiB are needed"
    return ""


@lru_cache(maxsize=1)
def check() -> str:
    """Sentence on kernels that are not kept, before Dr.Jit is imported; empty where they are."""
    why = fault()
    if not why:
        return ""
    os.environ[VARIABLE] = NOWHERE
    os.environ[OF_THE_DRIVER] = "0"
    return (
        f"kernels are compiled in each run, since they cannot be kept: {why}; free space, or set "
        f"{VARIABLE} to a folder of your own"
    )
