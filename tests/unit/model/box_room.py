"""A room of 4 m × 6 m × 3 m with a window of 2 m × 1 m, as every reader of models gets it."""

import json
from copy import deepcopy

import numpy as np

from drcmitsuba.model.materials import GlazingMaterial, Lambertian
from drcmitsuba.model.polygon import area_vector

PANE = GlazingMaterial(type="glazing", transmittance=0.6)
MATERIALS = {
    "wall": Lambertian(0.5),
    "floor": Lambertian(0.2),
    "ceiling": Lambertian(0.8),
    "pane": PANE,
}
CORNERS = np.array([[x, y, z] for z in (0.0, 3.0) for y in (0.0, 6.0) for x in (0.0, 4.0)])
FACES = {
    "Bottom": ("Floor", [0, 2, 3, 1]),
    "South": ("Wall", [0, 1, 5, 4]),
    "East": ("Wall", [1, 3, 7, 5]),
    "North": ("Wall", [3, 2, 6, 7]),
    "West": ("Wall", [2, 0, 4, 6]),
    "Top": ("RoofCeiling", [4, 5, 7, 6]),
}
"""Type and corners of each face, counter-clockwise from outside."""
WINDOW = np.array([[1.0, 0, 1], [3, 0, 1], [3, 0, 2], [1, 0, 2]])
L_SHAPE = np.array([[0, 0, 1], [3, 0, 1], [3, 1, 1], [1, 1, 1], [1, 2, 1], [0, 2, 1]], float)
OUTDOORS = {"type": "Outdoors"}


def geometry(corners, holes=()):
    face = {"type": "Face3D", "boundary": np.asarray(corners).tolist()}
    return face | ({"holes": [np.asarray(hole).tolist() for hole in holes]} if holes else {})


def element(kind, name, corners, modifier=None, **fields):
    """Face, aperture, door or shade."""
    own = {} if modifier is None else {"modifier": modifier}
    properties = {"radiance": own | fields.pop("radiance", {})}
    return {
        "type": kind,
        "identifier": name,
        "geometry": geometry(corners),
        "boundary_condition": OUTDOORS,
        "properties": properties,
    } | fields


def room(name="Room", shift=0.0, **fields):
    """Room whose south wall has the window; moved along x [m]."""
    move = np.array([shift, 0, 0])
    faces = [
        element("Face", f"{name}_{key}", CORNERS[index] + move, face_type=kind)
        for key, (kind, index) in FACES.items()
    ]
    faces[1]["apertures"] = [element("Aperture", f"{name}_Window", WINDOW + move)]
    return {"type": "Room", "identifier": name, "faces": faces, "properties": {}} | fields


def plastic(name, *colour, **fields):
    channels = dict(zip(("r_reflectance", "g_reflectance", "b_reflectance"), colour, strict=True))
    return {"type": "Plastic", "identifier": name} | channels | fields


def model(*rooms, radiance=None, **fields):
    properties = {"type": "ModelProperties"} | ({"radiance": radiance} if radiance else {})
    base = {"type": "Model", "identifier": "Box", "units": "Meters", "version": "1.53.4"}
    return base | {"properties": properties, "rooms": deepcopy(list(rooms))} | fields


def written(folder, value, name="box.hbjson"):
    path = folder / name
    path.write_text(json.dumps(value))
    return path


OBJ = [
    ("floor", [0, 2, 3, 1]),
    ("wall", [1, 3, 7, 5]),
    ("wall", [3, 2, 6, 7]),
    ("wall", [2, 0, 4, 6]),
    ("ceiling", [4, 5, 7, 6]),
    # the south wall around its window
    ("wall", [0, 1, 9, 8]),
    ("wall", [1, 5, 10, 9]),
    ("wall", [5, 4, 11, 10]),
    ("wall", [4, 0, 8, 11]),
    ("pane", [8, 9, 10, 11]),
]
"""Material and corners of the faces of a mesh."""
VERTICES = np.concatenate([CORNERS, WINDOW])


def obj_text(unit=1.0):
    """Box as OBJ, with so many metres a unit."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in (VERTICES / unit).tolist()]
    for name, index in OBJ:
        lines += [f"usemtl {name}", "f " + " ".join(str(k + 1) for k in index)]
    return "\n".join(lines) + "\n"


def area_of(layers):
    """Sum of normal times area of each material and role [m²]."""
    areas = {}
    for layer in layers:
        key = layer.name, layer.role
        vectors = np.array([area_vector(quad) for quad in layer.quads])
        areas[key] = areas.get(key, 0) + np.linalg.norm(vectors, axis=1).sum()
    return areas


def layer_of(model, name):
    (layer,) = (layer for layer in model.layers if layer.name == name)
    return layer
