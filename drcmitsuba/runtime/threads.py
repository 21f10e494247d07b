"""Threads of NumPy beside those of Dr.Jit."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from functools import cache
from typing import Any, TypeVar

from threadpoolctl import ThreadpoolController

THREADS = min(8, os.cpu_count() or 1)
"""Number of threads."""
Piece = TypeVar("Piece")


def in_threads(work: Callable[[Piece], None], pieces: Sequence[Piece]) -> None:
    """Do the work of all pieces, in any order: NumPy's inner loops run side by side."""

    def share(first: int) -> None:
        for piece in pieces[first::THREADS]:
            work(piece)

    with ThreadPoolExecutor(THREADS) as pool:
        list(pool.map(share, range(THREADS)))


def one_blas_thread() -> AbstractContextManager[Any]:
    """Begin a context in which BLAS computes in the thread that calls it.

    Threads of its own wait for further work in a loop, and hold up those of Dr.Jit.
    """
    limit: AbstractContextManager[Any] = _controller().limit(limits=1, user_api="blas")
    return limit


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()
