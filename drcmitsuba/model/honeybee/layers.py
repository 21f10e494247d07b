"""Layers of an HBJSON model: its polygons in metres, by modifier, role and group."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from drcmitsuba.model.facets import facet_quads, fans
from drcmitsuba.model.honeybee.entries import JsonEntry
from drcmitsuba.model.honeybee.modifiers import Modifiers
from drcmitsuba.model.honeybee.pieces import Piece
from drcmitsuba.model.materials import Lambertian, two_sided
from drcmitsuba.model.model import Layer, LayerState, Role, role_of
from drcmitsuba.model.notes import Notes
from drcmitsuba.model.plane import Plane
from drcmitsuba.model.polygon import FLAT, SAME, area_vector, quads_of

TOLERANCE = 0.01
"""Honeybee's tolerance, for files that state none [m]."""
BEYOND = "Openings that reach beyond their face within the model's tolerance are cut at its edge"


@dataclass(frozen=True)
class Scale:
    """Length of the model's unit, and how far its corners may lie from where they should."""

    metres: float
    tolerance: float
    """[m]."""

    @property
    def gap(self) -> float:
        """Distance within which edges of two objects count as one [m]."""
        return self.tolerance or TOLERANCE


def layers_of(pieces: Iterable[Piece], modifiers: Modifiers, scale: Scale) -> Iterator[Layer]:
    """Layers of polygons, one for each modifier, role, group and turn of states.

    Polygons of the modifier void are openings, and those without area no surface: neither is part
    of a layer.
    """
    sorts: dict[tuple[str, Role, str, tuple[str, ...], str], list[Piece]] = {}
    for piece in pieces:
        states = tuple(state.modifier for state in piece.states)
        sort = (piece.modifier, piece.role, piece.group, states, piece.behind)
        sorts.setdefault(sort, []).append(piece)
    for (name, role, group, states, behind), alike in sorts.items():
        materials = [modifiers.material(each, alike[0].source) for each in (*states, name)]
        if all(material is None for material in materials):
            continue
        quads, polygon = quads_of_pieces(alike, modifiers, scale)
        if not len(quads):
            continue
        material = next(m for m in (materials[-1], *materials) if m is not None)
        if materials[-1] is None:
            modifiers.notes.add(
                "The first state leaves an opening, not the layer's material", group
            )
        if behind:
            back = modifiers.material(behind, alike[0].source)
            if isinstance(material, Lambertian) and isinstance(back, Lambertian):
                material = two_sided(material, back)
            else:
                sentence = "One side of a wall between rooms is not diffuse: both have the material"
                modifiers.notes.add(sentence, name)
                behind = ""
        taken = tuple(
            LayerState(each, made, tuple(_shades(alike, k, modifiers, scale)))
            for k, (each, made) in enumerate(zip(states, materials, strict=False))
        )
        places = tuple(piece.source.place for piece in alike)
        part: Role = "context" if role == "context" else role_of(*materials)
        yield Layer(name, material, part, quads, polygon, places, group, taken, behind=behind)


def _shades(pieces: list[Piece], k: int, modifiers: Modifiers, scale: Scale) -> Iterator[Layer]:
    """Layers of the shades that stand in state k of alike polygons."""
    return layers_of((s for piece in pieces for s in piece.states[k].shades), modifiers, scale)


def quads_of_pieces(
    pieces: list[Piece], modifiers: Modifiers, scale: Scale
) -> tuple[np.ndarray, np.ndarray]:
    """Quads of polygons [m], shape (quad, 4, 3), and the polygon that each is part of."""
    simple: dict[int, list[int]] = {}
    for k, piece in enumerate(pieces):
        simple.setdefault(len(piece.rings[0]) if len(piece.rings) == 1 else 0, []).append(k)
    others = simple.pop(0, [])
    parts, polygons = [], []
    for alike in simple.values():
        corners = np.array([pieces[k].rings[0] for k in alike]) * scale.metres
        if corners.shape[1] < 3:
            others += alike
            continue
        quads, polygon, left = fans(corners)
        parts.append(quads)
        polygons.append(np.array(alike)[polygon])
        others += np.array(alike)[left].tolist()
    for k in others:
        parts.append(_cut(pieces[k], scale, modifiers.notes))
        polygons.append(np.full(len(parts[-1]), k))
    polygon = np.concatenate(polygons)
    empty = np.setdiff1d(np.arange(len(pieces)), polygon)
    if len(empty):
        for k in empty.tolist():
            modifiers.notes.add("Polygons without area are left out", pieces[k].source.place)
    order = np.argsort(polygon, kind="stable")
    return np.concatenate(parts)[order], polygon[order]


def _cut(piece: Piece, scale: Scale, notes: Notes) -> np.ndarray:
    """Quads of one polygon [m], shape (quad, 4, 3); none where it has no area."""
    rings = [ring * scale.metres for ring in piece.rings]
    size = float(np.linalg.norm(area_vector(rings[0])))
    if size <= SAME * float(np.ptp(rings[0], axis=0).max()) ** 2:
        return np.empty((0, 4, 3))
    normal = area_vector(rings[0]) / size
    off = [(ring - rings[0].mean(axis=0)) @ normal for ring in rings]
    if max(np.abs(each).max() for each in off) <= scale.tolerance:
        rings = [ring - np.outer(each, normal) for ring, each in zip(rings, off, strict=True)]
    try:
        return quads_of(rings[0], rings[1:])
    except ValueError as error:
        clipped = _clipped(rings, scale.gap)
        if clipped is not None:
            notes.add(BEYOND, piece.source.place)
            return clipped
        remedy = "correct it; its apertures and doors must lie within it"
        raise piece.source.refuse("geometry", str(error), remedy) from None


def _clipped(rings: list[np.ndarray], tolerance: float) -> np.ndarray | None:
    """Quads of a polygon whose holes reach beyond it by at most a tolerance [m]; None otherwise."""
    plane, extent = Plane.of(rings[0]), float(np.ptp(rings[0], axis=0).max())
    if len(rings) == 1 or plane.distance(np.concatenate(rings)) > FLAT * extent:
        return None
    outline, *holes = (plane.polygon([ring]) for ring in rings)
    if not all(shape.is_valid for shape in (outline, *holes)):
        return None
    within = outline.buffer(tolerance, join_style="mitre")
    if not all(within.covers(hole) for hole in holes):
        return None
    for hole in holes:
        outline = outline - hole
    parts = [quads_of(own[0], own[1:]) for own in plane.rings(outline)]
    return np.concatenate([np.empty((0, 4, 3)), *parts])


def mesh_layer(shade: JsonEntry, modifiers: Modifiers, scale: Scale) -> Layer | None:
    """Layer of a `ShadeMesh`; None where it has no surface."""
    own = shade.inner("properties", "radiance")
    detached = shade.flag("is_detached", default=True)
    family, kind = ("", "context_modifier") if detached else ("shade_set", "exterior_modifier")
    name = modifiers.name(own, None, family, kind)
    material = modifiers.material(name, shade)
    mesh = shade.entry("geometry")
    if mesh is None:
        raise shade.refuse("geometry", "missing", "give it a Mesh3D")
    vertices = mesh.corners("vertices") * scale.metres
    faces = mesh.sequence("faces")
    quads = []
    for corners in (3, 4):
        alike = [face for face in faces if isinstance(face, list) and len(face) == corners]
        index = _indices(mesh, alike, corners, len(vertices))
        quads.append(facet_quads(vertices[index])[0])
        faces = [face for face in faces if not isinstance(face, list) or len(face) != corners]
    if faces:
        raise mesh.refuse("faces", "one without three or four corners", "split it")
    every = np.concatenate(quads)
    if material is None or not len(every):
        return None
    return Layer(name, material, "context", every, np.zeros(len(every), int), (shade.place,))


def _indices(mesh: JsonEntry, faces: list[list[object]], corners: int, vertices: int) -> np.ndarray:
    """Vertices of faces of a mesh, int (face, corner)."""
    try:
        index = np.array(faces) if faces else np.empty((0, corners), int)
    except ValueError:
        index = np.empty(0)
    if index.shape != (len(faces), corners) or index.dtype.kind != "i":
        raise mesh.refuse("faces", "one of no whole numbers", "give indices of vertices")
    if index.size and (index.min() < 0 or index.max() >= vertices):
        raise mesh.refuse("faces", "an index beyond the vertices", "correct it")
    return index


def merged(layers: Iterable[Layer]) -> tuple[Layer, ...]:
    """Layers of which those of one name and role are one, where no group changes them."""
    out: dict[tuple[str, ...], Layer] = {}
    for layer in layers:
        fixed = not layer.group
        key = (*layer.names, layer.role) if fixed else (layer.name, layer.role, str(len(out)))
        first = out.get(key)
        out[key] = layer if first is None else _both(first, layer)
    return tuple(out.values())


def _both(first: Layer, second: Layer) -> Layer:
    """One layer of two."""
    return replace(
        first,
        quads=np.concatenate([first.quads, second.quads]),
        polygon=np.concatenate([first.polygon, second.polygon + len(first.places)]),
        places=first.places + second.places,
    )


def check_groups(model: JsonEntry, layers: Iterable[Layer]) -> None:
    """Raise InputError for groups whose members have different numbers of states."""
    states: dict[str, int] = {}
    for layer in (each for each in layers if each.group):
        count = states.setdefault(layer.group, len(layer.states))
        if count != len(layer.states):
            got = f"members with {count} and {len(layer.states)} states"
            remedy = "give all members of the group as many states"
            raise model.refuse(f"group {layer.group}", got, remedy)
