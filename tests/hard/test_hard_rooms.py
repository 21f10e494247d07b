"""Rooms without light, without walls, nearly without loss, and with the smallest of openings."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.sampling import disk_solid_angle

import drcmitsuba
from drcmitsuba.annual import simulation
from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.reading import load_case
from drcmitsuba.case.shipped import shipped_folder
from drcmitsuba.model.materials import Lambertian
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.geometry import Surface
from drcmitsuba.scene.materials import bsdf
from drcmitsuba.scene.meshes import quad_mesh
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.cells.cells import CellGrid
from drcmitsuba.transport.coefficients import compute
from drcmitsuba.transport.gather.paths import gather
from drcmitsuba.transport.rays.straight_suns import straight_suns

ROUNDING = 2e-6
"""Sums of thousands of equal float32 numbers are off by this much."""
NO_SUNS = Suns((), np.zeros((0, 3)))
UP = np.array([[0.0, 0.0, 1.0]])


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


def quad(corner, u, v):
    """Quadrilateral with its front towards u × v."""
    c, u, v = (np.asarray(a, float) for a in (corner, u, v))
    return np.array([c, c + u, c + u + v, c + v])


def white_box(reflectance, hole=0.0):
    """Cube of 2 m around the origin with a square hole of some width in its ceiling."""
    x, y, z = np.eye(3) * 2
    low, high, g = -np.ones(3), np.ones(3), hole / 2
    quads = [quad(low, x, y), quad(low, y, z), quad(low, z, x)]
    quads += [quad(high, -z, -y), quad(high, -x, -z)]
    strips = [(-1, 1, -1, -g), (-1, 1, g, 1), (-1, -g, -g, g), (g, 1, -g, g)]
    quads += [quad([x0, y0, 1], [0, y1 - y0, 0], [x1 - x0, 0, 0]) for x0, x1, y0, y1 in strips
              if x1 > x0 and y1 > y0]  # fmt: skip
    return [Surface("box", Lambertian(reflectance), np.array(quads))]


def test_no_opening(holds, tmp_path):
    """All effects are on, none finds anything: every division by a sum has a zero below it."""
    file = tmp_path / "case.toml"
    file.write_text(
        "[room]\nsize = [4.0, 5.0, 3.0]\nwalls = 0.99\n[sensors]\ncorner = [1.0, 1.0, 0.8]\n"
        "count = [2, 2]\n[shading]\nmaterial = 'shade'\n[materials.shade]\ntype = 'diffuser'\n"
        "transmittance = 0.1\n[period]\nmonths = [6]\n[accuracy]\nreplicates = 2\npaths = 16\n",
        encoding="utf-8",
    )
    result = drcmitsuba.evaluate(load_case(file))
    C = result.coefficients
    numbers = [C[name].values for name in ("straight", "direct", "interreflected", "replicates")]
    holds("C = 0", [abs(v).max() for v in numbers], 0)
    holds("E = 0 lx", [abs(v.values).max() for k, v in result.illuminance.items()
                       if v.dims == ("time", "sensor")], 0)  # fmt: skip
    ends = [
        result.metrics[k][end] for k in ("sDA", "ASE", "shade_closed") for end in ("low", "high")
    ]
    holds("sDA, ASE, closed shade = 0 %", ends, 0)


@pytest.mark.parametrize("subdivision", [1, 6])
def test_no_room(holds, subdivision):
    """Every ray of a free sensor leaves, and each counts once: the sum has no error to hide in."""
    case = Case.model_validate(
        {"sensors": {"corner": [0, 0, 0], "count": [3, 2]}, "sky": {"subdivision": subdivision}}
    )
    C = simulation.transport(case, "open", NO_SUNS, 45.0)["replicates"].values
    assert C.shape[-1] == len(Patches(subdivision))
    holds("ΣC over sky and ground = π", abs(C.sum(axis=-1, dtype=float) / np.pi - 1), ROUNDING)


@pytest.mark.parametrize("reflectance", [0.975, 0.99, pytest.param(0.995, marks=pytest.mark.slow)])
def test_closed_white_box(holds, same, reflectance):
    """Σ ρ^k = ρ / (1 − ρ): with roulette bounded at 0.95 a tenth of it was missing at 0.99.

    The bound is on the standard error as well: with weights of no finite variance it is 4 %.
    """
    world = scene.build(white_box(reflectance))
    points, normals = np.array([[0, 0, 0], [0.9, -0.9, 0.5]]), np.array([[0, 0, 1], [-0.6, 0.8, 0]])
    n, paths = 16, 1024
    grid = CellGrid.of(world, 1.0)
    met = gather(world, points, normals, replicates=n, paths=paths, grid=grid, seed=1)
    total = np.bincount(met.row.numpy(), met.weight.numpy(), minlength=2 * n).reshape(n, 2)
    series = reflectance / (1 - reflectance)
    same(total, exact=series, within=0.01)
    error = total.std(ddof=1) / np.sqrt(total.size)
    holds("Σ ρᵏ = ρ / (1 − ρ), in standard errors", abs(total.mean() - series) / error, 4)
    holds("standard error over the series", error / series, 0.01)


def test_energy_in_a_white_box_with_an_opening(holds, same):
    """Light that comes in is absorbed or leaves: π a = (1 − ρ) ∫ E dA + ∫ E dA over the opening.

    Light is reflected sixty times before it is gone. Any L = 1 outside, ground and sky alike.
    """
    rho, width = 0.99, 0.4
    world = scene.build(white_box(rho, width))
    rng, away = np.random.default_rng(3), 1 - 2e-3
    area, hole, totals = 24 - width**2, width**2, []
    for seed in range(12):
        on_walls = rng.uniform(-0.998, 0.998, (96, 3))
        side = np.arange(96) % 6
        on_walls[np.arange(96), side // 2] = np.where(side % 2, away, -away)
        normals = np.zeros((96, 3))
        normals[np.arange(96), side // 2] = np.where(side % 2, -1.0, 1.0)
        in_hole = (side == 5) & (abs(on_walls[:, :2]).max(axis=1) < width / 2)
        on_walls[in_hole, 0] += 0.5  # as even on the rest of the ceiling as needs be
        out = np.column_stack([rng.uniform(-width / 2, width / 2, (32, 2)), np.full(32, away)])
        points = np.concatenate([on_walls, out])
        facing = np.concatenate([normals, np.tile(-UP, (32, 1))])
        accuracy = Accuracy(seed=seed, replicates=2, paths=32, cell_size=0.2, cell_sky_rays=2048)
        C = compute(world, points, facing, NO_SUNS, accuracy)["replicates"].values
        E = C.sum(axis=-1, dtype=float).mean(axis=0)
        # Each side has its share of the points; the ceiling lacks the hole.
        weights = np.where(side == 5, 4 - hole, 4.0) / 16
        assert weights.sum() == pytest.approx(area)
        totals.append((1 - rho) * (weights * E[:96]).sum() + hole * E[96:].mean())
    totals = np.array(totals) / (np.pi * hole)
    same(totals, exact=1.0, within=0.02)
    error = totals.std(ddof=1) / np.sqrt(len(totals))
    holds("flux in = absorbed + flux out, in standard errors", abs(totals.mean() - 1) / error, 4)


def test_furnace_with_a_small_opening(holds, same):
    """Walls of reflectance 1 and 0.7 % of opening: L = 1 outside is L = 1 everywhere inside."""
    world = scene.build(white_box(1.0, 0.4))
    points, normals = np.array([[0, 0, 0], [0.9, -0.9, 0.5]]), np.array([[0, 0, 1], [-0.6, 0.8, 0]])
    accuracy = Accuracy(replicates=16, paths=512, cell_size=0.2, cell_sky_rays=256)
    C = compute(world, points, normals, NO_SUNS, accuracy)["replicates"].values
    total = C.sum(axis=-1, dtype=float)
    same(total, exact=np.pi, within=0.02)
    error = total.mean(axis=1).std(ddof=1) / 4
    holds("ΣC = π, in standard errors", abs(total.mean() - np.pi) / error, 4)


def test_white_box_and_the_plain_path_tracer(same):
    """The reference has to be right where the estimator is tested: its roulette had that bound."""
    surfaces = white_box(0.99, 0.4)
    mesh = quad_mesh("box", surfaces[0].quads, mi.load_dict(bsdf(surfaces[0].material)))
    world = mi.load_dict({"type": "scene", "box": mesh, "sky": {"type": "tregenza_sky"}})
    points, normals = (
        np.array([[0, 0, -0.5], [0.9, -0.9, 0.5]]),
        np.array([[0, 0, 1], [-0.6, 0.8, 0]]),
    )
    there = mi.load_dict({"type": "coefficient"}).sensors(
        world, np.tile(points, (16, 1)), np.tile(normals, (16, 1)), 256, 4
    )
    there = there.numpy().reshape(2, 16, 2, -1).sum(axis=(0, 3))
    accuracy = Accuracy(replicates=16, paths=512, cell_size=0.1, cell_sky_rays=64)
    here = compute(scene.build(surfaces), points, normals, NO_SUNS, accuracy)["replicates"].values
    same(here.sum(axis=-1, dtype=float), other=there, within=0.02)


SLIT, DEPTH = (1.5, 1.501), 2.0


def slit_case():
    """Black room with a slit of 1 mm across its south side, sensors along the sun's edge."""
    facade = {"strips": [{"bottom": SLIT[0], "top": SLIT[1], "material": "open"}]}
    black = dict.fromkeys(("floor", "walls", "ceiling"), 0.0)
    return Case.model_validate(
        {
            "room": {"size": [4, 4, 3], **black},
            "facade": {"south": facade},
            "sensors": {"corner": [1.0, DEPTH - 0.06, 0.8], "count": [20, 20], "spacing": 0.006},
        }
    )


def share_of_the_disk(points, sun, diameter):
    """Part of a disk that shows between two great circles, by its area between two chords."""
    normal_of = np.array([[0.0, SLIT[i] - points[0, 2], 0.0] for i in (0, 1)])
    radius = np.sin(np.radians(diameter / 2))
    below = []
    for i in (0, 1):
        # Directions d with d_z (y) + d_y (rise) ≥ 0 pass above this edge, at y from the façade.
        n = np.stack([0 * points[:, 1], normal_of[i, 1] + 0 * points[:, 1], points[:, 1]], axis=1)
        x = np.clip(n @ sun / np.linalg.norm(n, axis=1) / radius, -1, 1)
        below.append((np.arccos(x) - x * np.sqrt(1 - x**2)) / np.pi)
    return below[1] - below[0]


def slit_sun():
    rise = np.mean(SLIT) - 0.8
    return np.array([0.0, -DEPTH, rise]) / np.hypot(DEPTH, rise)


def test_sun_through_a_slit_of_1_mm(holds, same):
    """5 % of the sun's disk show: a pane of 1 mm was refused, for 1.501 − 1.5 < 0.001."""
    case, sun = slit_case(), slit_sun()
    points, normals = sensor_points(case)
    accuracy = Accuracy(replicates=48, paths=1, sensor_sun_samples=32)
    C = compute(scene.load(case), points, normals, Suns(("sun",), sun[None]), accuracy,
                subdivision=None)["replicates"].values[..., 0]  # fmt: skip
    share = share_of_the_disk(points, sun, 0.5)
    assert 0.03 < share.max() < 0.1
    assert (share == 0).any()
    exact = disk_solid_angle(0.5) * sun[2] * share
    assert (C[:, share == 0] == 0).all()
    same(C[:, share > 0], exact=exact[share > 0], within=0.01)
    total = C.sum(axis=1, dtype=float)
    error = total.std(ddof=1) / 48**0.5
    holds("ΣC = Ω cos θ × share of the disk, in standard errors",
          abs(total.mean() - exact.sum()) / error, 4)  # fmt: skip


def test_slit_that_no_direction_around_the_disk_meets(holds):
    """An adaptive sun looks at the rim first; a slit through the middle must not go unnoticed."""
    case, sun = slit_case(), slit_sun()
    points, normals = sensor_points(case)
    mean, error = straight_suns(
        scene.load(case), points, normals, Suns(("sun",), sun[None]), Accuracy(replicates=16)
    )
    exact = disk_solid_angle(0.5) * sun[2] * share_of_the_disk(points, sun, 0.5)
    off = abs(mean.sum(dtype=float) - exact.sum()) / np.sqrt(np.square(error.astype(float)).sum())
    holds("ΣC = Ω cos θ × share of the disk, in standard errors", off, 4)


def film_case():
    """A room with a pane of 1 cm² of film in a façade of 200 segments."""
    strips = [{"bottom": 1.978, "top": 2.022, "material": "film", "segments": [100]}]
    film = {"type": "bsdf", "file": str(shipped_folder() / "films" / "prism.xml")}
    return Case.model_validate(
        {
            "room": {"size": [8.8, 4, 3], "floor": 0.0, "walls": 0.0, "ceiling": 0.0},
            "facade": {
                "south": {
                    "frame_reflectance": 0.0,
                    "segments": 200,
                    "frame": 0.034,
                    "strips": strips,
                }
            },
            "materials": {"film": film},
            "sensors": {"corner": [3.9, 0.5, 0.8], "count": [2, 3], "spacing": 0.7},
        }
    )


def through_the_film(film, corner, u, v, points, suns, diameter):
    """C [sr] by a parallelogram of film of sensors that look south, shape (sensor, sun).

    C = ∫ ∫ f cos θ cos θ_p cos θ_s / r² dA dΩ as a mean over pairs of points on the pane and on the
    sun's disk; both lie in several cells of the film. With 16 times as many, ΣC changes by 8·10⁻⁵.
    """
    i = np.arange(n := 262_144)
    on_pane = np.stack([(i + 0.5) / n, i * 0.6180339887498949 % 1], axis=-1)
    at = corner + on_pane[:, :1] * u + on_pane[:, 1:] * v
    radius, turn = np.sqrt((i * 0.7548776662466927 + 0.5) % 1), 2 * np.pi * (i * 0.5698402909980532)
    across = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=-1)
    si = dr.zeros(mi.SurfaceInteraction3f, n)
    si.n = mi.Normal3f(0, 1, 0)
    si.sh_frame = mi.Frame3f(si.n)
    C = np.zeros((len(points), len(suns)))
    area, context = np.linalg.norm(np.cross(u, v)), mi.BSDFContext()
    for k, sun in enumerate(suns):
        east = np.cross([0.0, 0, 1], sun) / np.linalg.norm(np.cross([0.0, 0, 1], sun))
        axes = np.stack([east, np.cross(sun, east)])
        d = sun + np.sin(np.radians(diameter / 2)) * across @ axes
        wo = si.to_local(mi.Vector3f((d / np.linalg.norm(d, axis=1, keepdims=True)).T))
        for j, p in enumerate(points):
            to = p - at
            r = np.linalg.norm(to, axis=1)
            si.wi = si.to_local(mi.Vector3f((to / r[:, None]).T))
            values = film.eval(context, si, wo)[0].numpy() * to[:, 1] ** 2 / r**4
            C[j, k] = values.mean(dtype=float) * area * disk_solid_angle(diameter)
    return C


def test_film_of_1_square_centimetre(holds, same):
    """A pane of 10⁻⁶ of the room's surface, which no ray finds by chance: it has to be looked at.

    The room is black: what comes by the film alone, against a sum over pane and disk.
    """
    case = film_case()
    world = scene.load(case)
    (film,) = world.films
    corner, u, v = film.quads[0, 0], *(film.quads[0, i] - film.quads[0, 0] for i in (1, 3))
    assert np.linalg.norm(u) * np.linalg.norm(v) == pytest.approx(1e-4, rel=1e-9)
    suns = np.array([[0.1, -0.8, 0.6], [-0.5, -0.5, 0.7071]])
    suns /= np.linalg.norm(suns, axis=1, keepdims=True)
    x, z = np.meshgrid(np.linspace(1, 8, 8), np.linspace(0.3, 2.9, 6))
    points = np.stack([x.ravel(), np.full(x.size, 3.5), z.ravel()], axis=1)
    normals = np.tile([0.0, -1, 0], (x.size, 1))
    exact = through_the_film(film.bsdf, corner, u, v, points, suns, diameter=0.5)
    accuracy = Accuracy(replicates=32, paths=1, pane_points=256)
    C = compute(world, points, normals, Suns(("a", "b"), suns), accuracy, subdivision=None)
    replicates = C["replicates"].values
    same(replicates, exact=exact, within=0.01)
    total = replicates.sum(axis=(1, 2), dtype=float)
    error = total.std(ddof=1) / 32**0.5
    holds("C by the film = its integral over pane and disk, in standard errors",
          abs(total.mean() - exact.sum()) / error, 4)  # fmt: skip
