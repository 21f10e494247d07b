"""A film with a narrow peak, most of it in shadow: errors are honest, sensor by sensor."""

import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.klems_basis import BASES
from drcmitsuba_plugins.sampling import disk_solid_angle
from scipy.stats import t as student

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.scene import scene as scenes
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute
from drcmitsuba.transport.films.orientation import mounts
from tests.unit.plugins.test_measured import xml

SUN = np.array([[-0.3, -0.7, 0.65]]) / np.linalg.norm([0.3, 0.7, 0.65])
LIT = 2.0
"""The film is lit up to this x [m], by a wall that stands before the rest."""


def shaded_film(folder):
    """Room of 8 m with a film that lets light straight through into cells of some 10°."""
    basis = BASES["LBNL/Klems Full"]
    matrix = np.full((len(basis),) * 2, 1e-5) + np.diag(0.6 / basis.projected_solid_angle)
    path = folder / "peak.xml"
    columns = " ".join(f"{v:.8g}" for v in matrix.ravel())
    path.write_text(xml("Columns", {"tb": columns}, "LBNL/Klems Full"))
    before = LIT + 3 * SUN[0, 0] / -SUN[0, 1]
    return Case.model_validate(
        {
            "room": {"size": [8, 4, 3], "floor": 0.0, "ceiling": 0.0, "walls": 0.0},
            "facade": {"south": {"strips": [{"bottom": 1.8, "top": 2.7, "material": "film"}]}},
            "materials": {
                "film": {"type": "bsdf", "file": str(path), "straight_through": "off"}
            },
            "furniture": [
                {"name": "wall", "corner": [before, -3.5, 0], "size": [12, 0.5, 20],
                 "reflectance": 0.0},
            ],
            "sensors": {"corner": [0.7, 0.7, 0.8], "count": [4, 3], "spacing": 0.8},
        }
    )  # fmt: skip


def exact(case, sun):
    """D of the sensors by the film [sr]: an integral over its lit part, on a grid of 1 cm."""
    points, _ = sensor_points(case)
    (mount,) = mounts(scenes.load(case))
    lit = LIT + 3 * (sun[0] / sun[1] - SUN[0, 0] / SUN[0, 1])
    grid = np.meshgrid(np.arange(0.005, lit, 0.01), np.arange(1.805, 2.7, 0.01))
    x, z = (a.ravel() for a in grid)
    on_film = np.stack([x, 0 * x, z], axis=1)
    to_sun = mount.turn.to_local(mi.Vector3f(*map(float, sun)))
    D = []
    for point in points:
        way = point - on_film
        d = mi.Vector3f((way / np.linalg.norm(way, axis=1, keepdims=True)).T.astype(np.float32))
        si = mount.interaction(mount.turn.to_local(d))
        f_cos = mount.bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(to_sun))[0].numpy()
        square = (way**2).sum(axis=1)
        cosines = way[:, 1] * -way[:, 2] / square
        D.append((f_cos * cosines / square).sum() * 1e-4 * disk_solid_angle(0.5))
    return np.array(D)


def test_standard_errors_of_a_narrow_peak_partly_in_shadow(tmp_path):
    case = shaded_film(tmp_path)
    directions = np.concatenate([SUN, [[-0.12, -0.6, 0.79], [-0.3, -0.5, 0.81]]])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    suns = Suns(("sun_evening", "sun_afternoon", "sun_late"), directions)
    truth = np.stack([exact(case, sun) for sun in directions], axis=1)
    z, mean = [], []
    for seed in range(4):
        C = compute(
            scenes.load(case), *sensor_points(case), suns, Accuracy(seed=seed), subdivision=None
        )
        mean.append(C["direct"].values)
        error = C["direct_se"].values
        z.append((mean[-1] - truth) / np.maximum(error, 1e-3 * truth.max()))
    z, mean = np.array(z), np.array(mean)
    inside = (abs(z) < student.ppf(0.975, 5)).mean(axis=(0, 1))
    print(f"inside the 95 % interval, by sun: {inside}; farthest {abs(z).max():.1f} errors")
    assert (np.count_nonzero(truth > 1e-3 * truth.max(), axis=0) >= 2).all()
    np.testing.assert_allclose(mean.mean(axis=0).sum(axis=0), truth.sum(axis=0), rtol=0.1)
    assert inside.min() > 0.88
    assert abs(z).max() < 8
