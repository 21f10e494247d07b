"""Start of a command that runs kernels: slow imports, and their messages on stderr."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import ParamSpec, TypeVar

from drcmitsuba.runtime import interruption

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
            with _native_code_unheard():  # waits for the thread in which Dr.Jit looks for LLVM
                importlib.import_module("drcmitsuba.runtime.backend").llvm_version()
        importlib.import_module("drcmitsuba.annual.result")
        with interruption.raised():
            return command(*arguments, **options)

    return run
