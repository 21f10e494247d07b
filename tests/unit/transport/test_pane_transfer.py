"""K and the light between panes that scatter evenly: exact answers."""

from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.model.materials import DiffuserMaterial
from drcmitsuba.runtime.random_streams import Stream, number_in_replicate
from drcmitsuba.scene import scene as scenes
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.panes.patches import PanePatches, patch_sizes
from drcmitsuba.transport.panes.transfer import neumann_series, pane_transfer
from drcmitsuba.transport.rays.shadow_rays import sky_deposit
from tests.unit.transport.exact_scenes import (
    DIRECTIONS,
    DOWN,
    OMEGA,
    ORIGIN,
    PATCHES,
    SKY,
    UP,
    by_replicate,
    closed_box,
    diffuser,
    flat,
    glazing,
    plane,
    polygon_factor,
    quad,
    run,
    surface,
)

PANE = quad([-1, 0, 0], [0, 0, 2], [2, 0, 0])  # upright, front to the north
ROOF = surface(0.0, quad([-20, -0.7, 2], [40, 0, 0], [0, 0.7, 0]))


def test_patches_are_fine_where_a_shadow_may_cut_them():
    (plain,) = scenes.build([surface(diffuser(0.4), PANE)]).scattering
    corners = np.reshape(PANE, (-1, 3))
    assert patch_sizes([plain], corners, 0.9) == [0.9]
    inside, outside = corners + [0, 2, 0], corners - [0, 2, 0]
    assert patch_sizes([plain], np.concatenate([corners, inside]), 0.9) == [0.9]
    beyond = np.concatenate([corners, outside])
    assert patch_sizes([plain], beyond, 0.9) == [pytest.approx(0.3)]
    assert patch_sizes([plain], beyond, 0.15) == [0.075]  # narrower ones are too many
    assert patch_sizes([plain], beyond, 0.09) == [0.09]
    indoors = replace(plain, indoors=True)
    assert patch_sizes([indoors], corners, 0.9) == [0.45]
    assert patch_sizes([indoors, plain], beyond, 0.9) == pytest.approx([0.3, 0.3])


def test_a_pane_below_a_roof_is_seen_lit_below_the_shadows_edge(same):
    """The roof's shadow falls 0.7 m down; below its edge the pane shines evenly."""
    sun = np.array([[0, -1, 1]]) / np.sqrt(2)
    points, normals = np.array([[0, 0.25, 0.4], [0, 0.25, 0.9], [0.5, 0.5, 0.4]]), UP.repeat(3, 0)
    C = run([surface(diffuser(0.4), PANE), ROOF], points, normals, Suns(("sun",), sun),
            cell_size=0.45, pane_points=4096)[..., -1]  # fmt: skip
    lit = PANE * [1, 1, 0.65]
    above = lit[None].repeat(3, 0)
    above[..., 2] = np.maximum(above[..., 2], points[:, None, 2])
    factor = np.array([polygon_factor(p, q) for p, q in zip(points, above, strict=True)])
    same(C, exact=0.4 * OMEGA / np.sqrt(2) * factor, within=0.04)


@pytest.mark.parametrize(
    "pane",
    [
        quad([-0.4, 0.1, 1.0], [0, 2, 0], [3, 0, 0]),  # parallel to the receiver, front down
        quad([-0.4, 0.5, 0.3], [2, 0, 0], [0, 0, 1]),  # upright, front to the south
        quad([0.3, 0.2, 0.05], [0.5, 0, 0.1], [0, 0.5, 0.1]),  # close and tilted
    ],
    ids=["parallel", "upright", "close"],
)
@pytest.mark.parametrize("turned", [False, True])
def test_transfer_from_patches_is_t_times_the_form_factor(pane, turned, same):
    sides = {"outer_reflectance": 0.3} if turned else {"reflectance": 0.3}
    material = DiffuserMaterial(type="diffuser", transmittance=0.4, **sides)
    scene = scenes.build([surface(material, pane[::-1] if turned else pane)])
    patches = PanePatches.of([s.quads for s in scene.scattering], 0.5)
    n = 32
    k = by_replicate(
        pane_transfer(scene, patches, flat(ORIGIN, n), flat(UP, n), rays=1 << 12, seed=7), n
    )[:, 0]
    a, u, v = patches.corner, patches.u, patches.v
    corners = np.stack([a, a + u, a + u + v, a + v], axis=1)
    factor = np.abs(polygon_factor(np.zeros(3), corners))
    near, far = (1, 0) if turned else (0, 1)
    same(k[:, far::2], exact=0.4 * factor, within=0.003)  # through the pane
    same(k[:, near::2], exact=0.3 * factor, within=0.003)  # off the pane


@pytest.mark.parametrize("height", [0.05, 1.0])
def test_a_pane_is_seen_through_the_holes_of_a_fabric(height, same):
    """A black fabric that lets half of the light straight through halves the light of a pane."""
    fabric = DiffuserMaterial(type="diffuser", transmittance=0, straight=0.5)
    pane = quad([-2, -2, 2.0], [0, 4, 0], [4, 0, 0])
    cover = quad([-9, -9, height], [0, 18, 0], [18, 0, 0])
    scene = scenes.build([surface(diffuser(0.6), pane), surface(fabric, cover)])
    patches = PanePatches.of([s.quads for s in scene.scattering], 1.0)
    n, mine = 32, np.flatnonzero(patches.owner == 0)
    k = by_replicate(
        pane_transfer(scene, patches, flat(ORIGIN, n), flat(UP, n), rays=1 << 11, seed=7), n
    )[:, 0]
    a, u, v = (edges[mine] for edges in (patches.corner, patches.u, patches.v))
    factor = polygon_factor(np.zeros(3), np.stack([a, a + u, a + u + v, a + v], axis=1))
    same(k[:, 2 * mine + 1], exact=0.5 * 0.6 * factor, within=0.004)


@pytest.mark.parametrize("straight", [0.3, (0.5, 0.3, 0.0)])
@pytest.mark.parametrize("tilt", [0.0, 0.5])
def test_the_straight_part_of_a_pane_behind_glass_takes_nothing_of_what_it_scatters(straight, tilt):
    """Rays to the pane end before it, however far a clear pane lets them go on."""
    glass = quad([-9, -9, 1.0], [0, 18, 9 * tilt], [18, 0, 0])
    k = []
    for share in (0.0, straight):
        screen = DiffuserMaterial(type="diffuser", transmittance=0.4, straight=share)
        pane = quad([-2, -2, 1.2 + 2 * tilt], [0, 4, 0], [4, 0, 0])
        scene = scenes.build([surface(screen, pane), surface(glazing(0.8), glass)])
        patches = PanePatches.of([s.quads for s in scene.scattering], 1.0)
        points = ORIGIN + [[0, 0, 0.0], [60.0, 0, 0], [0, -3.0, 0.3]]
        normals = np.array([[0, 0, 1.0]] * 3)
        made = pane_transfer(scene, patches, flat(points), flat(normals), rays=1 << 10, seed=7)
        k.append(made.numpy())
    assert k[0][[0, 2]].sum(axis=1).min() > 0.01
    np.testing.assert_allclose(k[1], k[0], rtol=1e-6)


def test_pane_that_fills_the_view_transfers_t():
    scene = scenes.build([plane(0.1, diffuser(0.7, 0.2), front=-1)])
    patches = PanePatches.of([s.quads for s in scene.scattering], 300.0)
    k = pane_transfer(scene, patches, flat(ORIGIN), flat(UP), rays=1 << 12, seed=8).numpy()[0]
    assert k[1::2].sum() == pytest.approx(0.7, rel=0.01)
    assert k[0::2].sum() == pytest.approx(0.2, rel=0.01)
    away = pane_transfer(scene, patches, flat(ORIGIN), flat(DOWN), rays=1 << 10, seed=8)
    assert np.all(away.numpy() == 0)


def test_clear_pane_before_a_scattering_one_dims_it_by_its_angle(same):
    # K = T × the diffuse transmittance of the glass, 2 ∫ τ(x) x dx over x = cos θ.
    scene = scenes.build([plane(0.2, diffuser(0.7), front=-1), plane(0.1, glazing(0.8))])
    patches = PanePatches.of([s.quads for s in scene.scattering], 300.0)
    n = 32
    k = pane_transfer(scene, patches, flat(ORIGIN, n), flat(UP, n), rays=1 << 11, seed=8)
    same(by_replicate(k, n).sum(axis=-1), exact=0.7 * 0.8 * (1 - 2 / (5.5 * 6.5)), within=0.002)


def test_a_pane_that_scatters_by_the_incidence_weighs_sky_and_suns(same):
    # T(x) = 0.1 + 0.3 x over x = cos θ: ∫ T x dx times the width of a patch, Ω T x of a sun.
    scene = scenes.build([plane(0.1, diffuser((0.1, 0.4), 0.3), half=50, front=-1)])
    patches = PanePatches.of([s.quads for s in scene.scattering], 34.0)
    accuracy = Accuracy(cell_sky_rays=1024, pane_points=1024)
    deposit = Deposit(scene, DIRECTIONS, 0.5, 1, accuracy, patches)
    parts = [
        deposit.lit(r).scattered(
            flat(ORIGIN), flat(UP), (Stream.SENSORS,), number_in_replicate(mi.UInt32(0), r)
        )
        for r in range(24)
    ]
    low, high, west, east = PATCHES.bounds[1:].T
    at_low, at_high = (0.1 * x**2 / 2 + 0.3 * x**3 / 3 for x in (np.sin(low), np.sin(high)))
    exact = (at_high - at_low) * (east - west)
    same([one.sky.numpy()[0, 1:] for one in parts], exact=exact, within=0.003)
    x = DIRECTIONS[:, 2]
    of_suns = OMEGA * (0.1 + 0.3 * x) * x
    same([one.sun.numpy()[0] for one in parts], exact=of_suns, within=0.003)


def faces(scene, size, replicates, rays, seed):
    """Irradiance of the faces of all panes under the bare sky, one estimate per replicate."""
    patches = PanePatches.of([s.quads for s in scene.scattering], size)
    irradiances = []
    for r in range(replicates):
        p, n = patches.face_points(np.random.default_rng(seed + r))
        received = sky_deposit(scene, p, n, subdivision=1, rays=rays, seed=seed + r)
        between = pane_transfer(scene, patches, p, n, rays=rays, seed=seed + 1000 + r)
        irradiances.append(neumann_series(between, received))
    return patches, irradiances


def test_light_between_two_panes_is_a_geometric_series(same):
    # La = Ta + Ra Lb under the sky, Lb = Ra's light returned: between infinite panes
    # sky: La = Ta / (1 − Ra Rb); ground: La = Ra Tb / (1 − Ra Rb).
    Ta, Ra, Tb, Rb = 0.3, 0.6, 0.2, 0.7
    above, below = (
        plane(0.1, diffuser(Ta, Ra), half=50, front=-1),
        plane(-0.1, diffuser(Tb, Rb), half=50),
    )
    scene = scenes.build([above, below])
    patches, irradiances = faces(scene, 34.0, 32, 1 << 12, seed=9)
    assert len(patches) == 18
    c = [
        (pane_transfer(scene, patches, flat(ORIGIN), flat(UP), rays=1 << 12, seed=500 + r) @ e)
        .numpy()
        for r, e in enumerate(irradiances)
    ]  # fmt: skip
    exact = SKY * Ta / (1 - Ra * Rb)
    exact[0] = np.pi * Ra * Tb / (1 - Ra * Rb)
    same(np.array(c)[:, 0], exact=exact, within=0.003)


def test_inside_a_box_of_panes_it_is_pi_t_over_1_minus_r(same):
    # With π on every outer face, L = T + R L is the same all over the inside.
    scene = scenes.build([closed_box(2.0, diffuser(0.3, 0.6))])
    patches, irradiances = faces(scene, 0.5, 16, 256, seed=20)
    points, normals = np.array([[0, 0, 0], [0.8, 0.5, -0.9]]), np.array([[0, 0, 1], [-0.6, 0, 0.8]])
    c = [
        (pane_transfer(scene, patches, flat(points), flat(normals), rays=1 << 12, seed=r) @ e)
        .numpy().sum(axis=1)
        for r, e in enumerate(irradiances)
    ]  # fmt: skip
    same(c, exact=np.pi * 0.3 / (1 - 0.6), within=0.005)


@pytest.mark.parametrize("is_triangular", [False, True])
def test_a_pane_half_in_shadow_gets_half_the_light_in_each_replicate(same, is_triangular):
    """A sheet close above its western half: at one point of the pane there is all or no light."""
    whole = quad([0, 0, 0], [0, 1, 0], [1, 0, 0])  # its back sees the sky
    east, west = whole[[2, 3, 1]], whole[[0, 1, 3]]
    quads = [np.concatenate([t, t[-1:]]) for t in (east, west)] if is_triangular else [whole]
    sheet = surface(0.0, quad([-9, -9, 1e-3], [0, 19, 0], [9.5, 0, 0]))
    scene = scenes.build([surface(diffuser(0.5), *quads), sheet])
    patches = PanePatches.of([s.quads for s in scene.scattering], 1.0)
    suns = np.tile(DIRECTIONS, (256, 1)) + 1e-6 * np.arange(1280)[:, None]
    suns /= np.linalg.norm(suns, axis=1, keepdims=True)
    deposit = Deposit(scene, suns, 0.5, 1, Accuracy(cell_sky_rays=256), patches)
    faces = [deposit.lit(r).faces for r in range(24)]
    area = patches.area[:, None] / patches.area.sum()
    sky = np.array([(area * E.sky.numpy()[1::2]).sum(axis=0)[1:] for E in faces])
    same(sky, exact=SKY[1:] / 2, within=0.01)
    assert sky.sum(axis=1) == pytest.approx(np.pi / 2, rel=0.03)
    sun = np.array([(area * E.sun.numpy()[1::2]).sum(axis=0) for E in faces])
    same(sun, exact=OMEGA / 2 * suns[:, 2], within=0.01)
    assert sun.mean(axis=1) == pytest.approx((OMEGA / 2 * suns[:, 2]).mean(), rel=0.25)
