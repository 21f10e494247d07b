"""Radiance's `BSDF` and `aBSDF`: panes with a measured BSDF, and how they are mounted.

Their front faces the room, and `up`, projected on the pane, is the direction of the file's y axis.
The engine takes the world's z axis for it, and the y axis on a horizontal pane.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from drcmitsuba.model.materials import BsdfMaterial, FacedBsdf
from drcmitsuba.model.radiance import expression
from drcmitsuba.model.radiance.definitions import Definition
from drcmitsuba.model.radiance.text import Primitive, sought
from drcmitsuba.model.radiance.xform import transform

SAME_UP = np.cos(np.radians(0.5))
"""Smallest cosine between two directions that count as the same."""


class Mounted(NamedTuple):
    """Measured pane and the direction of its file's y axis in the world."""

    material: BsdfMaterial
    up: np.ndarray
    """Direction of any length, shape (3,)."""
    primitive: Primitive
    """Text that defines it, for errors."""


def film(definition: Definition) -> Mounted:
    """Measured pane of a `BSDF` or an `aBSDF`.

    The straight-through peak of `aBSDF` is taken out wherever its file has one, that of `BSDF`
    where it stands out.

    Raises
    ------
    InputError
        It is thick, has diffuse parts of its own or a function file, or its file is missing.
    """
    primitive = definition.primitive
    strings = primitive.strings
    if primitive.kind == "BSDF":
        if strings[:1] and _number(strings[0], primitive) != 0:
            got = f"a thickness of {strings[0]}: it stands for geometry that it hides"
            raise primitive.error(got, "give the geometry, or the pane with a thickness of 0")
        strings = strings[1:]
    if len(strings) < 5:
        got = f"{len(primitive.strings)} strings"
        raise primitive.error(got, "give file, up vector and function file")
    name, *direction, functions = strings[:5]
    if functions != ".":
        raise primitive.error(f"the function file {functions!r}", "write numbers and a stop")
    if any(primitive.numbers):
        got = "diffuse parts beside those of its file"
        raise primitive.error(got, "take them into the file")
    up = np.array([_number(text, primitive) for text in direction])
    moves, used = transform(strings[5:], primitive.place)
    if used < len(strings) - 5 or len(moves) > 1:
        raise primitive.error(f"the transform {' '.join(strings[5:])!r}", "write turns only")
    up = definition.moves.direction(moves.direction(up))
    file = sought(name, definition.folders)
    if file is None:
        where = ", ".join(str(folder) for folder in definition.folders)
        raise primitive.error(f"no file {name!r} in {where}", "put the BSDF file there")
    material = FacedBsdf(type="bsdf", file=file)
    if primitive.kind == "aBSDF":
        material = material.model_copy(update={"straight_through": "on"})
    return Mounted(material, up, primitive)


def _number(text: str, primitive: Primitive) -> float:
    try:
        value = float(expression.value(text, {}))
    except expression.ExpressionError as error:
        raise primitive.error(str(error), "write a number") from None
    if not abs(value) <= 1e12:
        raise primitive.error(f"{text} as a number", "write a finite one")
    return value


def upside_down(pane: Mounted, quads: np.ndarray) -> np.ndarray:
    """Whether each of the quads (quad, 4, 3) is mounted upside down, bool, shape (quad,).

    Raises
    ------
    InputError
        On one of them the file's y axis is neither up nor down.
    """
    normals = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    level = np.abs(normals[:, :2]).sum(axis=1) < 1e-4
    engine = _on(normals, np.where(level[:, None], [0.0, 1, 0], [0.0, 0, 1]))
    cosine = np.einsum("qx,qx->q", _on(normals, np.broadcast_to(pane.up, normals.shape)), engine)
    if not (np.abs(cosine) >= SAME_UP).all():
        got = "an up vector that is neither up nor down on the pane"
        remedy = "turn the file, so that its y axis is vertical, or along y on a horizontal pane"
        raise pane.primitive.error(got, remedy)
    return np.asarray(cosine < 0)


def _on(normals: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Unit vectors of directions projected on panes; zero where none is left."""
    flat = directions - np.einsum("qx,qx->q", directions, normals)[:, None] * normals
    length = np.linalg.norm(flat, axis=1)
    whole = np.linalg.norm(directions, axis=1)
    unit = flat / np.where(length > 0, length, 1)[:, None]
    return np.where((length > 1e-4 * whole)[:, None], unit, 0)
