"""BSDFs under grazing light: energy, densities, and films that are seen at a grazing angle."""

import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins import bsdf_file
from drcmitsuba_plugins.bsdf_file import Swapped

from drcmitsuba.runtime import backend
from drcmitsuba.scene.sensors import sensor_points
from tests.fast import slowly
from tests.hard.bsdf_cases import BINS, FLOAT, MODES, coefficients, lambertian, load, room, values
from tests.unit.plugins.test_measured import (
    IMPORTANCE,
    RADIANCE,
    draw,
    write,
)


@pytest.fixture(autouse=True, scope="module")
def _backend():
    backend.select()


ANGLES = np.array([80.0, 89.0, 89.9, 89.99, 89.999])


def most(file, mode, w):
    """Albedo bound of directions (n, 3) of the file's frame: of light in, or of light out."""
    if mode == IMPORTANCE:
        return np.sum(file.hemispherical(w), axis=0)
    total = np.zeros(len(w))
    for name, from_side, to_side in (("tf", 1, -1), ("tb", -1, 1), ("rf", 1, 1), ("rb", -1, -1)):
        mine = w[:, 2] * to_side > 0
        component = file.component(name)
        if not mine.any() or component is None:
            continue
        assert from_side
        if isinstance(component, Swapped):
            total[mine] += component.tree.hemispherical(w[mine])
        elif hasattr(component, "rank"):
            total[mine] += Swapped(component).hemispherical(w[mine])
        else:
            total[mine] += component.reversed().hemispherical(w[mine])
    return total


@MODES
@pytest.mark.parametrize("side", [1, -1], ids=["room", "outside"])
@pytest.mark.parametrize(
    "kind", slowly(["TensorTree4", "TensorTree3", "LBNL/Klems Full"], "TensorTree4")
)
def test_grazing_incidence(kind, side, mode, tmp_path, holds):
    """cos θ of 1.7e-5: a weight is f cos / density, and both go to 0."""
    path = write(tmp_path, kind)
    bsdf, file = load(path, straight_through="off"), bsdf_file.read(path)
    # Between two cells' borders, which all directions near the horizon would fall upon.
    phi = np.radians([10.0, 280.0])
    theta, phi = (a.ravel() for a in np.meshgrid(np.radians(ANGLES), phi))
    wi = np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), side * np.cos(theta)], -1
    )
    # Isotropic trees' columns vary within a cell: weights between 0 and 2 of the middle one's.
    slack = 2.0 if kind == "TensorTree3" and mode == RADIANCE else 1.0
    bound = most(file, mode, wi)
    assert bound.max() > 0
    for d, albedo in zip(wi, bound, strict=True):
        bs, weight = draw(bsdf, d, mode, 4000)
        wo, weight, pdf = np.array(bs.wo).T, weight[0].numpy(), bs.pdf.numpy()
        assert np.isfinite(wo).all()
        assert (weight >= 0).all()
        assert (pdf >= 0).all()
        near = 1e-2 if slack > 1 else 1e-4
        holds("weight beyond the albedo", max(0, weight.max() - slack * albedo * (1 + near)), FLOAT)
        f, density = values(bsdf, mode, np.broadcast_to(d, wo.shape), wo)
        kept = weight > 0
        # The direction is rounded on its way to the local frame and back: it may change its cell.
        off = abs(density[kept] / pdf[kept] - 1) > 1e-3
        holds("samples whose density is another one", off.mean() if kept.any() else 0, 0.02)
        rest = ~off
        again = f[kept][rest] / pdf[kept][rest]
        if rest.any():
            holds("eval / pdf = weight", abs(again / weight[kept][rest] - 1).max(), 2e-3)
        grazing = d * [-1, -1, 1]
        for other in (grazing, -grazing):
            f, density = values(bsdf, mode, d[None], other[None])
            assert np.isfinite([f, density]).all()
            assert f >= 0
            assert density >= 0


@MODES
@pytest.mark.parametrize("tilt", [0.0, 30.0])
def test_a_redirecting_film_at_grazing_incidence(tilt, mode, holds):
    """Its radiance grows as 1/cos θ there by definition: the flux, weight times cos θ, does not."""
    T, R = 0.6, 0.2
    film = mi.load_dict({
        "type": "redirecting_film", "transmittance": T, "redirected": 0.7, "tilt": tilt,
        "spread": 5.0, "reflectance_front": R,
    })  # fmt: skip
    for angle in np.radians(ANGLES):
        for phi in np.radians([10.0, 90.0, 200.0, 270.0]):
            for side in (1, -1):
                c, s = np.cos(angle), np.sin(angle)
                d = np.array([s * np.cos(phi), s * np.sin(phi), side * c])
                bs, weight = draw(film, d, mode, 4000)
                weight = weight[0].numpy()
                assert np.isfinite(np.array(bs.wo)).all()
                assert (weight >= 0).all()
                if mode == IMPORTANCE:
                    albedo = T + (R if side > 0 else 0)
                    holds("weight beyond the albedo", max(0, weight.max() - albedo), 1e-4)
                else:
                    holds("flux beyond that of two lobes", max(0, (weight * c).max() - 2), FLOAT)
                wo = np.array(bs.wo).T
                f, density = values(film, mode, np.broadcast_to(d, wo.shape), wo)
                kept = weight > 1e-6 * weight.max()
                again = f[kept] / density[kept]
                holds("eval / pdf = weight", abs(again / weight[kept] - 1).max(), 1e-2)


def form_factor(corners, point, normal):
    """∫ cos dω over a polygon above the horizon of a point [sr] (Lambert's formula)."""
    w = corners - point
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    total = 0.0
    for a, b in zip(w, np.roll(w, -1, axis=0), strict=True):
        edge = np.cross(a, b)
        total += np.arccos(np.clip(a @ b, -1, 1)) * (edge @ normal) / np.linalg.norm(edge)
    return abs(total) / 2


def before_the_plane(above, half):
    """∫ cos dω over the part of a small disk before a plane that its centre lies `above` [rad]."""
    y = np.linspace(max(-above, -half), half, 20_001)
    return np.trapezoid((above + y) * 2 * np.sqrt(np.maximum(half**2 - y**2, 0)), y)


@pytest.mark.parametrize(("above", "within"), [(1.0, 0.03), (0.26, 0.05), (0.05, 0.1)])
def test_a_film_seen_at_a_grazing_angle_under_a_grazing_sun(above, within, tmp_path, same):
    """Sensors 5 mm from the pane, its foot in their plane; suns 1° to 0.05° before its plane.

    Under an even sky C sums to T times the form factor. Of the last disk 40 % lie behind the plane;
    cos θ varies over the disks by as much as it is, which is what limits these samples.
    """
    T = 0.4
    path = lambertian(tmp_path / "even.xml", t=T)
    case = room(
        path, facade={"south": {"strips": [{"bottom": 0.6, "top": 2.8, "material": "film"}]}},
        sensors={"corner": [0.5, 0.0, 0.6], "count": [3, 1], "spacing": 0.01},
    )  # fmt: skip
    a = np.radians(above)
    along = np.linspace(0.2, 1.2, 8)
    suns = np.stack(
        [np.cos(a) * np.cos(along), 0 * along - np.sin(a), np.cos(a) * np.sin(along)], 1
    )
    C = coefficients(case, suns, replicates=64, pane_points=1 << 10, film_sky_samples=512)
    C = C["replicates"].values
    corners = np.array([[0, 0, 0.6], [0, 0, 2.8], [4, 0, 2.8], [4, 0, 0.6]], float)
    points, normals = sensor_points(case)
    seen = np.array([form_factor(corners, p, n) for p, n in zip(points, normals, strict=True)])
    same(C[..., :BINS].sum(axis=2), exact=T * seen, within=0.01)
    arrives = before_the_plane(a, np.radians(0.25))
    exact = np.repeat(T / np.pi * arrives * seen[:, None], len(suns), axis=1)
    same(C[..., BINS:], exact=exact, within=within)
