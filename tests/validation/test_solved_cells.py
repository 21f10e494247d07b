"""Light between surfaces solved on cells, against plain path tracing.

Rationale: T has one random point for each cell and replicate, and keeps what cells send on as means
over blocks of cells. Points and blocks stand for their surfaces in proportion to the light that all
sensors get by way of them, so that the mean over the sensors has no bias from the size of cells.

Method: rooms in which light varies within cells: long, white, of several rooms, with furniture
finer than a cell, behind diffusing glass. The sensors' means of every bin and the sums of every
sensor are compared with the plugin `coefficient`, per entry (Šidák) and in sum.
"""

import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.case.case import Case
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport import coefficients
from tests.model_rooms import l_room

DIAMETER = 20.0
SUNS = np.array([[0.3, -0.7, 0.5], [0.8, -0.2, 0.4], [-0.1, 0.2, 0.95], [-0.5, -0.6, 0.7]])
SUNS /= np.linalg.norm(SUNS, axis=1, keepdims=True)
ACCURACY = {
    "paths": 1024, "cell_paths": 128, "sensor_sky_rays": 8192, "cell_sky_rays": 512,
    "sensor_sun_samples": 64, "pane_points": 256, "replicates": 16,
}  # fmt: skip
GLASS = {"type": "glazing", "transmittance": 0.7, "reflectance": 0.1}
DESKS = [
    {
        "name": "desk", "corner": [0.6, 1.0, 0.70], "size": [1.2, 0.6, 0.03], "count": [2, 2],
        "step": [1.6, 1.5], "reflectance": 0.5,
    }
]  # fmt: skip


def room(size, strips, *, sensors, walls=0.6, floor=0.3, ceiling=0.8, **tables):
    """Case of a room with a façade to the south."""
    surfaces = {"size": size, "floor": floor, "walls": walls, "ceiling": ceiling}
    return Case.model_validate(
        {
            "room": surfaces,
            "facade": {"south": {"strips": strips}},
            "materials": {"glass": GLASS, "opal": {"type": "diffuser", "transmittance": 0.4,
                                                   "reflectance": 0.3}},
            "sensors": sensors,
            "accuracy": ACCURACY,
            **tables,
        }
    )  # fmt: skip


def corridor():
    sensors = {"corner": [0.9, 0.5, 0.8], "count": [1, 20], "spacing": 0.98}
    strip = {"bottom": 0.3, "top": 2.7, "material": "glass"}
    return room([2.0, 20.0, 3.0], [strip], sensors=sensors)


def white_room_with_desks():
    sensors = {"corner": [0.4, 0.5, 0.75], "count": [5, 6], "spacing": 0.7}
    strip = {"bottom": 0.9, "top": 2.4, "material": "glass"}
    white = {"walls": 0.9, "floor": 0.9, "ceiling": 0.9}
    return room([4.0, 5.0, 2.8], [strip], sensors=sensors, furniture=DESKS, **white)


def room_behind_diffusing_glass():
    sensors = {"corner": [0.4, 0.5, 0.75], "count": [5, 6], "spacing": 0.7}
    strips = [
        {"bottom": 0.9, "top": 1.8, "material": "glass"},
        {"bottom": 1.8, "top": 2.6, "material": "opal"},
    ]
    return room([4.0, 5.0, 2.8], strips, sensors=sensors, furniture=DESKS)


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "cell_size"),
    [
        pytest.param(corridor, 0.45, id="corridor"),
        pytest.param(corridor, 0.9, id="corridor, large cells"),
        pytest.param(white_room_with_desks, 0.45, id="white room with desks"),
        pytest.param(room_behind_diffusing_glass, 0.45, id="diffusing glass"),
        pytest.param(lambda: l_room(accuracy=ACCURACY), 0.45, id="L-shaped model"),
    ],
)
def test_solved_cells_agree_with_plain_path_tracing(case, cell_size, same, plain_coefficients):
    case = case()
    accuracy = case.accuracy.model_copy(update={"cell_size": cell_size})
    world = scene.load(case, effects=EnabledEffects(pane_to_pane=True, solved_cells=True))
    points, normals = sensor_points(case)
    suns = Suns(tuple(f"sun_{i}" for i in range(len(SUNS))), SUNS, DIAMETER)
    mine = coefficients.compute(world, points, normals, suns, accuracy)["replicates"].values
    directions = mi.TensorXf(SUNS.astype(np.float32))
    sources = {
        "sky": {"type": "tregenza_sky"},
        "suns": {"type": "sun_disks", "directions": directions, "diameter": DIAMETER},
    }
    shapes = {f"shape{i}": s for i, s in enumerate(world.full.shapes())}
    with_sources = mi.load_dict({"type": "scene", **shapes, **sources}, optimize=False)
    plain = plain_coefficients(with_sources, points, normals, replicates=16, spp=1 << 12)
    theirs = plain.sum(axis=0)
    for bins in (slice(0, 1), slice(1, 146), slice(146, None)):
        ours, other = mine[..., bins], theirs[..., bins]
        same(ours.mean(axis=1), other=other.mean(axis=1), within=0.02)
        same(ours.sum(axis=2), other=other.sum(axis=2), within=0.05)
