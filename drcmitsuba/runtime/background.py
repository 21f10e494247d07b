"""Jobs in a thread beside the main one."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager


@contextmanager
def beside(*jobs: Callable[[], object]) -> Iterator[None]:
    """Do jobs one after another in a thread while the block runs.

    The end of the block waits for them and raises the error of a job that fails, after which no
    further job begins. Where the block fails, the jobs are done nevertheless; after Ctrl-C only the
    one is that has begun, so that its file is whole.
    """
    is_stopped = threading.Event()

    def work() -> None:
        for job in jobs:
            if not is_stopped.is_set():
                job()

    with ThreadPoolExecutor(1) as thread:
        try:
            done = thread.submit(work)
            yield
            done.result()
        except KeyboardInterrupt:
            is_stopped.set()
            raise
