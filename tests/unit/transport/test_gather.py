"""G: the fast gather against the plain one of `tests.plain_gather`."""

import numpy as np
import pytest

from drcmitsuba.model.materials import Lambertian, MirrorMaterial
from drcmitsuba.scene import scene as scenes
from drcmitsuba.scene.geometry import Surface
from drcmitsuba.transport.cells import Grid
from drcmitsuba.transport.gather import gather
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
        grid=Grid.of(scene, 0.5), seed=99,
    )  # fmt: skip
    p, n = (column.numpy().reshape(-1, 3) for column in (vertices.p, vertices.n))
    row, weight = vertices.row.numpy(), vertices.weight.numpy()
    fast = [by_region(p[row == r], n[row == r], weight[row == r]) for r in range(REPLICATES)]
    same(np.array(fast), other=np.array(plain), within=0.01)
