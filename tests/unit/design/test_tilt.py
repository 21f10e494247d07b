"""The tilt of lamellae as a design variable: differences, the search, and what is refused."""

import json
from dataclasses import replace
from types import SimpleNamespace

import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.annual import simulation
from drcmitsuba.case.case import Case
from drcmitsuba.case.metrics import Metrics
from drcmitsuba.design import pictures
from drcmitsuba.design.measure import Measure
from drcmitsuba.design.parameters import Parameter
from drcmitsuba.design.simulated_tilt import SimulatedTilt
from drcmitsuba.design.tilt import TiltGoal, TiltProblem
from drcmitsuba.design.tilt_search import optimise_tilt
from drcmitsuba.metrics import Interval
from drcmitsuba.metrics.evaluate_metrics import evaluate_metrics
from drcmitsuba.metrics.intervals.rules import Rules
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import checked
from drcmitsuba.transport.elements.state_illuminances import Illuminances

SLATS = """[structure]
kind = "lamellae"
period = 100
width = 100
tilt = 5
turn = -30
reflectance = 0.9
specular = 1
"""
PRISM = """[structure]
kind = "prism"
n = 1.49
period = 20
polygons = [[[0, 0], [4, 0], [14, 4, 10], [4, 20], [0, 20]]]
"""


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


def case(folder, text=SLATS, design=None, strip="lamellae", **changes):
    (folder / "recipe.toml").write_text(text)
    (folder / "stamps.csv").write_text("time\n2015-03-20T12:00\n2015-06-20T10:00\n")
    tables = {
        "period": {"timestamps": str(folder / "stamps.csv")},
        "room": {"size": [4.0, 4.0, 3.0]},
        "facade": {"south": {"strips": [{"bottom": 1.8, "top": 2.8, "material": strip}]}},
        "materials": {
            "glass": {"type": "glazing", "transmittance": 0.7},
            "shade": {"type": "diffuser", "transmittance": 0.1},
        },
        "components": {"lamellae": {"type": "structure", "recipe": str(folder / "recipe.toml")}},
        "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 3], "spacing": 1.0},
        "metrics": {"sda_threshold": 3000.0, "ase_hours": 1.0},
        "accuracy": {
            "replicates": 8, "paths": 128, "photons": 1024, "sensor_sky_rays": 2048,
            "cell_sky_rays": 64, "sensor_square": 1.0,
        },
        "design": {"component": "lamellae"} if design is None else design,
    }  # fmt: skip
    return checked(Case, tables | changes, "room.toml")


def with_seed(problem, seed, step):
    accuracy = problem.case.accuracy.model_copy(update={"seed": seed})
    seeded = problem.case.model_copy(update={"accuracy": accuracy})
    return replace(problem, case=seeded, step=step, simulated={})


@pytest.mark.slow
def test_slopes_add_up_to_a_wide_difference_with_other_seeds(tmp_path):
    """Over four degrees by two slopes of two degrees each, whatever the curve in between.

    The two ends of the wide difference share no seed.
    """
    problem, k = TiltProblem.of(case(tmp_path)), 1.0
    narrow, wide = [], []
    for seed in range(4):
        one = with_seed(problem, seed, 1.0)
        slopes = [one.slope(problem.free(tilt), k).value for tilt in (23.0, 25.0)]
        narrow.append(np.mean(slopes))
        ends = [
            with_seed(problem, 100 + 2 * seed + i, 1.0).evaluate(problem.free(tilt), k).smooth.value
            for i, tilt in enumerate((22.0, 26.0))
        ]
        wide.append((ends[1] - ends[0]) / 4)
    error = np.hypot(*(np.std(v, ddof=1) / np.sqrt(len(v)) for v in (narrow, wide)))
    expected = np.mean(wide)
    print(f"{np.mean(narrow):.3f} and {expected:.3f}, ± {error:.3f} of the difference")
    assert error < 0.08 * abs(expected)  # or it would tell nothing
    assert abs(np.mean(narrow) - expected) < max(0.02 * abs(expected), 3 * error)


def test_a_shade_may_have_no_clear_pane_to_cover(tmp_path):
    """The plan leaves it out; the search knows its state all the same."""
    problem = TiltProblem.of(case(tmp_path, shading={"material": "shade"}))
    E = problem.simulate(23.0).E
    np.testing.assert_array_equal(E.shaded.numpy(), E.open.numpy())


def test_numbers_are_those_of_an_evaluation_with_the_same_seed(tmp_path):
    """Also with a shade, whose twin needs more of the shaded state than an evaluation does."""
    shade = {"material": "shade", "threshold": 500.0}
    facade = {"south": {"strips": [
        {"bottom": 0.5, "top": 1.5, "material": "glass"},
        {"bottom": 1.8, "top": 2.8, "material": "lamellae"},
    ]}}  # fmt: skip
    problem = TiltProblem.of(case(tmp_path, shading=shade, facade=facade))
    built = problem.built(23.0)
    assert built.components["lamellae"].tilt == 23.0
    assert built.source == problem.case.source
    sky = problem.daylight
    judged = evaluate_metrics(built, sky, simulation.coefficients(built, sky))
    assert judged.illuminance["shade_closed"].any()
    candidate = problem.evaluate(problem.free(23.0), 1e4)
    assert candidate.hard.aim == pytest.approx(judged.metrics["sDA"]["value"])
    assert candidate.hard.ase == pytest.approx(judged.metrics["ASE"]["value"])
    assert candidate.smooth.aim == pytest.approx(candidate.hard.aim, abs=1)
    assert problem.simulated[23.0].aim == Interval(**judged.metrics["sDA"])
    E = problem.simulated[23.0].E
    closed = judged.illuminance["shade_closed"].values[:, None]
    applied = np.where(closed, E.shaded.numpy(), E.open.numpy())
    np.testing.assert_allclose(applied, judged.illuminance["total"].values, rtol=1e-4)
    assert problem.afresh(23.0).accuracy.seed != built.accuracy.seed


GROUPS = {
    "low": {"panes": ["glass"], "facing": "south"},
    "west": {"panes": ["glass"], "facing": "west", "states": ["opal", "shade"]},
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["facing", "groups", "scheduled"])
def test_groups_take_the_states_of_an_evaluation(tmp_path, kind):
    """E in the states that groups take, and its twin, beside an evaluation with the same seed."""
    hours = [f"2015-{day}T{hour:02d}:00" for day in ("03-20", "12-21") for hour in (8, 11, 13, 15)]
    (tmp_path / "hours.csv").write_text("\n".join(["time", *hours]) + "\n")
    states = np.array(["open", "opal", "shade"])[np.arange(8760) % 3]
    (tmp_path / "west.csv").write_text("\n".join(["west", *states]) + "\n")
    groups = {} if kind == "facing" else GROUPS
    if kind == "scheduled":
        groups = GROUPS | {"west": GROUPS["west"] | {"schedule": str(tmp_path / "west.csv")}}
    glass = {"bottom": 0.5, "top": 1.5, "material": "glass"}
    lamellae = {"bottom": 1.8, "top": 2.8, "material": "lamellae"}
    tables = {
        "period": {"timestamps": str(tmp_path / "hours.csv")},
        "facade": {"south": {"strips": [glass, lamellae]}, "west": {"strips": [glass]}},
        "materials": {
            "glass": {"type": "glazing", "transmittance": 0.7},
            "opal": {"type": "diffuser", "transmittance": 0.4},
            "shade": {"type": "diffuser", "transmittance": 0.1},
        },
        "shading": {"material": "shade", "threshold": 500.0, "area": 0.2},
        "groups": groups,
        "accuracy": {"replicates": 4, "paths": 32, "photons": 128, "sensor_sky_rays": 64},
    }
    problem = TiltProblem.of(case(tmp_path, **tables))
    built, sky = problem.built(23.0), problem.daylight
    judged = evaluate_metrics(built, sky, simulation.coefficients(built, sky))
    taken = judged.illuminance["facade_state"].values
    assert len(np.unique(taken, axis=0)) >= 3
    assert (taken.min(axis=0) < taken.max(axis=0))[:2].all()  # both groups move
    expected = judged.illuminance["total"].values
    E = problem.simulate(23.0).E
    np.testing.assert_allclose(problem.groups.applied(E), expected, rtol=1e-4)
    twin = problem.groups.smooth(E, 1e5).numpy()
    assert (abs(twin / expected - 1).max(axis=1) < 1e-3).mean() > 0.8
    candidate = problem.evaluate(problem.free(23.0), 1e4)
    assert candidate.hard.aim == pytest.approx(judged.metrics["sDA"]["value"])
    assert candidate.hard.ase == pytest.approx(judged.metrics["ASE"]["value"])
    assert problem.simulated[23.0].aim == Interval(**judged.metrics["sDA"])


def test_too_many_states_are_refused(tmp_path):
    strips = [{"bottom": 0.9, "top": 1.5, "material": "glass"}]
    walls = {side: {"strips": strips} for side in ("north", "east", "west")}
    south = [*strips, {"bottom": 1.8, "top": 2.8, "material": "lamellae"}]
    facade = walls | {"south": {"strips": south}}
    with pytest.raises(InputError) as caught:
        TiltProblem.of(case(tmp_path, facade=facade, shading={"material": "shade"}))
    assert str(caught.value) == (
        "case: groups: more than 12 states of the façade, by 4 groups; join groups that close "
        "together, or name fewer states in their schedules"
    )


class ByFormula(TiltProblem):
    """E by formula: brightest at a tilt of `BEST`, in the sun above another one."""

    BEST, SUNNY, STOP = 7.3, 90.0, 99
    rules = Rules(Metrics(sda_threshold=500.0, ase_hours=5.0), 1e4, 1.0, 1.0)
    measure = Measure(rules, "sDA", np.ones(10, int))

    def simulate(self, tilt, progress=lambda share: None):
        if tilt not in self.simulated:
            if len(self.simulated) == self.STOP:
                raise KeyboardInterrupt
            progress(1.0)
            light = 1000 * np.exp(-(((tilt - self.BEST) / 40) ** 2))
            E = np.outer(np.ones(10), light * np.linspace(0.3, 1, 200))
            sun = np.full(E.shape, 2000.0 if tilt > self.SUNNY else 1.0)
            E, sun = (mi.TensorXf(a.astype(np.float32)) for a in (E, sun))
            sda = self.measure.hard(Illuminances(E, E, sun))[0]
            self.simulated[tilt] = SimulatedTilt(
                Illuminances(E, E, sun), Interval(sda, sda - 2, sda + 2)
            )
        return self.simulated[tilt]


def by_formula(low=-30.0, high=30.0, start=0.0, **attributes):
    kind = type("Formula", (ByFormula,), attributes)
    light = SimpleNamespace()  # of no use: nothing is simulated
    tilt = Parameter("tilt", low, high, start)
    return kind(None, "lamellae", light, TiltGoal("sDA", 10.0), tilt, 1.0)


@pytest.mark.parametrize(
    ("options", "expected"),
    [({}, 7.3), ({"BEST": -40.0}, -30.0), ({"BEST": 40.0, "start": 12.0}, 30.0),
     ({"SUNNY": 3.2}, 3.2), ({"low": 2.0, "high": 8.0, "start": 2.0}, 7.3)],
)  # fmt: skip
def test_the_search_finds_the_tilt_in_few_simulations(options, expected):
    problem, shares = by_formula(**options), []
    optimum = optimise_tilt(problem, 32.0, shares.append)
    assert optimum.finished
    assert optimum.is_feasible
    assert problem.at(optimum.best.x) == pytest.approx(expected, abs=1.0)
    assert len(problem.simulated) < 20
    assert shares == sorted(shares)
    assert shares[-1] == 1


def test_the_optimum_is_the_best_by_hard_numbers_and_has_its_slope(tmp_path):
    problem = by_formula()
    optimum = optimise_tilt(problem)
    assert optimum.best.hard.value == max(c.objective for c in optimum.history.candidates)
    optimum.save(tmp_path)
    saved = json.loads((tmp_path / "optimum.json").read_text())
    assert saved["tilt"] == problem.at(optimum.best.x)
    assert saved["low"] <= saved["sDA"] <= saved["high"]
    assert saved["simulations"] == len(problem.simulated)
    assert abs(saved["slope_per_degree"]) < 0.5  # it is a maximum
    near = {t for t, s in problem.simulated.items() if s.aim.value >= saved["sDA"] - 4}
    assert {saved["tilt"], *saved["intervals_overlap"]} == near
    pictures.tilts(optimum).savefig(tmp_path / "tilt.png")
    pictures.search(optimum).savefig(tmp_path / "search.png")


def test_slopes_are_one_sided_at_the_bounds():
    problem = by_formula(BEST=0.0)
    assert problem.beside(-30.0) == (-30.0, -29.0)
    assert problem.beside(30.0) == (29.0, 30.0)
    assert problem.beside(3.0) == (2.0, 4.0)
    left, right = (problem.slope(problem.free(t), 4.0).value for t in (-30.0, 30.0))
    assert left > 0
    assert right == pytest.approx(-left)


def test_ctrl_c_keeps_the_best_so_far():
    optimum = optimise_tilt(by_formula(STOP=3))
    assert not optimum.finished
    assert optimum.evaluations == 3
    assert "slope_per_degree" not in optimum.to_dict()
    with pytest.raises(KeyboardInterrupt):
        optimise_tilt(by_formula(STOP=0))


@pytest.mark.parametrize(
    ("design", "line"),
    [
        ({"component": "slats"}, 'design.component: "slats" is no structure in [components]; '
         'choose from: "lamellae"'),
        ({"component": "lamellae", "film": "shade"}, "design.film: the tilt of a component is "
         "searched, not a façade; leave it out"),
        ({"component": "lamellae", "wwr": [0.2, 0.4]}, "design.wwr: the tilt of a component is "
         "searched, not a façade; leave it out"),
        ({"component": "lamellae", "tilt": [10.0, -10.0]}, "design.tilt: 10 to -10; give the lower "
         "value first, and at least 2° between"),
        ({"component": "lamellae", "tilt": [-90.0, 0.0]}, "design.tilt.0: got -90.0; input should "
         "be greater than -90"),
        ({"component": "lamellae", "tilt_step": 0}, "design.tilt_step: got 0; input should be "
         "greater than 0"),
        ({"film": "shade", "tilt": [0.0, 9.0]}, "design.tilt: no component is named; name the "
         "lamellae: component = …"),
        ({}, "design.film: neither film nor component is named; name a material, or lamellae to be "
         "tilted"),
    ],
)  # fmt: skip
def test_a_wrong_design_is_refused_with_a_remedy(tmp_path, design, line):
    with pytest.raises(InputError) as caught:
        case(tmp_path, design=design)
    assert str(caught.value) == f"room.toml: {line}"


def test_what_cannot_be_tilted_is_refused(tmp_path):
    with pytest.raises(InputError, match=r'"lamellae" stands nowhere; name it as the material'):
        case(tmp_path, strip="glass")
    with pytest.raises(InputError, match=r'recipe of "lamellae" is of kind prism; only lamellae'):
        TiltProblem.of(case(tmp_path, PRISM))
    thick = SLATS.replace("width = 100", "width = 1500")
    with pytest.raises(InputError, match="a period takes"):
        TiltProblem.of(case(tmp_path, thick, {"component": "lamellae", "tilt": [0.0, 60.0]}))
    with pytest.raises(InputError, match="design: no component is named"):
        TiltProblem.of(case(tmp_path).model_copy(update={"design": None}))
