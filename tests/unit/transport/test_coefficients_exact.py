"""G and C = D + G·D: exact answers, and the bias of cells."""

import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.scene import scene as scenes
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.cells.cells import CellGrid
from drcmitsuba.transport.coefficients import compute
from drcmitsuba.transport.gather.paths import gather
from drcmitsuba.transport.interreflection import interior
from tests.unit.transport.exact_scenes import (
    DIRECTIONS,
    DOWN,
    NO_SUNS,
    OMEGA,
    ORIGIN,
    SKY,
    SUNS,
    UP,
    closed_box,
    glazing,
    plane,
    quad,
    room,
    run,
    surface,
)


@pytest.mark.parametrize("reflectance", [0.5, 0.95])
def test_gathered_weights_in_a_closed_room_are_a_geometric_series(reflectance, same):
    # Σ ρ^k = ρ / (1 − ρ). At 0.95 a path meets 19 surfaces: more than the buffer begins with.
    scene = scenes.build([closed_box(2.0, reflectance)])
    points = np.array([[0, 0, 0], [0.9, -0.9, 0.5]])
    normals = np.array([[0, 0, 1], [-0.6, 0.8, 0]])
    n, paths = 32, 4096
    vertices = gather(
        scene, points, normals, replicates=n, paths=paths, grid=CellGrid.of(scene, 0.5), seed=6
    )
    total = np.bincount(vertices.row.numpy(), vertices.weight.numpy(), minlength=2 * n)
    same(total.reshape(n, 2), exact=reflectance / (1 - reflectance), within=0.005)
    if reflectance > 0.9:
        assert len(vertices) > 4 * n * 2 * paths
    # Every vertex lies on the box, and its normal faces inward.
    p, normal = vertices.p.numpy().reshape(-1, 3), vertices.n.numpy().reshape(-1, 3)
    np.testing.assert_allclose(abs(p).max(axis=1), 1, atol=1e-3)
    assert np.all((p * normal).sum(axis=1) < -0.99)


def test_free_sensors_get_pi_and_omega_cos(same):
    ground_far_below = [plane(-300, 0.2, half=0.5)]  # something that paths can meet, of no weight
    c = run(ground_far_below, ORIGIN, UP, SUNS, sensor_sky_rays=1 << 14)
    exact = np.append(SKY, np.pi * np.sin(np.radians(0.25)) ** 2 * DIRECTIONS[:, 2])
    same(c, exact=exact, within=0.002)


def test_white_closed_box_is_exactly_dark():
    c = run([closed_box(2.0, 1.0)], ORIGIN, UP, SUNS, replicates=2, paths=256)
    assert np.all(c == 0)


def test_matt_plane_below_returns_its_reflectance(same):
    # A sensor that looks down on an endless plane under the free sky: C = ρ × (free C).
    c = run([plane(-0.5, 0.4)], ORIGIN, DOWN, SUNS, cell_size=20.0, paths=2048, cell_sky_rays=256)
    exact = 0.4 * np.append(SKY, OMEGA * DIRECTIONS[:, 2])
    same(c, exact=exact, within=0.005)


def test_standard_errors_are_honest():
    # The same exact answer: of 145 bins × 8 seeds, z² has the mean of Student's t.
    exact, z, n = 0.4 * SKY[1:], [], 16
    scene = scenes.build([plane(-0.5, 0.4)])
    for seed in range(8):
        accuracy = Accuracy(seed=seed, replicates=n, cell_size=20.0, paths=512, cell_sky_rays=256)
        c = compute(scene, ORIGIN, DOWN, NO_SUNS, accuracy)
        z.append((c["interreflected"] - np.append(0, exact)) / c["interreflected_se"])
    z = np.array(z)[..., 1:]
    expected = (n - 1) / (n - 3)
    print(f"mean z² {np.mean(z**2):.3f}, expected {expected:.3f}")
    assert np.mean(z**2) == pytest.approx(expected, rel=0.2)


def test_white_room_with_a_window_is_a_furnace(same):
    # Reflectance 1 inside, lossless pane, 1 all around: π everywhere, whatever the bins.
    clear = {"type": "glazing", "transmittance": 0.8, "exponent": 5.0, "reflectance": 0.2}
    white = dict.fromkeys(("walls", "floor", "ceiling", "frame_reflectance"), 1.0)
    case = room([(0.5, 2.9, "clear")], {"clear": clear}, **white)
    points, normals = sensor_points(case)
    c = run(scenes.load(case), points, normals, paths=2048, sensor_sky_rays=2048, cell_size=0.2)
    same(c.sum(axis=-1), exact=np.pi, within=0.005)


def test_scene_without_any_diffuse_surface(same):
    # Nothing to gather: C is D alone.
    c = run([plane(0.1, glazing(0.8), half=50)], ORIGIN, UP, cell_size=1.0, sensor_sky_rays=1 << 14)
    same(c.sum(axis=-1), exact=0.8 * np.pi * (1 - 2 / (5.5 * 6.5)), within=0.002)


def test_block_of_sensors_that_meets_nothing(same, monkeypatch):
    # The second sensor looks away from the only surface there is.
    monkeypatch.setattr(interior, "SENSORS", 1)
    points, normals = np.zeros((2, 3)), np.vstack([DOWN, UP])
    c = run([plane(-0.5, 0.4)], points, normals, cell_size=20.0, cell_sky_rays=256)
    same(c[:, 0], exact=0.4 * SKY, within=0.01)
    same(c[:, 1], exact=SKY, within=0.01)


def test_bias_of_cells_falls_with_their_size():
    """Two sensors that look down from 10 cm on either side of the edge of a sun patch.

    A screen shades the plane z = 0 where x < 0; the sensors stand at x = ±5 cm. Exactly, the lit
    half plane fills F = ½ (1 ± sin arctan(x / h)) of their views and C = ρ Ω F. Both share the
    cells below them: one large cell shows them the same light, so the whole difference between
    them is lost; what small cells lose is what F varies across a cell on the edge.
    """
    rho, h, x = 0.5, 0.1, 0.05
    zenith = Suns(("sun",), np.array([[0, 0, 1.0]]), diameter=0.01)
    screen = surface(0.0, quad([-8, -8, 1], [8, 0, 0], [0, 16, 0]))
    scene = scenes.build([plane(0.0, rho, half=4), screen])
    points = np.array([[x, 0, h], [-x, 0, h]])
    exact = rho * disk_solid_angle(0.01) * np.sin(np.arctan(x / h))
    lost, noise = {}, {}
    for count in (3, 26, 79, 199):  # across 8 m, such that the edge halves a cell
        size = 8 / (count + 0.13)
        key = CellGrid.of(scene, size).key(
            mi.Point3f([-0.4 * size, 0.4 * size], 0, 0), mi.Normal3f(0, 0, 1)
        )
        assert key[0] == key[1]
        c = run(scene, points, np.tile(DOWN, (2, 1)), zenith, cell_size=size, replicates=32,
                paths=1 << 11)[..., -1]  # fmt: skip
        difference = c[:, 0] - c[:, 1]
        lost[size] = 1 - difference.mean() / exact
        noise[size] = difference.std(ddof=1) / np.sqrt(len(c)) / exact
    print({f"{s:.2f} m": f"lost {lost[s]:+.1%} ± {noise[s]:.1%}" for s in lost})
    coarse, *_, fine = lost.values()
    assert coarse > 0.9  # the case shows the bias
    assert abs(fine) < 0.05
    assert list(lost.values()) == sorted(lost.values(), reverse=True)
    assert all(n < 0.03 for n in noise.values())
