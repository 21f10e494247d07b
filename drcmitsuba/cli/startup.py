"""Start of a command that runs kernels: slow imports, and their messages on stderr."""

from __future__ import annotations

import gc
import importlib
import logging
import os
import platform
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import wraps
from pathlib import Path
from typing import ParamSpec, TypeVar

from drcmitsuba.cli.terminal import show_progress
from drcmitsuba.runtime import interruption, kernel_folder, lazy
from drcmitsuba.runtime.errors import BackendError, on_a_line
from drcmitsuba.runtime.progress import Progress, Stage

WHILE = "open façade"
"""Stage in which kernels leave Python idle."""
SWITCH = 1e-3
"""Longest time that a thread of Python may hold up another one [s]: kernels wait for the main one
while further modules are imported and files are written beside it."""
OBJECTS = 20_000
"""Number of new objects after which Python looks for cycles among them."""
FOR_METRICS = ("scipy.special", "scipy.sparse")
FOR_FILES = ("h5netcdf", "numcodecs", "drcmitsuba.report.figures")
"""Modules that a year's metrics and files need."""
CHUNKS = "dask"
"""Package that xarray imports wherever it is installed, for arrays in chunks, which no command has:
a second. Workers look for it again."""
COMPILER = "f2py"
"""Module of NumPy that SciPy imports and nothing here uses: half of the time of `FOR_METRICS`."""

P = ParamSpec("P")
T = TypeVar("T")


@contextmanager
def _native_code_heard(lines: list[str]) -> Iterator[None]:
    """Keep the messages of compiled code on stderr to ourselves, in the command's own process.

    During its import Dr.Jit looks for LLVM and a GPU and complains of unfit ones, before its log
    level can be set. `backend` reports them in one line, and only where they are needed.
    """
    try:
        stderr = os.dup(2)
    except OSError:  # stderr is closed
        yield
        return
    read, write = os.pipe()
    interruption.descriptor = stderr
    os.dup2(write, 2)
    os.close(write)
    with suppress(OSError, AttributeError):  # what no longer fits into the pipe is lost
        os.set_blocking(2, False)
    try:
        yield
    finally:
        os.dup2(stderr, 2)  # nobody has the other end of the pipe any more: it ends
        interruption.descriptor = 2
        os.close(stderr)
        with os.fdopen(read, encoding="utf-8", errors="replace") as pipe:
            lines += pipe.read().splitlines()


def _without_mitsuba(error: ImportError) -> BackendError:
    """Error of a Python that cannot import Mitsuba."""
    bits = 64 if sys.maxsize > 2**32 else 32
    python = f"{platform.python_implementation()} {platform.python_version()}"
    return BackendError(
        f"{python} ({bits} bit, {platform.system()} {platform.machine()}) cannot import Mitsuba: "
        f"{on_a_line(str(error))}; install drcmitsuba in CPython 3.10 to 3.14 of 64 bit, on Linux "
        "(x86-64, arm64), macOS (arm64) or Windows (x86-64)"
    )


def _told_of_what_is_not_kept() -> None:
    """Tell in one line that kernels are not kept, and leave out what Matplotlib says of its fonts.

    Both keep files in the user's home, which may be read-only, and do their work without them.
    """
    if line := kernel_folder.check():
        show_progress(f"note: {line}")
    if not os.access(Path("~").expanduser(), os.W_OK):
        logging.getLogger("matplotlib").setLevel(logging.ERROR)


def with_kernels(command: Callable[P, T]) -> Callable[P, T]:
    """Make a command import Mitsuba first; Ctrl-C during the import ends the process at once."""

    @wraps(command)
    def run(*arguments: P.args, **options: P.kwargs) -> T:
        if "mitsuba" not in sys.modules:
            gc.disable()  # modules and their classes are no garbage
            numpy = importlib.import_module("numpy")
            setattr(numpy, COMPILER, lazy.module(f"numpy.{COMPILER}"))
            _told_of_what_is_not_kept()
            lines: list[str] = []
            try:
                with _native_code_heard(lines):  # waits for the thread in which LLVM is looked for
                    backend = importlib.import_module("drcmitsuba.runtime.backend")
                    backend.llvm_version()
            except ImportError as error:
                raise _without_mitsuba(error) from error
            backend.heard.extend(lines)
            if "xarray" not in sys.modules:  # it asks once whether there is one
                lazy.hide(CHUNKS)
            importlib.import_module("drcmitsuba.annual.result")
            gc.freeze()
            gc.set_threshold(OBJECTS)
            gc.enable()
        sys.setswitchinterval(SWITCH)
        with interruption.raised():
            return command(*arguments, **options)

    return run


def importing(stage: Stage, *modules: str) -> Stage:
    """Stages of an evaluation, which import modules in a thread while the kernels of `WHILE` run.

    What cannot be imported fails where it is used.
    """

    def work() -> None:
        with suppress(Exception):
            for name in modules:
                importlib.import_module(name)

    @contextmanager
    def opened(name: str) -> Iterator[Progress]:
        if name == WHILE:
            threading.Thread(target=work, name="imports", daemon=True).start()
        with stage(name) as done:
            yield done

    return opened
