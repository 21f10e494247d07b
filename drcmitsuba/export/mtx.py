"""Matrices in Radiance's format: a header, then three 32-bit floats (red, green, blue) an entry.

`dctimestep` takes no other number of components.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix

BLOCK = 1 << 22
"""Number of entries that are written at once."""


def write_mtx(path: Path, matrix: np.ndarray | csr_matrix) -> None:
    """Write a matrix (row, column), or one of colours (row, column, 3).

    Parameters
    ----------
    path : Path
        File ending in `.mtx`.
    matrix : np.ndarray or csr_matrix
        Entries in the unit that the file gets; a grey one stands for three equal channels.
    """
    rows, columns = matrix.shape[:2]
    lines = ["#?RADIANCE", f"NROWS={rows}", f"NCOLS={columns}", "NCOMP=3", "BigEndian=0"]
    step = max(1, BLOCK // max(1, columns))
    with path.open("wb") as file:
        file.write(("\n".join([*lines, "FORMAT=float"]) + "\n\n").encode("ascii"))
        for start in range(0, rows, step):
            block = matrix[start : start + step]
            dense = block.toarray() if isinstance(block, csr_matrix) else np.asarray(block)
            if dense.ndim == 2:
                dense = np.repeat(dense[..., None], 3, axis=-1)
            file.write(dense.astype("<f4").tobytes())
