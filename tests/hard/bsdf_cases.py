"""Rooms behind a film at its limits, and values of its plugin."""

import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins import bsdf_file
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.scene import scene
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute
from tests.unit.plugins.test_measured import (
    IMPORTANCE,
    RADIANCE,
    as_vector,
    interaction,
    xml,
)

MODES = pytest.mark.parametrize("mode", [RADIANCE, IMPORTANCE], ids=["radiance", "importance"])
BINS = len(Patches())
FLOAT = 1e-5
"""Float32 and the 5 to 7 digits of a file's text."""


def load(path, **parameters):
    kind = "klems" if bsdf_file.read(path).kind == "Klems" else "tensor_tree"
    return mi.load_dict({"type": kind, "filename": str(path), **parameters})


def values(bsdf, mode, wi, wo):
    """F·|cos| and density for pairs of directions (n, 3)."""
    value, density = bsdf.eval_pdf(mi.BSDFContext(mode), interaction(wi, len(wi)), as_vector(wo))
    return value[0].numpy(), density.numpy()


ROOM = {
    "room": {"size": [4.0, 5.0, 3.0], "floor": 0.0, "ceiling": 0.0, "walls": 0.0},
    "facade": {"south": {"strips": [{"bottom": 0.2, "top": 2.8, "material": "film"}]}},
    "sensors": {"corner": [1.0, 1.0, 0.6], "count": [2, 2], "spacing": 0.5},
}
TINY = {
    "replicates": 4, "paths": 32, "cell_size": 0.6, "cell_sky_rays": 16, "sensor_sky_rays": 64,
    "pane_points": 64, "film_sky_samples": 64,
}  # fmt: skip
NORTH, UP = np.array([0.0, 1, 0]), np.array([0.0, 0, 1])
PANE = np.stack([np.cross(UP, NORTH), UP, NORTH])
"""Axes of a pane in the south: x to the west, y up, z into the room."""


def room(path, **tables):
    return Case.model_validate(
        ROOM | {"materials": {"film": {"type": "bsdf", "file": str(path)}}} | tables
    )


def coefficients(case, directions, diameter=0.5, **accuracy):
    """Replicates of C by `compute`, shape (replicate, sensor, bin)."""
    points, normals = sensor_points(case)
    suns = Suns(tuple(f"sun_{i}" for i in range(len(directions))), np.array(directions), diameter)
    return compute(scene.load(case), points, normals, suns, Accuracy(**TINY | accuracy))


def towards(altitude, azimuth):
    a, z = np.radians([altitude, azimuth])
    return [np.sin(z) * np.cos(a), np.cos(z) * np.cos(a), np.sin(a)]


SUNS = [towards(50, 180), towards(30, 203)]


def lambertian(path, *, t, r=0.0):
    """File of an evenly scattering pane, the same on both sides."""
    parts = {"tb": t, "tf": t, "rb": r, "rf": r}
    path.write_text(xml("TensorTree4", {n: "{%.9g}" % (v / np.pi) for n, v in parts.items()}))
    return path
