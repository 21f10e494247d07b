"""Mesh files as models: surfaces by the names of their materials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain, count
from pathlib import Path
from typing import Literal

import numpy as np

from drcmitsuba.model.materials import Lambertian, SurfaceMaterial
from drcmitsuba.model.mesh.gltf import read_gltf
from drcmitsuba.model.mesh.obj import read_obj
from drcmitsuba.model.mesh.part import MeshPart
from drcmitsuba.model.mesh.ply import read_ply
from drcmitsuba.model.mesh.stl import read_stl
from drcmitsuba.model.model import Layer, Model, role_of
from drcmitsuba.model.notes import Notes
from drcmitsuba.runtime.errors import InputError

READERS = {
    ".obj": read_obj,
    ".ply": read_ply,
    ".stl": read_stl,
    ".gltf": read_gltf,
    ".glb": read_gltf,
}
METRES = (".gltf", ".glb")
"""Endings of the files whose unit is the metre."""


def read(
    file: Path, *, unit: float | None = None, up: Literal["z", "y"] = "z",
    materials: Mapping[str, SurfaceMaterial],
) -> Model:  # fmt: skip
    """Read a mesh: OBJ, PLY, STL, glTF or GLB.

    Two triangles that follow each other and share the diagonal of a parallelogram are one quad.
    Textures and normals are left out; corners in turn decide on fronts.

    Parameters
    ----------
    file : Path
        File of the mesh.
    unit : float, optional
        Length of the file's unit [m], which OBJ, PLY and STL need; 1 for glTF.
    up : str
        Axis of OBJ, PLY and STL that is up; glTF is turned from y up in any case.
    materials : Mapping[str, SurfaceMaterial]
        Materials by name: `usemtl` or the material of glTF; where it is not in the table, the
        group, object, mesh or node; the solid of STL; the file's name without ending for PLY. A
        name that the table lacks has the diffuse reflectance `Kd` of its MTL, or
        `baseColorFactor` of glTF, unless the file has it transparent or with a texture.

    Returns
    -------
    Model
        One layer for each material: a pane where the material lets light through.

    Raises
    ------
    InputError
        The file is not of these kinds, is damaged or too large, or names materials without
        reflectance that the table lacks.
    """
    file = Path(file)
    ending = file.suffix.lower()
    if ending not in READERS:
        raise InputError(file, "type", ending or "none", f"give one of {', '.join(READERS)}")
    if unit is None and ending not in METRES:
        remedy = 'write unit = "m" (dm, cm, mm, ft, in) in [model] of a case (in Python, in metres)'
        raise InputError(file, "unit", "none", remedy)
    if unit is not None and not 0 < unit < 1e6:
        raise InputError(file, "unit", f"{unit:g}", "give a length in metres above 0")
    notes = Notes()
    parts = [part for part in READERS[ending](file, notes) if len(part.quads)]
    if not parts:
        raise InputError(file, "faces", "none", "export the surfaces of the model")
    if up == "y" and ending not in METRES:
        parts = [replace(part, quads=part.quads[..., [0, 2, 1]] * [1, -1, 1]) for part in parts]
    named = _named(file, parts, materials)
    made = _materials(file, named, materials, notes)
    layers = tuple(_layer(file, name, made[name], named[name], unit or 1.0) for name in named)
    return Model(layers=layers, notes=notes.sentences())


def _named(
    file: Path, parts: list[MeshPart], materials: Mapping[str, SurfaceMaterial]
) -> dict[str, list[MeshPart]]:
    """Parts by the first of their names that the table has, or their first one.

    Materials of glTF may share a name: further ones, of another reflectance, are numbered.
    """
    named: dict[str, list[MeshPart]] = {}
    for part in parts:
        name = next((n for n in part.names if n in materials), None)
        if name is None:
            own = part.names[0] if part.names else file.stem
            names = chain([own], (f"{own} ({k})" for k in count(2)))
            name = next(n for n in names if _are_alike(part, named.get(n, ())))
        named.setdefault(name, []).append(part)
    return named


def _are_alike(part: MeshPart, others: Sequence[MeshPart]) -> bool:
    """Whether a part reflects as others of a name do."""
    return all(part.reflectance == other.reflectance for other in others[:1])


def _materials(
    file: Path,
    named: Mapping[str, list[MeshPart]],
    materials: Mapping[str, SurfaceMaterial],
    notes: Notes,
) -> dict[str, SurfaceMaterial]:
    """Material of every name: that of the table, or the diffuse reflectance of the file."""
    made: dict[str, SurfaceMaterial] = {n: materials[n] for n in named if n in materials}
    stated = {n: alike[0].reflectance for n, alike in named.items() if n not in made}
    missing = ", ".join(name for name, value in stated.items() if value is None)
    if missing:
        raise InputError(file, "materials without reflectance", missing, "add them to the table")
    for name in stated:
        notes.add("The file's own colour is the diffuse reflectance", name)
    return made | {name: Lambertian(value) for name, value in stated.items() if value is not None}


def _layer(
    file: Path, name: str, material: SurfaceMaterial, parts: list[MeshPart], unit: float
) -> Layer:
    """Layer of the parts of one name, in metres."""
    quads = np.concatenate([part.quads for part in parts]) * unit
    places = (f"{file.name}: {name}",)
    return Layer(name, material, role_of(material), quads, np.arange(len(quads)), places)
