"""`drcmitsuba comply` as a user runs it, on a case and on a folder of results."""

import json
import shutil

import numpy as np
import pytest
import xarray as xr

import drcmitsuba
from drcmitsuba import standards
from tests.system.small_room import CASE, DAYS
from tests.system.test_several_grids import written

YEAR = 'calendar = "LM-83"'


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Results of the small room, 8 to 18 h on every day of a year."""
    folder = tmp_path_factory.mktemp("year")
    (folder / "case.toml").write_text(CASE.replace(DAYS, YEAR))
    drcmitsuba.evaluate(folder / "case.toml").save(folder / "results")
    return folder / "results"


@pytest.fixture
def copied(results, tmp_path):
    return shutil.copytree(results, tmp_path / "copied")


def test_all_standards_have_a_row(run, results):
    code, out, err = run("comply", results)
    assert (code, err) == (0, "")
    for name in standards.names():
        assert f" {name} " in out
    assert "no verdict" in out  # EN 17037 wants the whole year
    assert "en-17037: 3650 of 8760 h; evaluate a whole year" in " ".join(out.split())


def test_a_verdict_in_full(run, results, tmp_path):
    code, out, err = run("comply", results, "--standard", "leed-v4.1", "-o", tmp_path / "out")
    assert (code, err) == (0, "")
    assert out.startswith("LEED v4.1, EQ credit Daylight, option 1")
    for part in ("verdict: ", "probability", "what decides: sDA", "note: ", "source, public page"):
        assert part in out
    told = json.loads((tmp_path / "out" / "compliance.json").read_text())
    (verdict,) = told["standards"]
    assert verdict["standard"] == "leed-v4.1"
    numbers = json.loads((results / "metrics.json").read_text())
    for name in ("sDA", "ASE"):
        assert verdict["quantities"][name] == pytest.approx(numbers[name])
    assert 0 <= verdict["levels"][0]["probability"] <= 1


def test_json_goes_to_stdout(run, results):
    code, out, err = run("comply", results, "--json")
    assert (code, err) == (0, "")
    told = json.loads(out)["standards"]
    assert [verdict["standard"] for verdict in told] == standards.names()
    assert "refused" in told[1]


def test_a_case_is_evaluated_first(run, results, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "case.toml").write_text(CASE.replace(DAYS, YEAR))
    code, out, err = run("comply", "case.toml", "--standard", "lm-83-12", "-o", "kept", "--view")
    assert (code, err) == (0, "")
    assert "view out of EN 17037, as far as geometry tells: minimum " in out
    seen = json.loads((tmp_path / "kept" / "compliance.json").read_text())["view_out"]
    level = drcmitsuba.metrics.view_level(
        drcmitsuba.view_distances(drcmitsuba.load_case("case.toml"))
    )
    of_level = [100 * float((level >= i).mean()) for i in (1, 2, 3)]
    assert [*seen["share"].values()] == pytest.approx(of_level)
    assert seen["median"]["distance"] is None  # nothing stands outside
    kept = json.loads((tmp_path / "kept" / "compliance.json").read_text())["standards"][0]
    assert (tmp_path / "kept" / "illuminance.nc").is_file()
    of_folder = standards.verdict("lm-83-12", standards.Evidence.of_folder(results)).to_dict()
    assert kept == json.loads(json.dumps(of_folder))  # the same numbers from files


def test_a_period_that_does_not_fit_is_refused_before_the_simulation(refused, tmp_path):
    (tmp_path / "case.toml").write_text(CASE)
    line = refused("comply", tmp_path / "case.toml", "--standard", "leed-v4.1")
    assert "440 of 3650 h from 8 to 18 h" in line
    assert 'calendar = "LM-83"' in line
    assert "of 3650 h" in refused("comply", tmp_path / "case.toml")  # no standard is covered


def test_other_versions_missing_files_and_mixed_results_are_refused(refused, copied, tmp_path):
    assert "no such standard" in refused("comply", copied, "--standard", "leed-v4")
    assert "give it with a case" in refused("comply", copied, "--weather", "w.epw")
    for option in ("--view", "--change"):
        assert "give it with a case" in refused("comply", copied, option)
    assert "name one: --standard NAME" in refused("comply", tmp_path / "case.toml", "--change")
    assert "no such file" in refused("comply", tmp_path)
    path = copied / "illuminance.nc"
    with xr.open_dataset(path, engine="h5netcdf") as data:
        E = data.load()
    E.assign_attrs(version="0.0.1").to_netcdf(path, engine="h5netcdf")
    assert "version: 0.0.1, but this is" in refused("comply", copied, "--standard", "leed-v4.1")
    E.assign_attrs(settings='{"name": "other"}').to_netcdf(path, engine="h5netcdf")
    assert "another evaluation" in refused("comply", copied, "--standard", "leed-v4.1")
    E.isel(time=slice(0, 3000)).to_netcdf(path, engine="h5netcdf")
    assert "other time stamps" in refused("comply", copied, "--standard", "leed-v4.1")
    E.drop_vars("total_open").to_netcdf(path, engine="h5netcdf")
    assert "has no 'total_open'" in refused("comply", copied, "--standard", "leed-v4.1")


@pytest.mark.parametrize(
    "change",
    [
        lambda E: E.assign_attrs(version=[0, 1]),
        lambda E: E.assign_attrs(step_hours=-1.0),
        lambda E: E.assign_attrs(settings="{"),
        lambda E: E.assign_attrs(settings='{"accuracy": {"replicates": "many"}}'),
        lambda E: E.assign_attrs(groups="[]"),
        lambda E: E.assign_attrs(shade_area=50.0),
        lambda E: E.assign_coords(x=E["x"] * np.nan),
        lambda E: E.assign(total=E["total"] * np.nan),
    ],
)
def test_damaged_results_end_in_one_line(refused, copied, change):
    path = copied / "illuminance.nc"
    with xr.open_dataset(path, engine="h5netcdf") as data:
        E = data.load()
    change(E).to_netcdf(path, engine="h5netcdf")
    for name in ("leed-v4.1", "lm-83-12"):
        refused("comply", copied, "--standard", name)


def test_without_coefficients_the_probability_is_unknown(run, copied):
    shutil.rmtree(copied / "coefficients.zarr")
    code, out, err = run("comply", copied, "--standard", "lm-83-12")
    assert (code, err) == (0, "")
    assert "unknown" in out
    assert "no probability: coefficients.zarr and sky.zarr hold the replicates" in out


def test_missing_states_are_refused(refused, copied):
    path = copied / "coefficients.zarr"
    with xr.open_zarr(path, consolidated=False) as data:
        C = data.load()
    shutil.rmtree(path)
    for variable in C.variables.values():
        variable.encoding.clear()
    C.sel(state=["open"]).to_zarr(path, zarr_format=2)
    line = refused("comply", copied, "--standard", "leed-v4.1")
    assert "no 'shaded'" in line


def test_every_room_is_a_space(run, tmp_path):
    case = written(tmp_path)
    text = case.read_text().replace("months = [3]", YEAR).replace("spacing = 1.0", "spacing = 0.6")
    case.write_text(text)
    code, out, err = run("comply", case, "--standard", "leed-v4.1", "--json")
    assert (code, err) == (0, "")
    (extra,) = json.loads(out)["standards"][0]["extras"]
    assert len(extra["spaces"]) > 1
