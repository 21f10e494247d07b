"""HBJSON files of Honeybee, read by their schema."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from drcmitsuba.model.honeybee.entries import JsonEntry, by_identifier, read_entry
from drcmitsuba.model.honeybee.layers import Scale, check_groups, layers_of, merged, mesh_layer
from drcmitsuba.model.honeybee.modifiers import modifiers_of
from drcmitsuba.model.honeybee.pieces import rings_of, walk_of
from drcmitsuba.model.honeybee.points_and_views import grids_of, views_of
from drcmitsuba.model.honeybee.spaces import spaces_of
from drcmitsuba.model.model import Model

MAJOR = 1
"""Newest major version of the schema that is known."""
SMALLEST, LEAST = 0.1, 1.0
"""Rooms that the stated unit makes smaller than the first are in metres, where these make them
larger than the second [m]."""
METRES = {"Meters": 1.0, "Millimeters": 1e-3, "Centimeters": 1e-2, "Feet": 0.3048, "Inches": 0.0254}
"""Length of each unit [m]."""


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
        Files of BSDF modifiers by their identifiers, in place of those in the model, which are
        unpacked to a temporary folder of this process.

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
    modifiers = modifiers_of(model, bsdf or {})
    metres, extent = METRES[unit], _extent(model)
    if extent * metres < SMALLEST and extent >= LEAST:
        got = f"units: {unit} would make the rooms {1000 * extent * metres:.3g} mm long"
        modifiers.notes.add(f"{got}: metres are taken")
        metres = 1.0
    scale = Scale(metres, max(0.0, model.number("tolerance", 0.0)) * metres)
    walk = walk_of(model, modifiers, scale.gap / scale.metres)
    layers = list(layers_of(walk.pieces(), modifiers, scale))
    for shade in by_identifier(model.entries("shade_meshes")).values():
        layer = mesh_layer(shade, modifiers, scale)
        layers += [layer] if layer else []
    check_groups(model, layers)
    radiance = model.inner("properties", "radiance")
    return Model(
        layers=merged(layers),
        grids=grids_of(radiance.entries("sensor_grids"), scale.metres),
        views=views_of(radiance.entries("views"), scale.metres, modifiers.notes),
        north=model.number("north_angle", 0.0),
        spaces=spaces_of(model.entries("rooms"), scale.metres, modifiers.notes),
        notes=modifiers.notes.sentences(),
    )


def _extent(model: JsonEntry) -> float:
    """Largest extent of the faces of a model's rooms, in the units of the file; 0 without any."""
    faces = [face for room in model.entries("rooms") for face in room.entries("faces")]
    corners = [rings_of(face)[0] for face in faces]
    return float(np.ptp(np.concatenate(corners), axis=0).max()) if corners else 0.0


def _check(model: JsonEntry) -> None:
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
