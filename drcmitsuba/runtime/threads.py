"""Threads of NumPy, and those of BLAS beside those of Dr.Jit."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from functools import cache
from typing import Any, TypeVar

from threadpoolctl import ThreadpoolController

MOST = 8
"""Number of threads that memory can serve."""

Job = TypeVar("Job")


def in_threads(work: Callable[[Job], None], jobs: Iterable[Job]) -> None:
    """Do the work of all jobs, by as many threads as there are cores; its errors are raised.

    The calling thread is one of them. So work that calls this again never waits for a thread, and
    few jobs that are soon done need no other one.
    """
    left = deque(jobs)

    def some() -> None:
        while True:
            try:
                job = left.popleft()
            except IndexError:
                return
            work(job)

    helpers = min(_cores(), len(left)) - 1
    others = [_threads().submit(some) for _ in range(helpers)]
    try:
        some()
    finally:
        left.clear()
        begun = [other for other in others if not other.cancel()]
        errors = [error for other in begun if (error := other.exception()) is not None]
    for error in errors:
        raise error


def one_blas_thread() -> AbstractContextManager[Any]:
    """Begin a context in which BLAS computes in the thread that calls it.

    Threads of its own wait for further work in a loop, and hold up those of Dr.Jit.
    """
    limit: AbstractContextManager[Any] = _controller().limit(limits=1, user_api="blas")
    return limit


@cache
def _cores() -> int:
    """Number of threads that work side by side."""
    return min(MOST, os.cpu_count() or 1)


@cache
def _threads() -> ThreadPoolExecutor:
    """Threads that wait for work: to start them takes as long as a small piece of it."""
    return ThreadPoolExecutor(_cores(), "drcmitsuba")


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()
