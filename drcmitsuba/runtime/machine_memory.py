"""Memory of the machine that arrays may take."""

from __future__ import annotations

import os

SHARE = 0.75
"""Share of the machine's memory that arrays may take."""


def of_machine() -> float:
    """Memory that arrays may take [bytes]."""
    try:
        return SHARE * os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # not POSIX
        return float("inf")
