"""Patches, DAYSIM's hours and the mesh stand for the sun."""

import numpy as np
import pytest
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.sky.sun import declination_and_hour, direction_of_hour
from drcmitsuba.sky.sun_models import (
    Blend,
    Suns,
    between_daysim_suns,
    mesh,
    moved_to_patch,
    spread_over_patches,
)
from drcmitsuba.sky.sun_models.daysim import DECLINATIONS

RNG = np.random.default_rng(0)
DIAMETER = 0.5


def sky_directions(n):
    d = RNG.normal(size=(n, 3))
    d[:, 2] = abs(d[:, 2])
    return d / np.linalg.norm(d, axis=1, keepdims=True)


DIRECTIONS = sky_directions(500)
UP = np.arange(500) % 7 > 0
"""Every seventh sun is taken to be below the horizon."""


# ---- equator ----------------------------------------------------------------------------------


def test_noon_at_an_equinox_is_as_high_as_the_equator():
    d = direction_of_hour(46.25, np.array(0.0), np.array([0.0, 90.0, -90.0]))
    altitude = np.degrees(np.arcsin(d[:, 2]))
    np.testing.assert_allclose(altitude, [90 - 46.25, 0, 0], atol=1e-12)
    np.testing.assert_allclose(d[1], [-1, 0, 0], atol=1e-12)  # the afternoon's sun is in the west
    assert d[0, 1] < 0  # south


@pytest.mark.parametrize("latitude", [-60.0, 0.0, 46.25, 89.0])
def test_declination_and_hour_invert_direction(latitude):
    declination, hour = declination_and_hour(latitude, DIRECTIONS)
    np.testing.assert_allclose(
        direction_of_hour(latitude, declination, hour), DIRECTIONS, atol=1e-12
    )


# ---- patches ----------------------------------------------------------------------------------


@pytest.mark.parametrize("subdivision", [1, 2, 4])
def test_spread_suns_keep_their_light(subdivision):
    patches = Patches(subdivision)
    blend = spread_over_patches(DIRECTIONS, UP, patches, DIAMETER)
    at = {label: i for i, label in enumerate(patches.labels)}
    bins = np.vectorize(lambda b: at.get(b, 0))(blend.bins)
    flux = (blend.weights * patches.solid_angles[bins]).sum(axis=1)
    np.testing.assert_allclose(flux, UP * disk_solid_angle(DIAMETER), rtol=1e-12)
    assert (blend.bins[~UP] == "").all()
    assert "ground" not in blend.bins


def test_a_sun_in_a_patch_centre_has_weights_of_the_formula():
    patches = Patches(1)
    d = patches.directions[[40]]
    blend = spread_over_patches(d, np.array([True]), patches, DIAMETER)
    cosines = np.sort(patches.directions[1:] @ d[0])[::-1][:4]
    near = 1 / (1.002 - cosines)
    share = near / near.sum()
    assert blend.bins[0, 0] == patches.labels[40]
    solid_angle = disk_solid_angle(DIAMETER) / patches.solid_angles[40]
    assert blend.weights[0, 0] == pytest.approx(share[0] * solid_angle)


def test_moved_suns_stand_in_the_nearest_centre_and_are_listed_once():
    suns, blend = moved_to_patch(DIRECTIONS, UP, DIAMETER)
    assert len(set(suns.labels)) == len(suns.labels)
    place = dict(zip(suns.labels, suns.directions, strict=True))
    moved = np.array([place[b] for b in blend.bins[UP, 0]])
    every = Patches(6).directions[1:]
    best = (DIRECTIONS[UP] @ every.T).max(axis=1)
    np.testing.assert_allclose((moved * DIRECTIONS[UP]).sum(axis=1), best, rtol=1e-12)
    assert np.degrees(np.arccos(best.min())) < 2  # patches of MF 6 are 2° high
    assert (blend.weights[~UP] == 0).all()


# ---- DAYSIM -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("latitude", "count"),
    [(46.25, 65), (47.4, 65), (0, 65), (1.4, 65), (33, 63), (42, 63), (60, 61)],
)
def test_daysim_has_as_many_suns_as_the_original(latitude, count):
    suns, _ = between_daysim_suns(np.zeros((0, 3)), np.zeros(0, bool), latitude, DIAMETER)
    assert len(suns.labels) == len(suns.directions) == count
    assert np.degrees(np.arcsin(suns.directions[:, 2].min())) == pytest.approx(2)


def test_a_sun_of_daysim_is_itself_and_one_between_is_near_its_mean():
    march = DECLINATIONS[2]
    d = direction_of_hour(46.25, np.array([march, 5.0]), np.array([30.0, 37.0]))
    suns, blend = between_daysim_suns(d, np.ones(2, bool), 46.25, DIAMETER)
    place = dict(zip(suns.labels, suns.directions, strict=True))
    mean = np.array([[place[b] for b in row] for row in blend.bins])
    mean = (mean * blend.weights[..., None]).sum(axis=1)
    np.testing.assert_allclose(mean[0], d[0], atol=1e-12)
    assert blend.weights[0].max() == pytest.approx(1)
    assert mean[1] @ d[1] / np.linalg.norm(mean[1]) > np.cos(np.radians(0.3))
    np.testing.assert_allclose(blend.weights.sum(axis=1), 1)


@pytest.mark.parametrize("latitude", [-90.0, -66.0, 71.0, 90.0])
def test_daysim_has_suns_for_polar_days_and_nights(latitude):
    possible = mesh.possible_suns(latitude)
    up = np.ones(len(possible), bool)
    suns, blend = between_daysim_suns(possible, up, latitude, DIAMETER)
    np.testing.assert_allclose(blend.weights.sum(axis=1), 1)
    assert set(blend.bins.ravel()) <= set(suns.labels)


# ---- mesh -------------------------------------------------------------------------------------


@pytest.mark.parametrize("level", [3, 5, 7])
def test_triangles_hold_their_directions(level):
    corners, weights = mesh.triangles(DIRECTIONS, level)
    uv = DIRECTIONS[:, :2] / abs(DIRECTIONS).sum(axis=1, keepdims=True)
    between = (corners / 128 * weights[..., None]).sum(axis=1)
    np.testing.assert_allclose(between, uv, atol=1e-12)
    assert weights.min() > -1e-12
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    assert abs(corners).sum(axis=2).max() <= 128  # none below the horizon


def test_the_edges_of_the_mesh_are_as_long_as_promised():
    corners = mesh.directions_of(mesh.triangles_of(DIRECTIONS, 5)[0])
    edge = np.degrees(np.arccos((corners[:, 0] * corners[:, 1]).sum(axis=1).clip(-1, 1)))
    assert 1.5 < edge.min() < 2.8 < edge.max() < 5


def test_the_zenith_and_the_horizon_are_in_the_mesh():
    d = np.array([[0, 0, 1.0], [1, 0, 0], [0, -1, 0], [-np.sqrt(0.5), np.sqrt(0.5), 0]])
    nodes = mesh.nodes_of(d, 3)
    blend = mesh.blend(d, np.ones(4, bool), [mesh.label(n) for n in nodes])
    np.testing.assert_allclose(blend.weights.max(axis=1), 1)
    at = [mesh.node(bins[k]) for bins, k in zip(blend.bins, blend.weights.argmax(1), strict=True)]
    np.testing.assert_allclose(mesh.directions_of(np.array(at)), d, atol=1e-12)


def test_a_blend_takes_the_finest_triangle_that_is_whole():
    coarse = mesh.triangles_of(DIRECTIONS, 3)[0].reshape(-1, 2)
    fine = mesh.triangles_of(DIRECTIONS[:1], 6)[0].reshape(-1, 2)
    labels = [mesh.label(n) for n in np.unique(np.concatenate([coarse, fine]), axis=0)]
    blend = mesh.blend(DIRECTIONS, UP | True, [*labels, "sun_2015-01-01T10:00", "sky_001"])
    assert set(blend.bins[0]) == {mesh.label(n) for n in fine}
    assert set(blend.bins[1]) == {mesh.label(n) for n in mesh.triangles(DIRECTIONS[[1]], 3)[0][0]}


def test_interpolation_is_exact_for_a_constant_and_second_order_for_what_is_smooth():
    errors = []
    for level in (3, 4):
        nodes = mesh.nodes_of(DIRECTIONS, level)
        labels = [mesh.label(n) for n in nodes]
        value = dict(zip(labels, np.exp(mesh.directions_of(nodes)[:, 0]), strict=True))
        blend = mesh.blend(DIRECTIONS, UP, labels)
        blended = (
            np.vectorize(lambda b, value=value: value.get(b, 0.0))(blend.bins) * blend.weights
        ).sum(axis=1)
        errors.append(abs(blended - np.exp(DIRECTIONS[:, 0]))[UP].max())
        np.testing.assert_allclose(blend.weights.sum(axis=1), UP)
    assert errors[1] < 0.35 * errors[0]


def test_no_mesh_no_bins():
    blend = mesh.blend(DIRECTIONS, UP, ["sky_001"])
    assert (blend.bins == "").all()
    assert (blend.weights == 0).all()


@pytest.mark.parametrize("latitude", [-35.0, 0.0, 46.25, 80.0])
def test_possible_suns_stay_between_the_tropics(latitude):
    d = mesh.possible_suns(latitude)
    declination, _ = declination_and_hour(latitude, d)
    assert abs(declination).max() <= mesh.OBLIQUITY + mesh.MARGIN + 1e-9
    assert d[:, 2].min() >= 0


@pytest.mark.parametrize("latitude", [-90.0, -35.0, 0.0, 12.0, 39.0, 40.42, 55.5, 62.0, 66.0, 90.0])
def test_the_mesh_holds_every_sun_of_a_place(latitude):
    nodes = mesh.nodes_of(mesh.possible_suns(latitude), mesh.COARSEST)
    assert abs(nodes).sum(axis=1).max() <= 128  # none below the horizon
    declination = RNG.uniform(-mesh.OBLIQUITY, mesh.OBLIQUITY, 100_000)
    d = direction_of_hour(
        latitude + RNG.uniform(-0.5, 0.5), declination, RNG.uniform(-180, 180, 100_000)
    )
    d = d[d[:, 2] > 0]
    blend = mesh.blend(d, np.ones(len(d), bool), list(map(mesh.label, nodes)))
    np.testing.assert_allclose(blend.weights.sum(axis=1), 1)


# ---- labels -----------------------------------------------------------------------------------


def test_only_named_suns_are_kept():
    suns = Suns(("a", "b", "c"), np.eye(3), DIAMETER, straight=False)
    kept = suns.only(np.array(["c", "a", "z"], dtype=object))
    assert kept.labels == ("a", "c")
    np.testing.assert_array_equal(kept.directions, np.eye(3)[[0, 2]])
    assert not kept.straight


def test_every_time_stamp_has_its_own_sun_or_none():
    blend = Blend.own(np.array(["sun_1", "", "sun_2"]))
    assert blend.bins[:, 0].tolist() == ["sun_1", "", "sun_2"]
    assert blend.weights[:, 0].tolist() == [1, 0, 1]
