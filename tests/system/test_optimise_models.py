"""Searches over the panes of a model, against simulations, differences and a sweep."""

import json

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import drcmitsuba
from drcmitsuba.design.model_layout import ModelLayout
from drcmitsuba.design.optimise import optimise
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from tests.differences import slopes
from tests.fast import slowly
from tests.system.every_room import MODELS, write_models

METRICS = "[metrics]\nsda_threshold = 600\n"
DESIGN = '[design]\nfilm = "opal"\nstarts = 1\nsharpness = [8.0]\npareto = 0\n'
FINER = "replicates = 2\npaths = 16", "replicates = 6\npaths = 128"


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def case_of(folder, name, design=DESIGN):
    write_models(folder)
    (folder / "case.toml").write_text(METRICS + MODELS[name].replace(*FINER) + design)
    return drcmitsuba.load_case(folder / "case.toml")


@pytest.mark.parametrize(
    "name",
    slowly(MODELS, "mesh", "Radiance model with groups"),
)
def test_a_search_is_simulations_and_finds_what_a_sweep_finds(tmp_path, name):
    case = case_of(tmp_path, name)
    layout = ModelLayout.of(case)
    year = layout.year()
    problem = layout.problem(year)
    assert year.tiles.area.sum() == pytest.approx(4)
    names = {layout.openings.every[g].name for g in layout.openings.searched}
    films = case.with_tables(
        materials={**case.materials, **dict.fromkeys(names, case.materials["opal"])}
    )
    for column, drawn in ((1, case), (2, films)):
        share = np.zeros((len(year.tiles), 3), np.float32)
        share[:, column] = 1
        applied = problem.measure.groups.applied(year.illuminance(mi.TensorXf(share)))
        result = drcmitsuba.evaluate(drawn)
        E = result.illuminance[["total", "total_se"]].transpose("time", "sensor")
        total, error = E["total"].values, E["total_se"].values
        off = abs(applied - total) > 6 * (error + 0.01 * total)
        assert off.mean() < 0.01
        assert applied.mean() == pytest.approx(total.mean(), rel=0.01)
        low, high = (result.metrics["sDA"][end] for end in ("low", "high"))
        assert low <= problem.hard(share).aim <= high
    compare_with_differences(problem)
    optimum = optimise(problem, layout.search, known=layout.known(problem))
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 6)] * problem.size), -1)
    sweep = max(problem.evaluate(x, 8.0).hard.value for x in grid.reshape(-1, problem.size))
    assert optimum.best.hard.value >= sweep - 1e-6
    fresh = layout.afresh(optimum).metrics
    assert fresh["sDA"]["low"] - 5 <= optimum.best.hard.aim <= fresh["sDA"]["high"] + 5  # a sensor


def compare_with_differences(problem):
    """Gradients of the objective, and of the mean E in the states that groups take, to 0.1 %.

    Values of the objective have a resolution of 4e-6 % in single precision.
    """
    x, h = np.full(problem.size, 0.5), 0.06

    def mean(at):
        _, E = problem.illuminance(problem.values(at))
        return dr.mean(mi.Float64(problem.measure.groups.smooth(E, 8.0).array))

    free = mi.Float(x)
    dr.enable_grad(free)
    dr.backward(mean(free))
    by_differences = slopes(lambda at: mean(mi.Float(at))[0], x, h)
    assert dr.grad(free).numpy() == pytest.approx(by_differences, rel=1e-3)
    by_differences = slopes(lambda at: problem.evaluate(at, 8.0).smooth.value, x, h)
    ours = problem.evaluate(x, 8.0).gradient
    assert ours == pytest.approx(by_differences, rel=1e-3, abs=3 * 4e-6 / h)


def test_panes_are_chosen_by_name(run, tmp_path, monkeypatch):
    case_of(tmp_path, "mesh", DESIGN + 'panes = ["*_2"]\n')
    monkeypatch.chdir(tmp_path)
    code, out, err = run("optimise", "case.toml", "-o", "out")
    assert (code, err) == (0, "")
    assert "best façade" in out
    optimum = json.loads((tmp_path / "out" / "optimum.json").read_text())
    assert optimum["panes"] == ["pane_2 (south)"]
    assert len(optimum["composition"]["opal"]) == 1
    assert (tmp_path / "out" / "facade.png").stat().st_size > 5000
    assert json.loads((tmp_path / "out" / "fresh_metrics.json").read_text())["sDA"]


@pytest.mark.parametrize(
    ("design", "message"),
    [
        (DESIGN + 'panes = ["door"]\n', "design.panes: no clear pane is meant; name some of the"),
        (DESIGN + 'side = "west"\n', "no clear pane is meant"),
        (DESIGN + "shade_vlt = [0.2, 0.5]\n", "design.shade_vlt: the panes of a model keep their"),
        (DESIGN.replace("opal", "pane_1"), 'design.film: "pane_1" is no such material'),
    ],
)
def test_what_panes_of_a_model_have_not_is_refused(tmp_path, design, message):
    with pytest.raises(InputError) as error:
        ModelLayout.of(case_of(tmp_path, "mesh", design))
    assert message in str(error.value)
