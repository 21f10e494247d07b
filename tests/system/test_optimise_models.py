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
from tests.system.every_room import MODELS, SHADING, write_models

METRICS = "[metrics]\nsda_threshold = 600\n"
DESIGN = '[design]\nfilm = "opal"\nstarts = 1\nsharpness = [8.0]\npareto = 0\n'
GROUPED = "Radiance model with groups"
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
    slowly(MODELS, "mesh", GROUPED),
)
def test_a_search_is_simulations_and_finds_what_a_sweep_finds(tmp_path, name):
    case = case_of(tmp_path, name)
    layout = ModelLayout.of(case)
    year = layout.year()
    problem = layout.problem(year)
    assert year.tiles.area.sum() == pytest.approx(4)
    for column in (1, 2):
        share = np.zeros((len(year.tiles), 3), np.float32)
        share[:, column] = 1
        applied = problem.measure.groups.applied(year.illuminance(mi.TensorXf(share)))
        result = drcmitsuba.evaluate(filled(layout, case, column))
        agrees(applied, result)
        low, high = (result.metrics["sDA"][end] for end in ("low", "high"))
        assert low <= problem.hard(share).aim <= high
    compare_with_differences(problem)
    optimum = optimise(problem, layout.search, known=layout.known(problem))
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 6)] * problem.size), -1)
    sweep = max(problem.evaluate(x, 8.0).hard.value for x in grid.reshape(-1, problem.size))
    assert optimum.best.hard.value >= sweep - 1e-6
    fresh = layout.afresh(optimum).metrics
    assert fresh["sDA"]["low"] - 5 <= optimum.best.hard.aim <= fresh["sDA"]["high"] + 5  # a sensor


def filled(layout, case, column):
    """Case whose searched panes are as drawn (1) or have the film (2)."""
    names = layout.openings.clear_materials if column == 2 else ()
    films = dict.fromkeys(names, case.materials["opal"])
    return case.with_tables(materials={**case.materials, **films})


def agrees(applied, result):
    """Compare E (time, sensor) [lx] in the states that groups take with that of a result."""
    E = result.illuminance[["total", "total_se"]].transpose("time", "sensor")
    total, error = E["total"].values, E["total_se"].values
    assert (abs(applied - total) > 6 * (error + 0.01 * total)).mean() < 0.01
    assert applied.mean() == pytest.approx(total.mean(), rel=0.01)


FREE = "glazing_transmittance = [0.3, 0.8]\nshade_vlt = [0.05, 0.3]\n"
GLASS, SHADE = 0.45, 0.2
OTHERS = (
    ("transmittance = 0.6", f"transmittance = {GLASS}"),
    (
        "transmittance = 0.1",
        f"transmittance = {SHADE}",
    ),
)


@pytest.mark.parametrize("name", slowly(["mesh", GROUPED], "mesh", GROUPED))
def test_transmittances_are_those_of_cases_that_have_them(tmp_path, name):
    shade = "" if SHADING in MODELS[name] else SHADING
    layout = ModelLayout.of(case_of(tmp_path, name, shade + DESIGN + FREE))
    text = (tmp_path / "case.toml").read_text()
    for old, new in OTHERS:
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "other.toml").write_text(text)
    other = drcmitsuba.load_case(tmp_path / "other.toml")
    problem = layout.problem(layout.year())
    free = {"glazing_transmittance": (GLASS - 0.3) / 0.5, "shade_vlt": (SHADE - 0.05) / 0.25}
    for column in (1, 2):
        x = problem.of_fractions({"film": column - 1, **free})
        _, E = problem.illuminance(problem.values(mi.Float(x)))
        agrees(
            problem.measure.groups.applied(E), drcmitsuba.evaluate(filled(layout, other, column))
        )
    compare_with_differences(problem)
    optimum = optimise(problem, layout.search, known=layout.known(problem))
    fresh = layout.afresh(optimum)
    _, E = problem.illuminance(problem.values(mi.Float(optimum.best.x)))
    agrees(problem.measure.groups.applied(E), fresh)
    materials, best = fresh.metrics["settings"]["materials"], optimum.values
    assert materials["pane_1"] == materials["pane_2"]
    for key, material in (("glazing_transmittance", "pane_1"), ("shade_vlt", "shade")):
        assert materials[material]["transmittance"] == pytest.approx(float(best[key][0]))
    assert materials["opal"]["transmittance"] == 0.5


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


@pytest.mark.slow
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
        (DESIGN + "shade_vlt = [0.2, 0.5]\n", 'design.shade_vlt: "shade" and "opal" are the same'),
        (DESIGN + "glazing_transmittance = [0.2, 0.5]\n", '"pane_1" stands within rooms, too'),
        (DESIGN + 'parameters = "window"\n', "panes and walls of a model are no one window"),
        (DESIGN.replace("opal", "pane_1"), 'design.film: "pane_1" is no such material'),
    ],
)
def test_what_panes_of_a_model_have_not_is_refused(tmp_path, design, message):
    """In a room with a pane in its middle, and with a shade of the film's values."""
    case_of(tmp_path, "mesh", design)
    with (tmp_path / "rooms.obj").open("a") as mesh:
        mesh.writelines(f"v 2 {y} {z}\n" for y, z in ((2, 1), (3, 1), (3, 2), (2, 2)))
        mesh.write("usemtl pane_1\nf -4 -3 -2 -1\n")
    text = (
        (tmp_path / "case.toml").read_text().replace("transmittance = 0.1", "transmittance = 0.5")
    )
    (tmp_path / "case.toml").write_text(text)
    with pytest.raises(InputError) as error:
        ModelLayout.of(drcmitsuba.load_case(tmp_path / "case.toml"))
    assert message in str(error.value)
