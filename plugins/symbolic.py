"""Loops over arrays, written as `while` and recorded once as kernels."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial, wraps
from typing import TypeVar

import drjit as dr

F = TypeVar("F", bound=Callable)

_rewritten = dr.syntax


def symbolic(function: F) -> F:
    """Make a function's `while` and `if` symbolic as `drjit.syntax` does, at its first call.

    Rewriting a function takes milliseconds, and a program calls few of the functions that it
    imports.
    """
    now = cache(partial(_rewritten, function))

    @wraps(function)
    def call(*arguments, **named):
        return now()(*arguments, **named)

    return call  # type: ignore[return-value]


@contextmanager
def rewriting_later() -> Iterator[None]:
    """Let modules that are imported meanwhile have `symbolic` for `drjit.syntax`.

    Mitsuba imports integrators whenever a variant is set, which a program may never call.
    """
    dr.syntax = symbolic
    try:
        yield
    finally:
        dr.syntax = _rewritten
