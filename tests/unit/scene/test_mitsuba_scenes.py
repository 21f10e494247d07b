"""Scenes that one kernel traces together, and the place where all of them are made."""

from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import drcmitsuba
from drcmitsuba.model.materials import DiffuserMaterial
from drcmitsuba.scene.materials import bsdf
from drcmitsuba.scene.meshes import quad_mesh
from drcmitsuba.scene.mitsuba_scenes import mitsuba_scene

PACKAGE = Path(drcmitsuba.__file__).parent
ALONE = {
    Path("scene/mitsuba_scenes.py"),
    Path("runtime/machine_speed.py"),
    Path("runtime/backend.py"),  # sees whether a GPU can trace rays
}
"""The only modules that make scenes by themselves."""


def square(height):
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
    return quad_mesh(f"at {height} m", np.column_stack([corners, np.full(4, height)])[None])


@pytest.mark.parametrize("count", [2, 5])
def test_one_kernel_traces_several_scenes(variant, count):
    """On a GPU, rays in scenes with a table of their own were left out: they met nothing."""
    squares = [square(1.0 + i) for i in range(count)]
    worlds = [mitsuba_scene({"one": one}) for one in squares] + [mitsuba_scene({})]
    ray = mi.Ray3f(mi.Point3f(dr.linspace(mi.Float, 0.5, 3.5, 4), 0, 0), mi.Vector3f(0, 0, 1))
    met = [world.ray_intersect(ray) for world in worlds]
    hidden = [world.ray_test(ray) for world in worlds]
    dr.eval(met, hidden)
    for height, one, si, dark in zip(range(1, count + 1), squares, met, hidden, strict=False):
        np.testing.assert_allclose(si.t, [height, np.inf, np.inf, np.inf], rtol=1e-6)
        np.testing.assert_array_equal(dark, [True, False, False, False])
        np.testing.assert_array_equal(si.shape == mi.ShapePtr(one), [True, False, False, False])
    assert not np.any(hidden[-1])


def test_a_loop_traces_several_scenes(variant):
    """Rays go from square to square, by turns in two scenes."""
    low, high = mitsuba_scene({"low": square(1.0)}), mitsuba_scene({"high": square(2.0)})

    def bounce(i, ray, length):
        t, n = high.ray_intersect(ray).t, low.ray_intersect(ray).t
        t = dr.minimum(t, n)
        return i + 1, mi.Ray3f(ray(t + 0.25), ray.d), length + t

    start = mi.Ray3f(mi.Point3f(dr.zeros(mi.Float, 3), 0, 0), mi.Vector3f(0, 0, 1))
    state = mi.UInt32(0), start, mi.Float(0)
    length = dr.while_loop(state, lambda i, ray, length: i < 2, bounce)[2]
    np.testing.assert_allclose(length, 1.75)


def test_all_scenes_are_made_in_one_place():
    made = {
        path.relative_to(PACKAGE)
        for path in PACKAGE.rglob("*.py")
        if "scenes" not in path.relative_to(PACKAGE).parts[:1]  # data, beside the rooms of a wheel
        and '"type": "scene"' in path.read_text(encoding="utf-8")
    }
    assert made == ALONE


def test_a_table_of_three_numbers_is_read_in_silence(variant, capfd):
    """Mitsuba tries to make a colour of three numbers, and tells that it cannot."""
    cloth = DiffuserMaterial(type="diffuser", transmittance=(0.3, 0.2, 0.4), straight=(0, 0.1, 0.3))
    made = mi.traverse(mi.load_dict(bsdf(cloth)))
    np.testing.assert_allclose(made["straight"], [0, 0.05, 0.1, 0.2, 0.3], rtol=1e-6)
    assert capfd.readouterr().err == ""
