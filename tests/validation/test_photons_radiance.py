"""Photons against Radiance's contribution photon map, `mkpmap -apC` with `rcontrib -ap`.

Rationale: it is what the original EvalDRC stood on, and it shares no code with this package.

Method: first the set-up itself against exact answers: the sun through a pane, and its image by a
mirror. Then a room with mirror lamellae, and suns that do not come straight between them:
means over fields of 0.25 m, which our squares tile, and Radiance has 4 × 4 look-ups in each.

Expected: agreement within both errors. Of Radiance's there are two kinds: the spread of maps with
different seeds, and the bias of its density estimate, which has no zero: irradiance by the nearest
photons does not keep the flux. A sensor beside a bright spot finds N photons at a distance r and
takes N / π r² for their density, so the spots grow tails of 1/r², and walls take light away from
sensors near them. The bias is seen in look-ups of 4 times as many photons: their difference is
taken for it (see `within_both`).
"""

from __future__ import annotations

import numpy as np
import pytest

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.geometry import Surface
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute
from tests import radiance, skips
from tests.validation import exact_optics as optics
from tests.validation import lamella_room as room
from tests.validation.radiance_photons import PhotonRoom, modifiers, receivers

pytestmark = skips.RADIANCE.mark

DIAMETER = 0.5
REPEATS = 4


def traced(surfaces, receiver, points, normals, folder) -> PhotonRoom:
    text = radiance.scene_text(surfaces, room.TRANSMISSIVITY) + receivers(receiver)
    return PhotonRoom(text, points, normals, folder, modifiers(surfaces, ["pane"]))


def to_sun(altitude: float, azimuth: float) -> np.ndarray:
    a, z = np.radians([altitude, azimuth])
    return np.array([[np.cos(a) * np.sin(z), np.cos(a) * np.cos(z), np.sin(a)]])


@pytest.mark.slow
def test_the_sun_through_a_pane(tmp_path):
    """A port that is the pane itself: light is attenuated by it once, and not lost or doubled."""
    surfaces = [*room.shell(0, 0, 0), room.casing(0), room.pane()]
    sun = to_sun(30, 180)
    x, y = np.meshgrid(np.linspace(1.7, 2.3, 13), np.linspace(1.6, 2.5, 13))
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 0.8)])
    up = np.tile([0.0, 0, 1], (len(points), 1))
    scene_ = traced(surfaces, room.receiver(), points, up, tmp_path)
    C, _ = scene_.repeated(sun, DIAMETER, REPEATS, count=20_000, bandwidth=100)
    tau, _ = radiance.glass(abs(sun[:, 1]), room.TRANSMISSIVITY)
    exact = float(tau[0]) * optics.seen(sun[0], np.array([0, 0, 1.0]), DIAMETER)
    each = C.mean(axis=(1, 2)) / exact
    error = each.std(ddof=1) / REPEATS**0.5
    assert error < 0.01
    # N − 1 of the N photons are within the radius of the last: some 1/N is the look-up's own.
    assert abs(each.mean() - 1) < 4 * error + 0.01


@pytest.mark.slow
def test_a_mirror_images_the_sun(tmp_path):
    """From a shelf in the room to its ceiling: reflectance and place."""
    shelf = optics.Mirror(room.rectangle((1.5, 0.8, 1), (1, 0, 0), (0, 0.5, 0)), 0.9)
    surfaces = [
        *room.shell(0, 1e-4, 0), room.casing(0), room.pane(),
        Surface("shelf", room.MIRROR, shelf.quad[None], "shelf"),
    ]  # fmt: skip
    sun = to_sun(40, 180)
    x, y = np.meshgrid(np.linspace(1.2, 2.8, 33), np.linspace(2.9, 3.95, 22))
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 2.999)])
    down = np.tile([0.0, 0, -1], (len(points), 1))
    # Photons lie on the ceiling; a receiver just below would have them counted twice.
    scene_ = traced(surfaces, room.receiver(), points, down, tmp_path)
    C, _ = scene_.repeated(sun, DIAMETER, REPEATS, count=40_000, bandwidth=100)
    tau, _ = radiance.glass(abs(sun[:, 1]), room.TRANSMISSIVITY)
    exact = float(tau[0]) * shelf.irradiance(-sun[0], np.array([0, 0, 1.0]), DIAMETER)
    spot = shelf.spot(-sun[0], np.array([0, 0, 3.0]), np.array([0, 0, -1.0]))
    low, high = spot.min(axis=0)[:2], spot.max(axis=0)[:2]
    blur = 0.1
    core = ((points[:, :2] > low + blur) & (points[:, :2] < high - blur)).all(axis=1)
    each = C[:, core].mean(axis=(1, 2)) / exact
    error = each.std(ddof=1) / REPEATS**0.5
    assert error < 0.02
    assert abs(each.mean() - 1) < 4 * error + 0.01
    far = ((points[:, :2] < low - 2 * blur) | (points[:, :2] > high + 2 * blur)).any(axis=1)
    assert C[:, far].mean() < 0.1 * exact


def within_both(ours: np.ndarray, coarse: np.ndarray, fine: np.ndarray, widest: float) -> None:
    """Assert that means agree within 4 standard errors and the bias, sun by sun.

    Parameters
    ----------
    ours, fine, coarse : np.ndarray, shape (replicate, sun)
        `coarse` with 4 times the photons in a look-up, and so twice the blur.
    widest : float
        Largest relative error of the mean over the suns with which this still says something.
    """
    mean = ours.mean(axis=0)
    variance = sum(a.var(axis=0, ddof=1) / len(a) for a in (ours, fine))
    bias = abs(coarse.mean(axis=0) - fine.mean(axis=0))
    error = 4 * np.sqrt(variance) + bias
    off = fine.mean(axis=0) - mean
    print("off by", (off / mean).round(4), "may be", (error / mean).round(4))
    assert error.sum() / mean.sum() < widest
    assert (abs(off) < error).all(), f"off by {off / mean}, may be {error / mean}"


SIDE, FINE = 16, 64
EVEN = slice(5, 8)


@pytest.mark.slow
def test_lamellae(tmp_path):
    """Means over the inner part of the plane, where no wall is near.

    Of the 8 suns in the map, the last three: the mirrors throw nothing of theirs down to the plane.
    Where they do, Radiance's means are 5 to 8 % higher, and depend on its bandwidth.
    """
    backend.select()
    surfaces = [*room.shell(), room.casing(), room.pane(), room.lamellae()]
    built = radiance.with_glass(scene.build(surfaces, ports=(room.port(),)), room.TRANSMISSIVITY)
    directions = room.suns(8, lowest=35.0)
    accuracy = Accuracy(
        replicates=16, photons=1 << 14, paths=4096, cell_size=0.15, cell_sky_rays=1,
        sensor_sky_rays=1, sensor_square=room.SIZE[0] / SIDE,
    )  # fmt: skip
    suns = Suns(tuple(f"sun_{i}" for i in range(8)), directions, DIAMETER)
    C = compute(built, *room.sensors(SIDE), suns, accuracy, subdivision=None)
    ours = C["replicates"].values.reshape(-1, SIDE, SIDE, 8)[:, 2:-2, 2:-2].mean(axis=(1, 2))

    fine = traced(surfaces, room.receiver(), *room.sensors(FINE), tmp_path)
    edge = 2 * FINE // SIDE

    def theirs(bandwidth: int) -> np.ndarray:
        C, _ = fine.repeated(directions, DIAMETER, REPEATS, count=800_000, bandwidth=bandwidth)
        cut = C.reshape(-1, FINE, FINE, 8)[:, edge:-edge, edge:-edge]
        return cut.mean(axis=(1, 2))[:, EVEN]

    within_both(ours[:, EVEN], theirs(200), theirs(50), widest=0.15)
