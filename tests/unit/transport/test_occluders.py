"""Rays that leave a box by its openings meet no wall: light without walls is that with them."""

from dataclasses import replace

import numpy as np
import pytest

from drcmitsuba.case.case import Case
from drcmitsuba.scene import scene
from drcmitsuba.scene.geometry import quad
from drcmitsuba.scene.surfaces import Enclosure
from drcmitsuba.transport.panes.patches import PanePatches
from drcmitsuba.transport.panes.transfer import pane_transfer
from drcmitsuba.transport.rays.shadow_rays import sky_deposit, sun_deposit
from tests.unit.transport.exact_scenes import flat

ROOM = {
    "room": {"size": [4.0, 5.0, 3.0]},
    "materials": {
        "glass": {"type": "glazing", "transmittance": 0.65},
        "milky": {"type": "diffuser", "transmittance": 0.3},
        "silver": {"type": "mirror", "reflectance": 0.95},
    },
    "facade": {"south": {"strips": [{"bottom": 0.9, "top": 2.6, "material": "glass"}]}},
    "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 4], "spacing": 1.0},
}
BANDS = {
    "segments": 3, "frame": 0.2,
    "strips": [
        {"bottom": 0.3, "top": 0.9, "material": "glass", "segments": [0, 2]},
        {"bottom": 0.9, "top": 1.4, "material": "milky"},
        {"bottom": 1.8, "top": 2.6, "material": "open"},
    ],
}  # fmt: skip
PIPE = {
    "type": "lightpipe", "centre": [2.0, 2.5], "width": 0.8, "height": 0.5,
    "mirror": "silver", "top": "glass", "bottom": "glass",
}  # fmt: skip
TABLE = {"corner": [1.0, 1.0, 0.75], "size": [1.6, 0.8, 0.0]}
ROOMS = {
    "walls alone": {},
    "open": {"facade": {"south": {"strips": [{"bottom": 0.9, "top": 2.6, "material": "open"}]}}},
    "bands, frames and opal": {"facade": {"south": BANDS, "east": {"strips": BANDS["strips"][2:]}}},
    "turned": {"room": {**ROOM["room"], "rotation": 25.0}},
    "light pipe": {"components": {"pipe": PIPE}},
    "furniture inside and outside, in the planes of floor and façade": {
        "furniture": [
            {"corner": [1.0, 0.5, 0.0], "size": [0.6, 0.6, 1.5]},
            {"corner": [0.0, 4.9, 0.0], "size": [1.0, 0.1, 3.0]},
            {"corner": [-3.0, -4.0, 0.0], "size": [9.0, 4.0, 0.0]},
            {"corner": [1.0, -3.0, 0.0], "size": [1.0, 1.0, 4.0]},
            {"corner": [-2.0, 0.0, 0.0], "size": [1.9, 1.0, 5.0]},
        ]
    },
}


@pytest.mark.parametrize("name", ROOMS)
def test_walls_make_no_difference(name):
    case = Case.model_validate({**ROOM, **ROOMS[name]})
    world = scene.load(case)
    rng = np.random.default_rng(5)
    count = 400
    room = world.enclosure
    points = rng.uniform(0.02, 0.98, (count, 3)) * room.size @ room.turn.T
    points = points.astype(np.float32)
    normals = rng.standard_normal((count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    suns = rng.standard_normal((60, 3))
    suns[:, 2] = abs(suns[:, 2])
    suns /= np.linalg.norm(suns, axis=1, keepdims=True)
    by_sun, by_sky = [], []
    for one in (world, replace(world, occluders=None)):
        at = flat(points), flat(normals)
        by_sun.append(sun_deposit(one, *at, suns=suns, diameter=0.5, samples=2, seed=3).numpy())
        by_sky.append(sky_deposit(one, *at, subdivision=1, rays=512, seed=4).numpy())
    assert (by_sun[0] > 0).sum() > 100
    for without_walls, with_walls in (by_sun, by_sky):
        same = np.isclose(without_walls, with_walls, rtol=1e-5, atol=1e-9)
        assert same.mean() > 0.9995  # but for rays at the very edge of an opening
        assert without_walls.sum() == pytest.approx(with_walls.sum(), rel=1e-3)


def test_walls_make_no_difference_on_the_way_to_panes():
    tables = {**ROOM, **ROOMS["bands, frames and opal"]}
    world = scene.load(Case.model_validate({**tables, "furniture": [TABLE]}))
    panes = PanePatches.of([part.quads for part in world.scattering], 0.5)
    rng = np.random.default_rng(6)
    points = flat(rng.uniform(0.02, 0.98, (200, 3)) * world.enclosure.size)
    normals = flat(np.tile([0.0, -0.6, 0.8], (200, 1)))
    K, with_walls = (
        pane_transfer(one, panes, points, normals, rays=64, seed=2).numpy()
        for one in (world, replace(world, occluders=None))
    )
    assert (K > 0).sum() > 100
    np.testing.assert_allclose(K, with_walls, rtol=1e-5, atol=1e-7)


def test_only_faces_of_the_box_beside_its_openings_hide_nothing():
    x, y, z = np.diag([4.0, 5.0, 3.0])
    window = quad(x / 4, z / 2, x / 4)  # in the south wall
    box = Enclosure(np.array([4.0, 5.0, 3.0]), np.eye(3), window[None])
    nowhere = np.zeros(3)
    hides_nothing = [
        quad(nowhere, x, y), quad(z, y, x), quad(y, x, z), quad(nowhere, z, x / 4),
        quad(x / 2, z, x / 2), quad(z / 2, z / 2, x), quad(nowhere, y, z),
    ]  # fmt: skip
    may_hide = [
        quad(x / 3, z / 4, x / 20), quad(nowhere, z, x), quad(y / 2, x, z), quad(-y, x, y),
        quad(nowhere, x, -z), quad(nowhere, y, 1.2 * z), quad(y * 1e-3, x, z),
    ]  # fmt: skip
    assert not box.may_hide(np.array(hides_nothing)).any()
    assert box.may_hide(np.array(may_hide)).all()
