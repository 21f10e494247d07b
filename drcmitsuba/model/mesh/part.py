"""Part of a mesh file: surfaces of one material."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drcmitsuba.model.materials import Reflectance
from drcmitsuba.model.source_file import FARTHEST
from drcmitsuba.runtime.errors import InputError

MOST = {"polygons": 2_000_000, "vertices": 6_000_000, "parts": 50_000}
"""Largest numbers of a mesh file; its parts are of different material, group and object."""
LARGEST = 512 * 2**20
"""Largest binary file that is read [B]."""
MOST_CORNERS = 1000
"""Largest number of corners of a polygon."""


@dataclass(frozen=True)
class MeshPart:
    """Surfaces of one material, in the units and axes of the file."""

    names: tuple[str, ...]
    """Names of the material, then of the group or object that the surfaces are part of."""
    quads: np.ndarray
    """Parallelograms and triangles, shape (quad, 4, 3)."""
    reflectance: Reflectance | None = None
    """Diffuse reflectance that the file states; None where it states none [–]."""


def check_count(file: Path, what: str, count: int) -> None:
    """Raise InputError for more polygons, vertices or parts than are read."""
    if count > MOST[what]:
        remedy = f"give a mesh of at most {MOST[what]} {what}"
        raise InputError(file, what, f"more than {MOST[what]}", remedy)


def doubles(values: np.ndarray) -> np.ndarray:
    """Numbers of a binary file in double precision; NaN of any kind without a warning."""
    with np.errstate(invalid="ignore"):
        return values.astype(float)


def check_vertices(file: Path, vertices: np.ndarray) -> None:
    """Raise InputError for coordinates that are no number or far away."""
    if len(vertices) and not np.abs(vertices).max() <= FARTHEST:
        remedy = f"give numbers of at most {FARTHEST:g}"
        raise InputError(file, "vertices", "a coordinate that is no number, or far away", remedy)


def check_index(file: Path, index: np.ndarray, vertices: int) -> None:
    """Raise InputError for polygons with corners that are no vertices of the file."""
    if index.size and (index.min() < 0 or index.max() >= vertices):
        got = f"a corner that is none of the {vertices} vertices"
        raise InputError(file, "faces", got, "export the mesh again")


def beside(file: Path, name: str) -> Path | None:
    """File of a name in the folder of another one; None for any place outside the folder."""
    if not name or name in (".", "..") or any(c in name for c in "/\\:\0"):
        return None
    # Path.resolve raises where links form a circle.
    folder = Path(os.path.realpath(file)).parent
    path = Path(os.path.realpath(folder / name))
    return path if path.parent == folder else None
