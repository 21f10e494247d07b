"""Whole periods of an endless structure, cut out to be built into a pane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drcmitsuba.model.materials import DielectricMaterial
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.structures.polygon import triangles
from drcmitsuba.scene.structures.recipe import Mesh, Recipe
from drcmitsuba.scene.structures.solid import check_solid
from drcmitsuba.scene.structures.structure import (
    MOST_TRIANGLES,
    StructureMaterial,
    alone,
    outlines,
    unit_cell,
)

MM = 1e-3


@dataclass(frozen=True)
class Block:
    """A piece of a structure."""

    quads: np.ndarray
    """Corners [m] in the recipe's axes, shape (quad, 4, 3): x along the façade and y up, both
    centred on 0; z into the room, at most 0. A triangle repeats its last corner. A clear solid's
    normals point out."""
    material: StructureMaterial
    size: np.ndarray
    """Extent along x, y and z [m], shape (3,)."""


def is_clear(recipe: Recipe) -> bool:
    """Whether the structure is a clear solid."""
    s = recipe.structure
    if isinstance(s, Mesh):
        return s.material.type == "dielectric"
    return s.kind != "lamellae"


def block(recipe: Recipe, width: float, height: float) -> Block:
    """Cut as many whole periods as fit into a pane out of a structure.

    Parameters
    ----------
    width, height : float
        Extents of the pane [m].

    Returns
    -------
    Block
        Extruded structures are as wide as the pane; clear ones are closed at their cuts and ends.

    Raises
    ------
    InputError
        No period fits, a clear mesh is not closed in its period, or triangles are too many.
    """
    unit = unit_cell(recipe)
    if unit.extruded:
        quads, span = _cut(recipe, unit.material, width / MM, height / MM)
    else:
        quads, span = _tiled(recipe, unit.vertices[unit.faces], width / MM, height / MM)
    if 2 * len(quads) > MOST_TRIANGLES:
        got = f"{2 * len(quads)} triangles in a pane"
        raise InputError(recipe.source, "structure", got, "give a longer period")
    low, high = quads.min(axis=(0, 1)), quads.max(axis=(0, 1))
    middle = np.array([*(low + high)[:2] / 2, high[2]])
    size = np.array([*span, high[2] - low[2]]) * MM
    return Block((quads - middle) * MM, unit.material, size)


def _count(recipe: Recipe, extent: float, period: float, room: float) -> int:
    """Number of periods [mm] that fit into `room` [mm]; the last one takes `extent` [mm]."""
    count = int(np.floor((room - extent) / period + 1e-6)) + 1
    if count < 1:
        got = f"a period takes {extent:g} mm, the pane leaves {room:.4g} mm"
        raise InputError(recipe.source, "structure.period", got, "give a shorter period")
    return count


def _cut(
    recipe: Recipe, material: StructureMaterial, width: float, height: float
) -> tuple[np.ndarray, tuple[float, float]]:
    """Quads of an extruded structure, and their span along x and y [mm]."""
    parts, s = outlines(recipe), recipe.structure
    assert not isinstance(s, Mesh)
    y = np.concatenate(parts)[..., 1]
    extent = max(float(np.ptp(y)), s.period)
    count = _count(recipe, extent, s.period, height)
    if count * sum(map(len, parts)) > MOST_TRIANGLES // 4:
        got = f"{count} periods in a pane"
        raise InputError(recipe.source, "structure.period", got, "give a longer period")
    moved = [part + [0, k * s.period] for k in range(count) for part in parts]
    edges = np.concatenate(moved)
    clear = isinstance(material, DielectricMaterial)
    if clear:
        edges = edges[alone(edges, s.period)]
    a, b = edges[:, 0], edges[:, 1]
    x = width / 2
    quads = [np.stack([_at(-x, a), _at(x, a), _at(x, b), _at(-x, b)], axis=1)]
    if clear:
        ears = [triangles(part[:, 0]) for part in parts]  # every period is cut the same way
        for i, outline in enumerate(moved):
            cap = outline[:, 0][ears[i % len(parts)]][:, [0, 1, 2, 2]]
            quads += [_at(-x, cap), _at(x, cap[:, [2, 1, 0, 0]])]
    return np.concatenate(quads), (width, (count - 1) * s.period + extent)


def _at(x: float, zy: np.ndarray) -> np.ndarray:
    """Points (…, 3) at x from points (…, 2) of the cross-section, z before y."""
    return np.stack([np.full(zy.shape[:-1], x), zy[..., 1], zy[..., 0]], axis=-1)


def _tiled(
    recipe: Recipe, corners: np.ndarray, width: float, height: float
) -> tuple[np.ndarray, tuple[float, float]]:
    """Quads of copies of a mesh (triangle, 3, 3), and their span along x and y [mm]."""
    s = recipe.structure
    assert isinstance(s, Mesh)
    extent = np.ptp(corners.reshape(-1, 3), axis=0)[:2]
    if is_clear(recipe):
        file = recipe.path(s.file)
        check_solid(file, corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
        if (extent >= s.period).any():
            got = f"the solid of {extent[0]:g} × {extent[1]:g} mm touches its repetition"
            raise InputError(file, "mesh", got, "give longer periods or a smaller one")
    extent = np.maximum(extent, s.period)
    nx, ny = (
        _count(recipe, e, p, r) for e, p, r in zip(extent, s.period, (width, height), strict=True)
    )
    if nx * ny * len(corners) > MOST_TRIANGLES:
        got = f"{nx * ny * len(corners)} triangles in a pane"
        raise InputError(recipe.source, "structure.period", got, "give longer periods")
    step = [[i * s.period[0], j * s.period[1], 0] for i in range(nx) for j in range(ny)]
    quads = (corners[None] + np.array(step)[:, None, None]).reshape(-1, 3, 3)[:, [0, 1, 2, 2]]
    span = np.array([nx - 1, ny - 1]) * s.period + extent
    return quads, (float(span[0]), float(span[1]))
