"""Jobs in a thread beside the main one."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
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


class Behind:
    """Jobs of which one at a time is done in a thread while the main one goes on.

    Outside of `opened`, jobs are done at once.
    """

    def __init__(self) -> None:
        self._thread: ThreadPoolExecutor | None = None
        self._job: Future[object] | None = None
        self._about: object = None

    def do(self, job: Callable[[], object], about: object) -> None:
        """Begin a job about something once the job before it has ended."""
        if self._thread is None:
            job()
            return
        self.wait()
        self._job, self._about = self._thread.submit(job), about

    def wait(self, about: object = None) -> None:
        """Wait for the job that is done, where it is about this; by default for any."""
        if self._job is None or about not in (None, self._about):
            return
        job, self._job = self._job, None
        job.result()

    @contextmanager
    def opened(self) -> Iterator[None]:
        """Do jobs in a thread while the block runs, whose end waits for the last one.

        The error of a job is raised by the next call that waits for it, or by the end of the block.
        """
        with ThreadPoolExecutor(1) as self._thread:
            try:
                yield
                self.wait()
            finally:
                self._thread = self._job = None
