"""Workers: processes that make blocks, on this machine or on others, by dask.distributed.

A job holds plain values; one worker does it. Blocks go to a folder that all workers see: a job that
is done again finds what is stored, and the caller reads the blocks as if it went on after a stop. A
worker that dies costs the block in progress.
"""

from __future__ import annotations

import importlib
import logging
import os
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import drjit as dr
import mitsuba as mi

from drcmitsuba.annual.block_parts import StatePart
from drcmitsuba.annual.run import MakeElsewhere
from drcmitsuba.blocks.block_folder import BlockFolder
from drcmitsuba.blocks.part import BlockPart
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import State
from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.errors import InputError, was_stopped
from drcmitsuba.runtime.interruption import kept_from_children
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.runtime.provenance import program
from drcmitsuba.runtime.release import RELEASE
from drcmitsuba.sky.sun_models import Suns

if TYPE_CHECKING:
    from distributed import Client

distributed = lazy.module("distributed")

THREADS = "DRCMITSUBA_THREADS"
"""Environment variable with the number of threads of a worker's kernels."""
ANSWER, START, POLL = 5.0, 60.0, 0.1
"""Seconds within which a scheduler answers and workers start; between two looks at the jobs."""
MOST_WORKERS = 1024
"""Largest number of workers on this machine."""
TOPIC = "drcmitsuba progress"
_ONE_JOB = threading.Lock()


class Job(Protocol):
    """Work for one worker, which can be pickled."""

    def make(self, progress: Progress) -> Any:
        """Do the work and return a result that can be pickled."""


def versions() -> dict[str, str]:
    """Versions on which blocks depend, by name, in this process."""
    return {**program(), "byte order": sys.byteorder, "drcmitsuba": RELEASE}


def _refuse_others(expected: dict[str, str]) -> None:
    """Refuse to work in a process of other versions than the caller's."""
    address = distributed.get_worker().address
    for name, own in versions().items():
        if own != expected[name]:
            got = f"{name} {own}, not {expected[name]}"
            raise InputError(f"worker {address}", "version", got, "install the same everywhere")


def _done(job: Job, number: int, expected: dict[str, str]) -> Any:
    """Do a job in a worker."""
    worker, shown = distributed.get_worker(), 0.0

    def progress(share: float) -> None:
        nonlocal shown
        if share - shown > 0.01:
            shown = share
            worker.log_event(TOPIC, [number, float(share)])

    with _ONE_JOB:  # Dr.Jit serves one job at a time, whatever the worker's number of threads
        _refuse_others(expected)
        if THREADS in os.environ:
            dr.set_thread_count(int(os.environ[THREADS]))
        return job.make(progress)


@dataclass(frozen=True)
class Workers:
    """Workers that a scheduler knows; from `opened`."""

    client: Client
    expected: dict[str, str]
    """Versions of this process."""

    @property
    def count(self) -> int:
        """Number of workers now."""
        return len(self.client.nthreads())

    def refuse_others(self) -> None:
        """Raise InputError where a worker has another version of the program."""
        # Of a worker that dies, its successor has another address: others do its job.
        once = {"pure": False, "allow_other_workers": True}
        futures = [
            self.client.submit(_refuse_others, self.expected, workers=[address], **once)
            for address in self.client.nthreads()
        ]
        for _ in self._finished(futures):
            pass

    def each(
        self, jobs: Sequence[Job], progress: Progress = lambda share: None
    ) -> Iterator[tuple[int, Any]]:
        """Have the workers do jobs; yield the number and the result of each as it ends.

        Raises
        ------
        InputError
            A worker has another version, a job kills one worker after another, or the scheduler
            has gone. Any error of a job is raised, too.
        """
        shares = dict.fromkeys(range(len(jobs)), 0.0)

        def told(event: tuple[float, tuple[int, float]]) -> None:
            shares[event[1][0]] = event[1][1]
            progress(sum(shares.values()) / len(jobs))

        self.client.subscribe_topic(TOPIC, told)
        submit = self.client.submit
        futures = [submit(_done, job, i, self.expected, pure=False) for i, job in enumerate(jobs)]
        try:
            for number in self._finished(futures):
                shares[number] = 1.0
                progress(sum(shares.values()) / len(jobs))
                yield number, futures[number].result()
        finally:
            if self.client.status == "running":
                self.client.unsubscribe_topic(TOPIC)
                self.client.cancel(futures)

    def elsewhere(self, case: Case, blocks: BlockFolder, seed: int) -> MakeElsewhere:
        """Make the function that has workers make the blocks of a case, for its `Run`."""
        made = set()
        there = BlockFolder(blocks.path.absolute(), blocks.is_shared)

        def make(state: State, suns: Suns, progress: Progress) -> None:
            if (state, suns.labels) in made:
                return
            there.path.mkdir(parents=True, exist_ok=True)
            among = max(1, self.count)
            parts = [BlockPart(i, among) for i in range(1, among + 1)]
            jobs = [StatePart(case, state, suns, seed, there, one) for one in parts]
            for _, notes in self.each(jobs, progress):
                blocks.notes.extend(notes)
            made.add((state, suns.labels))

        return make

    def _finished(self, futures: list[Any]) -> Iterator[int]:
        """Yield the number of each future as it ends; raise its error."""
        waiting = dict(enumerate(futures))
        while waiting:
            if self.client.status != "running":
                remedy = "start it and its workers; the same command goes on where this one ended"
                raise InputError(self.client.scheduler.address, "scheduler", "it has gone", remedy)
            for number, future in [*waiting.items()]:
                if future.done() and future.status != "cancelled":
                    del waiting[number]
                    _raise(future)
                    yield number
            time.sleep(POLL)


def _raise(future: Any) -> None:
    """Raise the error of a job, where it has one, in words for users."""
    error = future.exception() if future.status == "error" else None
    if isinstance(error, distributed.KilledWorker):
        got = f"{error.allowed_failures + 1} workers died of the same job"
        remedy = "give workers more memory; the same command goes on where this one ended"
        raise InputError("workers", str(error.last_worker.address), got, remedy) from None
    if isinstance(error, ImportError | AttributeError) and not was_stopped(error):
        got = f"a worker has another version of the program ({error})"
        raise InputError("workers", "version", got, "install the same everywhere") from None
    if error is not None:
        raise error


@contextmanager
def opened(count: int | None = None, scheduler: str | None = None) -> Iterator[Workers | None]:
    """Start workers on this machine, or join those of a scheduler; None without either.

    Parameters
    ----------
    count : int, optional
        Number of workers on this machine, which share its cores; on GPUs one for each is best.
    scheduler : str, optional
        Address of a Dask scheduler, "tcp://host:8786".

    Raises
    ------
    InputError
        Both are given, `count` is out of range, dask.distributed is missing, no scheduler
        answers, it has no workers, or one
        of them has another version of the program.
    """
    if count is None and scheduler is None:
        yield None
        return
    if count is not None and scheduler is not None:
        raise InputError("command line", "--workers", "beside --scheduler", "give one of them")
    if count is not None and not 1 <= count <= MOST_WORKERS:
        got, remedy = str(count), f"give a number from 1 to {MOST_WORKERS}"
        raise InputError("command line", "--workers", got, remedy)
    lazy.unhide("dask")
    if find_spec("distributed") is None:
        remedy = "pip install 'drcmitsuba[cluster]'"
        raise InputError("workers", "dask.distributed", "it is not installed", remedy)
    expected = versions()
    with _quiet(), _client(count, scheduler) as client:
        try:
            client.wait_for_workers(1 if count is None else count, timeout=START)
        except TimeoutError:
            remedy = "start some: dask worker ADDRESS --nthreads 1"
            raise InputError("workers", "scheduler", "it has no workers", remedy) from None
        workers = Workers(client, expected)
        workers.refuse_others()
        yield workers


@contextmanager
def _client(count: int | None, scheduler: str | None) -> Iterator[Client]:
    """Client of a scheduler; of one on this machine where `count` workers are wanted."""
    if count is not None:
        # A server of pages starts even without a dashboard; on port 0 two runs stay out of each
        # other's way.
        own = {"host": "127.0.0.1", "port": 0, "dashboard": False}
        own |= {"dashboard_address": "127.0.0.1:0"}
        spec = {"cls": distributed.Scheduler, "options": own}
        with ExitStack() as opened_here:
            with kept_from_children():  # also from workers that its threads start later
                cluster = distributed.SpecCluster(
                    _on_this_machine(count), spec, silence_logs=logging.CRITICAL
                )
                opened_here.enter_context(cluster)
            client = distributed.Client(cluster, set_as_default=False)
            yield opened_here.enter_context(client)
        return
    try:
        client = distributed.Client(scheduler, timeout=ANSWER, set_as_default=False)
    except (OSError, ValueError) as error:
        got = "no scheduler answers" if isinstance(error, OSError) else str(error)
        remedy = "give the address that `dask scheduler` prints, as tcp://host:8786"
        raise InputError("--scheduler", str(scheduler), got, remedy) from None
    try:
        yield client
    finally:
        client.close(timeout=1)


def _on_this_machine(count: int) -> dict[int, dict[str, Any]]:
    """Workers for `SpecCluster`, each with its share of the threads, and a GPU of its own."""
    threads = max(1, (os.cpu_count() or 1) // count)
    gpus = _gpus() if mi.variant().startswith("cuda") else []
    out = {}
    for i in range(count):
        environment = {THREADS: str(threads)}
        if gpus:
            environment["CUDA_VISIBLE_DEVICES"] = gpus[i % len(gpus)]
        options = {"nthreads": 1, "memory_limit": 0, "env": environment, "dashboard": False}
        options |= {"silence_logs": logging.CRITICAL, "host": "127.0.0.1"}
        out[i] = {"cls": distributed.Nanny, "options": options}
    return out


def _gpus() -> list[str]:
    """Names of the GPUs that this process may use."""
    visible = os.environ.get("CUDA_VISIBLE_DEVICES")
    if visible is not None:
        return [name for name in visible.split(",") if name.strip()]
    return [str(i) for i in range(len([*Path("/dev").glob("nvidia[0-9]*")]))]


@contextmanager
def _quiet() -> Iterator[None]:
    """Hold back the messages of dask, whose errors the program tells in one line."""
    importlib.import_module("distributed")  # makes its loggers
    names = [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]
    before = {name: logging.getLogger(name).level for name in names}
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for name, level in before.items():
            logging.getLogger(name).setLevel(level)
