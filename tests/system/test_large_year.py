"""A year summed block by block has the numbers of one whose arrays are kept, in little memory."""

import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest
import xarray as xr

import drcmitsuba
from drcmitsuba import load_case
from drcmitsuba.annual import sensor_stream, summed_year
from drcmitsuba.annual.large_result import LargeResult
from drcmitsuba.annual.result import Result
from drcmitsuba.annual.sensor_stream import aligned
from drcmitsuba.metrics import facade_states
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.transport import coefficients, elements, replicate
from drcmitsuba.transport.interreflection import interior
from drcmitsuba.transport.interreflection.first_bounce import CellLight
from drcmitsuba.transport.interreflection.solved_cells import Transfer
from tests.system.small_room import SHADING, changed, run

ALONE = '[output]\nilluminance = "metrics"\n[accuracy]'
SHARES = ("sDA", "ASE", "shade_closed", "msDA", "MSE", "shade_closed_monthly")
EAST = """
[facade.east]
strips = [{ bottom = 0.9, top = 2.7, material = "glass" }]
[facade.south]"""
FURTHER = '\n[[furniture]]\nname = "desk"\ncorner = [0.2, 4.0, 0.0]\nsize = [0.5, 0.5, 0.7]\n'
COLOURED = FURTHER + "reflectance = [0.6, 0.4, 0.2]\n"


def case_of(folder, *changes, more=""):
    path = folder / "case.toml"
    text = changed(("months = [3, 6]", "months = [3]"), *changes)
    path.write_text(text.replace("[sensors]", more + "[sensors]"))
    return load_case(path)


def compare(whole, large):
    """Metrics and their intervals, and metrics of the sensors."""
    assert isinstance(whole, Result)
    assert isinstance(large, LargeResult)
    for name in (*SHARES, "undecided"):
        assert large.metrics[name] == whole.metrics[name], name
    E, sensors = whole.illuminance, large.sensors
    total = E["total"]
    if "channel" in total.dims:
        return
    np.testing.assert_allclose(sensors["mean_illuminance"], total.mean("time"), rtol=1e-5)
    np.testing.assert_array_equal(
        sensors["autonomy"], 100 * (total >= 300).sum("time") / total.sizes["time"]
    )
    np.testing.assert_array_equal(sensors["sun_hours"], (E["direct_sun"] >= 1000).sum("time"))


@pytest.mark.parametrize(
    ("changes", "more"),
    [
        ((), ""),
        (((SHADING, ""),), ""),
        pytest.param((("count = [5, 5]", "count = [3, 3]"),), COLOURED, marks=pytest.mark.slow),
    ],
    ids=["shade", "no shade", "coloured"],  # channels are summed by luminance
)
def test_one_block_has_the_same_numbers(tmp_path, changes, more):
    case = case_of(tmp_path, *changes, more=more)
    large = drcmitsuba.evaluate_within(case, memory=1)
    compare(drcmitsuba.evaluate(case), large)
    assert large.metrics["settings"]["notes"][-1].startswith("E and C are not kept")


@pytest.fixture
def sums_of_groups(monkeypatch):
    """Any second state of a façade makes its year a sum over groups, of 7 sensors at once."""
    monkeypatch.setattr(facade_states, "most_states", lambda groups: 1)
    monkeypatch.setattr(summed_year, "ENTRIES", 7 * 31 * 13)


@pytest.mark.slow
def test_groups_of_panes_that_close_one_by_one(tmp_path):
    case = case_of(tmp_path, ("[facade.south]", EAST))
    whole, large = drcmitsuba.evaluate(case), drcmitsuba.evaluate_within(case, memory=1)
    compare(whole, large)
    assert whole.coefficients.sizes["state"] > 2
    assert large.metrics["groups"] == whole.metrics["groups"]


def test_groups_of_panes_whose_year_is_a_sum(tmp_path, sums_of_groups):
    case = case_of(tmp_path, ("[facade.south]", EAST))
    whole = drcmitsuba.evaluate(case)
    assert whole.coefficients.sizes["state"] == 1  # no state's coefficients are kept
    large = drcmitsuba.evaluate_within(case, memory=1)
    compare(whole, large)
    assert large.metrics["groups"] == whole.metrics["groups"]


@pytest.mark.slow
def test_a_sum_over_groups_goes_on_where_it_was_stopped(tmp_path, monkeypatch, sums_of_groups):
    case, blocks = case_of(tmp_path, ("[facade.south]", EAST)), tmp_path / "blocks"
    summed, sum_up = [], elements.illuminance

    def stopped(*args, **kwargs):
        if len(summed) == 2:
            raise KeyboardInterrupt
        summed.append(kwargs["receivers"][0])
        return sum_up(*args, **kwargs)

    monkeypatch.setattr(elements, "illuminance", stopped)
    with pytest.raises(KeyboardInterrupt):
        drcmitsuba.evaluate_within(case, memory=1, blocks=blocks)
    first, summed[:] = [*summed], [np.zeros((0, 3))]
    large = drcmitsuba.evaluate_within(case, memory=1, blocks=blocks)
    every = np.concatenate([*first, *summed[1:]])
    assert len(first) + len(summed[1:]) == 3
    assert len(np.unique(every, axis=0)) == len(every) == 25  # no sensor twice
    monkeypatch.setattr(elements, "illuminance", sum_up)
    assert large.metrics["sDA"] == drcmitsuba.evaluate_within(case, memory=1).metrics["sDA"]


def test_light_that_waits_on_the_disk_is_the_same(tmp_path, monkeypatch):
    case = case_of(tmp_path, (SHADING, ""))
    monkeypatch.setattr(replicate, "MANY", 0)
    monkeypatch.setattr(Transfer, "pays", lambda *_: True)
    held = drcmitsuba.evaluate(case)
    parked, park = [], CellLight.parked
    monkeypatch.setattr(coefficients, "HELD", 0)
    monkeypatch.setattr(replicate, "TOGETHER", 1)  # each replicate in launches of its own
    monkeypatch.setattr(CellLight, "parked", lambda *a: parked.append(a[1]) or park(*a))
    waiting = drcmitsuba.evaluate(case, blocks=tmp_path / "blocks")
    assert len(parked) == case.accuracy.replicates
    assert all(file.closed for file in parked)
    xr.testing.assert_identical(waiting.illuminance, held.illuminance)


@pytest.mark.slow
def test_an_adaptive_sun_refines_a_mesh_for_each_block(tmp_path, monkeypatch):
    case = case_of(tmp_path, ("[accuracy]", "[sun]\nmodel = 'adaptive'\n[accuracy]"))
    whole, one = drcmitsuba.evaluate(case), drcmitsuba.evaluate_within(case, memory=1)
    compare(whole, one)
    assert one.plan["suns"]["mesh_suns"] == whole.plan["suns"]["mesh_suns"]
    monkeypatch.setattr(sensor_stream, "MESHED", 10)
    several = drcmitsuba.evaluate_within(case, memory=1)
    mean = whole.illuminance["total"].mean("time")
    error = np.sqrt((whole.illuminance["total_se"] ** 2).mean("time"))
    assert several.plan["suns"]["mesh_suns"] > 0
    np.testing.assert_array_equal(several.sensors["sun_hours"], one.sensors["sun_hours"])
    assert (abs(several.sensors["mean_illuminance"] - mean) < 5 * error).all()


def test_many_blocks_differ_by_draws_of_the_sun_alone(tmp_path, monkeypatch):
    case = case_of(tmp_path, ("[accuracy]", ALONE))
    monkeypatch.setattr(interior, "SENSORS", 7)
    whole, large = drcmitsuba.evaluate(case), drcmitsuba.evaluate_within(case)
    for name in ("sDA", "ASE", "shade_closed"):
        assert large.metrics[name]["value"] == whole.metrics[name]["value"]
    for name in ("msDA", "MSE"):
        for mine, theirs in zip(large.metrics[name], whole.metrics[name], strict=True):
            assert (mine is None) == (theirs is None)
            assert mine is None or mine["value"] == theirs["value"]
    # Blocks have their own draws of the sun; one of 25 sensors is 4 points.
    for name in ("sDA", "ASE", "shade_closed"):
        for end in ("low", "high"):
            assert abs(large.metrics[name][end] - whole.metrics[name][end]) <= 4.0


def test_the_command_writes_metrics_of_sensors_and_removes_other_arrays(
    tmp_path, monkeypatch, capsys
):
    folder = tmp_path / "results"
    path = tmp_path / "case.toml"
    path.write_text(changed(("months = [3, 6]", "months = [3]")))
    run(monkeypatch, "evaluate", path, "-o", folder)
    run(monkeypatch, "evaluate", path, "-o", folder, "--memory", "1 MiB")
    assert "E and C are not kept: they do not fit" in " ".join(capsys.readouterr().out.split())
    left = {p.name for p in folder.iterdir()}
    assert {"sensors.nc", "sky.zarr", "metrics.json", "plan.json", "autonomy_plan.png"} <= left
    assert not left & {"illuminance.nc", "coefficients.zarr", "unfinished"}
    with xr.open_dataset(folder / "sensors.nc") as sensors:
        assert sensors.sizes["sensor"] == 25
        assert sensors["autonomy"].attrs["units"] == "%"
        assert set(sensors.coords) == {"x", "y", "z"}


def test_metrics_alone_beside_a_target_are_refused_by_name(tmp_path):
    case = case_of(tmp_path, ("[accuracy]", f'{ALONE}\ntarget = "1 point"'))
    with pytest.raises(InputError, match=r"output\.illuminance: .* beside a target"):
        drcmitsuba.evaluate_within(case)


def test_a_size_of_memory_that_is_none_is_refused(tmp_path, monkeypatch, capsys):
    path = tmp_path / "case.toml"
    path.write_text(changed())
    with pytest.raises(SystemExit) as stop:
        run(monkeypatch, "evaluate", path, "-o", tmp_path / "r", "--memory", "plenty")
    assert stop.value.code == 2
    assert "--memory" in capsys.readouterr().err
    assert not (tmp_path / "r").exists()


def test_streams_of_other_blocks_meet_sensor_by_sensor():
    def stream(*edges):
        for start, stop in pairwise(edges):
            yield slice(start, stop), xr.Dataset({"n": ("sensor", np.arange(start, stop))})

    seen = []
    for here, (one, two) in aligned([stream(0, 3, 4, 9), stream(0, 4, 8, 9)]):
        np.testing.assert_array_equal(one["n"], np.arange(here.start, here.stop))
        np.testing.assert_array_equal(two["n"], one["n"])
        seen.append((here.start, here.stop))
    assert seen == [(0, 3), (3, 4), (4, 8), (8, 9)]


def test_whole_arrays_are_kept_where_the_case_wants_them_whatever_the_memory(tmp_path):
    case = case_of(tmp_path, ("[accuracy]", ALONE.replace("metrics", "all")))
    assert isinstance(drcmitsuba.evaluate_within(case, memory=1), Result)


MEMORY = """
import sys
from drcmitsuba import evaluate_within, load_case
from drcmitsuba.runtime.machine_memory import peak_memory
case = load_case("classroom/reference/existing")
n = int(sys.argv[1])
sensors = case.sensors.model_copy(update={"count": (n, n), "spacing": 7.0 / n})
accuracy = case.accuracy.model_copy(update={"replicates": 2, "sensor_sky_rays": 256})
case = case.with_tables(sensors=sensors, accuracy=accuracy)
evaluate_within(case, memory=1)
print(peak_memory())
"""


@pytest.mark.slow
def test_memory_is_flat_from_5776_to_57600_sensors():
    """E of the further sensors in one state would take 0.7 GiB; a part of it is allocators'."""
    peaks = []
    for count in (76, 240):
        command = [sys.executable, "-c", MEMORY, str(count)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        peaks.append(int(done.stdout))
    assert peaks[1] - peaks[0] <= 200 << 20
    assert peaks[1] <= 3 << 30


def test_a_summed_year_has_the_suns_of_its_period_alone(tmp_path):
    """Verdicts want C and E, which are not kept: the year's further suns would serve nothing."""
    path, week = tmp_path / "case.toml", changed(("months = [3, 6]", "hours = [10, 12]"))
    path.write_text(week.replace("[accuracy]", ALONE))
    large = drcmitsuba.evaluate_within(path)
    assert isinstance(large, LargeResult)
    assert large.daylight.year is None
    assert large.daylight.suns.labels == daylight(load_case(path)).suns.labels
    path.write_text(week)
    whole = drcmitsuba.evaluate_within(path)
    assert len(whole.daylight.suns.labels) > 4 * len(large.daylight.suns.labels)
    for name in ("sDA", "ASE", "shade_closed"):
        assert large.metrics[name]["value"] == whole.metrics[name]["value"]
