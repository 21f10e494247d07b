"""A folder that one process at a time writes to."""

from __future__ import annotations

import errno
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from drcmitsuba.runtime.errors import InputError

NAME = ".lock"
CLOSED_FIRST = os.name == "nt"
"""Whether the system removes closed files alone. Others remove the file while it is locked, so that
none is removed that another process has taken meanwhile."""
NONE_TO_BE_HAD = {errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP}
"""Errors of file systems that know no locks."""
_held: set[tuple[Path, int, int]] = set()
"""Folders that are kept, each by a process and its thread."""


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other processes from a folder while the block runs.

    The system holds the lock as long as the process lives: one that was killed leaves none behind.
    Within the block, the same thread may ask for the folder again.

    Raises
    ------
    InputError
        Another process holds the lock, or there is a file of this name.
    OSError
        The folder may not be written.
    """
    if (own := (folder.resolve(), os.getpid(), threading.get_ident())) in _held:
        yield
        return
    if folder.is_file():
        raise InputError(folder, "folder", "it is a file", "name another folder")
    is_new, path = not folder.exists(), folder / NAME
    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as at_the_end, path.open("a+", encoding="utf-8") as file:
        if not (_taken(file.fileno()) and _is_at(path, file.fileno())):
            file.seek(0)
            owner = file.read(20).strip() or "unknown"
            got = f"another run writes to it (process {owner})"
            raise InputError(folder, "folder", got, "wait for its end, or name another folder")
        file.truncate(0)
        file.write(f"{os.getpid()}\n")
        file.flush()
        if CLOSED_FIRST:
            at_the_end.callback(_remove, path, is_new)
        _held.add(own)
        try:
            yield
        finally:
            _held.discard(own)
            if not CLOSED_FIRST:
                _remove(path, is_new)


def _remove(path: Path, with_folder: bool) -> None:
    """Remove the file, and the folder where the work has left nothing in it."""
    with suppress(OSError):
        path.unlink()
        if with_folder:
            path.parent.rmdir()


def _is_at(path: Path, descriptor: int) -> bool:
    """Whether an open file still stands at a path: its last owner may have removed it meanwhile."""
    with suppress(FileNotFoundError):
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    return False


def _taken(descriptor: int) -> bool:
    """Take the lock of an open file until it is closed; False where another process has it."""
    try:
        if sys.platform == "win32":
            import msvcrt

            os.lseek(descriptor, 1 << 30, os.SEEK_SET)  # beyond the text, which others read
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        return False
    except OSError as error:
        if error.errno not in NONE_TO_BE_HAD:
            raise
    return True
