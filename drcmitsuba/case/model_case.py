"""A case for a model alone, and the case file that one would edit."""

from __future__ import annotations

import itertools
import json
import os
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from drcmitsuba.case.sensors import (
    AnySensors,
    FloorSensors,
    GridsByRule,
    PointSensors,
    SpaceSensors,
)
from drcmitsuba.model.materials import (
    BsdfMaterial,
    DielectricMaterial,
    DiffuserMaterial,
    Lambertian,
    PorousMaterial,
    SurfaceMaterial,
)
from drcmitsuba.model.model import Layer, Model, View, areas
from drcmitsuba.runtime.errors import InputError, on_a_line

MOST_SPACES = 200
"""Largest number of spaces that a case file lists."""


def tables_of(file: Path) -> dict[str, Any]:
    """Tables of a case that consists of a model's file."""
    model: dict[str, Any] = {"files": [file.name]}
    return {"name": file.stem, "model": model, "sensors": {"grids": ["*"]}}


def usual_sensors(source: str, building: Model) -> AnySensors:
    """Sensors of a model alone: its grids, or grids in its spaces, or above its floors.

    Raises
    ------
    InputError
        The model has no grid, no space, and no material whose name holds "floor".
    """
    if building.grids:
        return PointSensors(grids=("*",))
    if building.spaces:
        return SpaceSensors(spaces=("*",))
    surfaces = (n for layer in building.layers if layer.role == "surface" for n in layer.names)
    floors = tuple(dict.fromkeys(name for name in surfaces if "floor" in name.lower()))
    if not floors:
        got = "no sensor grid, and no material whose name holds 'floor'"
        remedy = "name the floors in a case file: [sensors] floors = [...], [model] files = [...]"
        raise InputError(source, "sensors", got, remedy)
    return FloorSensors(floors=floors)


def notes_on_groups(building: Model, groups: Collection[str]) -> list[str]:
    """Note the groups of a model with several states that the case leaves in the first one."""
    states: dict[str, int] = {}
    for layer in building.layers:
        if layer.group not in groups and len(layer.states) > 1:
            states[layer.group] = max(states.get(layer.group, 0), len(layer.states))
    if not states:
        return []
    names = ", ".join(f"{name} ({count} states)" for name, count in states.items())
    how = "without a table [groups.NAME] or a state of theirs in [model.states]"
    return [f"groups of the model stay in their first state {how}: {names}"]


def words(material: SurfaceMaterial) -> str:
    """Describe a material in a few words."""
    if isinstance(material, Lambertian):
        values = [
            f"{rho:.2f}" if isinstance(rho, float | int) else str([round(v, 3) for v in rho])
            for rho in material.sides
        ]
        return f"diffuse, reflectance {' / '.join(dict.fromkeys(values))}"
    if isinstance(material, BsdfMaterial):
        return f"bsdf {material.file.name}"
    if isinstance(material, DielectricMaterial):
        return f"dielectric, index {material.ior:g}"
    if isinstance(material, PorousMaterial):
        return f"porosity {material.porosity:.2f}, {words(Lambertian(material.reflectance))}"
    through = getattr(material, "scattered", getattr(material, "transmittance", None))
    parts = [] if through is None else [f"transmittance {through:.2f}"]
    parts.append(f"reflectance {material.reflectance:.2f}")
    if isinstance(material, DiffuserMaterial) and material.most_straight > 0:
        parts.append(f"straight through up to {material.most_straight:.2f}")
    return f"{material.type}, {', '.join(parts)}"


def case_text(file: Path, folder: Path, building: Model, sensors: AnySensors) -> str:
    """Text of a case file in a folder for a model's file, with its materials as comments."""
    relative = os.path.relpath(file.absolute(), folder.absolute())
    taken = {name for layer in building.layers for name in layer.names}
    numbered = (f"sun_shade_{i}" for i in itertools.count(2))
    shade = next(n for n in itertools.chain(("shade", "sun_shade"), numbered) if n not in taken)
    lines = [
        f"# A case for {_comment(file.name)}.",
        "# Every key, its unit and its limits: drcmitsuba schema",
        f"name = {_text(file.stem)}",
        "",
        "[weather]",
        '# file = "my_town.epw"               # EPW, TMY3, TMY2 or WEA beside this file',
        "",
        "[period]",
        'calendar = "EvalDRC"                 # Monday to Friday, 8 to 18 h; "LM-83": every day',
        "",
        "[model]",
        f"files = [{_text(relative)}]",
        f"# north = {building.north:g}    # of the model, clockwise from its y axis [deg]",
        "# context = []                       # materials of buildings, trees and terrain outside",
        "# reflectances = { wall = 0.5 }      # in place of the model's",
        '# states = { tree = "winter" }       # in which a group of the model stays',
        "# Materials of the model; a table [materials.NAME] replaces the one of that name:",
        *(f"#   {_comment(line)}" for line in listing(building)),
        "",
        "[sensors]",
        *_sensors(sensors),
        "",
        *_spaces(building),
        f"# {f'[materials.{shade}]':<35}# fabric of the sun shade",
        '# type = "diffuser"',
        "# transmittance = 0.05",
        "# [shading]                          # closed, it stands in place of the clear panes",
        f'# material = "{shade}"',
        *(['# groups = "spaces"                  # each by its own sun'] * bool(building.spaces)),
    ]
    return "\n".join(lines) + "\n"


def _states(layer: Layer) -> str:
    """Group of a layer and its states."""
    names = ", ".join(state.name for state in layer.states)
    return f"  group {layer.group}: {names}" if layer.group else ""


def listing(model: Model) -> list[str]:
    """One line for every layer of a model: name, role, area [m²], material, group."""
    names = [" / ".join(layer.names) for layer in model.layers]
    width = min(max(map(len, names)), 40)
    return [
        f"{name:{width}}  {layer.role:8} {areas(layer.quads).sum():9.2f} m²  "
        f"{words(layer.material)}{_states(layer)}"
        for name, layer in zip(names, model.layers, strict=True)
    ]


KINDS = {
    "v": "perspective", "l": "parallel", "h": "hemispherical", "a": "angular",
    "s": "planispherical", "c": "cylindrical", "e": "equisolid",
}  # fmt: skip
"""Words for the projections of views, by their letter in Radiance's `-vt`."""


def views_listing(views: Sequence[View]) -> list[str]:
    """One line for every view: name, projection, position [m], direction, angles."""
    lines = []
    for view in views:
        unit = " m" if view.kind == "l" else "°"
        wide, high = view.angles
        at, along = (", ".join(f"{v:.4g}" for v in x) for x in (view.position, view.direction))
        lines.append(
            f"view {on_a_line(view.name)}: {KINDS[view.kind]}, {wide:g}{unit} × {high:g}{unit}, "
            f"from ({at}) along ({along})"
        )
    return lines


def _spaces(building: Model) -> list[str]:
    """Comments on the spaces: name, use, storey, floor area [m²], target [lx] and hours."""
    if not building.spaces:
        return []
    lines = ["# Spaces of the model; [spaces.NAME] takes use, storey, threshold, hours, power:"]
    for space in building.spaces[:MOST_SPACES]:
        told = [space.name, space.use, space.storey, f"{space.floor_area:.1f} m²"]
        told += [] if space.target is None else [f"{space.target:g} lx"]
        told += [] if space.hours is None else [f"{space.hours[0]} to {space.hours[1]} h"]
        lines.append(f"#   {_comment(', '.join(filter(None, told)))}")
    more = len(building.spaces) - MOST_SPACES
    return [*lines, *([f"#   and {more} more"] if more > 0 else []), ""]


def _sensors(sensors: AnySensors) -> list[str]:
    if not isinstance(sensors, GridsByRule):
        return ['grids = ["*"]                        # the grids of the model']
    margin = json.dumps(sensors.margin)
    where = sensors.floors if isinstance(sensors, FloorSensors) else ("*",)
    key = "floors" if isinstance(sensors, FloorSensors) else "spaces"
    return [
        f"{key} = [{', '.join(map(_text, where))}]",
        f"height = {sensors.height:g}                         # above the floor",
        f"spacing = {sensors.spacing:g}",
        f"margin = {margin}                         # without points, along the walls",
    ]


def _text(text: str) -> str:
    """Write a text as TOML, whose basic strings are those of JSON."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _comment(text: str) -> str:
    """Text that cannot end a comment."""
    return "".join(c if c.isprintable() else "?" for c in text)
