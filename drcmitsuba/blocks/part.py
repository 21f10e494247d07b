"""Every n-th block: the share of one worker, or of one job of an array."""

from __future__ import annotations

import re
from dataclasses import dataclass

from drcmitsuba.runtime.errors import InputError

MOST = 1_000_000
"""Largest number of parts."""


@dataclass(frozen=True)
class BlockPart:
    """Blocks `number`, `number` + `among`, `number` + 2·`among`, …; blocks count from 1."""

    number: int
    among: int

    @classmethod
    def of(cls, text: str) -> BlockPart:
        """Read "i/n"; InputError where i is not one of 1 … n."""
        match = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text.strip(), re.ASCII)
        number, among = map(int, match.groups()) if match else (0, 0)
        if not 1 <= number <= among <= MOST:
            remedy = f"give i/n with i from 1 to n, n at most {MOST}"
            raise InputError("command line", "--block", repr(text), remedy)
        return cls(number, among)

    def holds(self, block: int) -> bool:
        """Whether a block, counted from 0, belongs to this part."""
        return block % self.among == self.number - 1

    def __str__(self) -> str:
        return f"{self.number}/{self.among}"


EVERY_BLOCK = BlockPart(1, 1)
