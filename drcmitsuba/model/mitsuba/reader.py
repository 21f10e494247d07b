"""Mitsuba scenes as models: one layer for each BSDF."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from drcmitsuba.model.materials import Lambertian, SurfaceMaterial
from drcmitsuba.model.mitsuba import dictionary, xml
from drcmitsuba.model.mitsuba.bsdfs import AROUND, BSDFS, innermost, material_of
from drcmitsuba.model.mitsuba.entries import SceneEntries, SceneEntry
from drcmitsuba.model.mitsuba.shapes import SHAPES, quads_of
from drcmitsuba.model.model import Layer, Model, role_of
from drcmitsuba.model.notes import Notes
from drcmitsuba.runtime.errors import InputError

MOST_QUADS = 2_000_000
"""Largest number of triangles and parallelograms of a scene."""
NO_SOURCES = "Lamps, suns and skies of the scene are left out: the weather file gives the light"
GREY = "Shapes without a BSDF are diffuse with a reflectance of 0.5"


def read(
    file: Path, *, unit: float | None = None, materials: Mapping[str, SurfaceMaterial]
) -> Model:
    """Read a Mitsuba scene in XML. No plugin is loaded and nothing is executed.

    Parameters
    ----------
    file : Path
        Scene with the z axis up; files that it names lie beside it.
    unit : float
        Length of the scene's unit [m].
    materials : Mapping[str, SurfaceMaterial]
        Materials by the id of a BSDF, or of a shape whose BSDF has none; they replace the scene's.

    Returns
    -------
    Model
        One layer for each BSDF: a pane where the material lets light through.

    Raises
    ------
    InputError
        The file is unfit, or holds a shape or a BSDF without a counterpart here.
    """
    file = Path(file)
    if unit is None or not 0 < unit < 1e6:
        got = "none" if unit is None else f"{unit:g}"
        remedy = 'write unit = "m" (dm, cm, mm, ft, in) in [model] of a case (in Python, in metres)'
        raise InputError(file, "unit", got, remedy)
    return _model(xml.scene_of(file), unit, materials)


def from_dict(
    scene: Mapping[str, Any],
    *,
    unit: float = 1.0,
    materials: Mapping[str, SurfaceMaterial] | None = None,
    source: Path = Path("scene"),
) -> Model:
    """Make a model of a dictionary as `mi.load_dict` takes it; parameters are those of `read`.

    Parameters
    ----------
    source : Path
        Name for messages; files of meshes lie beside it.
    """
    return _model(dictionary.scene_of(scene, source), unit, materials or {})


def _model(scene: SceneEntries, unit: float, materials: Mapping[str, SurfaceMaterial]) -> Model:
    notes, left = Notes(), MOST_QUADS
    parts: dict[str, list[tuple[np.ndarray, str]]] = {}
    made: dict[str, SurfaceMaterial] = {}
    bsdfs: dict[str, SceneEntry | None] = {}
    for i, entry in enumerate(scene.entries):
        if entry.kind == "emitter":
            notes.add(NO_SOURCES)
        if entry.kind not in ("shape", "") or (entry.kind == "" and not _is_shape(entry)):
            continue
        quads = quads_of(entry, notes)
        left -= len(quads)
        if left < 0:
            got = f"more than {MOST_QUADS} surfaces"
            raise entry.error("shape", got, "leave out what no daylight meets")
        bsdf = _bsdf(entry, scene, notes)
        name = _name(entry, bsdf, i)
        if bsdfs.setdefault(name, bsdf) is not bsdf:
            raise entry.error("id", f"{name!r:.60}, also the id of another", "give it its own")
        if name not in made:
            made[name] = materials[name] if name in materials else _material(bsdf, scene, notes)
        if len(quads):
            parts.setdefault(name, []).append((quads, f"{scene.source.name}: {entry.id or name}"))
    if not parts:
        raise InputError(scene.source, "scene", "it holds no shape", "give shapes")
    layers = tuple(_layer(name, made[name], own, unit) for name, own in parts.items())
    return Model(layers=layers, notes=notes.sentences())


def _is_shape(entry: SceneEntry) -> bool:
    """Whether an entry of a dictionary is a shape, known or not."""
    return entry.type in SHAPES or ("to_world" in entry.values and "bsdf" in entry.children)


def _bsdf(entry: SceneEntry, scene: SceneEntries, notes: Notes) -> SceneEntry | None:
    """BSDF of a shape; None without any."""
    every = [scene.resolved(child) for child in entry.children.values()]
    if any(child.kind == "emitter" or child.type == "area" for child in every):
        notes.add(NO_SOURCES)
    bsdfs = [e for e in every if e.kind == "bsdf" or (e.kind == "" and _is_bsdf(e))]
    if len(bsdfs) > 1:
        raise entry.error("bsdf", f"{len(bsdfs)} of them", "give one")
    return bsdfs[0] if bsdfs else None


def _is_bsdf(entry: SceneEntry) -> bool:
    """Whether an entry within a dictionary's shape is a BSDF, known or not."""
    return entry.type in (*BSDFS, *AROUND) or entry.type not in ("area", "rgb", "")


def _name(entry: SceneEntry, bsdf: SceneEntry | None, number: int) -> str:
    """Name of a shape's layer: the id of its BSDF or of itself."""
    own = bsdf.id if bsdf is not None else ""
    if own in ("", "bsdf"):  # the usual key of a nameless BSDF in a dictionary
        own = entry.id
    return own or f"shape {number + 1}"


def _material(bsdf: SceneEntry | None, scene: SceneEntries, notes: Notes) -> SurfaceMaterial:
    if bsdf is None:
        notes.add(GREY)
        return Lambertian(0.5)
    return material_of(innermost(bsdf, scene, notes), notes)


def _layer(
    name: str, material: SurfaceMaterial, parts: list[tuple[np.ndarray, str]], unit: float
) -> Layer:
    """Layer of the shapes of one name, in metres; each shape is one polygon."""
    quads = np.concatenate([quads for quads, _ in parts]) * unit
    polygon = np.repeat(np.arange(len(parts)), [len(quads) for quads, _ in parts])
    places = tuple(place for _, place in parts)
    return Layer(name, material, role_of(material), quads, polygon, places)
