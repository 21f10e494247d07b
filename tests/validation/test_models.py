"""Rooms of any shape, as models give them, against plain path tracing.

Windows lie in several planes, one triangular, one with four slopes; the glass mirrors, a partition
of glass divides the room. Suns are 20° wide, so that plain path tracing finds them in the glass.
"""

import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.case.shipped import shipped_folder
from drcmitsuba.model.materials import BsdfMaterial, DiffuserMaterial, Lambertian
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport import coefficients
from tests.model_rooms import case_of, l_room, layer, prism

DIAMETER = 20.0
SUNS = np.array([[0.3, -0.7, 0.5], [0.8, -0.2, 0.4], [-0.1, 0.2, 0.95]])
SUNS /= np.linalg.norm(SUNS, axis=1, keepdims=True)
ACCURACY = {
    "paths": 512, "photons": 1 << 15, "cell_size": 0.25, "sensor_sky_rays": 8192,
    "cell_sky_rays": 256, "sensor_sun_samples": 64, "pane_points": 256, "film_sky_samples": 1024,
    "sensor_square": 0.2,
}  # fmt: skip


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def agree(case, same, plain_coefficients, *, pane_to_pane, within):
    """Sensors' means for every bin, then every sensor's sums, are those of plain path tracing."""
    world = scene.load(case, effects=EnabledEffects(pane_to_pane=pane_to_pane))
    suns = Suns(tuple(f"sun_{i}" for i in range(len(SUNS))), SUNS, DIAMETER)
    here = coefficients.compute(world, *sensor_points(case), suns, case.accuracy)
    sources = {
        "sky": {"type": "tregenza_sky"},
        "suns": {
            "type": "sun_disks",
            "directions": mi.TensorXf(SUNS.astype(np.float32)),
            "diameter": DIAMETER,
        },
    }
    shapes = {f"shape{i}": s for i, s in enumerate(world.full.shapes())}
    with_sources = mi.load_dict({"type": "scene", **shapes, **sources}, optimize=False)
    plain = plain_coefficients(with_sources, *sensor_points(case), replicates=16, spp=1 << 13)
    mine, theirs = here["replicates"].values, plain.sum(axis=0)
    for bins in (slice(0, 146), slice(146, None)):
        same(mine[..., bins].mean(axis=1), other=theirs[..., bins].mean(axis=1), within=within)
        same(mine[..., bins].sum(axis=2), other=theirs[..., bins].sum(axis=2), within=within)


def test_a_room_with_windows_of_any_shape_in_any_plane(same, plain_coefficients):
    agree(l_room(accuracy=ACCURACY), same, plain_coefficients, pane_to_pane=True, within=0.03)


def attic(pane):
    """Room under a roof of one slope, with a triangular and a sloped pane of one material."""
    floor, _, walls = prism([(0, 0), (4, 0), (4, 5), (0, 5)], 2.0)
    high = [(0, 0, 2), (4, 0, 2), (4, 5, 4), (0, 5, 4)]
    sloped = np.array([[1, 1, 2.4], [3, 1, 2.4], [3, 4, 3.6], [1, 4, 3.6]])
    gable = np.array([[4, 0, 2], [4, 5, 2], [4, 5, 4]], float)
    back = [(0, 5, 2), (4, 5, 2), (4, 5, 4), (0, 5, 4)]
    return case_of(
        layer("floor", Lambertian(0.3), floor),
        layer("walls", Lambertian(0.5), *walls, back, [(0, 5, 2), (0, 0, 2), (0, 5, 4)]),
        layer("roof", Lambertian(0.7), high[::-1], holes=[sloped]),
        layer("pane", pane, sloped[::-1], gable[::-1]),
        sensors={"floors": ["floor"], "spacing": 2.0, "margin": 0.5},
        accuracy=ACCURACY,
        north=25.0,
    )


PRISM = str(shipped_folder() / "films" / "prism.xml")


@pytest.mark.parametrize(
    "pane",
    [
        pytest.param(
            DiffuserMaterial(type="diffuser", transmittance=0.4, reflectance=0.3), id="diffuser"
        ),
        pytest.param(
            BsdfMaterial(type="bsdf", file=PRISM, straight_through="off"),
            id="film",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_sloped_and_triangular_panes_that_scatter(pane, same, plain_coefficients):
    # Light from film to film is followed by photons; diffusing panes exchange light among them.
    is_film = isinstance(pane, BsdfMaterial)
    agree(attic(pane), same, plain_coefficients, pane_to_pane=is_film, within=0.025)
