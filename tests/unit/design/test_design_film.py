"""A year as a function of its film: against the ordinary simulation, and every derivative of it."""

from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins import bsdf_file, energy
from drcmitsuba_plugins.lobes import square_code
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.annual import simulation
from drcmitsuba.design.film import Leaves, MeasuredFilm, Mix, ParametricFilm
from drcmitsuba.design.film_bins import FilmBins
from drcmitsuba.design.film_year import FilmYear
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene import scene
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.rays.shadow_rays import sky_deposit
from tests.fast import slowly
from tests.unit.design.film_room import (
    PRISM,
    PRISM_FILM,
    SOUTH,
    SUN,
    case_of,
    other_film,
)
from tests.unit.plugins.measured_files import write, xml


@pytest.fixture(autouse=True, scope="module")
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


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
    return FilmBins(SOUTH, 1, suns)


# Bins and cells


def irradiance_of(bins):
    """Irradiance on the film's outer face per unit radiance of every bin [sr], shape (bin,)."""
    arriving = bins.arriving(8, 4)
    return np.bincount(arriving.bin, arriving.weight, len(bins))


def test_a_finer_sky_gives_the_same_irradiance(bins):
    fine = irradiance_of(FilmBins(SOUTH, 3, bins.suns))
    assert fine[0] == pytest.approx(np.pi / 2, rel=1e-6)
    # Parts that the pane's plane cuts count whole, by what is before it less what is behind.
    assert fine[:-4].sum() == pytest.approx(np.pi, rel=1e-4)
    # Rows of the finer sky, three for each of Tregenza's, hold as much.
    for start, end in ((1, 31), (31, 61), (61, 85)):
        rows = slice(1 + (start - 1) * 9, 1 + (end - 1) * 9)
        assert fine[rows].sum() == pytest.approx(irradiance_of(bins)[start:end].sum(), rel=0.06)


def test_irradiance_of_the_bins(bins, same):
    irradiance = irradiance_of(bins)
    assert irradiance[:146].sum() == pytest.approx(np.pi, rel=1e-6)
    assert irradiance[0] == pytest.approx(np.pi / 2, rel=1e-6)
    cosines = np.maximum(0, -bins.suns.directions[:, 1])
    np.testing.assert_allclose(irradiance[146:], disk_solid_angle(0.5) * cosines, rtol=1e-5)
    # The other way: shadow rays from a point that faces south.
    n = 32
    d = sky_deposit(
        scene.build([]), mi.Float(np.zeros(3 * n, np.float32)),
        mi.Float(np.tile([0, -1, 0], n).astype(np.float32)), subdivision=1, rays=1 << 14, seed=1,
    )  # fmt: skip
    rows = d.numpy().reshape(n, 1, 146)
    # Patches that the pane's plane cuts are cut into 8 × 8 parts: their errors cancel.
    _, _, west, east = np.degrees(Patches().bounds).T
    cut = ((west < 90) & (east > 90)) | ((west < 270) & (east > 270))
    cut[0] = False
    assert 0 < cut.sum() < 20
    same(rows[..., ~cut], exact=irradiance[:146][~cut], within=0.002)
    assert irradiance[:146][cut].sum() == pytest.approx(rows[..., cut].sum() / n, rel=0.05)


@pytest.mark.parametrize("per_side", [1, 2, 4])
def test_parts_of_cells_cover_the_hemisphere(bins, per_side):
    parts = bins.parts(per_side)
    assert len(parts.d) == len(bins.points(per_side**2)) == 1024 * per_side**2
    np.testing.assert_allclose(np.linalg.norm(parts.d, axis=1), 1, atol=1e-6)
    assert parts.solid_angle.sum() == pytest.approx(2 * np.pi, rel=0.006 / per_side**1.5)
    # All cells have the same projected solid angle; parts at the rim are wide.
    projected = (parts.solid_angle * parts.d[:, 2]).reshape(1024, -1).sum(axis=1)
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
    reached = irradiance_of(bins) > 0
    assert np.isfinite(answer).all()
    assert answer.min() >= 0
    assert np.all(answer[:, ~reached] == 0)
    return (answer.sum(axis=0) * np.pi / bins.cells)[reached] / irradiance_of(bins)[reached]


@pytest.mark.parametrize("tilt", [-90.0, -30.0, 0.0, 30.0, 90.0])
@pytest.mark.parametrize("spread", [2.0, 20.0, 90.0])
def test_a_parametric_film_lets_out_exactly_its_share(bins, tilt, spread):
    transmittance = leaves_in_all(ParametricFilm(0.6, 0.8, tilt, spread), bins)
    # Patches at the pane's plane: cut in 4 × 4 parts for the film, in 8 × 8 for the irradiance.
    whole = irradiance_of(bins)[irradiance_of(bins) > 0] > 0.15 * irradiance_of(bins)[1:146].max()
    whole[146 - np.sum(irradiance_of(bins)[:146] == 0) :] = True
    np.testing.assert_allclose(transmittance[whole], 0.6, rtol=1e-4)


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
        share = answer[:, 146 + number] * np.pi / 1024 / irradiance_of(bins)[146 + number] / 0.7
        assert share.sum() == pytest.approx(1, rel=1e-4)
        # What 16 points in a cell miss, beside the counts' own scatter.
        scatter = np.sqrt(count * share + (0.01 * count * share) ** 2)
        assert abs((seen - count * share) / scatter).max() < 4.5


@pytest.mark.parametrize(("flip", "turn"), [(False, False), (True, False), (False, True)])
def test_a_measured_film_lets_out_what_its_file_says(bins, flip, turn):
    film = MeasuredFilm(PRISM, flip=flip, turn=turn)
    transmittance = leaves_in_all(film, bins)[-3:]
    tree = energy.scaled_to_conserve(bsdf_file.read(PRISM))[0].components["tf" if flip else "tb"]
    # The directions to the light, as the mounted file sees them.
    toward = bins.suns.directions[:3] @ bins.frame.T
    toward = toward * np.array([-1, 1, -1]) if flip else toward
    toward = toward * np.array([-1, -1, 1]) if turn else toward
    expected = tree.hemispherical(toward)
    np.testing.assert_allclose(transmittance, expected, rtol=0.03)


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
    "groups": (
        (
            ('[shading]\nmaterial = "shade"\n',
             '[groups.south]\npanes = ["glass"]\nstates = ["opal", "shade"]\n'
             '[materials.opal]\ntype = "diffuser"\ntransmittance = 0.4\n'),
        ),
        "opal/open",
    ),
    "a film that reflects what a window of another side lets in": (
        (
            (str(PRISM), "white.xml"),
            ('top = 1.8, material = "glass"', 'top = 1.8, material = "film"'),
            ("[materials.glass]",
             '[facade.east]\nstrips = [{ bottom = 1.2, top = 1.6, material = "open" }]\n'
             "[materials.glass]"),
        ),
        "open",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", slowly(CASES, *list(CASES)[1:3]))
def test_the_case_s_own_film_gives_what_the_simulation_gives(tmp_path, same, name):
    changes, state = CASES[name]
    white = {"tf": "{0.05}", "tb": "{0.05}", "rf": "{0.26}", "rb": "{0.26}"}
    (tmp_path / "white.xml").write_text(xml("TensorTree4", white))
    case = case_of(tmp_path, *changes)
    light = daylight(case)
    year = FilmYear.of(case, light, state=state)
    material = case.materials["film"]
    film = MeasuredFilm(material.file, material.flip, material.turn)
    other = case.model_copy(update={"accuracy": case.accuracy.model_copy(update={"seed": 8})})
    C = simulation.transport(other, state, light.suns, light.sky.attrs["latitude"])
    rest, answer = year.coefficients, film.answer(year.bins).numpy()
    assert list(rest["bin"].values) == list(C["bin"].values)
    ours = rest["replicates"].values + year.transfers @ answer
    part = year.transfers @ answer
    assert part.sum() > 0.1 * ours.sum()
    same(ours, other=C["replicates"].values, within=0.01)
    # E of the year is these coefficients times L.
    E = year.illuminance(film).numpy()
    np.testing.assert_allclose(E, (ours.mean(axis=0) @ year.L.numpy()).T, rtol=1e-4, atol=0.05)
    np.testing.assert_allclose(year.replicates(film).mean(axis=0), E, rtol=1e-4, atol=0.05)
    error = year.error(film)
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
    """Every illuminance has a weight of its own, so that no symmetry hides an error."""
    shape = year.rest.shape
    return (np.random.default_rng(5).random(shape) / np.prod(shape)).astype(np.float32)


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
        answer = Mix(PRISM_FILM, other_film(), share).answer(bins).numpy()
        mixed = (1 - share) * expected + share * second
        np.testing.assert_allclose(answer, mixed, rtol=1e-4, atol=1e-9)


# Refusals


@pytest.mark.parametrize(
    ("changes", "message"),
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
        ((("corner = [1.0, 1.5, 0.7]", "corner = [1.0, -1.5, 0.7]"),), "other things shade"),
        ((('"off"', '"on"'),), 'straight_through = "off"'),
        ((("rotation = 0.0", "rotation = 0.0\nfloor = [0.1, 0.2, 0.3]"),), "grey"),
    ],
)
def test_cases_that_do_not_fit_are_refused(tmp_path, changes, message):
    with pytest.raises(InputError, match=message):
        FilmYear.of(case_of(tmp_path, *changes))


def test_true_suns_take_the_place_of_an_adaptive_one(tmp_path):
    adaptive = case_of(tmp_path, ("[period]", '[sun]\nmodel = "adaptive"\n[period]'))
    with pytest.raises(InputError, match="that of an adaptive sun; leave it out"):
        FilmYear.of(adaptive, daylight(adaptive), depth=2)
    years = [FilmYear.of(one, depth=2) for one in (adaptive, case_of(tmp_path))]
    np.testing.assert_array_equal(*(year.rest.numpy() for year in years))


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
