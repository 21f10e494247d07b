"""The sensor `fisheye`: its pixels look where those of pictures do, and see what is there."""

import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.picture import PictureView
from drcmitsuba.runtime import backend

KINDS = {"hemispherical": 180.0, "equidistant": 360.0, "equisolid": 360.0}
AT, ALONG, UP = (1.0, 2.0, 3.0), (1.0, -2.0, 0.5), (0.1, 0.0, 1.0)


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


def camera(mapping, angle=180.0, angle_up=None, size=(40, 30), **film):
    target = tuple(np.add(AT, ALONG))
    return mi.load_dict({
        "type": "fisheye", "mapping": mapping, "angle": angle, "angle_up": angle_up or angle,
        "to_world": mi.ScalarTransform4f().look_at(origin=AT, target=target, up=UP),
        "film": {"type": "hdrfilm", "width": size[0], "height": size[1],
                 "pixel_format": "luminance", "rfilter": {"type": "box"}, **film},
    })  # fmt: skip


def rays(sensor, places):
    """Directions (n, 3) and weights (n,) of places (n, 2) of the film."""
    ray, weight = sensor.sample_ray(0.0, 0.5, mi.Point2f(*np.float32(places).T), mi.Point2f(0))
    return ray, np.broadcast_to(np.array(weight)[0], len(places))


@pytest.mark.parametrize("angle_up", [1.0, 0.6])
@pytest.mark.parametrize("kind", KINDS)
def test_pixels_look_where_radiance_has_them(kind, angle_up):
    # `PictureView` agrees with Radiance's vwrays, see test_picture_views.
    angles = (KINDS[kind], KINDS[kind] * angle_up)
    view = PictureView(kind, ALONG, UP, angles, AT)
    x, y = np.random.default_rng(0).uniform(0, 1, (2, 1000))
    wanted = view.directions(x, 1 - y)
    ray, weight = rays(camera(kind, *angles), np.stack([x, y], axis=1))
    seen = np.isfinite(wanted[:, 0])
    np.testing.assert_array_equal(weight, seen)
    np.testing.assert_allclose(np.array(ray.d).T[seen], wanted[seen], atol=2e-5)
    np.testing.assert_allclose(np.array(ray.o).T.reshape(-1, 3)[0], AT, atol=1e-6)
    back = np.stack(view.places(np.array(ray.d).T[seen]))
    np.testing.assert_allclose(back, np.stack([x, 1 - y])[:, seen], atol=2e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_light_from_everywhere_adds_up_to_pi(kind):
    size = (200, 200)
    scene = mi.load_dict({
        "type": "scene", "light": {"type": "constant", "radiance": 1.0},
        "camera": camera(kind, size=size),
    })  # fmt: skip
    picture = mi.render(scene, integrator=mi.load_dict({"type": "path"}), spp=4).numpy()[..., 0]
    view = PictureView(kind, ALONG, UP)
    cosine = np.nan_to_num(view.pixel_directions(*size) @ view.frame[2])
    total = (picture * np.maximum(cosine, 0) * view.solid_angles(*size)).sum()
    assert total == pytest.approx(np.pi, rel=2e-3)


def test_a_part_of_the_film_shows_that_part_of_the_picture():
    whole = camera("equidistant")
    part = camera("equidistant", crop_offset_x=10, crop_offset_y=6, crop_width=20, crop_height=12)
    places = np.random.default_rng(1).uniform(0, 1, (50, 2))
    inner, _ = rays(part, places)
    outer, _ = rays(whole, (places * [20, 12] + [10, 6]) / [40, 30])
    np.testing.assert_allclose(np.array(inner.d), np.array(outer.d), atol=1e-6)


def test_rays_of_neighbouring_pixels_are_those_of_the_pixels():
    sensor = camera("equisolid")
    places = np.random.default_rng(2).uniform(0.2, 0.7, (50, 2))
    ray, _ = sensor.sample_ray_differential(
        0.0, 0.5, mi.Point2f(*np.float32(places).T), mi.Point2f(0)
    )
    right, _ = rays(sensor, places + [1 / 40, 0])
    down, _ = rays(sensor, places + [0, 1 / 30])
    np.testing.assert_allclose(np.array(ray.d_x), np.array(right.d), atol=1e-6)
    np.testing.assert_allclose(np.array(ray.d_y), np.array(down.d), atol=1e-6)


def test_the_camera_may_turn_and_move():
    sensor = camera("equidistant")
    parameters = mi.traverse(sensor)
    parameters["to_world"] = mi.Transform4f().look_at([0, 0, 0], [0, 1, 0], [0, 0, 1])
    parameters.update()
    ray, _ = rays(sensor, [[0.5, 0.5], [0.75, 0.5], [0.5, 0.25]])
    wanted = [[0, 1, 0], [np.sqrt(0.5), np.sqrt(0.5), 0], [0, np.sqrt(0.5), np.sqrt(0.5)]]
    np.testing.assert_allclose(np.array(ray.d).T, wanted, atol=1e-5)


def test_the_sensor_renders_in_every_variant():
    present = {"llvm": bool(backend.llvm_version()), "cuda": backend.cuda_available()}
    names = [v for v in mi.variants() if present.get(v[:4]) and not v.endswith("polarized")]
    assert names
    for name in names:
        mi.set_variant(name)
        scene = mi.load_dict({
            "type": "scene", "light": {"type": "constant"}, "camera": camera("hemispherical"),
        })  # fmt: skip
        picture = mi.render(scene, integrator=mi.load_dict({"type": "direct"}), spp=16).numpy()
        centre, corner = picture[10:20, 15:25].mean(), picture[0, 0].mean()
        assert centre == pytest.approx(1, rel=1e-3)
        assert corner == 0


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"mapping": "round"}, "fisheye: mapping: 'round'"),
        ({"mapping": "hemispherical", "angle": 200.0}, "fisheye: angle: 200"),
        ({"angle": 0.0}, "fisheye: angle: 0"),
        ({"angle_up": float("nan")}, "fisheye: angle_up: nan"),
    ],
)
def test_unfit_parameters_are_named(values, complaint):
    with pytest.raises(Exception, match=complaint):
        mi.load_dict({"type": "fisheye", **values})
