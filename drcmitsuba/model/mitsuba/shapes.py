"""Shapes of Mitsuba as quads. Curved ones are facets."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drcmitsuba.model.mesh.obj import read_obj
from drcmitsuba.model.mesh.part import beside
from drcmitsuba.model.mesh.ply import read_ply
from drcmitsuba.model.mitsuba.entries import SceneEntry
from drcmitsuba.model.notes import Notes
from drcmitsuba.model.radiance import bodies
from drcmitsuba.model.radiance.xform import reversed_front

FACETS = "Curved bodies are facets, and up to 0.4 % smaller in area"
FLAT = "Facets are flat where normals round them"


def _rectangle(entry: SceneEntry, notes: Notes) -> np.ndarray:
    return np.array([[[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]])


def _cube(entry: SceneEntry, notes: Notes) -> np.ndarray:
    top = _rectangle(entry, notes)[0] + [0, 0, 1]
    faces = [np.roll(top, axis, axis=1) for axis in range(3)]
    return np.array([*faces, *(-face[::-1] for face in faces)])


def _disk(entry: SceneEntry, notes: Notes) -> np.ndarray:
    notes.add(FACETS)
    return bodies.ring(np.zeros(3), np.array([0.0, 0, 1]), (0.0, 1.0))


def _sphere(entry: SceneEntry, notes: Notes) -> np.ndarray:
    notes.add(FACETS)
    radius = entry.number("radius", 1)
    if not radius > 0:
        raise entry.error("radius", f"{radius:g}", "give a length above 0")
    return bodies.sphere(entry.point("center", (0.0, 0.0, 0.0)), radius)


def _cylinder(entry: SceneEntry, notes: Notes) -> np.ndarray:
    notes.add(FACETS)
    radius = entry.number("radius", 1)
    ends = entry.point("p0", (0.0, 0.0, 0.0)), entry.point("p1", (0.0, 0.0, 1.0))
    try:
        return bodies.cone(*ends, (radius, radius))
    except ValueError as error:
        raise entry.error("cylinder", str(error), "correct or remove it") from None


def _mesh(entry: SceneEntry, notes: Notes) -> np.ndarray:
    name = entry.text("filename")
    file = beside(entry.source, name)
    if file is None:
        raise entry.error("filename", f"{name:.80}", "put the mesh beside the scene's file")
    read = read_obj if entry.type == "obj" else read_ply
    parts = [part.quads for part in read(file, notes)]
    if not entry.flag("face_normals"):
        notes.add(FLAT)
    return np.concatenate([np.zeros((0, 4, 3)), *parts])


SHAPES: dict[str, Callable[[SceneEntry, Notes], np.ndarray]] = {
    "rectangle": _rectangle,
    "cube": _cube,
    "disk": _disk,
    "sphere": _sphere,
    "cylinder": _cylinder,
    "obj": _mesh,
    "ply": _mesh,
}
"""Shapes that are read, in their own frame."""

CURVED = ("disk", "sphere", "cylinder")


def quads_of(entry: SceneEntry, notes: Notes) -> np.ndarray:
    """Quads (quad, 4, 3) of a shape in the scene's frame, counter-clockwise from the front.

    Raises
    ------
    InputError
        The shape is of another kind, has no area, or its file is unfit.
    """
    if entry.type not in SHAPES:
        remedy = f"only {', '.join(SHAPES)} are read: export it as one of them"
        raise entry.error("type", entry.type, remedy)
    world = entry.transform()
    own = SHAPES[entry.type](entry, notes)
    quads = own @ world[:3, :3].T + world[:3, 3]
    size = np.linalg.norm(np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1]), axis=1)
    if len(quads) and not size.max() > 0:
        raise entry.error("to_world", "no area is left", "give a transform that keeps lengths")
    # A mirroring transform turns the fronts of meshes, not those of curved bodies.
    turns = entry.type in CURVED and np.linalg.det(world[:3, :3]) < 0
    return reversed_front(quads) if turns != entry.flag("flip_normals") else quads
