"""Views of pictures: directions of pixels as Radiance has them, and solid angles that add up."""

from pathlib import Path

import numpy as np
import pytest

from drcmitsuba.picture import PictureView, view
from drcmitsuba.picture.projection import PROJECTIONS
from drcmitsuba.runtime.errors import InputError
from tests import radiance, skips

ANGLES = {"perspective": 90.0, "hemispherical": 180.0, "stereographic": 300.0}


def oblique(kind, **others):
    angle = ANGLES.get(kind, 360.0)
    return PictureView(kind, (1.0, 2.0, -0.5), (0.2, 0.0, 1.0), (angle, 0.8 * angle), **others)


@pytest.mark.parametrize("kind", PROJECTIONS)
def test_directions_of_places_have_these_places(kind):
    x, y = np.random.default_rng(0).uniform(0, 1, (2, 500))
    shown = oblique(kind, shift=0.1, lift=-0.2)
    directions = shown.directions(x, y)
    inside = np.isfinite(directions[:, 0])
    assert inside.sum() > 250
    np.testing.assert_allclose(np.linalg.norm(directions[inside], axis=1), 1)
    back = np.stack(shown.places(3 * directions))[:, inside]
    np.testing.assert_allclose(back, np.stack([x, y])[:, inside], atol=1e-7)


@pytest.mark.parametrize("kind", [k for k in PROJECTIONS if k != "equisolid"])
@skips.RADIANCE.mark
def test_pixels_look_where_those_of_radiance_look(kind, tmp_path):
    shown = oblique(kind, shift=0.1, lift=-0.2)
    size = ["-pa", "0", "-x", "23", "-y", "17"]
    rays = radiance.run(["vwrays", "-fd", *shown.options().split(), *size], tmp_path)
    theirs = np.frombuffer(rays).reshape(17, 23, 6)[..., 3:]
    ours = shown.pixel_directions(17, 23)
    seen = np.linalg.norm(theirs, axis=-1) > 0.5
    np.testing.assert_array_equal(np.isfinite(ours[..., 0]), seen)
    np.testing.assert_allclose(ours[seen], theirs[seen], atol=2e-6)


@pytest.mark.parametrize(
    ("kind", "angle", "omega"),
    [
        ("hemispherical", 180, 2 * np.pi),
        ("hemispherical", 120, None),
        ("perspective", 90, 4 * np.pi / 6),
        ("equidistant", 360, 4 * np.pi),
        ("equisolid", 360, 4 * np.pi),
    ],
)
def test_solid_angles_add_up_to_that_of_the_picture(kind, angle, omega):
    shown = PictureView(kind, angles=(angle, angle))
    pixels = shown.solid_angles(301, 300)
    if omega is None:  # the square inscribed in the circle of 180°, by the integral of 1/cos
        u = (np.arange(2000) + 0.5) / 1000 - 1
        u = u * np.sin(np.radians(angle / 2))
        shown_at = 1 - u**2 - u[:, None] ** 2
        omega = np.where(shown_at > 0, 1 / np.sqrt(np.maximum(shown_at, 1e-12)), 0).sum()
        omega *= (u[1] - u[0]) ** 2
        assert pixels.sum() == pytest.approx(omega, rel=5e-3)
    else:
        assert pixels.sum() == pytest.approx(omega, rel=1e-4)


@pytest.mark.parametrize("kind", ["hemispherical", "equidistant", "equisolid", "stereographic"])
def test_the_cosine_of_half_a_sphere_adds_up_to_pi(kind):
    shown = PictureView(kind)
    cosine = np.nan_to_num(shown.pixel_directions(400, 400) @ shown.frame[2])
    projected = (shown.solid_angles(400, 400) * np.maximum(cosine, 0)).sum()
    assert projected == pytest.approx(np.pi, rel=3e-4)


@pytest.mark.parametrize("kind", view.KINDS)
def test_options_of_a_view_give_it_back(kind):
    shown = PictureView(kind, (1, 2, 0), (0, 0, 1), (100, 60), (1, -2, 3), 0.25, -0.5)
    assert view.from_options(shown.options(), Path("a.vf")) == shown


@pytest.mark.parametrize(
    ("fields", "complaint"),
    [
        ({"kind": "round"}, "kind: 'round'"),
        ({"kind": "perspective", "angles": (180, 90)}, "angles: 180 by 90"),
        ({"kind": "hemispherical", "angles": (181, 90)}, "angles: 181 by 90"),
        ({"kind": "equidistant", "angles": (0, 90)}, "angles: 0 by 90"),
        ({"kind": "equidistant", "direction": (0, 0, -1)}, "up: direction (0, 0, -1)"),
        ({"kind": "equidistant", "up": (0, 0, 0)}, "up (0, 0, 0)"),
        ({"kind": "equidistant", "position": (0, 0, np.inf)}, "position"),
    ],
)
def test_an_unfit_view_is_refused_in_one_line(fields, complaint):
    with pytest.raises(InputError) as error:
        PictureView(**fields)
    assert complaint in str(error.value)
    assert "\n" not in str(error.value)


def test_pixels_of_a_parallel_view_have_no_directions_here():
    with pytest.raises(InputError, match="parallel"):
        PictureView("parallel", angles=(4, 3)).solid_angles(3, 4)
