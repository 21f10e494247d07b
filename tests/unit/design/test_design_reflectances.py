"""E as a function of the reflectances, against fresh simulations, exact answers and differences."""

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import drcmitsuba
from drcmitsuba.case.case import Case
from drcmitsuba.design.reflectances import BOUNDS, Interior, reflectances, with_reflectances
from drcmitsuba.design.surface_kinds import Kinds, MarkedMesh
from drcmitsuba.metrics import accumulate
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene import scene as scenes
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky import daylight
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute
from tests import ROOT
from tests.fast import slowly

SEEDS = 8
PRISM = ROOT / "scenes" / "films" / "prism.xml"
KEYS = ("floor", "ceiling", "walls", "table")
ELSEWHERE = {"floor": 0.5, "ceiling": 0.6, "walls": 0.8, "table": 0.1}


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


def case_of(seed=0, replicates=2, **more):
    tables = {
        "room": {"size": (4.0, 5.0, 3.0), "floor": 0.2, "ceiling": 0.8, "walls": 0.5},
        "facade": {"south": {"segments": 2, "frame": 0.1, "strips": [
            {"bottom": 0.9, "top": 2.8, "material": "glass"}]}},
        "materials": {
            "glass": {"type": "glazing", "transmittance": 0.65, "reflectance": 0.12},
            "shade": {"type": "diffuser", "transmittance": 0.1, "reflectance": 0.4},
        },
        "furniture": [{"name": "table", "corner": (1.0, 2.0, 0.0), "size": (1.5, 1.0, 0.7),
                       "reflectance": 0.4}],
        "sensors": {"corner": (0.5, 0.5, 0.8), "count": (3, 4), "spacing": 1.0},
        "shading": {"material": "shade"},
        "period": {"months": [3], "hours": (10, 15), "days_per_week": 1},
        "accuracy": {"seed": seed, "replicates": replicates, "paths": 256, "cell_size": 0.3,
                     "cell_sky_rays": 64, "sensor_sky_rays": 512, "pane_points": 32},
    }  # fmt: skip
    return Case.model_validate(tables | more)


@pytest.fixture(scope="module")
def year():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")
    return daylight.daylight(case_of())


@pytest.fixture(scope="module")
def interiors(year):
    """Independent ones."""
    return [Interior.of(case_of(seed), year) for seed in range(SEEDS)]


def fresh(case, year, state="open"):
    """Mean over time by an ordinary simulation, (replicate, sensor) [lx]."""
    points, normals = sensor_points(case)
    C = compute(scenes.load(case, state), points, normals, year.suns, case.accuracy)
    every = np.arange(len(points))
    return accumulate.replicates(C, year.sky, every).mean(axis=1)


def at(interior, rho):
    """Mean over time, shade open and closed, (2, sensor) [lx]."""
    E = interior.illuminance({key: mi.Float(value) for key, value in rho.items()})
    return np.stack([E.open.numpy().mean(axis=0), E.shaded.numpy().mean(axis=0)])


@pytest.mark.parametrize(
    "rho",
    [
        pytest.param({}, id="start", marks=pytest.mark.slow),
        pytest.param(ELSEWHERE, id="elsewhere", marks=pytest.mark.slow),
        pytest.param(dict.fromkeys(KEYS, BOUNDS[0]), id="black", marks=pytest.mark.slow),
        pytest.param(dict.fromkeys(KEYS, BOUNDS[1]), id="white"),
        pytest.param({"floor": BOUNDS[1]}, id="white floor", marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_equals_a_fresh_simulation(interiors, year, same, rho):
    case = with_reflectances(case_of(100, replicates=16), rho)
    E = np.stack([at(interior, rho) for interior in interiors])
    same(E[:, 0], other=fresh(case, year), within=0.01)
    same(E[:, 1], other=fresh(case, year, "shaded"), within=0.01)


def test_light_between_mirroring_panes_counts(year):
    """Glass to the north mirrors the sun that comes in by that to the south."""
    side = {"strips": [{"bottom": 0.9, "top": 2.8, "material": "glass"}]}
    tables = {
        "room": {"size": (4.0, 1.2, 3.0)}, "facade": {"south": side, "north": side},
        "sensors": {"corner": (0.5, 0.1, 0.8), "count": (8, 3), "spacing": 0.3}, "furniture": [],
    }  # fmt: skip
    case = case_of(replicates=4, **tables)
    materials = case.model_dump(mode="json", exclude_none=True)["materials"]
    plain = case_of(
        **tables, materials=materials | {"glass": materials["glass"] | {"reflectance": 0.0}}
    )
    direct, without = (
        Interior.of(each, year).illuminance({}).direct.numpy().mean() for each in (case, plain)
    )
    mean = float(drcmitsuba.evaluate(case).illuminance["direct_sun"].mean())
    assert direct > 1.004 * without
    assert direct == pytest.approx(mean, rel=1e-3)


def film_case(seed=0, replicates=2, **accuracy):
    strips = [{"bottom": 0.9, "top": 2.0, "material": "glass"},
              {"bottom": 2.0, "top": 2.8, "material": "film"}]  # fmt: skip
    materials = {
        "glass": {"type": "glazing", "transmittance": 0.65},
        "film": {"type": "bsdf", "file": PRISM},
        "shade": {"type": "diffuser", "transmittance": 0.1, "reflectance": 0.4},
    }
    return case_of(
        facade={"south": {"strips": strips}}, materials=materials,
        period={"months": [3], "hours": (12, 13), "days_per_week": 1},
        accuracy={"seed": seed, "replicates": replicates, "cell_size": 0.3} | accuracy,
    )  # fmt: skip


@pytest.mark.slow
def test_shade_that_sees_no_film_in_its_own_plane():
    case = film_case(paths=32, film_sky_samples=16)
    interior = Interior.of(case, daylight.daylight(case))
    is_open, shaded = at(interior, {"ceiling": 0.6})
    assert np.isfinite(is_open).all()
    assert 0 < shaded.mean() < is_open.mean()


@pytest.mark.slow
def test_film_equals_a_fresh_simulation(same):
    year, rho = daylight.daylight(film_case()), {"ceiling": 0.6}
    interiors = [
        Interior.of(film_case(seed, paths=1024, pane_points=512), year) for seed in range(SEEDS)
    ]
    E = np.stack([at(interior, rho) for interior in interiors])
    case = with_reflectances(film_case(100, replicates=16, paths=1024, pane_points=512), rho)
    for i, state in enumerate(("open", "shaded")):
        same(E[:, i], other=fresh(case, year, state), within=0.01)


def test_direct_sun_is_that_of_the_coefficients(interiors, year, same):
    case = case_of(100, replicates=16)
    points, normals = sensor_points(case)
    others = []
    for seed in range(6):  # what an edge of shadow leaves of a disk has an error in each
        accuracy = case.accuracy.model_copy(update={"seed": 100 + seed})
        ordinary = compute(scenes.load(case), points, normals, year.suns, accuracy)
        others.append(accumulate.direct_sun(ordinary, year.sky)["direct_sun"].values)
    E = np.stack([interior.illuminance({}).direct.numpy() for interior in interiors])
    assert others[0].max() > 1000
    same(E, other=np.stack(others), within=0.01)


def mean_of(interior, rho):
    """One number that depends on all: E of both states, each entry with a weight of its own."""
    E = interior.illuminance(rho)
    weight = 1 + dr.arange(mi.Float, dr.width(E.open)) / dr.width(E.open)
    return dr.mean(E.open.array * weight) + 3 * dr.mean(E.shaded.array * weight)


def gradient(interior, rho, function=mean_of):
    """By reverse mode, (key,)."""
    values = {key: mi.Float(value) for key, value in rho.items()}
    dr.enable_grad(values)
    dr.backward(function(interior, values))
    return np.array([values[key].grad[0] for key in rho])


def precise_mean_of(interior, rho):
    """The same, its sums in float64."""
    E = interior.illuminance(rho)
    sums = [part.numpy().astype(float).ravel() for part in (E.open, E.shaded, E.direct)]
    weight = 1 + np.arange(len(sums[0])) / len(sums[0])
    return (sums[0] * weight).mean() + 3 * (sums[1] * weight).mean()


def differences(interior, rho, key, steps, weights):
    """Weighed sum of function values at steps of one reflectance."""
    return sum(
        w * precise_mean_of(interior, rho | {key: mi.Float(rho[key] + step)})
        for step, w in zip(steps, weights, strict=True)
    )


@pytest.mark.parametrize("rho", [reflectances(case_of()), ELSEWHERE], ids=["start", "elsewhere"])
def test_gradient_equals_central_differences(interiors, rho):
    slopes, h = gradient(interiors[0], rho), 0.02
    for key, each in zip(KEYS, slopes, strict=True):
        expected = differences(interiors[0], rho, key, (-h, h), (-0.5 / h, 0.5 / h))
        assert each == pytest.approx(expected, rel=0.005)


@pytest.mark.parametrize("bound", slowly(BOUNDS, BOUNDS[1]))
def test_gradient_at_the_bounds_equals_one_sided_differences(interiors, bound):
    h = 0.1 if bound == BOUNDS[0] else -0.02  # float32 noise there, high powers here
    for rho in ({**ELSEWHERE, "floor": bound}, dict.fromkeys(KEYS, bound)):
        slopes = gradient(interiors[0], rho)
        assert np.isfinite(slopes).all()
        for key, each in zip(KEYS, slopes, strict=True):
            inward = h if rho[key] == bound else 0.02
            steps = inward * np.arange(5)
            weights = np.array([-25, 48, -36, 16, -3]) / (12 * inward)
            expected = differences(interiors[0], rho, key, steps, weights)
            assert each == pytest.approx(expected, rel=0.005)


def test_parameters_are_the_surfaces(interiors):
    bounds = {p.key: (p.low, p.start, p.high) for p in interiors[0].parameters}
    assert bounds == {k: (0.0, v, 0.95) for k, v in reflectances(case_of()).items()}
    assert (interiors[0].months == 3).all()


def test_forward_mode_equals_reverse_mode(interiors):
    rho = reflectances(case_of())
    reverse = gradient(interiors[0], rho)
    for key, expected in zip(KEYS, reverse, strict=True):
        values = {k: mi.Float(v) for k, v in rho.items()}
        dr.enable_grad(values[key])
        out = mean_of(interiors[0], values)
        dr.forward(values[key])
        assert out.grad[0] == pytest.approx(expected, rel=1e-4)


def test_gradient_equals_differences_of_fresh_simulations(interiors, year):
    def open_mean(interior, rho):
        return dr.mean(interior.illuminance(rho).open.array)

    rho, h = reflectances(case_of()), 0.1
    case = case_of(200, replicates=32)
    slopes = np.array([gradient(interior, rho, open_mean) for interior in interiors])
    for i, key in enumerate(KEYS):
        up, down = (
            fresh(with_reflectances(case, {key: rho[key] + step}), year).mean(axis=1)
            for step in (h, -h)
        )  # the same random numbers
        each = (up - down) / (2 * h)
        errors = [x.std(ddof=1) / np.sqrt(len(x)) for x in (slopes[:, i], each)]
        error = float(np.hypot(*errors))
        off = slopes[:, i].mean() - each.mean()
        print(f"{key}: {slopes[:, i].mean():.1f} lx, off by {off:+.2f} ± {error:.2f}")
        assert error < 0.03 * each.mean()
        assert abs(off) < max(0.02 * each.mean(), 3 * error)


def test_standard_error_is_the_scatter_of_independent_runs(interiors):
    for rho in ({}, dict.fromkeys(KEYS, 0.9)):
        scatter = np.stack([at(interior, rho)[0] for interior in interiors]).var(axis=0, ddof=1)
        variance = np.stack([interior.standard_error(rho) for interior in interiors]) ** 2
        # F distributions of 7 and about 8 degrees of freedom, the mean of 12 sensors that share
        # cells.
        assert 0.4 < variance.mean() / scatter.mean() < 2.5


def escapes(walks, start, size, seed):
    """Surfaces that random walks in a box meet before they leave by its south side."""
    rng = np.random.default_rng(seed)
    p = np.tile(np.asarray(start, float), (walks, 1))
    normal_axis, sign = np.full(walks, 2), np.ones(walks)
    met, bounces = np.full(walks, -1), 0
    alive = np.arange(walks)
    while len(alive):
        n = len(alive)
        u, angle = rng.random(n), 2 * np.pi * rng.random(n)
        d = np.empty((n, 3))
        a, i = normal_axis[alive], np.arange(n)
        d[i, a] = np.sqrt(1 - u) * sign[alive]
        d[i, (a + 1) % 3], d[i, (a + 2) % 3] = np.sqrt(u) * [np.cos(angle), np.sin(angle)]
        t = np.where(d > 0, size - p[alive], -p[alive]) / d
        a = t.argmin(axis=1)
        t = t[i, a]
        p[alive] += t[:, None] * d
        upper = d[i, a] > 0
        p[alive, a] = np.where(upper, np.asarray(size)[a], 0.0)
        out = (a == 1) & ~upper
        met[alive[out]] = bounces
        normal_axis[alive], sign[alive] = a, np.where(upper, -1.0, 1.0)
        alive, bounces = alive[~out], bounces + 1
    return met


@pytest.mark.slow
def test_box_in_a_uniform_world_gives_the_series_of_its_bounces(year, same):
    # Outside all is of luminance 1, so E(ρ) = π Σ ρⁿ P(n), with P(n) the chance that a walk from
    # the sensor meets n surfaces before it leaves; all of them leave, so that E(1) = π exactly.
    size = (3.0, 4.0, 3.0)
    facade = {"south": {"strips": [{"bottom": 0.0, "top": 3.0, "material": "open"}]}}
    box = {
        "room": {"size": size}, "facade": facade, "furniture": [], "shading": None,
        "sensors": {"corner": (1.0, 1.5, 1.0), "count": (1, 1), "spacing": 1.0},
        "accuracy": {"replicates": 2, "paths": 1 << 15, "cell_size": 0.15, "cell_sky_rays": 64},
    }  # fmt: skip
    sky = year.sky.isel(time=slice(0, 1)).copy(deep=True)
    sky["sky"][:], sky["sun"][:] = 1.0, 0.0
    uniform = replace(year, sky=sky, suns=Suns.none())
    boxes = []
    for seed in range(8):
        box["accuracy"]["seed"] = seed
        boxes.append(Interior.of(case_of(**box), uniform))
    met = escapes(1 << 20, (1.5, 2.0, 1.0), size, 5).reshape(32, -1)
    for rho in (0.0, 0.2, 0.5, 0.8, BOUNDS[1], 1.0):
        E = [box.illuminance(dict.fromkeys(KEYS[:3], rho)).open.numpy()[0] for box in boxes]
        expected = np.pi * (float(rho) ** met).mean(axis=1)
        assert abs(expected.mean() - np.pi) < 1e-9 or rho < 1
        same(np.stack(E), other=expected, within=0.02)


def test_rays_are_marked_with_the_surface_that_they_end_on():
    corners = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]])
    shapes = [scenes.quad_mesh(f"square {i}", corners + [2 * i, 0, 0]) for i in range(3)]
    scene = mi.load_dict({"type": "scene"} | {f"square{i}": s for i, s in enumerate(shapes)})
    x = mi.Float(0.3, 2.3, 4.3)
    si = scene.ray_intersect(mi.Ray3f(mi.Point3f(x, 0.3, 1), mi.Vector3f(0, 0, -1)))
    kinds = Kinds([MarkedMesh(shapes[2], 2, 4), MarkedMesh(shapes[0], 3, 3)])  # one is of no kind
    _, mark, factor, is_cell, _ = kinds.meet(si, dr.zeros(mi.UInt32, 3), mi.Float(0.5))
    assert mark.numpy().tolist() == [3, 0, 2]
    up = scene.ray_intersect(mi.Ray3f(mi.Point3f(x, 0.3, -1), mi.Vector3f(0, 0, 1)))
    assert kinds.meet(up, dr.zeros(mi.UInt32, 3), mi.Float(0.5))[1].numpy().tolist() == [3, 0, 4]
    assert dr.all(factor == 1)
    assert dr.all(is_cell)


def test_gradients_cost_no_more_than_two_evaluations_beside_and_all_as_much_as_one(interiors):
    """Lanes of compiled kernels, which no other work on the machine changes."""
    rho = reflectances(case_of())

    def lanes(*keys):
        values = {key: mi.Float(value) for key, value in rho.items()}
        dr.enable_grad(*(values[key] for key in keys))
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            out = mean_of(interiors[0], values)
            if keys:
                dr.backward(out)
            dr.eval(out, *(values[key].grad for key in keys))
            dr.sync_thread()
            return sum(kernel["size"] for kernel in dr.kernel_history([dr.KernelType.JIT]))

    primal, one, all_four = lanes(), lanes(KEYS[0]), lanes(*KEYS)
    assert primal < one < 3 * primal
    assert one <= all_four < 1.001 * one


@pytest.mark.parametrize(
    ("change", "rho", "field", "got"),
    [
        ({}, {"flor": 0.3}, "reflectance", 'did you mean "floor"'),
        ({}, {"floor": 1.2}, "reflectance", "from 0 to 1"),
        ({}, {"floor": -0.1}, "reflectance", "from 0 to 1"),
        ({"room": {"size": (4.0, 5.0, 3.0), "floor": (0.1, 0.2, 0.3)}}, {}, "room", "grey"),
        ({"furniture": [{"corner": (1, 1, 0), "size": (1, 1, 0.5), "reflectance": r}
                        for r in (0.2, 0.3)]}, {}, "furniture.name", "two reflectances"),
        ({"furniture": [{"name": "walls", "corner": (1, 1, 0), "size": (1, 1, 0.5)}]}, {},
         "furniture.name", "two reflectances"),
        ({"furniture": [{"name": f"{i}", "corner": (1, 1, 0), "size": (1, 1, 0.5)}
                        for i in range(98)]}, {}, "furniture.name", "at most 100"),
    ],
)  # fmt: skip
def test_indistinct_surfaces_are_refused(change, rho, field, got):
    with pytest.raises(InputError) as error:
        with_reflectances(case_of(**change), rho)
    assert error.value.field == field
    assert got in str(error.value)


def test_a_wall_of_glass_leaves_the_key(year):
    strips = [{"bottom": 0.0, "top": 3.0, "material": "open"}]
    facade = {side: {"strips": strips} for side in ("south", "east", "north", "west")}
    interior = Interior.of(case_of(facade=facade, shading=None), year)
    assert np.array_equal(at(interior, {"walls": 0.1}), at(interior, {"walls": 0.9}))


def test_sensors_that_see_no_surface_are_refused(year):
    table = [{"name": "table", "corner": (1.0, 1.0, 0.0), "size": (1.0, 1.0, 0.5)}]
    with pytest.raises(InputError, match="no surface"):
        Interior.of(case_of(room=None, facade={}, furniture=table, shading=None), year)
