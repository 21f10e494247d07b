"""Component of any shape, read from a file."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.components import MeshComponent
from drcmitsuba.case.unit_check import ask_about_mesh, refuse_far
from drcmitsuba.model.materials import DielectricMaterial
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.components.placed_component import PlacedComponent
from drcmitsuba.scene.coplanar import refuse_in_walls
from drcmitsuba.scene.geometry import Port, Surface, around, box, normals, turn
from drcmitsuba.scene.structures.mesh import read_mesh
from drcmitsuba.scene.structures.solid import check_solid, is_closed, volume

AIR = 1e-3
"""Distance of automatic ports from the mesh that they surround [m]."""


def _shape(component: MeshComponent) -> tuple[np.ndarray, np.ndarray, bool]:
    """Vertices and faces of a component's file, and whether the mesh is closed."""
    file = component.file
    return _read(file, file.stat().st_mtime_ns if file.is_file() else 0)


@lru_cache(maxsize=4)
def _read(path: Path, changed: int) -> tuple[np.ndarray, np.ndarray, bool]:
    vertices, faces = read_mesh(path)
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    if area <= np.square(1e-6 * np.ptp(vertices, axis=0).max()):
        raise InputError(path, "mesh", "its triangles have no area", "give a mesh with faces")
    vertices.flags.writeable = faces.flags.writeable = False
    return vertices, faces, is_closed(vertices, faces)


def is_solid(component: MeshComponent) -> bool:
    """Whether a mesh is closed."""
    return _shape(component)[2]


def triangles(component: MeshComponent) -> np.ndarray:
    """Triangles (triangle, 3, 3) of a placed mesh, in the room's frame [m]."""
    vertices, faces, _ = _shape(component)
    placed = component.scale * vertices @ turn(component.rotation).T + component.position
    return placed[faces]


def mesh(case: Case, name: str, component: MeshComponent) -> PlacedComponent:
    """Place a mesh.

    Raises
    ------
    InputError
        The file is unfit, a clear solid is not closed or inside out, or a port is no rectangle or
        turns its back on the mesh.
    """
    corners = triangles(component)
    material = case.materials[component.material]
    points = corners.reshape(-1, 3)
    faces = np.arange(len(points)).reshape(-1, 3)
    refuse_far(case.source, f"components.{name}.position", points, around(case))
    if case.unit is None:
        where = f"components.{name}.scale"
        ask_about_mesh(case.source, where, np.ptp(points, axis=0).tolist(), component.scale)
    if isinstance(material, DielectricMaterial):  # checked as placed: turned and scaled
        check_solid(component.file, points, faces)
    if component.ports:
        quads = np.array(component.ports)
        where = f"components.{name}.ports"
        refuse_far(case.source, where, quads.reshape(-1, 3), around(case))
        _check(case.source, where, quads, points)
    else:
        low, high = points.min(axis=0) - AIR, points.max(axis=0) + AIR
        if case.room is not None:  # a mesh on the floor has no port below it
            size = np.array(case.room.size)
            if (low >= -2 * AIR).all() and (high <= size + 2 * AIR).all():
                low, high = np.maximum(low, 0), np.minimum(high, size)
        quads = np.array(box(low, high - low))[:, [0, 3, 2, 1]]
    closed = is_solid(component)
    if closed and volume(points, faces) < 0:
        corners = corners[:, [0, 2, 1]]  # a mirror is the same on both sides
    refuse_in_walls(case, name, corners, not closed or isinstance(material, DielectricMaterial))
    surface = Surface(name, material, corners[:, [0, 1, 2, 2]], name, closed)
    return PlacedComponent(name, (surface,), tuple(Port(name, q) for q in quads))


def _check(source: str, field: str, quads: np.ndarray, points: np.ndarray) -> None:
    """Refuse ports (port, 4, 3) that are no rectangles, or that lead away from the mesh."""
    for i, q in enumerate(quads):
        u, v = q[1] - q[0], q[3] - q[0]
        size = np.linalg.norm(u) * np.linalg.norm(v)
        flat = np.linalg.norm(q[0] + u + v - q[2]) <= 1e-6 * (1 + abs(q).max())
        if size < 1e-8 or abs(u @ v) > 1e-6 * size or not flat:
            remedy = "give the corners of a rectangle in turn"
            raise InputError(source, f"{field}.{i}", "no rectangle", remedy)
        if ((points - q[0]) @ normals(q[None])[0]).max() <= 0:
            got = "it leads away from the mesh"
            raise InputError(source, f"{field}.{i}", got, "give its corners in the other order")
