"""Kinds of surfaces whose reflectance is a design parameter, and marks of rays that end on them.

Kinds are floor, ceiling and walls in a room of boxes, the diffuse materials of a model by name, and
furniture by name in both.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import State
from drcmitsuba.model.materials import Lambertian, two_sided
from drcmitsuba.model.model import Layer
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat_indices
from drcmitsuba.runtime.toml import choose, shortened
from drcmitsuba.scene import scene
from drcmitsuba.scene.geometry import Surface, clockwise
from drcmitsuba.scene.materials import bsdf, channel_of
from drcmitsuba.scene.mitsuba_scenes import mitsuba_scene
from drcmitsuba.scene.scene import Scene
from drcmitsuba.scene.surfaces import surfaces_of

MOST_KINDS = 100
"""Largest number of kinds of surfaces, each of which takes a mesh of its own."""
WALLS = tuple(f"wall {side}" for side in ("south", "east", "north", "west"))
FRAMES = tuple(name.replace("wall", "frame") for name in WALLS)
_ROOM = ("floor", "ceiling", "walls")
_TAKEN = {*_ROOM, *WALLS, *FRAMES}


def reflectances(case: Case) -> dict[str, float]:
    """Reflectances of a case by the kind of its surfaces.

    Kinds are floor, ceiling and walls of a room of boxes, the diffuse materials of a model by name,
    and furniture by name. Materials that the states of a model's groups change are left out.

    Raises
    ------
    InputError
        The case is coloured, has more than `MOST_KINDS` kinds of surfaces, or gives one name to
        surfaces of two reflectances.
    """
    table = "room" if case.model is None else "model.reflectances"
    if scene.is_coloured(case):
        got = "a reflectance differs between channels"
        raise InputError(case.source, table, got, "make it grey")
    room, rho = case.room, dict[str, float]()
    for name, value in _of_model(case):
        if rho.setdefault(name, value) != value:
            got = f"{shortened(name)} names surfaces of two reflectances"
            raise InputError(case.source, table, got, "give that name one reflectance")
    if room is not None:
        rho |= {kind: channel_of(getattr(room, kind), 0) for kind in _ROOM}
    for piece in case.furniture:
        value, is_taken = channel_of(piece.reflectance, 0), room is not None
        if (is_taken and piece.name in _TAKEN) or rho.setdefault(piece.name, value) != value:
            got = f"{shortened(piece.name)} names surfaces of two reflectances"
            raise InputError(case.source, "furniture.name", got, "give each its own name")
    if len(rho) > MOST_KINDS:
        got = f"{len(rho)} kinds of surfaces"
        remedy = f"at most {MOST_KINDS}: give surfaces of one reflectance one name"
        raise InputError(case.source, "furniture.name" if room else table, got, remedy)
    return rho


def with_reflectances(case: Case, rho: Mapping[str, float]) -> Case:
    """Case with other reflectances of some kinds of surfaces, checked by `check_reflectances`."""
    check_reflectances(case.source, reflectances(case), rho)
    values = {kind: float(value) for kind, value in rho.items()}
    furniture = tuple(
        piece.model_copy(update={"reflectance": values.get(piece.name, piece.reflectance)})
        for piece in case.furniture
    )
    of_room = {kind: value for kind, value in values.items() if kind in _ROOM}
    room = None if case.room is None else case.room.model_copy(update=of_room)
    changed = case.with_tables(furniture=furniture, room=room)
    own = {name: values[name] for name, _ in _of_model(case) if name in values}
    if case.model is None or not own:
        return changed
    model = case.model.model_copy(update={"reflectances": {**case.model.reflectances, **own}})
    layers = tuple(_painted(layer, own) for layer in case.building.layers)
    return changed.with_tables(model=model).with_building(replace(case.building, layers=layers))


def check_reflectances(
    source: str, known: Mapping[str, float], rho: Mapping[str, float | mi.Float]
) -> None:
    """Raise InputError for an unknown kind of surfaces, and for a value outside 0 … 1."""
    for kind, value in rho.items():
        if kind not in known:
            got = f"no surface {shortened(kind)}"
            raise InputError(source, "reflectance", got, choose(kind, list(known)))
        number = np.ravel(dr.detach(value))
        if number.size != 1 or not 0 <= number[0] <= 1:
            got = f"{shortened(number.tolist())} for {shortened(kind)}"
            raise InputError(source, "reflectance", got, "give one number from 0 to 1")


def _of_model(case: Case) -> Iterator[tuple[str, float]]:
    """Yield name and reflectance of each side of a model's diffuse layers that no group changes."""
    layers, changed = case.building.layers, set[str]()
    for layer in layers:
        if layer.states or layer.stands_in:
            parts = (layer, *layer.added)
            changed |= {name for part in parts for name in part.names}
            changed |= {state.name for state in layer.states}
    for layer in layers:
        if isinstance(layer.material, Lambertian):
            for name, side in zip(_names(layer), layer.material.sides, strict=True):
                if name not in changed:
                    yield name, channel_of(side, 0)


def _painted(layer: Layer, rho: Mapping[str, float]) -> Layer:
    """Layer whose sides have the reflectances of their names."""
    if not isinstance(layer.material, Lambertian) or rho.keys().isdisjoint(layer.names):
        return layer
    sides = zip(_names(layer), layer.material.sides, strict=True)
    front, back = (Lambertian(rho.get(name, side)) for name, side in sides)
    return replace(layer, material=two_sided(front, back))


def _names(sheet: Layer | Surface) -> tuple[str, str]:
    """Names of the materials of front and back."""
    return sheet.name, sheet.behind or sheet.name


class MarkedMesh(NamedTuple):
    """Mesh, and the marks of rays that end on its front and on its back."""

    shape: mi.Shape
    front: int
    back: int


class Kinds:
    """Marks of rays: 1 + the number of the kind of surface that a ray ends on, 0 for all others.

    It is a rule of `gather.paths.Marks` for paths that end at their first diffuse vertex.
    """

    def __init__(self, meshes: Sequence[MarkedMesh]) -> None:
        self.context = mi.BSDFContext()
        number = [int(_number(mi.ShapePtr(mesh.shape))[0]) for mesh in meshes]
        table = np.zeros((2, 1 + max(number, default=0)), np.uint32)
        for i, mesh in zip(number, meshes, strict=True):
            table[:, i] = mesh.front, mesh.back
        self._shapes, self._marks = table.shape[1], flat_indices(table)

    def meet(
        self, si: mi.SurfaceInteraction3f, mark: mi.UInt32, number: mi.Float
    ) -> tuple[mi.BSDFPtr, mi.UInt32, mi.Float, mi.Bool, mi.Bool]:
        """Mark a ray where it meets a surface of a kind; see `gather.paths.Marks.meet`."""
        shapes, shape = dr.opaque(mi.UInt32, self._shapes), _number(si.shape)
        at = shape + dr.select(mi.Frame3f.cos_theta(si.wi) > 0, mi.UInt32(0), shapes)
        known = dr.gather(mi.UInt32, self._marks, at, shape < shapes)
        mark = dr.select(known > 0, known, mark)
        return si.bsdf(), mark, mi.Float(1), mi.Bool(True), mi.Bool(False)


def _number(shape: mi.ShapePtr) -> mi.UInt32:
    """Number of a shape among all that exist, from 1 on; 0 for none."""
    return dr.reinterpret_array(mi.UInt32, shape)


def marked(case: Case, state: State, values: Mapping[str, float]) -> tuple[Scene, Kinds]:
    """Scene with meshes of one kind of surface a side, and the marks of rays that end on them.

    `values` are the reflectances by kind, of all that `reflectances` tells.
    """
    mark = {kind: i for i, kind in enumerate(values, start=1)}
    sheets: dict[tuple[str, str, Lambertian], list[np.ndarray]] = {}
    others = []
    for surface in surfaces_of(case, state):
        sides = _names(surface)
        if case.room is not None and surface.name in WALLS:
            sides = "walls", "walls"
        elif surface.component and surface.name == f"{surface.component} ring":
            sides = "ceiling", "ceiling"  # what is left of it around a round pipe
        if isinstance(surface.material, Lambertian) and not mark.keys().isdisjoint(sides):
            sheets.setdefault((*sides, surface.material), []).append(surface.quads)
        else:
            others.append(surface)
    meshes = [
        MarkedMesh(
            scene.quad_mesh(front, np.concatenate(quads), mi.load_dict(bsdf(material))),
            mark.get(front, 0), mark.get(back, 0),
        )
        for (front, back, material), quads in sheets.items()
    ]  # fmt: skip
    unmarked = scene.build(others, clockwise=clockwise(case)).full.shapes()
    shapes = [*unmarked, *(mesh.shape for mesh in meshes)]
    named = {f"shape{i}": shape for i, shape in enumerate(shapes)}
    full = mitsuba_scene(named)
    return scene.load(case, state).searched(full=full), Kinds(meshes)
