"""Surfaces, suns and a small room that tests of transport share."""

import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import DiffuserMaterial, GlazingMaterial, Lambertian
from drcmitsuba.scene import scene as scenes
from drcmitsuba.scene.geometry import Surface
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute

PATCHES = Patches()
SKY = np.where(np.arange(146) > 0, PATCHES.projected_solid_angles, 0)
"""D of a free horizontal sensor [sr]."""
DIRECTIONS = np.array(
    [[0, -0.8, 0.6], [0.48, -0.64, 0.6], [-0.6, -0.48, 0.64], [0, -0.28, 0.96], [0, 0.8, 0.6]]
)
SUNS = Suns(tuple(f"sun_{i}" for i in range(5)), DIRECTIONS)
NO_SUNS = Suns((), np.zeros((0, 3)))
OMEGA = disk_solid_angle(0.5)
UP, DOWN = np.array([[0, 0, 1.0]]), np.array([[0, 0, -1.0]])
ORIGIN = np.zeros((1, 3))

GLASS = {"type": "glazing", "transmittance": 0.65, "reflectance": 0.12}
OPAL = {"type": "diffuser", "transmittance": 0.4, "reflectance": 0.3}
CLOTH = {"type": "diffuser", "transmittance": 0.15, "reflectance": 0.5}
WINDOW = [(0.9, 2.7, "glass")]
OPPOSITE = {"name": "house", "corner": [-1, -4, 0], "size": [4, 1, 4], "reflectance": 0.5}
BENCH = {"name": "bench", "corner": [0.3, 2.2, 0.1], "size": [2.4, 0.6, 0.5], "reflectance": 0.7}


def quad(corner, u, v):
    """Quadrilateral with its front towards u × v."""
    c, u, v = (np.asarray(a, float) for a in (corner, u, v))
    return np.array([c, c + u, c + u + v, c + v])


def surface(material, *quads):
    material = Lambertian(material) if isinstance(material, float) else material
    return Surface("surface", material, np.array(quads))


def glazing(transmittance, **more):
    return GlazingMaterial(type="glazing", transmittance=transmittance, **more)


def diffuser(transmittance, reflectance=0.0):
    return DiffuserMaterial(type="diffuser", transmittance=transmittance, reflectance=reflectance)


def plane(z, material, half=500.0, front=1):
    edges = ([2 * half, 0, 0], [0, 2 * half, 0])[::front]
    return surface(material, quad([-half, -half, z], *edges))


def closed_box(size, material):
    """Box around the origin, fronts inward."""
    h = size / 2
    x, y, z = np.eye(3) * size
    faces = [quad([-h, -h, -h], a, b) for a, b in ((x, y), (y, z), (z, x))]
    return surface(
        material, *faces, *(quad([h, h, h], -b, -a) for a, b in ((x, y), (y, z), (z, x)))
    )


def flat(points, repeat=1):
    return mi.Float(np.tile(np.asarray(points, np.float32), (repeat, 1)).ravel())


def by_replicate(values, replicates):
    values = values.numpy()
    return values.reshape(replicates, -1, values.shape[-1])


def run(things, points, normals, suns=NO_SUNS, **accuracy):
    """Replicates of C (replicate, sensor, bin) by G·D."""
    scene = things if isinstance(things, scenes.Scene) else scenes.build(things)
    chosen = Accuracy(**{"replicates": 24, "cell_size": 0.1, **accuracy})
    return compute(scene, points, normals, suns, chosen)["replicates"].values


def polygon_factor(points, corner):
    """Form factor from a horizontal receiver at `points` up to a polygon, by Lambert's formula."""
    r = corner - points
    r = r / np.linalg.norm(r, axis=-1, keepdims=True)
    following = np.roll(r, -1, axis=-2)
    cross = np.cross(r, following)
    length = np.linalg.norm(cross, axis=-1)
    angle = np.arctan2(length, (r * following).sum(axis=-1))
    return abs((angle * cross[..., 2] / length).sum(axis=-1)) / (2 * np.pi)


def room(
    strips,
    materials=None,
    rotation=0.0,
    furniture=(),
    shading=None,
    frame=0.1,
    frame_reflectance=0.5,
    **reflectances,
):
    """Room of 3 × 4 × 3 m with its façade to the south and six sensors."""
    facade = {
        "segments": 2,
        "frame": frame,
        "frame_reflectance": frame_reflectance,
        "strips": [{"bottom": b, "top": t, "material": m} for b, t, m in strips],
    }
    size = {"size": [3, 4, 3], "rotation": rotation}
    return Case.model_validate(
        {
            "room": size | {"floor": 0.3, "ceiling": 0.8, "walls": 0.6} | reflectances,
            "facade": {"south": facade},
            "materials": materials or {},
            "furniture": furniture,
            "shading": shading,
            "sensors": {"corner": [0.5, 0.5, 0.8], "count": [2, 3], "spacing": 1.0},
        }
    )
