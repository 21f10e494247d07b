"""The tables `[components.NAME]` of a case: components that are geometry, not a BSDF on a pane."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from drcmitsuba.model.materials import (
    DielectricMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Material,
    MirrorMaterial,
)
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import (
    Coordinate,
    Fraction,
    Point,
    Side,
    Table,
    choose,
    named_of_kind,
    shortened,
)

Extent = Annotated[float, Field(ge=1e-3, le=10_000, strict=True)]
"""Width or length of a pipe or duct [m]; smaller values are taken for mistakes."""

Kinds = dict[str, tuple[type[Table], ...]]
"""Classes that the materials of a component may have, by key."""

Clear = (GlazingMaterial,)
Pane = (GlazingMaterial, DiffuserMaterial)
Mirror = (MirrorMaterial,)
Solid = (MirrorMaterial, DielectricMaterial)


class StructureComponent(Table):
    """A micro-structure repeated behind the panes of a façade's strip that names it.

    It stands outside of the façade plane, in a casing that closes its four sides.
    """

    type: Literal["structure"]
    """Kind of the component."""
    recipe: Path
    """Recipe of the goniophotometer (TOML), relative to the case file."""
    tilt: Annotated[float, Field(gt=-90, lt=90)] | None = None
    """Tilt of lamellae [deg]; default: the recipe's."""
    outer: str | None = None
    """Glazing outside of the structure, in addition to the recipe's own [glass]."""
    inner: str | None = None
    """Glazing between the structure and the room."""
    gap: Annotated[float, Field(gt=0, le=1)] = 0.005
    """Thickness of the air between neighbouring layers [m]."""
    casing: Fraction = 0.5
    """Reflectance of the casing, and of the part of the pane that no whole period fills [–]."""

    kinds: ClassVar[Kinds] = {"outer": Clear, "inner": Clear}


class LightPipe(Table):
    """A straight mirrored pipe through the ceiling."""

    type: Literal["lightpipe"]
    """Kind of the component."""
    centre: tuple[Coordinate, Coordinate]
    """Centre of the pipe in the ceiling, x and y [m]."""
    width: Extent
    """Diameter of the pipe, from side to opposite side [m]."""
    sides: Annotated[int, Field(ge=4, le=720, multiple_of=4)] = 24
    """Number of plane sides of the pipe."""
    height: Extent
    """Height of the upper end above the ceiling [m]."""
    mirror: str
    """Mirror inside the pipe."""
    top: str | None = None
    """Glazing at the upper end; default: open."""
    bottom: str | None = None
    """Glazing or diffuser in the ceiling; default: open."""

    kinds: ClassVar[Kinds] = {"mirror": Mirror, "top": Clear, "bottom": Pane}


class Duct(Table):
    """A rectangular mirrored duct over the ceiling, from an opening in a side down into the room.

    One plane mirror at 45° turns the light down at its end.
    """

    type: Literal["duct"]
    """Kind of the component."""
    side: Side = "south"
    """Side of the room at which the light enters."""
    centre: Coordinate
    """Centre of the duct along its side, from the left, seen from outside [m]."""
    width: Extent
    """Width of the channel [m]."""
    height: Extent
    """Height of the channel [m]."""
    length: Extent
    """Length from the plane of the side to the far end [m]."""
    above: Annotated[float, Field(gt=0, le=100)] = 0.05
    """Height of the entry's lower edge above the ceiling [m]."""
    acceptance: Annotated[float, Field(ge=5, le=85)] | None = None
    """Half angle of a compound parabolic concentrator at the entry, above and below [deg]."""
    mirror: str
    """Mirror inside the duct."""
    cover: str | None = None
    """Glazing at the entry; default: open."""
    bottom: str | None = None
    """Glazing or diffuser in the ceiling; default: open."""

    kinds: ClassVar[Kinds] = {"mirror": Mirror, "cover": Clear, "bottom": Pane}


class MeshComponent(Table):
    """Any shape from a file (PLY or OBJ), of a mirror or a clear solid."""

    type: Literal["mesh"]
    """Kind of the component."""
    file: Path
    """PLY or OBJ file, relative to the case file."""
    material: str
    """A mirror or a dielectric of [materials]."""
    position: Point = (0.0, 0.0, 0.0)
    """Position of the file's origin in the room's frame [m]."""
    scale: Annotated[float, Field(gt=0, le=1e6)] = 1.0
    """Length of one unit of the file [m]."""
    rotation: Annotated[float, Field(ge=-360, le=360)] = 0.0
    """Rotation about the file's origin, clockwise seen from above [deg]."""
    ports: Annotated[tuple[tuple[Point, Point, Point, Point], ...], Field(max_length=1000)] = ()
    """Corners of rectangles by which light reaches the mesh [m]; default: its bounding box."""

    kinds: ClassVar[Kinds] = {"material": Solid}


Component = Annotated[
    StructureComponent | LightPipe | Duct | MeshComponent, Field(discriminator="type")
]


def check_components(
    components: Mapping[str, Component], materials: Mapping[str, Material], has_room: bool
) -> None:
    """Refuse components with unknown or unfit materials, with taken names, or without a room."""
    for name, component in components.items():
        where = f"components.{name}"
        if name in ("", "wall", "open") or name in materials:
            raise InputError("case", where, "the name is taken", "choose another name")
        if not has_room and not isinstance(component, MeshComponent):
            raise InputError("case", where, "there is no room", "add a [room]")
        for key, kinds in component.kinds.items():
            used = getattr(component, key)
            if used is not None and not isinstance(materials.get(used), kinds):
                known = named_of_kind(materials, kinds)
                wanted = " or ".join(k.__name__.removesuffix("Material").lower() for k in kinds)
                got = f"{shortened(used)} is no {wanted} in [materials]"
                raise InputError("case", f"{where}.{key}", got, choose(used, known))
