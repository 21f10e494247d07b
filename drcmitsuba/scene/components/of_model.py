"""Mirrors and clear solids of a model, as components: photons follow the light that they deviate.

Light reaches a layer of few faces by these, and one of many by the faces of its bounding box. Light
that passes a port and meets no mirror there is counted by shadow rays as any other.
"""

from __future__ import annotations

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import DielectricMaterial, Lambertian
from drcmitsuba.model.model import count_planes
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import shortened
from drcmitsuba.scene.components.placed_component import PlacedComponent, ray_offset
from drcmitsuba.scene.geometry import Port, Surface, box, origin, reversed_quads

MOST_FACES = 32
"""Largest number of faces that are ports themselves."""
OPEN = 1e-3
"""Area by which the faces of a body may look one way rather than the other, over that of all."""


def of_model(case: Case) -> tuple[PlacedComponent, ...]:
    """Layers of a case's model that deviate light, relative to the case's `geometry.origin`."""
    start = origin(case)
    placed = []
    for layer in case.building.layers:
        material = layer.deviating
        is_left_out = layer.role == "context" and case.effects.obstructions == "off"
        if material is not None and not (is_left_out and isinstance(layer.material, Lambertian)):
            quads = layer.quads - start
            if isinstance(material, DielectricMaterial):
                _refuse_open(case.source, layer.name, quads)
            ports = _ports(quads, isinstance(material, DielectricMaterial))
            surface = Surface(layer.name, material, quads, layer.name)
            placed.append(
                PlacedComponent(layer.name, (surface,), tuple(Port(layer.name, q) for q in ports))
            )
    return tuple(placed)


def _refuse_open(source: str, name: str, quads: np.ndarray) -> None:
    """Refuse clear solids that are flat, or closed and look inward.

    Faces of other materials may close a body that is open by itself.
    """
    u, v = quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1]
    area = np.cross(u, v) / 2
    got, remedy = "", ""
    is_open = np.linalg.norm(area.sum(axis=0)) > OPEN * np.linalg.norm(area, axis=1).sum()
    if is_open and count_planes(quads) == 1:
        got = "a flat sheet of a clear solid"
        remedy = "close its surface, or take glass for a pane"
    elif not is_open and (area * (quads.mean(axis=1) - quads.mean(axis=(0, 1)))).sum() < 0:
        got, remedy = "a clear solid whose faces look inward", "turn its polygons"
    if got:
        raise InputError(source, f"model: {shortened(name)}", got, remedy)


def _ports(quads: np.ndarray, is_solid: bool) -> np.ndarray:
    """Ports (port, 4, 3) of faces, fronts the way the light goes; solids face it outward."""
    if len(quads) <= MOST_FACES:
        inward = reversed_quads(quads)
        return inward if is_solid else np.concatenate([inward, quads])
    # Rays that start on the box would skip faces that are nearer than the offset.
    air = 4 * ray_offset(quads)
    low, high = quads.min(axis=(0, 1)) - air, quads.max(axis=(0, 1)) + air
    return np.array(box(low, high - low))[:, [0, 3, 2, 1]]
