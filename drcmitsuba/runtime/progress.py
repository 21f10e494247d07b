"""Progress of long work, and the seconds of its stages."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

Progress = Callable[[float], None]
"""Function that is called with the share of the work that is done, 0 to 1."""
Stage = Callable[[str], AbstractContextManager[Progress]]
"""Function that opens a named stage of the work, and yields the stage's `Progress`."""


def rough(amount: float) -> str:
    """Write an amount with two significant digits, or as a whole number."""
    return f"{amount:.0f}" if amount >= 99.5 else f"{amount:.2g}"


def part(progress: Progress, begin: float, end: float) -> Progress:
    """Progress of a part of the work, which spans two shares of the whole."""
    return lambda share: progress(begin + share * (end - begin))


@contextmanager
def silent(name: str) -> Iterator[Progress]:
    """Show nothing of a stage."""
    yield lambda share: None


@contextmanager
def timed(stage: Stage, name: str, seconds: dict[str, float]) -> Iterator[Progress]:
    """Show a stage and write its seconds into `seconds`."""
    start = time.perf_counter()
    with stage(name) as done:
        yield done
        done(1.0)
    seconds[name] = round(time.perf_counter() - start, 3)
