"""Threads of BLAS beside those of Dr.Jit."""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache
from typing import Any

from threadpoolctl import ThreadpoolController


def one_blas_thread() -> AbstractContextManager[Any]:
    """Begin a context in which BLAS computes in the thread that calls it.

    Threads of its own wait for further work in a loop, and hold up those of Dr.Jit.
    """
    limit: AbstractContextManager[Any] = _controller().limit(limits=1, user_api="blas")
    return limit


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()
