"""C = D + G·D of a small room against the plugin `coefficient`, and what must not matter to it.

Two-sided tests of equal means need a bias far below the standard error. The bias of G·D comes from
cells, so cells of 10 cm are paired with sample counts that leave 0.1 to 0.5 % of standard error (in
runs with forty times the samples the two agreed to 0.04 %); the bias itself is measured by
`test_bias_of_cells_falls_with_their_size`.
"""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.scene import scene as scenes
from drcmitsuba.scene.geometry import Surface
from drcmitsuba.scene.materials import bsdf
from drcmitsuba.scene.meshes import quad_mesh
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.scene.surfaces import surfaces_of
from drcmitsuba.transport.coefficients import compute
from drcmitsuba.transport.interreflection import interior
from tests.fast import slowly
from tests.unit.transport.exact_scenes import (
    BENCH,
    CLOTH,
    DIRECTIONS,
    GLASS,
    OPAL,
    OPPOSITE,
    SUNS,
    WINDOW,
    quad,
    room,
    run,
)

ROOMS = {
    "open hole": lambda: (room([(0.9, 2.7, "open")]), "open"),
    "glazing with inner reflectance": lambda: (room(WINDOW, {"glass": GLASS}), "open"),
    "shaded": lambda: (
        room(WINDOW, {"glass": GLASS, "cloth": CLOTH}, shading={"material": "cloth"}), "shaded"),
    "opal above clear": lambda: (
        room([(0.9, 1.8, "glass"), (1.8, 2.7, "opal")], {"glass": GLASS, "opal": OPAL}), "open"),
    "house opposite and bench": lambda: (
        room(WINDOW, {"glass": GLASS}, furniture=[OPPOSITE, BENCH]), "open"),
}  # fmt: skip

FINE = {"replicates": 16, "paths": 1024, "sensor_sky_rays": 8192, "pane_points": 128}
ROUGH = {"replicates": 16, "paths": 256, "cell_size": 0.3, "sensor_sky_rays": 2048}


def with_sources(surfaces, turn=0.0):
    """The surfaces under sky and suns, for `coefficient`; `turn` rotates sky and suns [deg]."""
    T = mi.ScalarTransform4f().rotate([0, 0, 1], turn)
    matrix = np.array(T.matrix)[:3, :3]
    meshes = {
        f"s{i}": quad_mesh(s.name, s.quads, mi.load_dict(bsdf(s.material)))
        for i, s in enumerate(surfaces)
    }
    sky = {"type": "tregenza_sky", "to_world": T}
    directions = mi.TensorXf((DIRECTIONS @ matrix.T).astype(np.float32))
    suns = {"type": "sun_disks", "directions": directions}
    return mi.load_dict({"type": "scene", **meshes, "sky": sky, "suns": suns}, optimize=False)


@pytest.mark.parametrize(
    "name", slowly(ROOMS, "open hole", "house opposite and bench", "opal above clear", "shaded")
)
def test_gd_agrees_with_the_plain_path_tracer(name, same, plain_coefficients):
    case, state = ROOMS[name]()
    points, normals = sensor_points(case)
    here = run(scenes.load(case, state), points, normals, SUNS, **FINE)
    there = plain_coefficients(
        with_sources(surfaces_of(case, state)),
        points,
        normals,
        spp=1 << 12,
        seed=list(ROOMS).index(name),
    ).sum(axis=0)
    same(here[..., :146], other=there[..., :146], within=0.01)
    same(here[..., 146:], other=there[..., 146:], within=0.02)


def test_turned_room_is_the_plain_room_under_the_turned_sky(same, plain_coefficients):
    # The room turns clockwise, so that in its own frame the sky turns the other way.
    turned, plain = (
        room(WINDOW, {"glass": GLASS}, rotation=angle, furniture=[BENCH]) for angle in (37.0, 0.0)
    )
    here = run(scenes.load(turned), *sensor_points(turned), SUNS, **FINE)
    there = plain_coefficients(
        with_sources(surfaces_of(plain), turn=37.0), *sensor_points(plain), spp=1 << 12
    ).sum(axis=0)
    same(here[..., :146], other=there[..., :146], within=0.01)
    same(here[..., 146:], other=there[..., 146:], within=0.02)


def test_back_of_a_pane_is_black_outside(same, plain_coefficients):
    # Panes reflect towards the room only, in both estimators: an opal strip and a house opposite.
    case = room([(0.9, 2.7, "opal")], {"opal": OPAL}, furniture=[OPPOSITE])
    points, normals = np.array([[1.5, -0.3, 1.8]]), np.array([[0, 1.0, 0]])
    here = run(scenes.load(case), points, normals, SUNS, **FINE)
    there = plain_coefficients(with_sources(surfaces_of(case)), points, normals, spp=1 << 13)
    same(here, other=there.sum(axis=0), within=0.01)


def test_direct_and_interreflected_are_separated_alike(same, plain_coefficients):
    case, _ = ROOMS["opal above clear"]()
    points, normals = sensor_points(case)
    c = compute(scenes.load(case), points, normals, SUNS, Accuracy(cell_size=0.1, **FINE))
    direct = plain_coefficients(
        with_sources(surfaces_of(case)), points, normals, spp=1 << 12, max_depth=2
    )[0]
    # `coefficient` calls direct what met no diffuse surface; so do transport's means.
    mean, error = direct.mean(axis=0), direct.std(axis=0, ddof=1) / np.sqrt(len(direct))
    sure = (error < 0.1 * mean) & (c["direct_se"].values < 0.1 * c["direct"].values)
    sure[:, 146:] = False  # a sun through glass is the same number in all replicates
    assert sure.sum() > 100
    z = (c["direct"].values - mean)[sure] / np.hypot(c["direct_se"].values, error)[sure]
    # Student's t of 15 and 31 degrees of freedom: 1.07 to 1.15.
    print(f"mean z² of {z.size} entries {np.mean(z**2):.3f}")
    assert np.mean(z**2) == pytest.approx(1.1, abs=0.35)
    assert np.all(c["straight"].values <= c["direct"].values)
    assert c["straight"].sum() < 0.9 * c["direct"].sum()


def test_threads_do_not_matter():
    case, _ = ROOMS["opal above clear"]()
    points, normals = sensor_points(case)
    scene = scenes.load(case)
    threads = dr.thread_count()
    runs = []
    try:
        for count in (1, 2):
            dr.set_thread_count(count)
            runs.append(run(scene, points, normals, SUNS, replicates=2, cell_size=0.2))
    finally:
        dr.set_thread_count(threads)
    np.testing.assert_allclose(runs[0], runs[1], rtol=1e-5, atol=1e-5 * runs[0].mean())


def test_seed_decides_and_another_seed_differs():
    case, _ = ROOMS["opal above clear"]()
    points, normals = sensor_points(case)
    scene = scenes.load(case)
    a, b, c = (
        run(scene, points, normals, SUNS, replicates=2, cell_size=0.2, seed=s) for s in (1, 1, 2)
    )
    np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-5 * a.mean())
    assert np.abs(a - c).max() > 1e-3 * a.max()


def test_blocks_of_sensors_do_not_matter(same, monkeypatch):
    case, _ = ROOMS["opal above clear"]()
    points, normals = sensor_points(case)
    scene = scenes.load(case)
    whole = run(scene, points, normals, SUNS, **ROUGH)
    monkeypatch.setattr(interior, "SENSORS", 4)
    parts = run(scene, points, normals, SUNS, seed=77, **ROUGH)
    same(parts, other=whole, within=0.02)


def test_order_and_cut_of_surfaces_do_not_matter(same):
    case, state = ROOMS["house opposite and bench"]()
    points, normals = sensor_points(case)
    things = surfaces_of(case, state)
    cut = []
    for s in reversed(things):
        for q in s.quads:
            u, v = (q[1] - q[0]) / 2, q[3] - q[0]
            cut += [Surface("part", s.material, np.array([quad(q[0] + i * u, u, v)]))
                    for i in (0, 1)]  # fmt: skip
    whole = run(scenes.build(things), points, normals, SUNS, **ROUGH)
    parts = run(scenes.build(cut), points, normals, SUNS, seed=5, **ROUGH)
    same(parts, other=whole, within=0.02)
