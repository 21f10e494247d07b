"""Work of NumPy in several threads: its inner loops run side by side."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

THREADS = min(8, os.cpu_count() or 1)
"""Number of threads."""
Piece = TypeVar("Piece")


def in_threads(work: Callable[[Piece], None], pieces: Sequence[Piece]) -> None:
    """Do the work of all pieces, in any order."""

    def share(first: int) -> None:
        for piece in pieces[first::THREADS]:
            work(piece)

    with ThreadPoolExecutor(THREADS) as pool:
        list(pool.map(share, range(THREADS)))
