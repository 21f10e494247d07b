"""Start of a command that runs kernels: slow imports, and their messages on stderr."""

from __future__ import annotations

import gc
import importlib
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import wraps
from typing import ParamSpec, TypeVar

from drcmitsuba.runtime import interruption, lazy
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
def _native_code_unheard() -> Iterator[None]:
    """Discard the messages of compiled code on stderr, in the command's own process.

    During its import Dr.Jit looks for LLVM and complains of an unfit one, before its log level can
    be set. `backend.check_llvm` reports it in one line, and only where LLVM is needed.
    """
    try:
        stderr = os.dup(2)
    except OSError:  # stderr is closed
        yield
        return
    null = os.open(os.devnull, os.O_WRONLY)
    interruption.descriptor = stderr
    os.dup2(null, 2)
    try:
        yield
    finally:
        os.dup2(stderr, 2)
        interruption.descriptor = 2
        os.close(stderr)
        os.close(null)


def with_kernels(command: Callable[P, T]) -> Callable[P, T]:
    """Make a command import Mitsuba first; Ctrl-C during the import ends the process at once."""

    @wraps(command)
    def run(*arguments: P.args, **options: P.kwargs) -> T:
        if "mitsuba" not in sys.modules:
            gc.disable()  # modules and their classes are no garbage
            numpy = importlib.import_module("numpy")
            setattr(numpy, COMPILER, lazy.module(f"numpy.{COMPILER}"))
            with _native_code_unheard():  # waits for the thread in which Dr.Jit looks for LLVM
                importlib.import_module("drcmitsuba.runtime.backend").llvm_version()
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
