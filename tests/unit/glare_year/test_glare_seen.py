"""What an eye sees: exact luminances and images of suns, and the illuminance of all of them."""

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins.patches import patch_index
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.glare_year.eyes import eyes
from drcmitsuba.glare_year.pixels import rays
from drcmitsuba.glare_year.rule import Rule
from drcmitsuba.glare_year.state import at_eyes, places
from drcmitsuba.picture.glare import glare
from drcmitsuba.picture.picture import Picture
from drcmitsuba.picture.position_index import position_index
from drcmitsuba.picture.view import PictureView
from drcmitsuba.plan import plan
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.sky.daylight import daylight
from tests.unit.glare_year.glare_room import by_suns, case_in, sum_over

WINDOW = np.array([[0.1, 3.9], [1.0, 2.5]])
"""Ends of the pane along x and z [m]: the frame is 0.1 m wide."""
EYE = np.array([2.0, 1.8, 1.2])
NORMAL, TAU, EXPONENT = np.array([0, -1.0, 0]), 0.7, 4.5


@pytest.fixture(scope="module")
def office(tmp_path_factory):
    """Case, daylight, eyes and the open state of the façade."""
    return seen_in(tmp_path_factory.mktemp("office"))


def seen_in(folder, more=""):
    case = case_in(folder, more=more)
    backend.select()
    light, looking = daylight(case), eyes(case)
    run = Run.of(case, plan(case, light).scope)
    illuminance = at_eyes(case, "open", light, looking, run)
    (place,) = places(case, "open", light, looking, run)
    return case, light, looking, place, illuminance


def all_of(known, L):
    """Surfaces that have one luminance at all hours [cd/m²]."""
    shape = len(known.seen.surfaces.points), len(known.sky)
    point, time = (index.ravel() for index in np.indices(shape))
    values = np.full(len(point), L, np.float32)
    return replace(known.surfaces, point=point, time=time, luminance=values)


def through(d):
    """Transmittance of the pane for directions, and whether they meet it from the eye."""
    cosine = d @ NORMAL
    at = EYE + d * np.divide(EYE[1], cosine, out=np.zeros_like(cosine), where=cosine > 0)[:, None]
    met = (cosine > 0) & np.all((at[:, ::2] > WINDOW[:, 0]) & (at[:, ::2] < WINDOW[:, 1]), axis=1)
    return np.where(met, TAU * (1 - (1 - cosine) ** EXPONENT), 0)


def test_the_sky_is_seen_through_the_pane_with_its_transmittance(office):
    _, light, _, place, _ = office
    known = place.known
    L, seen = known.at(np.arange(6)), known.seen
    tau = through(seen.directions)
    outside = np.flatnonzero(tau > 0)
    assert len(outside) > 500
    ground = outside[seen.directions[outside, 2] < 0]
    np.testing.assert_allclose(
        L[ground], tau[ground, None] * light.sky["sky"].values[:, 0], rtol=1e-3
    )
    ones = np.ones((len(seen.directions), 1))
    for forward in office[2].forward:
        assert sum_over(seen, ones, forward) == pytest.approx(np.pi, rel=4e-3)  # pixels have a size


@pytest.mark.parametrize("off", ["", "sky", "ground", "suns"])
def test_pixels_and_suns_add_up_to_the_illuminance_at_the_eye(office, off, tmp_path):
    """Also where a source is left out, which then is not seen either."""
    shown = seen_in(tmp_path, f'[effects]\n{off} = "off"\n') if off else office
    _, _, looking, place, illuminance = shown
    known = place.known
    L = known.at(np.arange(6))
    for i, forward in enumerate(looking.forward):
        Ev = illuminance[:, :, i]
        error = Ev.std(axis=0, ddof=1) / np.sqrt(len(Ev))
        difference = sum_over(known.seen, L, forward) + by_suns(known, forward) - Ev.mean(axis=0)
        # 4 replicates; a pixel's edge may lie 2 % beside that of the window.
        assert (np.abs(difference) < 5 * error + 0.02 * Ev.mean(axis=0)).all()
        assert abs(difference.sum()) < 0.01 * Ev.mean(axis=0).sum() + 5 * np.hypot.reduce(error)


@pytest.mark.parametrize("place", [(0, 0), (1.5, 1.5), (-2, 2)])
def test_no_ray_leaves_a_closed_room_at_its_corners(place):
    """From a diagonal of a square room, many rays would meet a corner in one upright line."""
    backend.select()
    case = Case.model_validate(
        {
            "room": {"size": [6.0, 6.0, 3.0]},
            "sensors": {"corner": [1, 1, 0.8], "count": [2, 2], "spacing": 1.0},
        }
    )
    eye = np.array([3 + place[0], 3 + place[1], 1.2])
    every = np.concatenate([rays(np.array([[0, y, 0.0]])).directions for y in (1, -1)])
    d = mi.Vector3f(*every.T.astype(np.float32))
    met = scene.load(case).full.ray_intersect(mi.Ray3f(mi.Point3f(*map(float, eye)), d))
    assert dr.all(met.is_valid())


def test_the_sun_is_seen_through_the_pane_as_a_disk(office):
    case, light, _, place, _ = office
    known = place.known
    suns = light.sky["sun_direction"].values[light.sky["sun"].values > 0]
    images, omega = known.seen.images, disk_solid_angle(case.outside.sun_diameter)
    tau = through(suns)
    whole = images.solid_angle > 0.999 * omega
    assert whole.any()
    assert set(images.sun[whole]) == set(np.flatnonzero(tau > 0))
    np.testing.assert_allclose(images.transmittance, tau[images.sun], rtol=2e-3)
    np.testing.assert_allclose(images.direction, suns[images.sun], atol=1e-6)


def test_the_sun_right_behind_the_glass_has_the_dgp_of_its_formula(office):
    """With a black sky, the disk alone is the source: DGP follows from τ, Ω and E_v."""
    case, light, _, place, _ = office
    hour = int(np.flatnonzero(through(light.sky["sun_direction"].values) > 0)[0])
    sun = light.sky["sun_direction"].values[hour]
    right = np.cross(sun, [0, 0, 1]) / np.linalg.norm(np.cross(sun, [0, 0, 1]))
    frame = np.array([right, np.cross(right, sun), sun])
    dark = replace(place.known, sky=0 * place.known.sky, surfaces=all_of(place.known, 0))
    toward = replace(place.known.seen, frames=frame[None])
    at_sun = replace(place, known=replace(dark, seen=toward), views=np.array([0]))
    sums, _ = at_sun.sums(Rule(), np.array([hour]))
    L = light.sky["sun"].values[hour] * through(sun[None])[0]
    omega = disk_solid_angle(case.outside.sun_diameter)
    np.testing.assert_allclose(sums, L**2 * omega, rtol=5e-3)
    Ev = np.array([L * omega])
    contrast = np.log10(1 + L**2 * omega / Ev**1.87)
    value = np.clip(5.87e-5 * Ev + 0.092 * contrast + 0.159, 0, 1)
    np.testing.assert_allclose(Rule().dgp(Ev, sums[0]), value, rtol=1e-3)


def test_dgp_is_that_of_full_pictures(office):
    """Pictures made from the window's edges, whose sources are joined pixel by pixel."""
    case, light, looking, place, illuminance = office
    size = 512
    dim = replace(place.known, surfaces=all_of(place.known, 100))
    ours, _ = replace(place, known=dim).sums(Rule(), np.arange(6))
    Ev = illuminance.mean(axis=0)
    for v, frame in enumerate(looking.frames):
        view = PictureView("equidistant", tuple(frame[2]), tuple(frame[1]))
        d = view.pixel_directions(size, size)
        inside = np.isfinite(d).all(axis=-1)
        flat = np.where(inside[..., None], d, frame[2]).reshape(-1, 3)
        tau = through(flat).reshape(size, size)
        bins = patch_index(mi.Vector3f(flat.T.astype(np.float32)), case.sky.subdivision).numpy()
        for hour in range(6):
            L = tau * light.sky["sky"].values[hour][bins].reshape(size, size) + 100
            seen = glare(Picture(np.repeat(L[..., None], 3, 2).astype(np.float32), view))
            s = seen.sources
            theirs = float((s.luminance**2 * s.solid_angle / s.position_index**2).sum())
            suns = place.known.seen.images
            mine = suns.sun == place.known.sun_index[hour]
            shown = suns.transmittance[mine] * place.known.sun[hour]
            local = suns.direction[mine] @ frame.T
            disk = shown**2 * suns.solid_angle[mine] / position_index(local) ** 2
            theirs += disk[local[:, 2] > 0].sum()
            expected = Rule().dgp(Ev[hour, v], np.array(theirs))
            assert Rule().dgp(Ev[hour, v], ours[hour, v]) == pytest.approx(expected, abs=0.005)
