"""Ctrl-C and SIGTERM of the command line: one line on stderr and exit code 130.

Before the work begins nothing is written, so the process ends at once: an import may swallow an
exception. During the work KeyboardInterrupt is raised, so that files are whole and a search keeps
its best design so far.
"""

from __future__ import annotations

import _thread
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

STOPPED = 130
"""Exit code after Ctrl-C or SIGTERM."""
LINE = "drcmitsuba: stopped\n"
SOON = 0.01
"""Time until a stop that nobody has heard comes once more [s]."""

descriptor = 2
"""File descriptor for the line, also while stderr is redirected."""
came = False
"""Whether a stop was asked for during the work. Compiled code may turn KeyboardInterrupt into an
error of its own, without a cause: Matplotlib's Agg does."""

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def _exit_at_once(number: int, frame: FrameType | None) -> None:
    os.write(descriptor, LINE.encode())
    os._exit(STOPPED)


def _raise(number: int, frame: FrameType | None) -> None:
    global came
    came = True
    raise KeyboardInterrupt


def _send(number: signal.Signals) -> None:
    """Send a signal to the main thread."""
    if hasattr(signal, "pthread_kill"):  # which ends a wait, too
        signal.pthread_kill(threading.main_thread().ident or 0, number)
    else:
        _thread.interrupt_main(number)


def exit_at_once() -> None:
    """End the process at Ctrl-C or SIGTERM, from now on until the work begins."""
    for number in _SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:  # a shell's background job ignores it
            signal.signal(number, _exit_at_once)


@contextmanager
def raised() -> Iterator[None]:
    """Raise KeyboardInterrupt at Ctrl-C or SIGTERM, where `exit_at_once` was called before.

    A finaliser that happens to run swallows every exception; the stop comes again after it.
    """
    caught = [number for number in _SIGNALS if signal.getsignal(number) is _exit_at_once]
    for number in caught:
        signal.signal(number, _raise)
    told = sys.unraisablehook

    def again(unraisable: UnraisableHookArgs) -> None:
        """Raise what a finaliser has swallowed once more, soon after it."""
        if not caught or not issubclass(unraisable.exc_type, KeyboardInterrupt):
            told(unraisable)
            return
        timer = threading.Timer(SOON, _send, caught[:1])
        timer.daemon = True
        timer.start()

    sys.unraisablehook = again
    try:
        yield
    finally:
        sys.unraisablehook = told
        for number in caught:
            signal.signal(number, _exit_at_once)


@contextmanager
def kept_from_children() -> Iterator[None]:
    """Keep Ctrl-C for good from threads and processes that begin within; it waits meanwhile.

    A terminal sends Ctrl-C to every process of a command. Workers leave it to the one that has
    started them, which ends them.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # multiprocessing would start it, and let Ctrl-C in again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
