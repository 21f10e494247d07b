"""Panes of a case by kind, and the largest albedo of the surfaces that light meets."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TypeVar

from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import (
    BsdfMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Lambertian,
)
from drcmitsuba.model.model import Layer
from drcmitsuba.scene.components import PlacedComponent
from drcmitsuba.scene.materials import albedo, max_reflectance, mean_albedo
from drcmitsuba.scene.panes_of_model import panes_of_model
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.sun_visibility import outside

M = TypeVar("M", BsdfMaterial, DiffuserMaterial)


def used(case: Case) -> dict[str, tuple[str, ...]]:
    """Sides that have each material: panes, the hole "open" and states of groups, by name.

    The side of a model's pane is the direction that it faces, such as "south".
    """
    sides_of: dict[str, tuple[str, ...]] = {}
    side: str
    for side, facade in case.facade.items():
        for name in dict.fromkeys(s.material for s in facade.strips if s.material != "wall"):
            sides_of[name] = (*sides_of.get(name, ()), side)
    panes = panes_of_model(case.building)
    for i, side in dict.fromkeys(zip(panes.layer.tolist(), panes.facing, strict=True)):
        name = case.building.layers[i].name
        sides_of[name] = tuple(dict.fromkeys((*sides_of.get(name, ()), side)))
    groups = prepared(case).groups
    names = {id(material): name for name, material in case.materials.items()}
    for group, sides, materials in zip(
        groups.states.names, groups.facings, groups.materials, strict=True
    ):
        taken = [names[id(material)] for material in materials]
        if not materials:  # the states of the model's own group
            layers = [x for x in case.building.layers if x.group == group and x.role == "pane"]
            states = (state for layer in layers for state in layer.states[1:])
            taken = ["open" if state.material is None else state.name for state in states]
        for name in taken:
            sides_of[name] = tuple(dict.fromkeys((*sides_of.get(name, ()), *sides)))
    return sides_of


def of(case: Case, kind: type[M]) -> dict[str, M]:
    """The materials of a kind that the façades or the shade use, by name."""
    materials = ((name, case.materials.get(name)) for name in used(case))
    return {name: m for name, m in materials if isinstance(m, kind)}


def most_reflecting(
    case: Case, components: tuple[PlacedComponent, ...], beyond: bool
) -> tuple[float, str]:
    """Largest albedo [–] of the surfaces that light may meet, and the name of that surface.

    With `beyond`, light that leaves by a pane may come back, and a pane counts with its albedo;
    without it, clear and diffusing panes count with their reflectance.
    """
    reflectances: list[tuple[float, str]] = []
    if case.room is not None:
        for name in ("floor", "ceiling", "walls"):
            reflectances.append((max_reflectance(getattr(case.room, name)), name))
        for side, facade in case.facade.items():
            if facade.frame > 0:
                reflectances.append((max_reflectance(facade.frame_reflectance), f"frames {side}"))
    for layer in case.building.layers:
        for part in (layer, *layer.added):
            if part.role == "surface" or (part.role == "context" and beyond):
                reflectances += _of_sides(part)
    left_out = [] if beyond else outside(case)
    for piece in case.furniture:
        if piece not in left_out:
            reflectances.append((max_reflectance(piece.reflectance), piece.name))
    for name in used(case):
        material = case.materials.get(name)
        if isinstance(material, GlazingMaterial | DiffuserMaterial) and not beyond:
            reflectances.append((max(material.sides), name))
        elif material is not None:
            reflectances.append((albedo(material), name))
    reflectances += [(mean_albedo(s.material), c.name) for c in components for s in c.surfaces]
    return max(reflectances, default=(0.0, "nothing"))


def _of_sides(layer: Layer) -> Iterator[tuple[float, str]]:
    """Yield the albedo [–] of a layer's materials with the name of the side that has it."""
    for material in layer.materials:
        if isinstance(material, Lambertian) and layer.behind:
            yield from zip(map(max_reflectance, material.sides), layer.names, strict=True)
        elif material is not None:
            yield albedo(material), layer.name


def depth(albedo: float, part: float) -> int | None:
    """Number of surfaces after which less than `part` of the light in the room is left.

    After n surfaces at most ρⁿ of the light is left, with ρ the largest albedo; None for ρ ≥ 1, and
    so near to 1 that a path's count of its surfaces, of 32 bit, would not hold n.
    """
    if albedo <= 0:
        return 0
    if albedo >= 1:
        return None
    surfaces = max(1, math.ceil(math.log(part) / math.log(albedo)))
    return surfaces if surfaces < 1 << 31 else None
