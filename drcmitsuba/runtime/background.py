"""Jobs in a thread beside the main one."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager


@contextmanager
def _started() -> Iterator[ThreadPoolExecutor]:
    """Yield a thread that runs: after Ctrl-C nothing waits for one that is being started."""
    with ThreadPoolExecutor(1) as thread:
        thread.submit(int).result()
        yield thread


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

    with _started() as thread:
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
        self._about: Collection[object] = ()

    def do(self, job: Callable[[], object], about: Collection[object] = ()) -> None:
        """Begin a job about some things once the job before it has ended."""
        if self._thread is None:
            job()
            return
        self.wait()
        self._job, self._about = self._thread.submit(job), about

    def wait(self, about: object = None) -> None:
        """Wait for the job in hand, where it is about something; by default for any.

        A job that has failed already raises its error whatever it is about.
        """
        if self._job is None:
            return
        if about is None or about in self._about or self._job.done():
            job, self._job = self._job, None
            job.result()

    @contextmanager
    def opened(self) -> Iterator[None]:
        """Do jobs in a thread while the block runs, whose end waits for the last one.

        The error of a job is raised by the next call that waits for it, or by the end of the block
        unless the block itself fails.
        """
        with _started() as self._thread:
            try:
                yield
                self.wait()
            finally:
                self._thread = self._job = None
