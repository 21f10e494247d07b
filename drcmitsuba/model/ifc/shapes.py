"""Shapes of an IFC file's elements as triangles, by the materials of their faces."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drcmitsuba.model.polygon import closes
from drcmitsuba.model.source_file import size_of
from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.errors import InputError, printable

ifcopenshell = lazy.module("ifcopenshell")

LARGEST = 5 * 10**8
"""Largest file that is read [B]: what it holds takes some ten times as much memory."""
MOST_TRIANGLES = 5_000_000
"""Largest number of triangles of all elements."""
SCHEMAS = ("IFC2X3", "IFC4")
"""Schemas that are read, with their additions."""
LEFT_OUT = (
    "IfcOpeningElement", "IfcVirtualElement", "IfcAnnotation", "IfcGrid", "IfcDistributionElement",
    "IfcFeatureElement", "IfcReinforcingElement", "IfcPort",
)  # fmt: skip
"""Elements without a surface of their own, and those of installations."""
OPEN = 1e-3
"""Largest sum of the area vectors of a closed body's faces, over their area [–]."""
CLEAR = 0.3
"""Transparency from which on a face is glass [–]."""


@dataclass(frozen=True, eq=False)
class IfcShape:
    """Triangles of an element."""

    element: Any
    """Element of ifcopenshell."""
    triangles: np.ndarray
    """Corners, counter-clockwise from outside, shape (triangle, 3, 3) [m]."""
    is_clear: np.ndarray
    """Whether each triangle is of a transparent material, bool (triangle,)."""

    @property
    def kind(self) -> str:
        """Class of the element, such as IfcWall."""
        return str(self.element.is_a())

    @property
    def place(self) -> str:
        """Class and identifier of the element, for messages."""
        return printable(f"{self.kind} {self.element.GlobalId}")

    def is_any(self, *kinds: str) -> bool:
        """Whether the element is of one of some classes, or of one derived from them."""
        return any(self.element.is_a(kind) for kind in kinds)


def opened(file: Path) -> Any:
    """File of ifcopenshell.

    Raises
    ------
    InputError
        ifcopenshell is not installed, or the file is too large, damaged, or of another schema.
    """
    size_of(file, LARGEST)
    try:
        model = ifcopenshell.open(str(file))
    except ImportError:
        remedy = "pip install 'drcmitsuba[ifc]'"
        raise InputError(file, "IFC", "ifcopenshell is not installed", remedy) from None
    except Exception as error:  # those of its parser have no class in common
        got = printable(str(error) or type(error).__name__)[:120]
        raise InputError(file, "IFC", got, "check that it is a whole IFC 2x3 or 4 file") from None
    schema = str(model.schema)
    if not schema.startswith(SCHEMAS):
        remedy = "export the building as IFC 2x3 or IFC 4"
        raise InputError(file, "FILE_SCHEMA", printable(schema)[:40], remedy)
    return model


def shapes_of(file: Path, model: Any) -> Iterator[IfcShape]:
    """Shapes of the elements, spaces and sites, in the order of the file.

    Openings are cut out of the elements that they are in.

    Raises
    ------
    InputError
        There are more than `MOST_TRIANGLES`.
    """
    from ifcopenshell import geom

    settings = geom.settings()
    settings.set("use-world-coords", True)
    named = [model.by_type(kind) for kind in ("IfcElement", "IfcSpace", "IfcSite")]
    wanted = [each for some in named for each in some if _has_shape(each)]
    if not wanted:
        return
    shapes, count = geom.iterator(settings, model, 1, include=wanted), 0
    if not shapes.initialize():
        return
    while True:
        shape = shapes.get()
        made = _shape(model.by_id(shape.id), shape.geometry)
        count += len(made.triangles)
        if count > MOST_TRIANGLES:
            got = f"more than {MOST_TRIANGLES} triangles"
            raise InputError(file, "IFC", got, "leave out furniture and installations")
        if len(made.triangles) and np.isfinite(made.triangles).all():
            yield made
        if not shapes.next():
            return


def _has_shape(element: Any) -> bool:
    left_out = any(_is(element, kind) for kind in LEFT_OUT)
    return element.Representation is not None and not left_out


def _is(element: Any, kind: str) -> bool:
    try:
        return bool(element.is_a(kind))
    except RuntimeError:  # the schema lacks this class
        return False


def _shape(element: Any, geometry: Any) -> IfcShape:
    corners = np.array(geometry.verts, float).reshape(-1, 3)
    faces = np.array(geometry.faces, int).reshape(-1, 3)
    of_face = np.array(geometry.material_ids, int)
    triangles = outward(corners[faces])
    return IfcShape(element, triangles, _clear(geometry.materials)[of_face])


def outward(triangles: np.ndarray) -> np.ndarray:
    """Triangles (triangle, 3, 3) of a closed body, counter-clockwise from outside.

    A mapping that mirrors turns them over.
    """
    areas = area_vectors(triangles)
    if not (len(triangles) and closes(areas, OPEN)):
        return triangles
    volume = float((areas * (triangles[:, 0] - triangles.mean(axis=(0, 1)))).sum())
    return triangles if volume >= 0 else triangles[:, ::-1]


def area_vectors(triangles: np.ndarray) -> np.ndarray:
    """Normals times areas of triangles (triangle, 3, 3), front counter-clockwise [m²]."""
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]) / 2


def _clear(materials: Sequence[Any]) -> np.ndarray:
    """Whether materials of the file are transparent; the last entry, for faces without one, is not.

    Those that the library makes for elements without a material are not of the file.
    """
    known = [m.transparency if m.instance_id() and m.has_transparency() else 0.0 for m in materials]
    with np.errstate(invalid="ignore"):
        return np.array([*known, 0.0], float) >= CLEAR
