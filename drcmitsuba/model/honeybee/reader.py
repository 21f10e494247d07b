"""HBJSON files of Honeybee, read by their schema."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from drcmitsuba.model.honeybee.entries import Entry, by_identifier, read_entry
from drcmitsuba.model.honeybee.layers import Scale, check_groups, layers_of, merged, mesh_layer
from drcmitsuba.model.honeybee.modifiers import modifiers_of
from drcmitsuba.model.honeybee.pieces import walk_of
from drcmitsuba.model.model import Grid, Model, View
from drcmitsuba.model.notes import Notes

MAJOR = 1
"""Newest major version of the schema that is known."""
METRES = {"Meters": 1.0, "Millimeters": 1e-3, "Centimeters": 1e-2, "Feet": 0.3048, "Inches": 0.0254}
"""Length of each unit [m]."""
KINDS = "vhlcas"
"""Types of views, as of `-vt` of Radiance."""
SHIFTS = ("shift", "lift", "fore_clip", "aft_clip")
"""Fields of views that are left out."""


def read(file: Path, *, bsdf: Mapping[str, Path] | None = None) -> Model:
    """Read a Honeybee model.

    Faces have their apertures and doors cut out. Faces, apertures, doors and indoor shades are
    panes where their modifier lets light through; other shades are context. Air boundaries and
    void modifiers are openings. A pane or door between two rooms stands twice in the file and once
    in the model: the one whose identifier comes first. A wall or a slab between two rooms is one
    sheet whose sides have the modifiers of their rooms; where only one of two touching faces
    reaches, it stands alone. Objects without a modifier take
    that of their room's modifier set, then of the model's, then of Honeybee's default set.

    Parameters
    ----------
    file : Path
        HBJSON file.
    bsdf : Mapping[str, Path], optional
        Files of BSDF modifiers by their identifiers; `bsdf_xml` gives their content.

    Returns
    -------
    Model
        The model in metres.

    Raises
    ------
    InputError
        The file is larger than 2 GB, its values need more than 1 GiB, it is no Honeybee model of
        a known version, or an object in it is not as the schema has it.
    """
    model = read_entry(Path(file))
    _check(model)
    unit = model.text("units") or "Meters"
    if unit not in METRES:
        raise model.refuse("units", unit, f"choose one of {', '.join(METRES)}")
    scale = Scale(METRES[unit], max(0.0, model.number("tolerance", 0.0)) * METRES[unit])
    modifiers = modifiers_of(model, bsdf or {})
    walk = walk_of(model, modifiers, scale.gap / scale.metres)
    layers = list(layers_of(walk.pieces(), modifiers, scale))
    for shade in by_identifier(model.entries("shade_meshes")).values():
        layer = mesh_layer(shade, modifiers, scale)
        layers += [layer] if layer else []
    check_groups(model, layers)
    radiance = model.inner("properties", "radiance")
    grids = by_identifier(radiance.entries("sensor_grids")).values()
    views = by_identifier(radiance.entries("views")).values()
    return Model(
        layers=merged(layers),
        grids=tuple(_grid(grid, scale.metres) for grid in grids),
        views=tuple(_view(view, scale.metres, modifiers.notes) for view in views),
        north=model.number("north_angle", 0.0),
        notes=modifiers.notes.sentences(),
    )


def _check(model: Entry) -> None:
    """Raise InputError for what is no Honeybee model of a known version."""
    kind, version = model.fields.get("type"), model.text("version") or f"{MAJOR}"
    if kind != "Model":
        raise model.refuse("type", str(kind), "give a Honeybee model, whose type is Model")
    major = version.partition(".")[0]
    if not (major.isascii() and major.isdigit()) or len(major) > 9:
        raise model.refuse("version", version, "give a version such as 1.53.4")
    if int(major) > MAJOR:
        remedy = f"export it for version {MAJOR} of the schema"
        raise model.refuse("version", f"{version}, newer than {MAJOR}", remedy)


def _grid(grid: Entry, metres: float) -> Grid:
    """Sensors of a `SensorGrid`."""
    sensors = grid.sequence("sensors")
    if not all(isinstance(s, dict) and "pos" in s and "dir" in s for s in sensors):
        raise grid.refuse("sensors", "one without pos and dir", "give every sensor both")
    if not sensors:
        return Grid(grid.identifier(), np.empty((0, 3)), np.empty((0, 3)))
    points = grid.corners("sensors", [s["pos"] for s in sensors])
    directions = grid.corners("sensors", [s["dir"] for s in sensors])
    length = np.linalg.norm(directions, axis=1, keepdims=True)
    if (length < 1e-12).any():
        raise grid.refuse("sensors", "a direction without length", "correct it")
    return Grid(grid.identifier(), points * metres, directions / length)


def _view(view: Entry, metres: float, notes: Notes) -> View:
    """View of the model."""
    kind = view.text("view_type") or "v"
    if len(kind) != 1 or kind not in KINDS:
        raise view.refuse("view_type", kind, f"choose one of {', '.join(KINDS)}")
    if any(view.number(key, 0.0) != 0 for key in SHIFTS):
        notes.add("Shift, lift and clipping of views are left out", view.place)
    position, direction, up = (
        view.vector(key).tolist() for key in ("position", "direction", "up_vector")
    )
    sizes = np.array([view.number("h_size", 60.0), view.number("v_size", 60.0)])
    angles = sizes * metres if kind == "l" else sizes
    at = [metres * each for each in position]
    return View(
        view.identifier(), kind, _triple(at), _triple(direction), _triple(up), _pair(angles)
    )


def _triple(values: list[float]) -> tuple[float, float, float]:
    x, y, z = values
    return x, y, z


def _pair(values: np.ndarray) -> tuple[float, float]:
    x, y = values.tolist()
    return x, y
