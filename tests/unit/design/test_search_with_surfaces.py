"""Searches of a model whose groups have states with surfaces of their own: a shelf, a tree."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.annual import simulation
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.summed_year import luminances_of
from drcmitsuba.case.design import Design
from drcmitsuba.case.views import ViewTable
from drcmitsuba.design.composed_facades import ComposedFacade
from drcmitsuba.design.model_layout import ModelLayout
from drcmitsuba.design.optimise import optimise
from drcmitsuba.glare_year import EyesOfSearch
from drcmitsuba.model.materials import DiffuserMaterial
from drcmitsuba.plan import plan
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.prepared_case import prepared
from tests.unit.annual.test_summed_year import case_by_the_hour


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def searched(tmp_path, **design):
    """Case of a window with a shelf that the sun closes, and of a tree that loses its leaves."""
    one = case_by_the_hour(tmp_path, "06-21", "09-23", tree=("winter", "summer"))
    dim = DiffuserMaterial(type="diffuser", transmittance=0.1)
    materials = {**one.materials, "dim": dim}
    return one.with_tables(materials=materials, design=Design(film="dim", **design))


@pytest.mark.slow
def test_every_state_has_its_surfaces(tmp_path):
    one = searched(tmp_path)
    layout = ModelLayout.of(one)
    tiled, light = layout.light()
    assert {*tiled.channels[0].known} == {(0, 0), (1, 0), (0, 1), (1, 1)}
    year, groups = layout.year(), tiled.groups
    filmed = one.with_tables(materials={**one.materials, "clear": one.materials["dim"]})
    means = []
    for share, case in (([[0.0, 1, 0]], one), ([[0.0, 0, 1]], filmed)):
        ours = np.stack([E.numpy() for E in year.illuminance(mi.TensorXf(share)).states])
        C, run = [], Run.of(case, plan(case, light).scope)
        for row in groups.indices:
            label = prepared(case).groups.states.label(row)
            C.append(simulation.transport(case, label, light.suns, 40.0, run=run))
        L = luminances_of(light, C[0]["bin"].values).toarray()
        theirs = np.stack([np.einsum("rsb,tb->rts", of["replicates"].values, L) for of in C])
        error = np.sqrt(2 / 8) * theirs.std(axis=1, ddof=1)
        assert (abs(ours - theirs.mean(axis=1)) / error).max() < 6
        np.testing.assert_allclose(ours.mean((1, 2)), theirs.mean((1, 2, 3)), rtol=0.03)
        means.append(ours.mean((1, 2)))
        composed = ComposedFacade(case, tiled, np.array(share))
        every = composed.year(light, groups.indices[np.zeros(len(light.sky["time"]), int)], None)
        np.testing.assert_allclose(every["illuminance"].mean("replicate"), ours[0], rtol=2e-3)
    (bare, closed, *_), (filmed_bare, *_) = means
    assert closed < 0.3 * bare
    assert filmed_bare < 0.5 * bare


def test_gradients_are_those_of_differences(tmp_path):
    year = ModelLayout.of(searched(tmp_path)).year()

    def total(film):
        share = mi.TensorXf(mi.Float(0, 1, 0) + mi.Float(0, -1, 1) * film, (1, 3))
        return sum(dr.sum(mi.Float64(E.array)) for E in year.illuminance(share).states)

    film = mi.Float(0.4)
    dr.enable_grad(film)
    dr.backward(total(film))
    difference = (total(mi.Float(0.5)) - total(mi.Float(0.3)))[0] / 0.2
    np.testing.assert_allclose(dr.grad(film)[0], difference, rtol=1e-3)


def test_a_search_and_its_evaluation_afresh_agree(tmp_path):
    layout = ModelLayout.of(searched(tmp_path))
    problem = layout.problem(layout.year())
    found = optimise(problem, layout.search, known=layout.known(problem))
    _, E = problem.illuminance(problem.values(mi.Float(found.best.x)))
    result = layout.afresh(found)
    assert not any("variants" in note for note in result.metrics["settings"]["notes"])
    afresh = result.illuminance
    np.testing.assert_array_equal(
        problem.year.groups.indices[problem.measure.states(E)], afresh["facade_state"]
    )
    assert set(np.unique(afresh["facade_state"][:, 1])) == {0, 1}  # the tree has leaves in autumn
    ours = problem.year.groups.applied(E)
    np.testing.assert_allclose(ours.mean(axis=1), afresh["total"].mean("sensor"), rtol=0.05)


def test_glare_of_a_search_names_the_group(tmp_path):
    one = searched(tmp_path, glare_limit=5.0)
    views = {"eye": ViewTable(position=(2, 2, 1.2), direction=(0, -1, 0))}
    with pytest.raises(InputError, match=r"groups\.south: its states have surfaces of their own"):
        ModelLayout.of(one.with_tables(views=views)).year(trace_eyes=EyesOfSearch.of)
