"""A job in a process of its own, with its own memory, whose failure does not touch the caller.

The interpreter starts the process: `multiprocessing` would run the user's own script once more.
"""

from __future__ import annotations

import pickle
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from drcmitsuba.runtime.errors import BackendError, InputError
from drcmitsuba.runtime.progress import Progress

T = TypeVar("T")

APART: dict[str, Any] = {"start_new_session": True}
"""Options by which Ctrl-C reaches this process only."""
if sys.platform == "win32":
    APART = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
POLL = 0.05
"""Seconds between two looks at a process."""


class JobError(RuntimeError):
    """A process ended without a result; the message names its signal or exit code."""


def run(job: Callable[[], T], deadline: float, progress: Progress = lambda share: None) -> T:
    """Do a job in another process, wait for it, and return its result; both can be pickled.

    An unfinished job is stopped at the `deadline`, a time by `time.monotonic` [s]; `progress` is
    called with the share [–] of the time until then that has passed.

    Raises
    ------
    TimeoutError
        The job was not done by the deadline.
    JobError
        The process ended without a result.
    InputError, BackendError
        The job raised it.
    """
    start = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="drcmitsuba-") as name:
        folder = Path(name)
        (folder / "job").write_bytes(pickle.dumps(job))
        code = f"from {__name__} import work; work({name!r})"
        with (folder / "stderr").open("wb") as stderr:
            process = subprocess.Popen(
                [sys.executable, "-c", code], **APART,
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=stderr,
            )  # fmt: skip
            try:
                while process.poll() is None:
                    now = time.monotonic()
                    if now >= deadline:
                        raise TimeoutError
                    progress((now - start) / (deadline - start))
                    time.sleep(POLL)
            finally:
                process.kill()
                process.wait()
        return _result(folder, process.returncode)


def _result(folder: Path, code: int) -> Any:
    """Result that a process has left in the folder; raises the error that it left instead."""
    file = folder / "result"
    if not file.is_file():
        lines = (folder / "stderr").read_text("utf-8", errors="replace").strip().splitlines()
        ended = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        raise JobError(f"{ended}: {lines[-1][:200]}" if lines else ended)
    kind, content = pickle.loads(file.read_bytes())
    if kind == "input":
        raise InputError(*content)
    if kind == "backend":
        raise BackendError(content)
    return content


def work(name: str) -> None:
    """Do the job in a folder and leave the result there; the other process of `run` calls this."""
    folder = Path(name)
    job = pickle.loads((folder / "job").read_bytes())
    result: tuple[str, object]
    try:
        result = ("done", job())
    except InputError as error:
        result = ("input", (error.source, error.field, error.got, error.remedy))
    except BackendError as error:
        result = ("backend", str(error))
    part = folder / "part"
    part.write_bytes(pickle.dumps(result, protocol=pickle.HIGHEST_PROTOCOL))
    part.replace(folder / "result")
