"""Photons against exact answers, and with every other kind of light against plain path tracing."""

from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba import backend
from drcmitsuba import scene as scenes
from drcmitsuba.accuracy import Accuracy
from drcmitsuba.case import Case, MirrorMaterial
from drcmitsuba.coefficients import compute
from drcmitsuba.scene import Port, Surface
from drcmitsuba.suns import Suns

FILM = Path(__file__).resolve().parents[2] / "scenes" / "films" / "prism.xml"
X, Y, Z = np.eye(3)
DIRECTIONS = np.array([[0, -0.8, 0.6], [0.48, -0.64, 0.6], [0, -0.28, 0.96], [0, 0.8, 0.6]])
WIDE = Suns(tuple(f"sun_{i}" for i in range(4)), DIRECTIONS, 8.0)
"""Suns that a path tracer without emitter sampling finds."""


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else None)


def quad(corner, u, v):
    """Quadrilateral with its front towards u × v."""
    c, u, v = (np.asarray(a, float) for a in (corner, u, v))
    return np.array([c, c + u, c + u + v, c + v])


def box(low, high, fronts=1):
    """Six faces, fronts outward, or inward with −1."""
    low, (x, y, z) = np.asarray(low, float), np.diag(np.subtract(high, low))
    faces = [quad(low, y, x), quad(low, x, z), quad(low, z, y)]
    faces += [quad(low + z, x, y), quad(low + y, z, x), quad(low + x, y, z)]
    return np.array(faces)[:, ::fronts]


def mirror(reflectance, **more):
    return MirrorMaterial(type="mirror", reflectance=reflectance, **more)


def box_ports(name, low, high):
    """Ports on all sides of a box, 1 mm off."""
    low, high = np.subtract(low, 1e-3), np.add(high, 1e-3)
    return tuple(Port(name, face) for face in box(low, high, -1))


ROOM = {
    "room": {"size": [4.0, 4.0, 3.0], "floor": 0.3, "walls": 0.5, "ceiling": 0.7},
    "facade": {
        "south": {
            "segments": 4,
            "strips": [
                {"bottom": 0.9, "top": 1.5, "material": "glass"},
                {"bottom": 1.6, "top": 2.1, "material": "film"},
                {"bottom": 2.3, "top": 2.8, "material": "open", "segments": [1]},
            ],
        }
    },
    "materials": {
        "glass": {"type": "glazing", "transmittance": 0.7, "reflectance": 0.1},
        "film": {"type": "bsdf", "file": str(FILM)},
    },
    "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 3], "spacing": 1.0},
}


def mirror_duct():
    """A mirror tube of 1.2 m behind the hole in the façade."""
    low, high = [1.0, 0.0, 2.3], [2.0, 1.2, 2.8]
    x, y, z = np.diag(np.subtract(high, low))
    faces = [
        quad(low, x, y), quad(low + z, x, y), quad(low, y, z), quad(low + x, y, z),
    ]  # fmt: skip
    return Surface("duct", mirror(0.9), np.array(faces), "duct"), box_ports("duct", low, high)


def test_glass_film_and_mirror_duct_are_counted_once(same, plain_coefficients):
    case = Case.model_validate(ROOM)
    duct, ports = mirror_duct()
    scene = scenes.build([*scenes.surfaces(case), duct], ports=ports)
    points, normals = scenes.sensor_points(case)
    accuracy = Accuracy(
        replicates=16, paths=512, cell_size=0.15, sensor_sky_rays=4096, photons=1 << 13,
        sensor_square=0.1, sensor_sun_samples=64, pane_points=128,
    )  # fmt: skip
    here = compute(scene, points, normals, WIDE, accuracy)
    world = {f"s{i}": shape for i, shape in enumerate(scene.full.shapes())}
    world["sky"] = {"type": "tregenza_sky"}
    directions = mi.TensorXf(DIRECTIONS.astype(np.float32))
    world["suns"] = {"type": "sun_disks", "directions": directions, "diameter": WIDE.diameter}
    there = plain_coefficients(
        mi.load_dict({"type": "scene", **world}, optimize=False), points, normals, spp=1 << 14
    ).sum(axis=0)
    C = here["replicates"].values
    same(C[..., :146], other=there[..., :146], within=0.01)
    same(C[..., 146:], other=there[..., 146:], within=0.02)
