"""Cases with components, and what their tests look at."""

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.scene.structures.recipe import load_recipe
from drcmitsuba.scene.structures.solid import welded

SIZE = np.array([4.0, 5.0, 3.0])
MATERIALS = {
    "glass": {"type": "glazing", "transmittance": 0.8},
    "opal": {"type": "diffuser", "transmittance": 0.6},
    "shade": {"type": "diffuser", "transmittance": 0.1},
    "silver": {"type": "mirror", "reflectance": 0.95},
    "acrylic": {"type": "dielectric", "ior": 1.49},
}
SLATS = """[structure]
kind = "lamellae"
period = 40
width = 40
tilt = 10
turn = -30
reflectance = 0.9
specular = 1
"""
PRISM = """[structure]
kind = "prism"
n = 1.49
period = 20
polygons = [[[0, 0], [4, 0], [14, 4, 10], [4, 20], [0, 20]]]
"""
PIPE = {"type": "lightpipe", "centre": [2.0, 2.5], "width": 0.5, "height": 1.0, "mirror": "silver"}
DUCT = {
    "type": "duct", "centre": 2.0, "width": 0.8, "height": 0.3, "length": 2.5, "mirror": "silver",
}  # fmt: skip


def surface_of(*parts):
    """Welded triangles of quads (quad, 4, 3)."""
    quads = np.concatenate(parts)
    corners = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return welded(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def area(quads):
    a = np.cross(quads[:, 1] - quads[:, 0], quads[:, 2] - quads[:, 0])
    b = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 0])
    return (np.linalg.norm(a, axis=1) + np.linalg.norm(b, axis=1)).sum() / 2


def case(**changes):
    tables = {
        "room": {"size": list(SIZE)},
        "materials": MATERIALS,
        "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 4], "spacing": 1.0},
    }
    return Case.model_validate(tables | changes)


def with_strip(folder, text, side="south", frame=0.1, strip=(1.0, 2.0), **changes):
    recipe = folder / "recipe.toml"
    recipe.write_text(text, encoding="utf-8")
    table = {"type": "structure", "recipe": str(recipe)}
    strips = [{"bottom": strip[0], "top": strip[1], "material": "panel"}]
    facade = {side: {"segments": 2, "frame": frame, "strips": strips}}
    return case(components={"panel": table | changes}, facade=facade)


def only(placed):
    (one,) = placed
    return one


def part(placed, word):
    return next(s for s in placed.surfaces if s.name.endswith(word))


def recipe(folder, text):
    file = folder / "recipe.toml"
    file.write_text(text, encoding="utf-8")
    return load_recipe(file)


CUBE = """v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
f 4 3 2 1
f 5 6 7 8
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
"""


def with_mesh(folder, text=CUBE, **changes):
    file = folder / "mesh.obj"
    file.write_text(text, encoding="utf-8")
    table = {"type": "mesh", "file": str(file), "material": "acrylic", "position": [1, 2, 1]}
    facade = {"south": {"strips": [{"bottom": 1, "top": 2, "material": "glass"}]}}
    return case(components={"cube": table | changes}, facade=facade)
