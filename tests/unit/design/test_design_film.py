"""A year as a function of its film: against the ordinary simulation, and every derivative of it."""

import json
from pathlib import Path
from types import SimpleNamespace

import drjit as dr
import mitsuba as mi
import numpy as np
import pandas as pd
import pytest
from drcmitsuba_plugins import bsdf_file, energy
from drcmitsuba_plugins.lobes import square_code
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba import load_case
from drcmitsuba.annual import simulation
from drcmitsuba.design.film import Leaves, MeasuredFilm, Mix, ParametricFilm
from drcmitsuba.design.film_bins import Bins
from drcmitsuba.design.film_problem import gradient, gradient_error
from drcmitsuba.design.film_search import optimise_film
from drcmitsuba.design.film_year import FilmYear
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene import scene
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.shadow_rays import sky_deposit
from tests import ROOT
from tests.unit.plugins.test_measured import write

PRISM = ROOT / "scenes" / "films" / "prism.xml"
CASE = f"""
name = "small room"
[period]
months = [3]
hours = [8, 13]
days_per_week = 1
[room]
size = [4.0, 5.0, 3.0]
rotation = 0.0
[facade.south]
segments = 2
frame = 0.1
strips = [
    {{ bottom = 0.9, top = 1.8, material = "glass" }},
    {{ bottom = 1.8, top = 2.7, material = "film" }},
]
[materials.glass]
type = "glazing"
transmittance = 0.65
[materials.film]
type = "bsdf"
file = "{PRISM}"
straight_through = "off"
[materials.shade]
type = "diffuser"
transmittance = 0.1
reflectance = 0.4
[shading]
material = "shade"
[[furniture]]
name = "desk"
corner = [1.0, 1.5, 0.7]
size = [1.6, 0.8, 0.0]
[sensors]
corner = [0.6, 0.6, 0.8]
count = [4, 4]
spacing = 0.7
[accuracy]
replicates = 8
seed = 3
"""
SUN = np.array([[0.07, -0.8, 0.6], [0.48, -0.64, 0.6], [-0.2, -0.3, 0.93], [0.0, 0.8, 0.6]])
"""The last one is behind a façade that faces south."""
SOUTH = np.array([[-1.0, 0, 0], [0, 0, 1], [0, 1, 0]])
"""Frame of such a façade's panes: x is y × z."""


@pytest.fixture(autouse=True, scope="module")
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else None)


def case_of(folder, *changes):
    text = CASE
    for old, new in changes:
        assert text.count(old) == 1, f"{old!r} does not name one place"
        text = text.replace(old, new)
    file = folder / "case.toml"
    file.write_text(text)
    return load_case(file)


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return case_of(tmp_path_factory.mktemp("film"))


@pytest.fixture(scope="module")
def year(case):
    return FilmYear.of(case)


@pytest.fixture(scope="module")
def coarse(case):
    """With fewer cells: what films and searches do does not depend on them."""
    return FilmYear.of(case, depth=3)


@pytest.fixture(scope="module")
def bins():
    suns = Suns(
        tuple(f"sun_{i}" for i in range(len(SUN))), SUN / np.linalg.norm(SUN, axis=1)[:, None]
    )
    return Bins(SOUTH, 1, suns)


PRISM_FILM = MeasuredFilm(PRISM)


# Bins and cells


def test_a_finer_sky_gives_the_same_irradiance(bins):
    fine = Bins(SOUTH, 3, bins.suns).irradiance
    assert fine[0] == pytest.approx(np.pi / 2, rel=1e-6)
    # Parts that the pane's plane cuts count whole, by what is before it less what is behind.
    assert fine[:-4].sum() == pytest.approx(np.pi, rel=1e-4)
    # Rows of the finer sky, three for each of Tregenza's, hold as much.
    for start, end in ((1, 31), (31, 61), (61, 85)):
        rows = slice(1 + (start - 1) * 9, 1 + (end - 1) * 9)
        assert fine[rows].sum() == pytest.approx(bins.irradiance[start:end].sum(), rel=0.06)


def test_irradiance_of_the_bins(bins, same):
    found = bins.irradiance
    assert found[:146].sum() == pytest.approx(np.pi, rel=1e-6)
    assert found[0] == pytest.approx(np.pi / 2, rel=1e-6)
    cosines = np.maximum(0, -bins.suns.directions[:, 1])
    np.testing.assert_allclose(found[146:], disk_solid_angle(0.5) * cosines, rtol=1e-5)
    # The other way: shadow rays from a point that faces south.
    n = 32
    d = sky_deposit(
        scene.build([]), mi.Float(np.zeros(3 * n, np.float32)),
        mi.Float(np.tile([0, -1, 0], n).astype(np.float32)), subdivision=1, rays=1 << 14, seed=1,
    )  # fmt: skip
    rows = d.numpy().reshape(n, 1, 146)
    # Patches that the pane's plane cuts are told apart in 8 × 8 parts: their errors cancel.
    _, _, west, east = np.degrees(Patches().bounds).T
    cut = ((west < 90) & (east > 90)) | ((west < 270) & (east > 270))
    cut[0] = False
    assert 0 < cut.sum() < 20
    same(rows[..., ~cut], exact=found[:146][~cut], within=0.002)
    assert found[:146][cut].sum() == pytest.approx(rows[..., cut].sum() / n, rel=0.05)


@pytest.mark.parametrize("per_side", [1, 2, 4])
def test_parts_of_cells_cover_the_hemisphere(bins, per_side):
    found = bins.parts(per_side)
    assert len(found.d) == len(bins.points(per_side**2)) == 1024 * per_side**2
    np.testing.assert_allclose(np.linalg.norm(found.d, axis=1), 1, atol=1e-6)
    assert found.solid_angle.sum() == pytest.approx(2 * np.pi, rel=0.006 / per_side**1.5)
    # All cells have the same projected solid angle; parts at the rim are wide.
    projected = (found.solid_angle * found.d[:, 2]).reshape(1024, -1).sum(axis=1)
    inner = bins.points(1)[:, 2] > 0.5
    np.testing.assert_allclose(projected[inner], np.pi / 1024, rtol=0.01)
    assert projected.sum() == pytest.approx(np.pi, rel=0.01)


@pytest.mark.parametrize("per_side", [1, 4])
def test_points_lie_in_their_cells(bins, per_side):
    for d in (bins.points(per_side**2), bins.parts(per_side).d):
        x, y = (mi.Float(c.astype(np.float32)) for c in d.T[:2])
        cell = square_code(mi.Point2f(x, y), bins.depth).numpy()
        np.testing.assert_array_equal(cell, np.repeat(np.arange(1024), per_side**2))


# Answers


def leaves_in_all(film, bins):
    """Transmittance of a film for every bin that reaches it."""
    answer = film.answer(bins).numpy().astype(float)
    reached = bins.irradiance > 0
    assert np.isfinite(answer).all()
    assert answer.min() >= 0
    assert np.all(answer[:, ~reached] == 0)
    return (answer.sum(axis=0) * np.pi / bins.cells)[reached] / bins.irradiance[reached]


@pytest.mark.parametrize("tilt", [-90.0, -30.0, 0.0, 30.0, 90.0])
@pytest.mark.parametrize("spread", [2.0, 20.0, 90.0])
def test_a_parametric_film_lets_out_exactly_its_share(bins, tilt, spread):
    found = leaves_in_all(ParametricFilm(0.6, 0.8, tilt, spread), bins)
    # Patches at the pane's plane: cut in 4 × 4 parts for the film, in 8 × 8 for the irradiance.
    whole = bins.irradiance[bins.irradiance > 0] > 0.15 * bins.irradiance[1:146].max()
    whole[146 - np.sum(bins.irradiance[:146] == 0) :] = True
    np.testing.assert_allclose(found[whole], 0.6, rtol=1e-4)


@pytest.mark.parametrize(("tilt", "spread"), [(-20.0, 8.0), (0.0, 20.0), (15.0, 8.0), (60.0, 30.0)])
def test_a_parametric_film_is_the_plugin(bins, tilt, spread):
    """Directions that the plugin draws are counted in the cells, for suns."""
    parameters = {"transmittance": 0.7, "redirected": 0.6, "tilt": tilt, "spread": spread}
    bsdf, count = mi.load_dict({"type": "redirecting_film", **parameters}), 1 << 19
    answer = ParametricFilm(**parameters).answer(bins).numpy().astype(float)
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(1, count)
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.n, si.sh_frame = mi.Normal3f(0, 0, 1), mi.Frame3f(mi.Normal3f(0, 0, 1))
    for number, sun in enumerate(bins.suns.directions[:3]):
        si.wi = mi.Vector3f(*map(float, bins.frame @ sun))
        ctx = mi.BSDFContext(mi.TransportMode.Importance)
        bs, _ = bsdf.sample(ctx, si, sampler.next_1d(), sampler.next_2d())
        seen = np.bincount(square_code(bs.wo.xy, bins.depth).numpy(), minlength=1024)
        share = answer[:, 146 + number] * np.pi / 1024 / bins.irradiance[146 + number] / 0.7
        assert share.sum() == pytest.approx(1, rel=1e-4)
        # What 16 points in a cell miss, beside the counts' own scatter.
        scatter = np.sqrt(count * share + (0.01 * count * share) ** 2)
        assert abs((seen - count * share) / scatter).max() < 4.5


@pytest.mark.parametrize(("flip", "turn"), [(False, False), (True, False), (False, True)])
def test_a_measured_film_lets_out_what_its_file_says(bins, flip, turn):
    film = MeasuredFilm(PRISM, flip=flip, turn=turn)
    found = leaves_in_all(film, bins)[-3:]
    tree = energy.scaled_to_conserve(bsdf_file.read(PRISM))[0].components["tf" if flip else "tb"]
    # The directions to the light, as the mounted file sees them.
    toward = bins.suns.directions[:3] @ bins.frame.T
    toward = toward * np.array([-1, 1, -1]) if flip else toward
    toward = toward * np.array([-1, -1, 1]) if turn else toward
    expected = tree.hemispherical(toward)
    np.testing.assert_allclose(found, expected, rtol=0.03)


@pytest.mark.parametrize("kind", ["TensorTree4", "TensorTree3", "LBNL/Klems Quarter"])
def test_any_file_gives_its_bsdf(bins, tmp_path, kind):
    """Averages of f over many points of each cell, for suns."""
    film = MeasuredFilm(write(tmp_path, kind))
    answer = film.answer(bins).numpy()[:, 146:149]
    d = bins.points(1 << 10)
    si = dr.zeros(mi.SurfaceInteraction3f, len(d))
    si.n, si.sh_frame = mi.Normal3f(0, 0, 1), mi.Frame3f(mi.Normal3f(0, 0, 1))
    si.wi = mi.Vector3f(*(mi.Float(c.astype(np.float32)) for c in d.T))
    for i, sun in enumerate(bins.suns.directions[:3]):
        local = mi.Vector3f(*map(float, bins.frame @ sun))
        expected = film.bsdf.eval(mi.BSDFContext(), si, local)[0].numpy() * disk_solid_angle(0.5)
        expected = expected.reshape(1024, -1).mean(axis=1)
        assert answer[:, i].sum() == pytest.approx(expected.sum(), rel=0.02)
        # Cells of a tensor tree of rank 4 hold ours whole; borders of others run through some.
        close = np.isclose(answer[:, i], expected, rtol=1e-3, atol=1e-9)
        assert close.mean() > (0.999 if kind == "TensorTree4" else 0.6)


# Against the ordinary simulation


CASES = {
    "south": ((), "open"),
    "shade closed": ((), "shaded"),
    "turned room, film upside down on the east side": (
        (
            ("rotation = 0.0", "rotation = 25.0"),
            ("[facade.south]", "[facade.east]"),
            ('straight_through = "off"', 'straight_through = "off"\nflip = true\nturn = true'),
        ),
        "open",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_the_case_s_own_film_gives_what_the_simulation_gives(tmp_path, same, name):
    changes, state = CASES[name]
    case = case_of(tmp_path, *changes)
    light = daylight(case)
    found = FilmYear.of(case, light, state=state)
    material = case.materials["film"]
    film = MeasuredFilm(material.file, material.flip, material.turn)
    other = case.model_copy(update={"accuracy": case.accuracy.model_copy(update={"seed": 8})})
    C = simulation.transport(other, state, light.suns, light.sky.attrs["latitude"])
    rest, answer = found.coefficients, film.answer(found.bins).numpy()
    assert list(rest["bin"].values) == list(C["bin"].values)
    ours = rest["replicates"].values + found.transfers @ answer
    part = found.transfers @ answer
    assert part.sum() > 0.1 * ours.sum()
    same(ours, other=C["replicates"].values, within=0.01)
    # E of the year is these coefficients times L.
    E = found.illuminance(film).numpy()
    np.testing.assert_allclose(E, (ours.mean(axis=0) @ found.L.numpy()).T, rtol=1e-4, atol=0.05)
    np.testing.assert_allclose(found.replicates(film).mean(axis=0), E, rtol=1e-4, atol=0.05)
    error = found.error(film)
    assert error.shape == E.shape
    assert 0 < (error[E > 100] / E[E > 100]).mean() < 0.1


# Derivatives


def loss_of(year, weight, film):
    return dr.sum(year.illuminance(film).array * mi.Float(weight.ravel()))


def exactly(year, weight, film):
    """The loss in double precision."""
    return float((dr.detach(year.illuminance(film)).numpy().astype(float) * weight).sum())


@pytest.fixture(scope="module")
def weight(year):
    """Of every illuminance, so that no symmetry hides an error."""
    shape = year.rest.shape
    return (np.random.default_rng(5).random(shape) / np.prod(shape)).astype(np.float32)


def other_film():
    return ParametricFilm(0.5, 0.9, -10.0, 12.0)


PARAMETERS = {
    # builds a film of the numbers; the numbers; the steps; the ends of the ranges
    "parametric": (
        ParametricFilm,
        (0.6, 0.7, 8.0, 11.0),
        (0.05, 0.05, 0.1, 0.1),
        ((0, 1), (0, 1), (-90, 90), (2, 90)),
    ),
    "untilted": (
        ParametricFilm,
        (0.6, 0.7, 0.0, 6.0),
        (0.05, 0.05, 0.1, 0.1),
        ((0, 1), (0, 1), (-90, 90), (2, 90)),
    ),
    "least spread, dark": (
        ParametricFilm,
        (0.0, 1.0, 5.0, 2.0),
        (0.05, 0.05, 0.05, 0.05),
        ((0, 1), (0, 1), (-90, 90), (2, 90)),
    ),
    "least spread, clear, even": (
        ParametricFilm,
        (1.0, 0.0, 5.0, 2.0),
        (0.05, 0.05, 0.05, 0.05),
        ((0, 1), (0, 1), (-90, 90), (2, 90)),
    ),
    "narrow": (
        ParametricFilm,
        (1.0, 1.0, 0.0, 2.0),
        (0.05, 0.05, 0.05, 0.05),
        ((0, 1), (0, 1), (-90, 90), (2, 90)),
    ),
    "ends of tilt and spread": (
        ParametricFilm,
        (1.0, 1.0, 90.0, 90.0),
        (0.05, 0.05, 0.5, 0.5),
        ((0, 1), (0, 1), (-90, 90), (2, 90)),
    ),
    "mix": (lambda s: Mix(PRISM_FILM, other_film(), s), (0.3,), (0.05,), ((0, 1),)),
    "mix, none": (lambda s: Mix(PRISM_FILM, other_film(), s), (0.0,), (0.05,), ((0, 1),)),
    "mix, all": (lambda s: Mix(PRISM_FILM, other_film(), s), (1.0,), (0.05,), ((0, 1),)),
}


def difference(f, at, step, low, high):
    """Derivative by differences of second order, one-sided at the ends of a range."""
    if low <= at - step and at + step <= high:
        return (f(at + step) - f(at - step)) / (2 * step)
    h = step if at + 2 * step <= high else -step
    return (4 * f(at + h) - 3 * f(at) - f(at + 2 * h)) / (2 * h)


@pytest.mark.parametrize("name", PARAMETERS)
def test_derivatives_are_differences(coarse, year, weight, name):
    build, at, steps, ends = PARAMETERS[name]
    year = year if "mix" in name else coarse
    values = [mi.Float(v) for v in at]
    for v in values:
        dr.enable_grad(v)
    dr.backward(loss_of(year, weight, build(*values)))
    reverse = [float(dr.grad(v)[0]) for v in values]
    scale = abs(exactly(year, weight, build(*at)))
    for i, step in enumerate(steps):

        def loss(value, i=i):
            return exactly(year, weight, build(*at[:i], float(value), *at[i + 1 :]))

        expected = difference(loss, at[i], step, *ends[i])
        # Differences of float32 illuminances are known to 1e-7 of them.
        margin = 3e-7 * scale / step
        assert reverse[i] == pytest.approx(expected, rel=0.02, abs=margin), i
        values = [mi.Float(v) for v in at]
        dr.enable_grad(values[i])
        dr.set_grad(values[i], 1.0)
        forward = dr.forward_to(loss_of(year, weight, build(*values)))
        assert float(forward.numpy().item()) == pytest.approx(reverse[i], rel=1e-3, abs=margin), i


def test_derivatives_by_leaves_are_differences(year, weight):
    """E is linear in the leaves; those of largest and of middling influence, at 0 too."""
    start = PRISM_FILM.values
    values = mi.Float(start)
    dr.enable_grad(values)
    dr.backward(loss_of(year, weight, Leaves(PRISM_FILM, values)))
    gradient = dr.grad(values).numpy()
    assert np.isfinite(gradient).all()
    assert gradient.min() >= 0
    met = np.flatnonzero(gradient)
    order = met[np.argsort(-gradient[met])]
    zeros = order[start.numpy()[order] == 0]
    for leaf in (*order[:3], order[len(order) // 20], zeros[0]):
        sides = []
        for h in (0.0, 20.0):
            changed = start.numpy().copy()
            changed[leaf] += h
            sides.append(exactly(year, weight, Leaves(PRISM_FILM, mi.Float(changed))))
        assert gradient[leaf] == pytest.approx((sides[1] - sides[0]) / 20.0, rel=0.02)
    # Euler: a linear function is the sum of its derivatives times its variables.
    by_film = (loss_of(year, weight, PRISM_FILM) - exactly_rest(year, weight)).numpy().item()
    assert float((gradient * start.numpy()).sum()) == pytest.approx(by_film, rel=1e-4)


def exactly_rest(year, weight):
    return float((year.rest.numpy().astype(float) * weight).sum())


def test_leaves_and_mixes_at_their_ends(bins):
    expected = PRISM_FILM.answer(bins).numpy()
    same = Leaves(PRISM_FILM, PRISM_FILM.values).answer(bins).numpy()
    np.testing.assert_allclose(same, expected, rtol=1e-5)
    dark = Leaves(PRISM_FILM, dr.zeros(mi.Float, dr.width(PRISM_FILM.values)))
    assert np.all(dark.answer(bins).numpy() == 0)
    second = other_film().answer(bins).numpy()
    for share in (0.0, 0.25, 1.0):
        found = Mix(PRISM_FILM, other_film(), share).answer(bins).numpy()
        mixed = (1 - share) * expected + share * second
        np.testing.assert_allclose(found, mixed, rtol=1e-4, atol=1e-9)


# Search


def likeness(year, film):
    """Objective that is largest where illuminances are those of a film."""
    target = mi.Float(np.log(year.illuminance(film).numpy().ravel() + 1))
    return lambda E: 1 - 100 * dr.mean(dr.square(dr.log(E.array + 1) - target))


def without_replicates(year):
    """A year that does not know its noise: a search of it ends where the gradient vanishes."""
    return SimpleNamespace(illuminance=year.illuminance)


def test_search_finds_the_film_that_light_came_by(coarse):
    shares, exact = [], without_replicates(coarse)
    objective = likeness(coarse, ParametricFilm(0.6, 1.0, 14.0, 9.0))
    optimum = optimise_film(exact, objective, starts=2, progress=shares.append)
    assert np.isnan(list(optimum.gradient_error.values())).all()
    assert not optimum.is_within_noise
    assert optimum.values["tilt"] == pytest.approx(14, abs=0.5)
    assert optimum.values["spread"] == pytest.approx(9, abs=0.5)
    assert optimum.objective == pytest.approx(1, abs=1e-3)
    assert optimum.film == ParametricFilm(0.6, 1.0, **optimum.values)
    assert optimum.objective == max(step.candidate.objective for step in optimum.history)
    assert {step.label for step in optimum.history} == {"start 1", "start 2"}
    first = optimum.history.steps[0].candidate
    assert optimum.problem.named(first.x) == pytest.approx({"tilt": 0.0, "spread": 10.0}, abs=1e-5)
    assert shares == sorted(shares)
    assert shares[-1] == 1


def test_search_of_a_share(year):
    objective = likeness(year, Mix(PRISM_FILM, other_film(), 0.4))
    film = Mix(PRISM_FILM, other_film(), 0.9)
    optimum = optimise_film(year, objective, film, ranges={"share": (0, 1)}, starts=1)
    assert optimum.values["share"] == pytest.approx(0.4, abs=0.01)


def test_search_ends_within_the_noise_of_its_derivatives(coarse, tmp_path):
    objective = likeness(coarse, ParametricFilm(0.6, 1.0, 14.0, 9.0))
    exact = optimise_film(without_replicates(coarse), objective, starts=1)
    optimum = optimise_film(coarse, objective, starts=1)
    assert optimum.evaluations < exact.evaluations
    assert optimum.is_within_noise
    for name, error in optimum.gradient_error.items():
        assert abs(optimum.gradient[name]) <= error / 4
    optimum.save(tmp_path)
    saved = json.loads((tmp_path / "optimum.json").read_text())
    assert saved["by_tilt_se"] == pytest.approx(optimum.gradient_error["tilt"])
    assert saved["within_noise"]
    assert len(pd.read_csv(tmp_path / "history.csv")) == optimum.evaluations


def test_errors_of_derivatives_are_their_scatter_between_seeds(case):
    film, at = ParametricFilm(0.6), {"tilt": 10.0, "spread": 12.0}

    def objective(E):
        return dr.mean(1 / (1 + dr.exp((300 - E.array) / 30)))

    slopes, errors = [], []
    for seed in range(12):
        accuracy = case.accuracy.model_copy(update={"seed": seed})
        year = FilmYear.of(case.model_copy(update={"accuracy": accuracy}), depth=3)
        slopes.append(gradient(year, objective, film, at)[1])
        errors.append(gradient_error(year, objective, film, at))
    ratio = np.mean(np.square(errors), axis=0) / np.var(slopes, axis=0, ddof=1)
    print(f"derivatives {np.mean(slopes, axis=0)} ± {np.std(slopes, axis=0, ddof=1)}, {ratio}")
    # χ² of 11 degrees of freedom over those of 12 × 7: 99.9 % within these bounds.
    assert ((ratio > 0.3) & (ratio < 4.5)).all()


def test_ctrl_c_keeps_the_best_film_so_far(coarse):
    objective = likeness(coarse, ParametricFilm(0.6, 1.0, 14.0, 9.0))
    calls = []

    def stopping(E):
        calls.append(1)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return objective(E)

    optimum = optimise_film(without_replicates(coarse), stopping)
    assert not optimum.finished
    assert optimum.evaluations == 3
    assert optimum.objective == max(c.objective for c in optimum.history.candidates)
    calls[:] = [1, 1, 1]
    with pytest.raises(KeyboardInterrupt):
        optimise_film(without_replicates(coarse), stopping)


# Refusals


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ((('top = 2.7, material = "film"', 'top = 2.7, material = "glass"'),), "0 films"),
        (
            (
                (
                    "[materials.glass]",
                    '[facade.east]\nstrips = [{ bottom = 1.0, top = 2.0, material = "film" }]\n'
                    "[materials.glass]",
                ),
            ),
            "2 films",
        ),
        (
            (
                (
                    "[materials.glass]",
                    '[facade.north]\nstrips = [{ bottom = 1.0, top = 2.0, material = "glass" }]\n'
                    "[materials.glass]",
                ),
            ),
            "light from the room",
        ),
        ((("corner = [1.0, 1.5, 0.7]", "corner = [1.0, -1.5, 0.7]"),), "other things shade"),
        ((("[period]", '[sun]\nmodel = "adaptive"\n[period]'),), "true_sun"),
        ((('"off"', '"on"'),), 'straight_through = "off"'),
        ((("rotation = 0.0", "rotation = 0.0\nfloor = [0.1, 0.2, 0.3]"),), "grey"),
    ],
)
def test_cases_that_do_not_fit_are_refused(tmp_path, changes, told):
    with pytest.raises(InputError, match=told):
        FilmYear.of(case_of(tmp_path, *changes))


@pytest.mark.parametrize(
    "film",
    [
        ParametricFilm(1.2),
        ParametricFilm(0.5, redirected=-0.1),
        ParametricFilm(0.5, tilt=120.0),
        ParametricFilm(0.5, spread=1.0),
        ParametricFilm(float("nan")),
        Mix(ParametricFilm(0.5), ParametricFilm(0.6), 1.5),
        Leaves(PRISM_FILM, [1.0, 2.0]),
        MeasuredFilm(Path("no such film.xml")),
    ],
)
def test_films_that_cannot_be_are_refused(bins, film):
    with pytest.raises(InputError, match="film: "):
        film.answer(bins)


def test_searches_that_cannot_be_are_refused(year):
    def objective(E):
        return dr.mean(E.array)

    for told, options in {
        "no parameter 'share'": {"ranges": {"share": (0, 1)}},
        "tilt: 3, 3": {"ranges": {"tilt": (3, 3)}},
        "starts: 0": {"starts": 0},
    }.items():
        with pytest.raises(InputError, match=told):
            optimise_film(year, objective, **options)
    with pytest.raises(InputError, match="objective: value: nan"):
        optimise_film(year, lambda E: dr.mean(dr.log(-E.array)))
