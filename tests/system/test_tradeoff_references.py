"""References of a trade-off beside an evaluation: groups by path tracing, components by photons."""

import time

import numpy as np
import pytest

import drcmitsuba
from drcmitsuba.annual.tradeoff import finer_samples
from drcmitsuba.annual.tradeoff.errors import Yardstick
from drcmitsuba.annual.tradeoff.finer_samples import is_called_for, sample_reference
from drcmitsuba.annual.tradeoff.path_tracing import trace_reference
from drcmitsuba.annual.tradeoff.reference import number_of, rule_of, some_hours
from drcmitsuba.annual.tradeoff.run import evaluate_setting
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky.daylight import daylight
from tests.system.every_room import BOXES, MODELS, write_models

CASES = BOXES | MODELS
SECONDS = 60.0


def case_of(folder, name, accuracy="replicates = 6\npaths = 256"):
    write_models(folder)
    text = CASES[name].replace("replicates = 2\npaths = 16", accuracy)
    (folder / "case.toml").write_text(text)
    return drcmitsuba.load_case(folder / "case.toml")


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["groups", "component", "groups and component", "Radiance model with groups"]
)
def test_references_are_evaluations_without_their_errors(tmp_path, name):
    backend.select()
    case = case_of(tmp_path, name)
    times = daylight(case).sky["time"].values
    times = times[some_hours(times)]
    assert is_called_for(case) == ("component" in name)
    trace = sample_reference if is_called_for(case) else trace_reference
    reference = trace(case, times, time.monotonic() + SECONDS)
    assert len(np.unique(reference.state)) > 1
    yardstick = Yardstick(reference, case.metrics, 1.0, 1.0)
    errors = yardstick.errors(evaluate_setting(case, times), same_sensors=True)
    E = drcmitsuba.evaluate(case).illuminance.sel(time=times)  # the same numbers again
    stated = 100 * float(np.sqrt((E["total_se"] ** 2).mean()) / E["total"].mean())
    print(f"RMS {errors.rms:.2f} ± {errors.rms_error:.2f} %, stated {stated:.2f} %")
    print(
        f"mean {errors.mean.value:+.2f} ± {errors.mean.error:.2f} %, own {yardstick.own_rms:.2f} %"
    )
    assert yardstick.own_rms < 3  # else the comparison means nothing
    assert errors.rms < 1.5 * stated + 2 * errors.rms_error
    assert abs(errors.mean.value) < 4 * errors.mean.error + stated
    assert errors.shade.value == 0


def test_a_reference_that_leaves_no_time_says_how_much_it_takes(tmp_path):
    case = case_of(tmp_path, "component", "replicates = 2\npaths = 16\nphotons = 1000")
    with pytest.raises(InputError, match=r"minutes: the reference alone takes about \d+ min; give"):
        sample_reference(case, daylight(case).sky["time"].values[:1], time.monotonic() + 0.01)


def test_states_have_numbers(tmp_path):
    rule = rule_of(case_of(tmp_path, "groups"))
    indices = np.array([[0, 0], [2, 0], [0, 1], [1, 1]])
    assert number_of(rule.groups, indices).tolist() == [0, 2, 3, 4]


def test_a_finer_round_has_the_sensors_of_the_case(tmp_path):
    case = case_of(tmp_path, "groups").with_spaces(["Office"])
    finer = finer_samples._finer(case, 0)
    assert finer.output.spaces == ("Office",)
    assert finer.output.illuminance == "auto"
