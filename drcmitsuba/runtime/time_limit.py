"""Limit of the time for further rounds of samples."""

from __future__ import annotations

import time


class TimeLimit:
    """Limit of time, which runs from when it is made.

    Parameters
    ----------
    seconds : float
        Time after which no round begins [s].
    """

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self._start = time.perf_counter()

    @property
    def is_over(self) -> bool:
        """Whether the time is over."""
        return time.perf_counter() - self._start > self.seconds
