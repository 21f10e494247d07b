"""Sensor grids and views of an HBJSON model, by the names that Honeybee gives them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drcmitsuba.model.honeybee.entries import JsonEntry
from drcmitsuba.model.model import SensorGrid, View, numbered_views
from drcmitsuba.model.notes import Notes

KINDS = "vhlcas"
"""Types of views, as of `-vt` of Radiance."""
SHIFTS = ("shift", "lift", "fore_clip", "aft_clip")
"""Fields of views that are left out."""


def grids_of(entries: Sequence[JsonEntry], metres: float) -> tuple[SensorGrid, ...]:
    """Grids of some `SensorGrid`, whose coordinates have a unit of so many metres.

    Grids of one identifier are joined, but for those whose `group_identifier` differs: their names
    are then GROUP/IDENTIFIER.
    """
    grids: dict[str, list[SensorGrid]] = {}
    for entry, name in zip(entries, _names(entries), strict=True):
        grids.setdefault(name, []).append(replace(_grid(entry, metres), name=name))
    return tuple(
        SensorGrid(
            name,
            np.concatenate([grid.points for grid in alike]),
            np.concatenate([grid.normals for grid in alike]),
        )
        for name, alike in grids.items()
    )


def views_of(entries: Sequence[JsonEntry], metres: float, notes: Notes) -> tuple[View, ...]:
    """Views of the model, named as its grids; others of one name are numbered."""
    names = zip(entries, _names(entries), strict=True)
    return numbered_views(replace(_view(entry, metres, notes), name=name) for entry, name in names)


def _names(entries: Sequence[JsonEntry]) -> list[str]:
    """Identifiers, with their groups where one identifier stands in several groups."""
    groups: dict[str, set[str]] = {}
    for entry in entries:
        groups.setdefault(entry.identifier(), set()).add(entry.text("group_identifier") or "")
    names = []
    for entry in entries:
        name, group = entry.identifier(), entry.text("group_identifier") or ""
        names.append(f"{group}/{name}" if group and len(groups[name]) > 1 else name)
    return names


def _grid(grid: JsonEntry, metres: float) -> SensorGrid:
    """Sensors of a `SensorGrid`."""
    sensors = grid.sequence("sensors")
    if not all(isinstance(s, dict) and "pos" in s and "dir" in s for s in sensors):
        raise grid.refuse("sensors", "one without pos and dir", "give every sensor both")
    if not sensors:
        return SensorGrid(grid.identifier(), np.empty((0, 3)), np.empty((0, 3)))
    points = grid.corners("sensors", [s["pos"] for s in sensors])
    directions = grid.corners("sensors", [s["dir"] for s in sensors])
    length = np.linalg.norm(directions, axis=1, keepdims=True)
    if (length < 1e-12).any():
        raise grid.refuse("sensors", "a direction without length", "correct it")
    return SensorGrid(grid.identifier(), points * metres, directions / length)


def _view(view: JsonEntry, metres: float, notes: Notes) -> View:
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
