"""Arrays of numbers as parameters of plugins: a tensor, a text as in XML scenes, or a file."""

from __future__ import annotations

import re
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

MAX_BYTES = 1 << 26
"""Size of the largest file of numbers that is read [bytes]."""
_FILES = (".npy", ".csv", ".txt")
_WANTED = "give a tensor, a text of numbers (rows end with ';'), or a .npy or .csv file"


def table_of(plugin: str, name: str, value) -> mi.TensorXf:
    """Tensor of the numbers that a parameter holds.

    Parameters
    ----------
    plugin, name : str
        Plugin and parameter, named in errors.
    value : tensor, array, vector, number or str
        A text holds numbers between blanks or commas, its rows end with ';' or with the line; or it
        is the path of a file .npy, .csv or .txt, relative ones are sought beside the scene's file.

    Returns
    -------
    mi.TensorXf
        As many dimensions as the value has; a text of one row, or of rows of different lengths,
        gives one dimension. A tensor keeps its gradients.

    Raises
    ------
    ValueError
        No numbers, or a file that cannot be read; one line with the plugin's name.
    """
    if dr.is_tensor_v(value):
        return mi.TensorXf(value)
    try:
        if isinstance(value, str):
            numbers = _of_file(value) if value.lower().endswith(_FILES) else _of_text(value)
        else:
            numbers = np.asarray(value, np.float32)
            # A Dr.Jit vector (3, n) lists n of them.
            numbers = numbers.T if dr.is_vector_v(value) and numbers.ndim == 2 else numbers
        return mi.TensorXf(np.ascontiguousarray(numbers, np.float32))
    except (TypeError, ValueError, EOFError) as error:
        got = str(error) if isinstance(value, str) else f"a {type(value).__name__}"
        raise ValueError(f"{plugin}: {name}: {' '.join(got.split())[:200]}; {_WANTED}") from None
    except OSError as error:
        raise ValueError(f"{plugin}: {name}: {value}: {error.strerror}; {_WANTED}") from None


def _of_text(text: str) -> np.ndarray:
    """Numbers of a text, shape (row, column), or (n,) where there is one row or rows differ."""
    rows = [row.replace(",", " ").split() for row in re.split(r"[;\n]", text)]
    rows = [row for row in rows if row]
    if not rows:
        raise ValueError("no number")
    try:
        numbers = [[float(word) for word in row] for row in rows]
    except ValueError:
        raise ValueError(f"{text[:60]!r} is no list of numbers") from None
    if len(numbers) > 1 and len({len(row) for row in numbers}) == 1:
        return np.array(numbers)
    return np.concatenate(numbers)


def _of_file(name: str) -> np.ndarray:
    """Numbers of a file; a .csv may begin with a line of names, and '#' begins a comment."""
    path = Path(str(mi.file_resolver().resolve(name)))
    if not path.is_file():  # a device would never end
        raise ValueError(f"{name}: {'no plain file' if path.exists() else 'no such file'}")
    if path.stat().st_size > MAX_BYTES:
        raise ValueError(f"{name}: more than {MAX_BYTES >> 20} MB")
    if path.suffix.lower() == ".npy":
        return np.asarray(np.load(path, allow_pickle=False), float)
    lines = [
        line.partition("#")[0] for line in path.read_text("utf-8", errors="replace").splitlines()
    ]
    lines = [line for line in lines if line.strip()]
    if lines and re.fullmatch(r"\s*[A-Za-z_]\w*(\s*[,;\s]\s*[A-Za-z_]\w*)*\s*", lines[0]):
        lines = lines[1:]
    return _of_text("\n".join(lines))
