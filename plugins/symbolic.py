"""Loops over arrays, written as `while` and recorded once as kernels."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, wraps
from pathlib import Path
from typing import TypeVar

import drjit as dr

F = TypeVar("F", bound=Callable)

_rewritten = dr.syntax


def symbolic(function: F) -> F:
    """Make a function's `while` and `if` symbolic as `drjit.syntax` does, at its first call.

    Rewriting a function takes milliseconds, and a program calls few of the functions that it
    imports.
    """
    file = function.__code__.co_filename
    imported = _age(file)

    @cache
    def now():
        if _age(file) != imported:  # its lines may be those of another function by now
            raise RuntimeError(f"{file} has changed since it was imported: start anew")
        return _rewritten(function)

    @wraps(function)
    def call(*arguments, **named):
        return now()(*arguments, **named)

    return call  # type: ignore[return-value]


def _age(file: str) -> int | None:
    """Time of a file's last change [ns]; None where there is no such file, as in a notebook."""
    try:
        return Path(file).stat().st_mtime_ns
    except OSError:
        return None


@contextmanager
def rewriting_later() -> Iterator[None]:
    """Let modules that are imported meanwhile have `symbolic` for `drjit.syntax`.

    Mitsuba imports integrators whenever a variant is set; a program may call none of them.
    """

    def syntax(function=None, **options):
        eager = function is None or options
        return _rewritten(function, **options) if eager else symbolic(function)

    dr.syntax = syntax
    try:
        yield
    finally:
        dr.syntax = _rewritten
