"""The search for a film: a film that is known, the noise of derivatives, what is refused."""

import json
from types import SimpleNamespace

import drjit as dr
import mitsuba as mi
import numpy as np
import pandas as pd
import pytest

from drcmitsuba.design.film import Mix, ParametricFilm
from drcmitsuba.design.film_problem import gradient, gradient_error
from drcmitsuba.design.film_search import optimise_film
from drcmitsuba.design.film_year import FilmYear
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from tests.unit.design.film_room import PRISM_FILM, case_of, other_film


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


@pytest.mark.slow
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


def test_searches_that_cannot_be_are_refused(year):
    def objective(E):
        return dr.mean(E.array)

    for message, options in {
        "no parameter 'share'": {"ranges": {"share": (0, 1)}},
        "tilt: 3, 3": {"ranges": {"tilt": (3, 3)}},
        "starts: 0": {"starts": 0},
    }.items():
        with pytest.raises(InputError, match=message):
            optimise_film(year, objective, **options)
    with pytest.raises(InputError, match="objective: value: nan"):
        optimise_film(year, lambda E: dr.mean(dr.log(-E.array)))
