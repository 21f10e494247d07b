"""The tables `[components.NAME]` of a case: components that are geometry, not a BSDF on a pane."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from drcmitsuba.case.materials import (
    DielectricMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Material,
    MirrorMaterial,
)
from drcmitsuba.case.toml import Coordinate, Fraction, Point, Side, Table, choose, shortened
from drcmitsuba.runtime.errors import InputError

Extent = Annotated[float, Field(ge=1e-3, le=10_000, strict=True)]
"""Of pipes and ducts [m]; thinner ones are slips of the pen."""

Wanted = tuple[str | None, tuple[type[Table], ...]]
"""Name of a material, None where there is none, and what it may be."""

Clear = (GlazingMaterial,)
Pane = (GlazingMaterial, DiffuserMaterial)
Mirror = (MirrorMaterial,)
Solid = (MirrorMaterial, DielectricMaterial)


class StructureComponent(Table):
    """A micro-structure repeated behind the panes of a façade's strip that names it.

    It stands outside of the façade plane, in a casing that closes its four sides.
    """

    type: Literal["structure"]
    recipe: Path
    """TOML file of the goniophotometer, relative to the case file."""
    tilt: Annotated[float, Field(gt=-90, lt=90)] | None = None
    """Of lamellae [deg], in place of their recipe's."""
    outer: str | None = None
    """Glazing outside of the structure; a recipe's own [glass] stands there too."""
    inner: str | None = None
    """Glazing between the structure and the room."""
    gap: Annotated[float, Field(gt=0, le=1)] = 0.005
    """Air between neighbouring layers [m]."""
    casing: Fraction = 0.5
    """Reflectance of the casing and of what whole periods leave of the pane."""

    def materials(self) -> dict[str, Wanted]:
        """Materials by key: their names and what they may be."""
        return {"outer": (self.outer, Clear), "inner": (self.inner, Clear)}


class LightPipe(Table):
    """A straight mirrored pipe through the ceiling."""

    type: Literal["lightpipe"]
    centre: tuple[Coordinate, Coordinate]
    width: Extent
    """Diameter, from side to side."""
    sides: Annotated[int, Field(ge=4, le=720, multiple_of=4)] = 24
    height: Extent
    """Of its upper end above the ceiling."""
    mirror: str
    top: str | None = None
    """Glazing at its upper end; without it, it is open."""
    bottom: str | None = None
    """Glazing or diffuser in the ceiling; without it, it is open."""

    def materials(self) -> dict[str, Wanted]:
        """Materials by key: their names and what they may be."""
        return {
            "mirror": (self.mirror, Mirror),
            "top": (self.top, Clear),
            "bottom": (self.bottom, Pane),
        }


class Duct(Table):
    """A rectangular mirrored duct over the ceiling, from an opening in a side down into the room.

    One plane mirror at 45° turns the light down at its end.
    """

    type: Literal["duct"]
    side: Side = "south"
    centre: Coordinate
    """Of the duct along its side, from the left, seen from outside."""
    width: Extent
    height: Extent
    """Of the channel."""
    length: Extent
    """From the plane of the side to the far end."""
    above: Annotated[float, Field(gt=0, le=100)] = 0.05
    """Lower edge of the entry above the ceiling."""
    acceptance: Annotated[float, Field(ge=5, le=85)] | None = None
    """Half angle of a compound parabolic concentrator at the entry, above and below [deg]."""
    mirror: str
    cover: str | None = None
    """Glazing at the entry; without it, it is open."""
    bottom: str | None = None
    """Glazing or diffuser in the ceiling; without it, it is open."""

    def materials(self) -> dict[str, Wanted]:
        """Materials by key: their names and what they may be."""
        return {
            "mirror": (self.mirror, Mirror),
            "cover": (self.cover, Clear),
            "bottom": (self.bottom, Pane),
        }


class MeshComponent(Table):
    """Any shape from a file (PLY or OBJ), of a mirror or a clear solid."""

    type: Literal["mesh"]
    file: Path
    """Relative to the case file."""
    material: str
    position: Point = (0.0, 0.0, 0.0)
    """Where the file's origin stands."""
    scale: Annotated[float, Field(gt=0, le=1e6)] = 1.0
    """Metres of one unit of the file."""
    rotation: Annotated[float, Field(ge=-360, le=360)] = 0.0
    """Clockwise, seen from above, about the file's origin [deg]."""
    ports: Annotated[tuple[tuple[Point, Point, Point, Point], ...], Field(max_length=1000)] = ()
    """Rectangles by which light comes to it; without any, the faces of its bounding box."""

    def materials(self) -> dict[str, Wanted]:
        """Materials by key: their names and what they may be."""
        return {"material": (self.material, Solid)}


Component = Annotated[
    StructureComponent | LightPipe | Duct | MeshComponent, Field(discriminator="type")
]


def check_components(
    components: Mapping[str, Component], materials: Mapping[str, Material], has_room: bool
) -> None:
    """Refuse components of unknown or unfit materials, of taken names, or without their room."""
    for name, component in components.items():
        where = f"components.{name}"
        if name in ("", "wall", "open") or name in materials:
            raise InputError("case", where, "the name is taken", "choose another name")
        if not has_room and not isinstance(component, MeshComponent):
            raise InputError("case", where, "there is no room", "add a [room]")
        for key, (used, kinds) in component.materials().items():
            if used is not None and not isinstance(materials.get(used), kinds):
                known = [k for k, m in materials.items() if isinstance(m, kinds)]
                wanted = " or ".join(k.__name__.removesuffix("Material").lower() for k in kinds)
                got = f"{shortened(used)} is no {wanted} in [materials]"
                raise InputError("case", f"{where}.{key}", got, choose(used, known))
