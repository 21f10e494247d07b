"""The scene of sun_and_sky.xml as a dict: `mi.render(mi.load_dict(scene()))`."""

import mitsuba as mi
import numpy as np

import drcmitsuba  # noqa: F401  registers the plugins

SUNS = np.array([[0.3, -0.5, 0.8], [-0.4, -0.3, 0.5]])
"""Directions to the suns: x east, y north, z up, of any length."""


def scene() -> dict:
    """Scene for the variant that is set.

    Returns
    -------
    dict
        Tregenza's sky, two suns and a sun shade above a matt floor.
    """
    place = mi.ScalarTransform4f

    def matt(reflectance: float) -> dict:
        return {"type": "diffuse", "reflectance": {"type": "uniform", "value": reflectance}}

    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 8},
        "sky": {"type": "tregenza_sky", "radiance": 1.0},
        "suns": {
            "type": "sun_disks",
            "directions": mi.TensorXf(SUNS),
            "radiance": mi.TensorXf([60000.0, 20000.0]),
            "diameter": 0.5,
        },
        "floor": {"type": "rectangle", "to_world": place().scale(4), "bsdf": matt(0.4)},
        "box": {
            "type": "cube",
            "to_world": place().translate([-0.6, 0.3, 0.4]).scale(0.4),
            "bsdf": matt(0.7),
        },
        "shade": {
            "type": "rectangle",
            "to_world": place().translate([0.9, 0, 1.2]).scale(0.8),
            "bsdf": {"type": "diffuser", "transmittance": 0.3, "reflectance_front": 0.4},
        },
        "camera": {
            "type": "perspective",
            "fov": 45.0,
            "to_world": place().look_at(origin=[0, -5, 3], target=[0, 0, 0.4], up=[0, 0, 1]),
            "film": {"type": "hdrfilm", "width": 32, "height": 24, "rfilter": {"type": "box"}},
            "sampler": {"type": "independent", "sample_count": 256},
        },
    }
