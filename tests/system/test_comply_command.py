"""`drcmitsuba comply` as a user runs it, on a case and on a folder of results."""

import json
import shutil

import numpy as np
import pytest
import xarray as xr

import drcmitsuba
from drcmitsuba import standards
from drcmitsuba.sky import weather
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
    assert "no verdict" not in out
    words = " ".join(out.split())
    assert "en-17037: hours of most daylight are counted, in place of the case's 3650 h" in words
    assert "from 8 to 18 h" not in words  # these are the case's own


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


def test_option_2_of_leed_by_hand(results):
    """E of the days with the most direct irradiance at 9 and 15 h, from the weather file itself."""
    dni = weather.default().data["dni"]
    with xr.open_dataset(results / "illuminance.nc") as stored:
        E = stored["total_open"].load()
    held = np.ones(E.sizes["sensor"], bool)
    for hour in (9, 15):
        of_days = []
        for equinox in ("2015-03-21", "2015-09-21"):
            near = np.datetime64(equinox) + np.arange(-15, 16)
            stamps = (near + np.timedelta64(hour, "h")).astype("datetime64[ns]")
            best = stamps[dni.sel(time=stamps).values.argmax()]
            of_days.append(E.sel(time=best).values)
        mean = np.mean(of_days, axis=0)
        held &= (mean >= 300) & (mean <= 3000)
    verdict = standards.verdict("leed-v4.1-option-2", standards.Evidence.of_folder(results))
    assert verdict.quantities["area in range"].value == pytest.approx(100 * held.mean())
    assert 0 < held.mean() < 1


def test_json_goes_to_stdout(run, results):
    code, out, err = run("comply", results, "--json")
    assert (code, err) == (0, "")
    told = json.loads(out)["standards"]
    assert [verdict["standard"] for verdict in told] == standards.names()
    assert not any("refused" in verdict for verdict in told)


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


@pytest.mark.slow
def test_a_default_evaluation_serves_all_standards(run, results, tmp_path):
    """The five-day week has 2610 h; what standards count is that of cases with their own periods.

    Before, every standard answered "2610 of 3650 h" or "2610 of 8760 h".
    """
    judged = {}
    for name, period in (("week", ""), ("year", YEAR + "\nhours = [0, 24]")):
        (tmp_path / "case.toml").write_text(CASE.replace(DAYS, period))
        drcmitsuba.evaluate(tmp_path / "case.toml").save(tmp_path / name)
        judged[name] = standards.verdicts(standards.Evidence.of_folder(tmp_path / name))
    assert (tmp_path / "week" / "year.zarr").is_dir()
    assert not (tmp_path / "year" / "year.zarr").exists()
    with xr.open_dataset(tmp_path / "week" / "illuminance.nc", engine="h5netcdf") as E:
        assert E.sizes["time"] == 2610  # the case's own, and its metrics with it
    for of_week, of_year in zip(judged["week"], judged["year"], strict=True):
        assert of_week.level == of_year.level
        assert of_week.quantities.keys() == of_year.quantities.keys()
        for name, quantity in of_year.quantities.items():
            assert of_week.quantities[name].value == pytest.approx(quantity.value, abs=1e-6)
        assert bool(of_week.taken) == bool(of_week.quantities)  # some count nothing
        assert not of_year.taken
    lm83 = next(v for v in judged["week"] if v.standard == "lm-83-12")
    alone = standards.verdict("lm-83-12", standards.Evidence.of_folder(results))
    assert lm83.quantities["sDA"].value == pytest.approx(alone.quantities["sDA"].value)
    code, _, err = run("report", tmp_path / "week", "--markdown")
    assert (code, err) == (0, "")
    page = (tmp_path / "week" / "report.md").read_text()
    assert "no verdict" not in page
    assert "Standards count hours of their own" in page
    assert "in place of the case's 2610 h" in page.replace("\\", "")


def test_a_year_of_another_evaluation_is_refused(refused, tmp_path):
    (tmp_path / "case.toml").write_text(CASE.replace(DAYS, ""))
    drcmitsuba.evaluate(tmp_path / "case.toml").save(tmp_path / "week")
    path = tmp_path / "week" / "year.zarr"
    with xr.open_zarr(path, consolidated=False) as data:
        year = data.load()
    for variable in year.variables.values():
        variable.encoding.clear()
    shutil.rmtree(path)
    year.assign(sun=2 * year["sun"]).to_zarr(path, zarr_format=2)
    line = refused("comply", tmp_path / "week")
    assert "year.zarr" in line
    assert "another evaluation" in line
    shutil.rmtree(path)  # as results of an earlier version
    assert "2610 of 3650 h" in refused("comply", tmp_path / "week", "--standard", "leed-v4.1")


@pytest.mark.slow
def test_a_case_with_another_period_is_judged_by_the_hours_of_standards(run, results, tmp_path):
    """Before, the case of two months was refused: "440 of 3650 h"."""
    (tmp_path / "case.toml").write_text(CASE)
    code, out, err = run("comply", tmp_path / "case.toml", "--standard", "leed-v4.1", "--json")
    assert (code, err) == (0, "")
    (told,) = json.loads(out)["standards"]
    line = "hours from 8 to 18 h on every day are counted, in place of the case's 440 h"
    assert told["taken"] == [line]
    alone = standards.verdict("leed-v4.1", standards.Evidence.of_folder(results))
    for name, quantity in alone.quantities.items():
        assert told["quantities"][name]["value"] == pytest.approx(quantity.value)
    code, out, err = run("comply", tmp_path / "case.toml")
    assert (code, err) == (0, "")
    assert "no verdict" not in out
    assert line in " ".join(out.split())


@pytest.mark.slow
def test_a_coarse_grid_gives_way_to_one_that_the_standard_asks_for(run, tmp_path):
    """Before, the standard had no verdict: "1.2 m between points"."""
    coarse = CASE.replace(DAYS, "").replace("count = [5, 5]", "count = [2, 3]")
    (tmp_path / "case.toml").write_text(coarse.replace("spacing = 0.6", "spacing = 1.2"))
    code, out, err = run("comply", tmp_path / "case.toml", "-o", tmp_path / "out")
    assert (code, err) == (0, "")
    words = " ".join(out.split())
    line = "4 × 6 points lie 0.6 m apart, 0.8 m high, in place of the case's: 1.2 m between points"
    assert (
        f"leed-v4.1, leed-v5, lm-83-12, lm-83-23, well-l01, well-l01-2025, well-l06: {line}"
        in words
    )
    kept = json.loads((tmp_path / "out" / "compliance.json").read_text())["standards"]
    told = {verdict["standard"]: verdict for verdict in kept}
    assert not any(line in told[name]["taken"] for name in ("en-17037", "breeam-hea01"))
    for folder, points in (("out", 6), ("out/laid_grid", 24)):
        with xr.open_dataset(tmp_path / folder / "illuminance.nc", engine="h5netcdf") as E:
            assert E.sizes["sensor"] == points
    fine = coarse.replace("count = [2, 3]", "count = [4, 6]")  # the same grid by the user
    (tmp_path / "fine.toml").write_text(fine)
    code, out, err = run("comply", tmp_path / "fine.toml", "--standard", "lm-83-12", "--json")
    (of_user,) = json.loads(out)["standards"]
    assert of_user["quantities"] == told["lm-83-12"]["quantities"]


@pytest.mark.parametrize(
    "points", ["[[1, 1, 0.8], [3, 4, 0.8]]", "[[1, 1, 0.8], [3, 4, 0.8, 0, 1, 0]]"]
)
def test_single_points_give_way_to_a_grid_of_the_room(tmp_path, points):
    sensors = "corner = [0.5, 0.5, 0.8]\ncount = [5, 5]\nspacing = 0.6\n"
    (tmp_path / "case.toml").write_text(CASE.replace(sensors, f"points = {points}\n"))
    case = drcmitsuba.load_case(tmp_path / "case.toml")
    every, refused = standards.terms(case, ["lm-83-12"])
    assert not refused
    (laid,) = every
    assert laid.case.sensors.count == (6, 8)
    assert laid.case.sensors.corner == pytest.approx((0.2, 0.1, 0.8))
    assert laid.grid.startswith("6 × 8 points lie 0.6 m apart, 0.8 m high, in place of the case's:")


def test_weather_without_a_year_is_refused_before_the_simulation(refused, tmp_path):
    wea = "place x\nlatitude 46\nlongitude -6\ntime_zone -15\nsite_elevation 0\n"
    wea += "weather_data_file_units 1\n"
    hours = [f"3 {day} {hour}.5 300 100\n" for day in range(1, 32) for hour in range(24)]
    (tmp_path / "month.wea").write_text(wea + "".join(hours))
    (tmp_path / "case.toml").write_text(CASE.replace(DAYS, "months = [3]"))
    with_month = ("comply", tmp_path / "case.toml", "--weather", tmp_path / "month.wea")
    assert "310 of 3650 h from 8 to 18 h" in refused(*with_month, "--standard", "leed-v4.1")
    assert "h" in refused(*with_month)  # no standard is covered


def test_other_versions_missing_files_and_mixed_results_are_refused(refused, copied, tmp_path):
    assert "no such standard" in refused("comply", copied, "--standard", "leed-v4")
    assert "give it with a case" in refused("comply", copied, "--weather", "w.epw")
    for option in ("--view", "--change"):
        assert "give it with a case" in refused("comply", copied, option)
    assert "name one: --standard NAME" in refused("comply", tmp_path / "case.toml", "--change")
    assert "no illuminance.nc" in refused("comply", tmp_path)
    path = copied / "illuminance.nc"
    with xr.open_dataset(path, engine="h5netcdf") as data:
        E = data.load()
    E.assign_attrs(version="0.1.0", method=1).to_netcdf(path, engine="h5netcdf")
    line = refused("comply", copied, "--standard", "leed-v4.1")
    assert "method: 1, of version 0.1.0, not " in line
    assert line.endswith("evaluate the case again")
    E.assign_attrs(settings='{"name": "other"}').to_netcdf(path, engine="h5netcdf")
    assert "another evaluation" in refused("comply", copied, "--standard", "leed-v4.1")
    E.isel(time=slice(0, 3000)).to_netcdf(path, engine="h5netcdf")
    assert "other time stamps" in refused("comply", copied, "--standard", "leed-v4.1")
    E.drop_vars("total_open").to_netcdf(path, engine="h5netcdf")
    assert "has no 'total_open'" in refused("comply", copied, "--standard", "leed-v4.1")


@pytest.mark.parametrize(
    "change",
    [
        lambda E: E.assign_attrs(method=[0, 1]),
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
    assert "a state is missing" in line


def test_every_room_is_a_space(run, tmp_path):
    case = written(tmp_path)
    text = case.read_text().replace("months = [3]", YEAR).replace("spacing = 1.0", "spacing = 0.6")
    case.write_text(text)
    code, out, err = run("comply", case, "--standard", "leed-v4.1", "--json")
    assert (code, err) == (0, "")
    (extra,) = json.loads(out)["standards"][0]["extras"]
    assert len(extra["spaces"]) > 1
