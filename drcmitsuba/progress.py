"""How long work tells how far it has come."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float], None]
"""Called with the share of the work that is done, 0 to 1."""


def part(progress: Progress, begin: float, end: float) -> Progress:
    """Progress of a part of the work, between two shares of the whole."""
    return lambda share: progress(begin + share * (end - begin))
