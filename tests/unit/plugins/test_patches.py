"""Sky patches against Radiance's tables, and the look-up in Dr.Jit against the patches' bounds."""

import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins.patches import Patches, patch_index

from drcmitsuba.runtime import backend
from tests import REFERENCE


@pytest.fixture(scope="module", autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


def look_up(directions, subdivision):
    d = mi.Vector3f(np.ascontiguousarray(directions.T, dtype=np.float32))
    return np.array(patch_index(d, subdivision))


def direction(altitude, azimuth):
    return np.stack(
        [
            np.cos(altitude) * np.sin(azimuth),
            np.cos(altitude) * np.cos(azimuth),
            np.sin(altitude),
        ],
        axis=-1,
    )


@pytest.mark.parametrize("subdivision", [1, 2])
def test_patches_are_those_of_radiance(subdivision):
    rings = np.genfromtxt(REFERENCE / "reinhart.csv", delimiter=",", names=True)
    rings = rings[rings["subdivision"] == subdivision]
    counts = rings["patches"].astype(int)
    table, patches = rings.repeat(counts), Patches(subdivision)
    assert len(patches) == 1 + len(table)
    np.testing.assert_allclose(patches.solid_angles[1:], table["solid_angle_sr"], atol=6e-9)
    # Patches of a ring begin in the north and go on by the east.
    azimuth = np.concatenate([np.arange(n) * 2 * np.pi / n for n in counts])
    theirs = direction(np.radians(table["centre_deg"]), azimuth)
    np.testing.assert_allclose(patches.directions[1:], theirs, atol=2e-8)
    low, high, west, east = np.degrees(patches.bounds[1:].T)
    np.testing.assert_allclose(low, table["low_deg"], atol=1e-6)
    np.testing.assert_allclose(high, table["high_deg"], atol=1e-6)
    np.testing.assert_allclose(east - west, 360 / table["patches"], atol=1e-6)


@pytest.mark.parametrize("subdivision", range(1, 7))
def test_solid_angles_fill_the_hemispheres(subdivision):
    patches = Patches(subdivision)
    assert len(patches) == 2 + 144 * subdivision**2
    assert patches.solid_angles[1:].sum() == pytest.approx(2 * np.pi, rel=1e-13)
    assert patches.solid_angles[0] == pytest.approx(2 * np.pi, rel=1e-13)
    assert patches.projected_solid_angles[1:].sum() == pytest.approx(np.pi, rel=1e-13)
    assert patches.projected_solid_angles[0] == pytest.approx(np.pi, rel=1e-13)


def test_labels():
    assert Patches().labels[:2] == ["ground", "sky_001"]
    assert Patches().labels[-1] == "sky_145"
    assert len(set(Patches(4).labels)) == len(Patches(4)) == 2306


@pytest.mark.parametrize("subdivision", range(1, 7))
def test_every_centre_is_in_its_own_patch(subdivision):
    patches = Patches(subdivision)
    np.testing.assert_array_equal(look_up(patches.directions, subdivision), np.arange(len(patches)))


@pytest.mark.parametrize("subdivision", [1, 2, 3, 4])
def test_random_directions_close_to_borders(subdivision):
    """Just inside each patch's four borders, by more than float32 can lose."""
    patches = Patches(subdivision)
    rng = np.random.default_rng(subdivision)
    low, high, west, east = patches.bounds[1:].T
    inset = 2e-6
    index = np.arange(1, len(patches))
    for side in range(4):
        altitude = rng.uniform(low + inset, high - inset)
        azimuth = rng.uniform(west + inset, east - inset)
        if side == 0:
            altitude = low + inset
        elif side == 1:
            altitude = high - inset
        elif side == 2:
            azimuth = west + inset / np.cos(altitude)
        else:
            azimuth = east - inset / np.cos(altitude)
        np.testing.assert_array_equal(look_up(direction(altitude, azimuth), subdivision), index)


def test_zenith_horizon_and_below():
    d = np.array([[0, 0, 1], [0, 1, 0], [0, -1, 0], [0, 0, -1], [0, 1, -1e-6]], dtype=float)
    np.testing.assert_array_equal(look_up(d, 1), [145, 1, 16, 0, 0])


def test_frequency_of_uniform_directions_is_the_solid_angle():
    rng = np.random.default_rng(5)
    n = 400_000
    z, azimuth = rng.uniform(-1, 1, n), rng.uniform(0, 2 * np.pi, n)
    counts = np.bincount(look_up(direction(np.arcsin(z), azimuth), 1), minlength=146)
    expected = Patches().solid_angles / (4 * np.pi) * n
    chi2 = ((counts - expected) ** 2 / expected).sum()
    assert chi2 < 145 + 4 * np.sqrt(2 * 145)


@pytest.mark.parametrize("subdivision", [0, 7])
def test_unknown_subdivision_is_refused(subdivision):
    with pytest.raises(ValueError, match="1 to 6"):
        Patches(subdivision)
