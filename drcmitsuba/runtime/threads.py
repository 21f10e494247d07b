"""Threads of NumPy, and those of BLAS beside those of Dr.Jit."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from functools import cache
from typing import Any, TypeVar

from threadpoolctl import ThreadpoolController

MOST = 8
"""Number of threads that memory can serve."""

Job = TypeVar("Job")


def in_threads(work: Callable[[Job], None], jobs: Sequence[Job]) -> None:
    """Do the work of all jobs, by as many threads as there are cores; its errors are raised."""
    with ThreadPoolExecutor(min(MOST, os.cpu_count() or 1)) as threads:
        for _ in threads.map(work, jobs):
            pass


def one_blas_thread() -> AbstractContextManager[Any]:
    """Begin a context in which BLAS computes in the thread that calls it.

    Threads of its own wait for further work in a loop, and hold up those of Dr.Jit.
    """
    limit: AbstractContextManager[Any] = _controller().limit(limits=1, user_api="blas")
    return limit


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()
