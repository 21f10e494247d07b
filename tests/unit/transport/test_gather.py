"""G: the fast gather against the plain one of `tests.plain_gather`."""

import numpy as np
import pytest

from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import Lambertian, MirrorMaterial
from drcmitsuba.scene import scene as scenes
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.geometry import Surface
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.transport.cells.cells import CellGrid
from drcmitsuba.transport.gather import paths as gather_module
from drcmitsuba.transport.gather.paths import ends_at_once, gather
from tests.plain_gather import plain_gather

MATERIALS = {
    "diffuse": Lambertian(0.3),
    "partly mirrored": MirrorMaterial(type="mirror", reflectance=0.8, specular=0.6),
}
POINT, NORMAL = np.array([0.3, -0.4, -0.2]), np.array([0, 0, 1.0])
REPLICATES, PATHS = 12, 1 << 13


def box(wall):
    """Closed box of 2 m about the origin, 0.6 inside, one of its walls of another material."""
    x, y, z = np.eye(3) * 2
    faces = [
        np.array([c, c + u, c + u + v, c + v])
        for c, edges in ((np.full(3, -1.0), (x, y, z)), (np.full(3, 1.0), (-y, -x, -z)))
        for u, v in zip(edges, (*edges[1:], edges[0]), strict=True)
    ]
    first, rest = np.array(faces[:1]), np.array(faces[1:])
    return scenes.build([Surface("wall", wall, first), Surface("rest", Lambertian(0.6), rest)])


def by_region(p, n, weight):
    """Sum of weights by facing and octant of the box, shape (region,)."""
    axis = abs(n).argmax(axis=1)
    facing = 2 * axis + (np.take_along_axis(n, axis[:, None], 1)[:, 0] > 0)
    octant = (p > 0) @ np.array([1, 2, 4])
    return np.bincount(8 * facing + octant, weight, minlength=48)


@pytest.mark.parametrize("material", MATERIALS)
def test_fast_and_plain_gather_agree(material, same):
    scene = box(MATERIALS[material])
    plain = [
        by_region(*plain_gather(scene, POINT, NORMAL, paths=PATHS, bounces=20, seed=seed))
        for seed in range(REPLICATES)
    ]
    vertices = gather(
        scene, POINT[None], NORMAL[None], replicates=REPLICATES, paths=PATHS,
        grid=CellGrid.of(scene, 0.5), seed=99,
    )  # fmt: skip
    p, n = (column.numpy().reshape(-1, 3) for column in (vertices.p, vertices.n))
    row, weight = vertices.row.numpy(), vertices.weight.numpy()
    fast = [by_region(p[row == r], n[row == r], weight[row == r]) for r in range(REPLICATES)]
    same(np.array(fast), other=np.array(plain), within=0.01)


def test_paths_that_end_at_once_are_those_of_a_loop(monkeypatch):
    """A matt room with a clear pane from which nothing comes back: the same vertices to a bit."""
    case = Case.model_validate(
        {
            "room": {"size": [3.0, 4.0, 2.8]},
            "materials": {"glass": {"type": "glazing", "transmittance": 0.7}},
            "facade": {"south": {"strips": [{"bottom": 0.8, "top": 2.4, "material": "glass"}]}},
            "furniture": [{"corner": [1, 1.5, 0.7], "size": [1.2, 0.6, 0.03]}],
            "sensors": {"corner": [0.4, 0.4, 0.8], "count": [4, 5], "spacing": 0.7},
        }
    )
    world = scenes.load(case, effects=EnabledEffects(beyond=False))
    points, normals = sensor_points(case)
    assert ends_at_once(world)
    assert not ends_at_once(scenes.load(case))  # light may come back from outside
    grid, both = CellGrid.of(world, 0.5), []
    for ends in (True, False):
        monkeypatch.setattr(gather_module, "ends_at_once", lambda world, ends=ends: ends)
        both.append(
            gather(world, points, normals, replicates=2, paths=64, grid=grid, seed=3, once=True)
        )
    for name in ("row", "weight", "key", "tag", "p", "n"):
        one, other = (getattr(vertices, name).numpy() for vertices in both)
        met = np.repeat(both[0].weight.numpy() > 0, len(one) // len(both[0]))
        np.testing.assert_array_equal(one[met], other[met], err_msg=name)
    assert 0.8 < (both[0].weight.numpy() > 0).mean() < 1
