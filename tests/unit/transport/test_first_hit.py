"""First hits in a box room by closed form beside those of a search, ray by ray."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import Lambertian
from drcmitsuba.scene import scene
from drcmitsuba.scene.box_faces import BoxFaces
from drcmitsuba.scene.geometry import Surface, quad
from drcmitsuba.scene.surfaces import Enclosure
from drcmitsuba.transport.rays.first_hit import InBox
from tests.unit.transport.test_occluders import BANDS, ROOM, ROOMS

FLAGS = mi.RayFlags.Minimal | mi.RayFlags.ShadingFrame
BOXES = [*ROOMS, "opal and windows on all sides", "no window"]
SIDES = {side: {"strips": BANDS["strips"][1:]} for side in ("south", "east", "north")}
OTHERS = {"opal and windows on all sides": {"facade": SIDES}, "no window": {"facade": {}}}


def loaded(**tables):
    return scene.load(Case.model_validate({**ROOM, **tables}))


def rays(room, count=1 << 17):
    """Rays from within the room, half of them along its surfaces or outside."""
    rng = np.random.default_rng(2)
    o = rng.random((count, 3))
    o[: count // 4] = o[: count // 4] * 2 - 0.5
    d = rng.standard_normal((count, 3))
    d[-count // 4 :, rng.integers(0, 3)] = 0  # parallel to two faces
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    o, d = (np.ascontiguousarray(x @ room.turn.T, np.float32) for x in (o * room.size, d))
    return mi.Ray3f(mi.Point3f(o.T), mi.Vector3f(d.T))


@pytest.mark.parametrize("name", BOXES)
def test_closed_form_finds_what_a_search_finds(name):
    world = loaded(**(ROOMS | OTHERS)[name])
    faces, ray = InBox.of(world), rays(world.enclosure)
    by_search = world.full.ray_intersect(ray, FLAGS, coherent=False)
    by_faces = faces.intersect(ray, mi.Bool(True))
    there = by_search.is_valid().numpy()
    t = np.where(there, by_search.t.numpy(), 0), np.where(there, by_faces.t.numpy(), 0)
    same = (there == by_faces.is_valid().numpy()) & np.isclose(*t, rtol=1e-5, atol=1e-5)
    assert same.mean() > 0.9999  # but for rays at the very edge of an aperture
    kept = same & there
    at, onto = (np.array(si.p)[:, kept] for si in (by_search, by_faces))
    np.testing.assert_allclose(at, onto, atol=1e-4)
    # A wall and the furniture that touches it lie in one plane: rays within furniture tell.
    least = 0.995 if "furniture" in name else 1
    normals = (np.array(si.n)[:, kept] for si in (by_search, by_faces))
    assert np.isclose(*normals, atol=1e-4).mean() >= least
    kinds = (dr.reinterpret_array(mi.UInt32, si.bsdf()) for si in (by_search, by_faces))
    of_search, of_faces = (kind.numpy()[kept] for kind in kinds)
    assert (of_search == of_faces).mean() >= least
    assert len(np.unique(of_search)) > 2
    local = by_faces.to_local(-ray.d).z.numpy()[kept]
    facing = dr.dot(by_faces.n, -ray.d).numpy()[kept]
    np.testing.assert_allclose(local, facing, atol=1e-5)
    none = faces.intersect(ray, mi.Bool(False))
    assert not none.is_valid().numpy().any()


def test_a_face_is_of_one_material_but_for_what_a_rectangle_encloses():
    size = np.array([4.0, 5.0, 3.0])
    room = Enclosure(size, np.eye(3), np.zeros((0, 4, 3)))
    x, y, z = np.diag(size)
    sides = [quad(0 * x, z, x), quad(y, x, z), quad(0 * x, y, z), quad(x, z, y), quad(z, y, x)]

    def faces(*floor):
        parts = [Surface("rest", Lambertian(0.5), np.array(sides))]
        parts += [Surface(f"{i}", Lambertian(0.1 * i), np.array(q)) for i, q in enumerate(floor)]
        return BoxFaces.of(room, parts)

    def strip(low, high):
        return quad(low * x, (high - low) * x, y)

    assert faces([strip(0, 1)]).parts == (0, 0, 0, 0, 1, 0)
    assert len(faces([strip(0, 1)]).apertures) == 0
    beside = faces([strip(0, 0.3), strip(0.4, 1)], [strip(0.3, 0.4)])
    np.testing.assert_allclose(np.ptp(beside.apertures[0], axis=0), [0.4, 5, 0], atol=1e-12)
    assert faces([strip(0, 0.2), strip(0.4, 1)]) is None  # a hole that is no opening
    assert faces([strip(0, 1)], [strip(0.3, 0.4)]).parts[4] == 1  # a carpet
    apart = [strip(0, 0.2), strip(0.4, 1)], [strip(0.2, 0.3)], [strip(0.3, 0.4)]
    assert len(faces(*apart).apertures) == 1
    assert scene.build([]).faces is None
