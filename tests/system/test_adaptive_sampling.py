"""Sampling until a target is reached: what the rounds come to, and when they end."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import drcmitsuba
from drcmitsuba import load_case
from drcmitsuba.annual import adaptive_sampling
from drcmitsuba.annual.adaptive_sampling import of_hours
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.sample_accumulator import SampleAccumulator
from drcmitsuba.case.accuracy import Accuracy, Target
from drcmitsuba.case.groups import OPEN, SHADED
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import checked
from tests.system.test_evaluate import changed

RNG = np.random.default_rng(0)
PATHS = "paths = 32\n"


@pytest.fixture
def evaluate(tmp_path):
    def evaluate(*lines, model="true_sun", threshold=300.0):
        text = changed((PATHS, PATHS + "\n".join(lines) + "\n"))
        text += f'[sun]\nmodel = "{model}"\n[metrics]\nsda_threshold = {threshold}\n'
        (tmp_path / "case.toml").write_text(text)
        return drcmitsuba.evaluate(load_case(tmp_path / "case.toml"))

    return evaluate


# ---- target -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "target"),
    [
        ("1 point", Target(1, "point")),
        ("0.5 points", Target(0.5, "point")),
        (" 2% ", Target(2, "%")),
        ("2 % at each sensor", Target(2, "% at each sensor")),
        ("1 point of glare hours", Target(1, "point of glare hours")),
        ("0.5 points of glare hours", Target(0.5, "point of glare hours")),
    ],
)
def test_a_target_is_read(text, target):
    assert checked(Accuracy, {"target": text}, "case").goal == target
    assert Target.parse(str(target)) == target


@pytest.mark.parametrize(
    "text", ["", "1", "point", "0 points", "101 %", "-1 %", "1 point of sDA", "1 % of glare hours"]
)
def test_a_target_that_is_none_is_refused(text):
    with pytest.raises(InputError, match=r'target: .*write "1 point"'):
        checked(Accuracy, {"target": text}, "case")


# ---- samples -------------------------------------------------------------------------------------


def coefficients(sensors, bins):
    values = RNG.random((4, sensors, len(bins))).astype(np.float32)
    return xr.Dataset(
        {
            "replicates": (("replicate", "sensor", "bin"), values),
            "direct": (("sensor", "bin"), values.mean(axis=0)),
            "direct_se": (("sensor", "bin"), values.std(axis=0, ddof=1) / 2),
        },
        coords={"bin": np.array(list(bins), dtype=object)},
    )


def test_rounds_are_averaged_where_they_were_sampled():
    first, second, third = coefficients(3, "abc"), coefficients(2, "cb"), coefficients(1, "b")
    before = first.copy(deep=True)
    samples = SampleAccumulator(first)
    samples.add(second, np.array([2, 0]))
    samples.add(third, np.array([2]))
    xr.testing.assert_identical(first, before)
    a, b, c, merged = (d["replicates"].values for d in (first, second, third, samples.coefficients))
    np.testing.assert_array_equal(merged[:, 1], a[:, 1])
    np.testing.assert_array_equal(merged[..., 0], a[..., 0])
    np.testing.assert_allclose(
        merged[:, 2, 1], (a[:, 2, 1] + b[:, 0, 1] + c[:, 0, 0]) / 3, rtol=1e-6
    )
    np.testing.assert_allclose(merged[:, 0, 2], (a[:, 0, 2] + b[:, 1, 0]) / 2, rtol=1e-6)
    np.testing.assert_allclose(samples.coefficients["direct"], merged.mean(axis=0), rtol=1e-5)


def test_errors_of_rounds_add_up_as_those_of_means():
    rounds = [coefficients(1, "a") for _ in range(3)]
    samples = SampleAccumulator(rounds[0])
    for more in rounds[1:]:
        samples.add(more, np.array([0]))
    each = np.stack([r["direct_se"].values for r in rounds])
    expected = np.sqrt((each**2).sum(axis=0)) / 3
    np.testing.assert_allclose(samples.coefficients["direct_se"], expected, rtol=1e-6)


def test_bins_that_are_met_later_are_taken_as_they_come():
    first, more = coefficients(2, "ab"), coefficients(2, "bc")
    samples = SampleAccumulator(first)
    samples.extend(more)
    assert list(samples.coefficients["bin"].values) == list("abc")
    np.testing.assert_array_equal(
        samples.coefficients["replicates"][..., 1], first["replicates"][..., 1]
    )
    np.testing.assert_array_equal(
        samples.coefficients["replicates"][..., 2], more["replicates"][..., 1]
    )
    again = coefficients(1, "c")
    samples.add(again, np.array([1]))
    mean = (more["replicates"][:, 1, 1] + again["replicates"][:, 0, 0]) / 2
    np.testing.assert_allclose(samples.coefficients["replicates"][:, 1, 2], mean, rtol=1e-6)


# ---- evaluations ------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("model", ["true_sun", "adaptive"])
def test_more_rounds_narrow_the_intervals_and_seeds_fix_the_numbers(evaluate, model):
    # Half of the hours of the middle sensor are beyond this threshold.
    middle = evaluate(model=model).illuminance["total"].median("time")
    kind = {"model": model, "threshold": float(np.sort(middle)[12])}
    plain = evaluate(**kind)
    width = max(plain.metrics[m]["high"] - plain.metrics[m]["low"] for m in ("sDA", "ASE")) / 2
    assert width > 0, "the room is to have points that are too close to call"
    target = f'target = "{max(width / 2, 2.1):.2f} points"'  # one of 25 sensors is 4 points
    result, again = evaluate(target, **kind), evaluate(target, **kind)
    accuracy = result.metrics["accuracy"]
    assert accuracy["reached"]
    assert accuracy["reason"] == "target reached"
    assert accuracy["half_width"] <= max(width / 2, 2.1)
    assert accuracy["rounds"] > 1
    assert result.metrics["sDA"] == again.metrics["sDA"]
    np.testing.assert_allclose(result.illuminance["total"], again.illuminance["total"], rtol=1e-5)
    # Of the entries alone: a sensor may differ in the few hours in which its shade now moves.
    sampled = (result.illuminance["total"] != plain.illuminance["total"]).values
    se, before = (r.illuminance["total_open_se"].values[sampled] for r in (result, plain))
    assert np.sqrt((se**2).mean() / (before**2).mean()) < 0.95  # 0.71 of two rounds


def test_a_target_of_the_mean_takes_all_sensors(evaluate):
    plain = evaluate()
    result = evaluate('target = "1 %"')
    assert result.metrics["accuracy"]["reached"]
    assert result.metrics["accuracy"]["half_width"] <= 1
    if result.metrics["accuracy"]["rounds"] > 1:
        assert (result.illuminance["total"] != plain.illuminance["total"]).any("time").all()


def test_a_target_of_each_sensor_takes_those_that_miss_it(evaluate):
    plain = evaluate()
    E, se = (plain.illuminance[v].transpose("time", "sensor").values for v in ("total", "total_se"))
    widths = of_hours(E, se, plain.case.accuracy.replicates)
    wanted = round(float(np.quantile(widths, 0.8)), 2)
    result = evaluate(f'target = "{wanted} % at each sensor"')
    accuracy = result.metrics["accuracy"]
    assert accuracy["reached"]
    assert accuracy["rounds"] > 1
    assert accuracy["half_width"] <= wanted
    sampled = (result.illuminance["total"] != plain.illuminance["total"]).any("time").values
    assert sampled[widths > wanted].all()
    assert not sampled[widths < 0.9 * wanted].any()


def test_the_interval_of_hours_is_their_root_mean_square():
    E = np.array([[300.0, 0.0], [400.0, 0.0]])
    error = np.array([[3.0, 0.0], [4.0, 0.0]])
    np.testing.assert_allclose(of_hours(E, error, 6), [2.5706, 0], rtol=1e-4)


def test_the_time_limit_ends_the_sampling(evaluate):
    result = evaluate('target = "0.0001 %"', "time_limit = 0.5")
    accuracy = result.metrics["accuracy"]
    assert not accuracy["reached"]
    assert accuracy["reason"] == "limit of 0.5 s reached"
    assert accuracy["half_width"] > 0.0001
    assert 1 < accuracy["rounds"] < 200


def test_a_target_of_glare_adds_no_rounds_to_an_evaluation_and_says_so(evaluate):
    result = evaluate('target = "0.1 points of glare hours"')
    assert "accuracy" not in result.metrics
    note = 'accuracy.target: "0.1 points of glare hours" is one of `glare`'
    assert [note in said for said in result.metrics["settings"]["notes"]].count(True) == 1


def test_a_target_that_is_met_at_once_costs_nothing(evaluate):
    result = evaluate('target = "100 points"')
    assert result.metrics["accuracy"]["rounds"] == 1
    plain = evaluate().illuminance["total"]
    np.testing.assert_allclose(result.illuminance["total"], plain, rtol=1e-5)


def test_a_state_that_no_draw_takes_any_more_gets_no_round(monkeypatch):
    """Its suns may be other ones than those of the hours that were asked for."""
    light = SimpleNamespace(sky=xr.Dataset(coords={"time": np.arange(3)}))
    samples = {state: SimpleNamespace(add=lambda *_: None) for state in (OPEN, SHADED, "gone")}
    case = SimpleNamespace(accuracy=Accuracy())
    sampling = adaptive_sampling._Sampling(case, light, Run(seed=0), None, samples)
    asked = {}
    monkeypatch.setattr(adaptive_sampling, "sources", lambda sky: sky["time"].values.tolist())
    monkeypatch.setattr(
        adaptive_sampling._Sampling, "transport",
        lambda self, state, labels, *_, **__: asked.setdefault(state, labels),
    )  # fmt: skip
    possible = {SHADED: np.array([False, True, True])}
    evaluated = SimpleNamespace(draws=SimpleNamespace(possible=possible))
    sampling.add_round(1, evaluated, np.arange(2), np.array([0, 1]))
    assert asked == {OPEN: [0, 1], SHADED: [1]}
