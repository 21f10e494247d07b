"""The recipe file: one period of a micro-structure, checked before anything is traced.

A recipe is a TOML file whose tables are the classes below. Lengths are millimetres, angles
degrees. z points into the room, y up, x along the façade; light from the sun comes from −z.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, PrivateAttr, model_validator

from drcmitsuba.model.materials import check_energy
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Name, Table, checked, read_toml

MAX_BYTES = 1 << 20

Length = Annotated[float, Field(ge=1e-4, le=10_000)]
"""Length [mm]."""
Coordinate = Annotated[float, Field(ge=-10_000, le=10_000)]
"""Coordinate [mm]."""
Share = Annotated[float, Field(ge=0, le=1)]
Index = Annotated[float, Field(gt=1, le=4)]
"""Refractive index against air."""
Turn = Annotated[float, Field(ge=-170, le=170)]
"""Angle between the tangents at both ends of an arc [deg]."""
Corner = tuple[Coordinate, Coordinate] | tuple[Coordinate, Coordinate, Turn]
Polygon = Annotated[tuple[Corner, ...], Field(min_length=3, max_length=512)]


class Prism(Table):
    """Clear dielectric whose cross-section is extruded along x and repeated along y.

    Edges that two neighbours share, such as the cuts at both ends of a period of a film, are no
    surfaces and vanish. Limits: one material; polygons are solid, none is a hole in another.
    """

    kind: Literal["prism"]
    """Kind of structure: "prism"."""
    n: Index
    """Refractive index of the material; air is outside."""
    period: Length
    """Distance from one repetition to the next along y [mm]."""
    polygons: Annotated[tuple[Polygon, ...], Field(min_length=1, max_length=64)]
    """Polygons of the cross-section, each a list of corners [z, y] in mm, or [z, y, turn]: the
    edge to the next corner is then an arc along which the surface turns by `turn` degrees,
    outward where positive."""


class Slots(Table):
    """Clear panel with air slots cut from the side of the room (laser-cut panel)."""

    kind: Literal["slots"]
    """Kind of structure: "slots"."""
    n: Index
    """Refractive index of the panel; air is outside."""
    period: Length
    """Distance from one slot to the next along y [mm]."""
    thickness: Length
    """Thickness of the panel [mm]."""
    slot: Length
    """Width of the slots along y [mm]."""
    depth: Length
    """Depth of the slots [mm]; the panel's thickness for pieces that are cut apart."""

    @model_validator(mode="after")
    def _fits(self) -> Slots:
        if self.slot >= self.period:
            got = f"{self.slot:g} is not below the period, {self.period:g}"
            raise InputError("slots", "slot", got, "give a narrower slot")
        if self.depth > self.thickness:
            got = f"{self.depth:g} is above the thickness, {self.thickness:g}"
            raise InputError("slots", "depth", got, "cut at most through the panel")
        return self


class Lamellae(Table):
    """Thin opaque slats along x, the same on both sides, flat or bent to an arc."""

    kind: Literal["lamellae"]
    """Kind of structure: "lamellae"."""
    period: Length
    """Distance from one slat to the next along y [mm]."""
    width: Length
    """Length of the slat's chord in cross-section [mm]."""
    tilt: Annotated[float, Field(gt=-90, lt=90)] = 0.0
    """Angle of the chord from the horizontal [deg]; positive lifts the edge at the room."""
    turn: Turn = 0.0
    """Angle by which a bent slat turns from edge to edge [deg]; positive bulges upward."""
    reflectance: Share
    """Reflectance of the slats, mirrored and diffuse together, 0 to 1."""
    specular: Share = 0.0
    """Part of the reflected light that is mirrored, 0 to 1; the rest is diffuse."""


class Dielectric(Table):
    """Clear material of a closed mesh whose normals point outward."""

    type: Literal["dielectric"]
    """Type of material: "dielectric"."""
    n: Index
    """Refractive index of the solid; air is outside."""


class Opaque(Table):
    """Opaque material, the same on both sides."""

    type: Literal["opaque"]
    """Type of material: "opaque"."""
    reflectance: Share
    """Reflectance, mirrored and diffuse together, 0 to 1."""
    specular: Share = 0.0
    """Part of the reflected light that is mirrored, 0 to 1; the rest is diffuse."""


class Mesh(Table):
    """One period of any shape from a file (PLY or OBJ), repeated along x and y."""

    kind: Literal["mesh"]
    """Kind of structure: "mesh"."""
    file: Path
    """PLY or OBJ file of triangles; a relative path begins at the recipe's folder."""
    period: tuple[Length, Length]
    """Distances from one repetition to the next along x and y [mm]."""
    scale: Annotated[float, Field(gt=0, le=1e6)] = 1.0
    """Length of one unit of the file [mm]."""
    material: Annotated[Dielectric | Opaque, Field(discriminator="type")]
    """Material of all triangles."""

    @model_validator(mode="after")
    def _compact(self) -> Mesh:
        if max(self.period) > 1000 * min(self.period):
            got = f"{self.period[0]:g} and {self.period[1]:g}"
            raise InputError("mesh", "period", got, "give periods within a factor of 1000")
        return self


class Glass(Table):
    """Clear pane outside the structure: τ(θ) = τ₀ [1 − (1 − cos θ)ᵖ], mirrored share by Schlick."""

    transmittance: Share
    """Transmittance τ₀ at normal incidence, 0 to 1."""
    exponent: Annotated[float, Field(gt=0, le=100)] = 4.5
    """Exponent p: how late the transmittance falls with the angle of incidence."""
    reflectance: Share = 0.0
    """Reflectance at normal incidence, on both sides, 0 to 1."""
    distance: Length = 1.0
    """Width of the air gap between pane and structure [mm]."""

    @model_validator(mode="after")
    def _energy(self) -> Glass:
        check_energy(self.transmittance, self.reflectance, self.exponent)
        return self


Structure = Annotated[Prism | Slots | Lamellae | Mesh, Field(discriminator="kind")]


class Recipe(Table):
    """Micro-structure that the goniophotometer measures, with or without glass before it."""

    name: Name = "component"
    """Name of the component, written to its BSDF file."""
    manufacturer: Name = ""
    """Manufacturer of the component, written to its BSDF file."""
    structure: Structure
    """One period of the structure, of kind "prism", "slots", "lamellae" or "mesh"."""
    glass: Glass | None = None
    """Pane on the outside of the structure; none if it is left out."""

    _source: str = PrivateAttr("recipe")
    _folder: Path = PrivateAttr(Path())

    @property
    def source(self) -> str:
        """The file that the recipe came from, for messages."""
        return self._source

    def path(self, file: Path) -> Path:
        """Path of a file that the recipe names: relative ones begin at the recipe's folder."""
        return file if file.is_absolute() else self._folder / file


def load_recipe(path: str | Path) -> Recipe:
    """Read and check a recipe (TOML).

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Recipe

    Raises
    ------
    InputError
        The file is missing, is no TOML, has an unknown key or a value out of range.

    Examples
    --------
    >>> from drcmitsuba import goniophotometer
    >>> goniophotometer.load_recipe("lamellae.toml").structure.period
    40.0
    """
    file = Path(path)
    data = read_toml(file, MAX_BYTES)
    recipe = checked(Recipe, data, file)
    recipe._source, recipe._folder = str(file), file.parent
    return recipe
