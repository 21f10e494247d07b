"""The command `drcmitsuba lights`: files, agreement with the evaluation, refusals."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import drcmitsuba
from drcmitsuba.annual import light_tracing
from drcmitsuba.case.groups import GroupStates
from drcmitsuba.report.sky_dome import who_lights
from drcmitsuba.report.style import png
from drcmitsuba.runtime.progress import silent
from drcmitsuba.transport.windows import light_paths
from tests.system.small_room import SITE, changed, run

DAYS = ("months = [3, 6]", "months = [12]\nhours = [10, 14]")
FEWER = ("count = [5, 5]", "count = [5, 4]")
BY_PATHS = '[effects]\nsolved_cells = "off"\n'


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    path = tmp_path_factory.mktemp("lights") / "small.toml"
    path.write_text(changed(DAYS, FEWER) + BY_PATHS + SITE)
    return path


@pytest.fixture(scope="module")
def evaluated(case):
    loaded = drcmitsuba.load_case(case)
    return loaded, drcmitsuba.evaluate(loaded).save(case.parent / "results")


def test_lights_of_all_sensors_are_their_illuminance(evaluated):
    """With the same sensors the random numbers are the same, and so is the light of the year."""
    case, result = evaluated
    E = result.illuminance
    points = np.stack([E[axis].values for axis in "xy"], axis=1)
    of_all = drcmitsuba.lights(case, points, results=result)
    exposure = of_all.dataset["exposure"].sum(["state", "window", "source", "bounces"])
    expected = E["total"].sum("time") * E.attrs["step_hours"]
    assert exposure.values == pytest.approx(expected.values, rel=2e-6)
    closed = float(E["shade_closed"].sum())
    assert of_all.dataset["hours"].sel(state="shaded") == closed > 0
    assert of_all.shares.sum(["window", "source", "bounces"]).values == pytest.approx(1, rel=1e-6)
    assert "<img" in of_all._repr_html_()


@pytest.mark.parametrize(("block", "each", "whole"), [(20, 2e-6, 2e-6), (12, 0.3, 0.05)])
def test_light_of_all_sensors_is_their_illuminance(
    case, evaluated, block, each, whole, monkeypatch, capsys
):
    """In one block the random numbers are those of the evaluation, in two they are others."""
    E, folder = evaluated[1].illuminance, case.parent / "results"
    monkeypatch.setattr(light_tracing, "BLOCK", block)
    run(monkeypatch, "lights", case, "-o", folder)
    assert "all sensors" in capsys.readouterr().out
    with xr.open_dataset(folder / "light_of_sensors.nc", engine="h5netcdf") as data:
        exposure = data["exposure"].sum(["state", "window", "source", "bounces"]).values
        assert data["exposure"].sizes["source"] == 3
    expected = E["total"].sum("time").values * E.attrs["step_hours"]
    assert exposure == pytest.approx(expected, rel=each)
    assert exposure.sum() == pytest.approx(expected.sum(), rel=whole)


def test_command_writes_a_dataset_and_pictures(case, evaluated, monkeypatch, capsys):
    folder = case.parent / "results"
    run(monkeypatch, "lights", case, "--point", "1,1", "--point", "2.0,2.0", "-o", folder)
    assert "glass" in capsys.readouterr().out
    with xr.open_dataset(folder / "lights.nc", engine="h5netcdf") as data:
        assert data.attrs["by_evaluation"] == 1
        assert data.sizes["sensor"] == 2
        assert data["by_window"].attrs["units"] == "sr"
        assert float(data["hours"].sum()) == evaluated[1].illuminance.sizes["time"]
    assert len(list(folder.glob("lights_*.png"))) == 2


def test_a_state_whose_name_holds_dollars_is_drawn(case, evaluated):
    one = drcmitsuba.lights(evaluated[0], [(1, 1)], results=evaluated[1]).dataset.isel(sensor=0)
    names = np.array([f"$\\foo{{${i}" for i in range(one.sizes["state"])], object)
    assert png(who_lights(one.assign_coords(state=names)))


def test_hours_of_further_states_are_told(case, evaluated, tmp_path, monkeypatch, capsys):
    """A folder of its own: reports read lights of a folder."""
    folder = evaluated[1].save(tmp_path / "results") and tmp_path / "results"
    monkeypatch.setattr(light_tracing, "MOST_STATES", 1)
    run(monkeypatch, "lights", case, "--point", "1,1", "-o", folder)
    closed = evaluated[1].illuminance["shade_closed"].values
    fewer = min(closed.sum(), (1 - closed).sum())
    out = capsys.readouterr().out
    assert f"note: {fewer:g} h with further states of the façade are left out" in out
    with xr.open_dataset(folder / "lights.nc", engine="h5netcdf") as data:
        assert data.attrs["hours_left_out"] == fewer > 0
        assert float(data["hours"].sum()) + fewer == closed.size
    run(monkeypatch, "report", folder, "-o", tmp_path / "report.html")
    assert f"{fewer:g} h with further states" in (tmp_path / "report.html").read_text("utf-8")


@pytest.mark.parametrize(
    ("points", "line"),
    [
        (["9,9"], "no sensor within 1 m of 9, 9; the nearest one is at 3.2, 2.6, 0.8"),
        (["here"], "--point: 'here'; give --point x,y or x,y,z in metres"),
        (["1"], "--point: '1'; give --point x,y or x,y,z in metres"),
        (["nan,1"], "--point: 'nan,1'; give --point x,y or x,y,z in metres"),
        (["1,1"] * 25, "25 points; give at most 24 of them"),
    ],
)
def test_points_that_are_none_are_refused_in_one_line(case, points, line, monkeypatch, capsys):
    given = [part for point in points for part in ("--point", point)]
    with pytest.raises(SystemExit) as stop:
        run(monkeypatch, "lights", case, *given, "-o", case.parent / "none")
    assert stop.value.code == 2
    error = capsys.readouterr().err
    assert line in error
    assert error.count("\n") == 1
    assert not (case.parent / "none").exists()


def test_states_of_which_one_has_light_from_pane_to_pane_stand_side_by_side():
    names = [["south", "elsewhere"], ["south", "elsewhere", "pane to pane"]]
    parts = [
        xr.Dataset({"by_window": ("window", np.arange(1.0, len(n) + 1))}, {"window": n})
        for n in names
    ]
    C = light_tracing._by_state(parts, ["open", "shaded"])["by_window"]
    assert C["window"].values.tolist() == names[1]
    assert C.values.tolist() == [[1, 2, 0], [1, 2, 3]]


def test_very_many_windows_are_told_apart_by_their_direction_alone(case, monkeypatch):
    loaded = drcmitsuba.load_case(case)
    assert [window.name for window in light_tracing._windows(loaded)] == ["glass (south)"]
    monkeypatch.setattr(light_tracing, "MOST_WINDOWS", 0)
    assert [window.name for window in light_tracing._windows(loaded)] == ["south"]


def test_results_of_another_case_are_refused(case, evaluated):
    other = evaluated[0].with_tables(accuracy=evaluated[0].accuracy.model_copy(update={"seed": 9}))
    with pytest.raises(drcmitsuba.InputError, match="the results are not of"):
        drcmitsuba.lights(other, [(1, 1)], results=case.parent / "results")


def test_blocks_are_as_large_as_memory_holds(evaluated, monkeypatch):
    traced = light_tracing.LightTracing.of(evaluated[0], None, silent)
    bins = 146 + len(traced.suns.labels)
    each = 4 * 4 * 3 * (light_paths.MOST_BOUNCES + 1) * bins  # replicates, windows
    monkeypatch.setattr(light_paths, "MOST_BYTES", 5 * each)
    assert traced.block == 5


SOME = changed(
    ("months = [3, 6]", "months = [3]\nhours = [10, 14]"), ("count = [5, 5]", "count = [2, 2]")
)
TWO = (
    '\n[facade.east]\nstrips = [{ bottom = 0.9, top = 2.7, material = "glass" }]\n[groups.south]\n'
    'panes = ["glass"]\nfacing = "south"\nschedule = "states.csv"\n[groups.east]\n'
    'panes = ["glass"]\nfacing = "east"\nschedule = "states.csv"\n'
)


def scheduled(folder, south, east):
    """Case of two groups that keep their states."""
    (folder / "states.csv").write_text("south,east\n" + f"{south},{east}\n" * 8760)
    (folder / "case.toml").write_text(SOME + TWO + BY_PATHS + SITE)
    return drcmitsuba.load_case(folder / "case.toml")


def test_results_of_other_contents_of_a_file_are_refused(tmp_path):
    drcmitsuba.evaluate(scheduled(tmp_path, "open", "open")).save(tmp_path / "results")
    other = scheduled(tmp_path, "open", "shade")
    with pytest.raises(drcmitsuba.InputError, match="of another version of it or its files"):
        drcmitsuba.lights(other, [(1, 1)], results=tmp_path / "results")


def test_groups_are_those_of_their_names_and_a_choice_is_told(tmp_path):
    case = scheduled(tmp_path, "open", "shade")
    known = drcmitsuba.elements(case)
    result = known.evaluate()
    E = result.illuminance.assign_coords(
        facade_state=result.illuminance["facade_state"][:, ::-1].variable
    )
    groups = GroupStates(("east", "south"), (("open", "shade"),) * 2)
    turned = replace(result, illuminance=E.assign_attrs(groups.attributes()))
    for given in (result, turned):
        states = drcmitsuba.lights(case, [(1, 1)], results=given).dataset["state"]
        assert states.values.tolist() == ["open/shade"]
    chosen = known.evaluate({"south": {"glass": 0.5, "shade": 0.5}}, {"east": "shade"})
    told = chosen.metrics["settings"]
    assert (told["choice"], told["drawn"]) == ("south: 0.5 glass + 0.5 shade", "east: shade")
    with pytest.raises(drcmitsuba.InputError, match="or of a choice of fills"):
        drcmitsuba.lights(case, [(1, 1)], results=chosen)


def test_a_shade_without_any_sun_lights_as_it_does_in_an_evaluation(tmp_path):
    (tmp_path / "case.toml").write_text(SOME + BY_PATHS + 'suns = "off"\n' + SITE)
    case = drcmitsuba.load_case(tmp_path / "case.toml")
    result = drcmitsuba.evaluate(case)
    shaded = drcmitsuba.lights(case, [(0.5, 0.5), (1, 1)]).dataset.sel(state="shaded")
    assert (shaded["exposure"].sum(["window", "source", "bounces"]) > 0).all()
    assert float(shaded["exposure"].sel(source="sun").sum()) == 0
    light = drcmitsuba.lights_of_sensors(case, results=result)["exposure"]
    light = light.sum(["state", "window", "source", "bounces"])
    E = result.illuminance["total"].sum("time") * result.illuminance.attrs["step_hours"]
    assert light.values == pytest.approx(E.values, rel=2e-6)
