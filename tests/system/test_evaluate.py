"""From a case to the files on disk: a small room, few hours, every promise about the results."""

import json

import numpy as np
import pytest
import xarray as xr

import drcmitsuba
from drcmitsuba import load_case, metrics
from drcmitsuba.annual import simulation
from drcmitsuba.case.case import Case
from drcmitsuba.case.metrics import Metrics
from drcmitsuba.metrics import accumulate, evaluate_metrics, illuminance, stored_arrays
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky import daylight as light_module
from tests.system.small_room import CASE, DAYS, SHADING, SUN, VARIABLES, changed, run


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """Result of the small case and the folder that it is saved in."""
    folder = tmp_path_factory.mktemp("small")
    (folder / "case.toml").write_text(CASE)
    result = drcmitsuba.evaluate(load_case(folder / "case.toml"))
    result.save(folder / "results")
    return result, folder / "results"


@pytest.fixture(scope="module")
def on_disk(small):
    """E, C and L as xarray alone opens them."""
    _, folder = small
    with (
        xr.open_dataset(folder / "illuminance.nc") as E,
        xr.open_zarr(folder / "coefficients.zarr", chunks=None) as C,
        xr.open_zarr(folder / "sky.zarr", chunks=None) as L,
    ):
        yield E.load(), C.load(), L.load()


def bounds_are_fair(entry):
    assert set(entry) == {"value", "low", "high"}
    return 0 <= entry["low"] <= entry["value"] <= entry["high"] <= 100


# ---- what lies on disk ------------------------------------------------------------------------


def test_metrics_json_holds_what_is_promised(small):
    _, folder = small
    numbers = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    yearly, monthly = {"sDA", "ASE", "shade_closed"}, {"msDA", "MSE", "shade_closed_monthly"}
    others = {"undecided", "spaces", "building", "settings", "seconds", "peak_memory_bytes"}
    assert set(numbers) == yearly | monthly | others
    assert all(bounds_are_fair(numbers[name]) for name in yearly)
    for name in monthly:
        assert len(numbers[name]) == 12
        for month, entry in enumerate(numbers[name], start=1):
            assert (entry is not None) == (month in (3, 6))
            assert entry is None or bounds_are_fair(entry)
    assert 0 < numbers["shade_closed"]["value"] < 100  # else half of these tests test nothing
    assert numbers["peak_memory_bytes"] > 1e7
    assert all(seconds >= 0 for seconds in numbers["seconds"].values())
    assert {"open façade", "shaded façade", "writing"} < set(numbers["seconds"])
    assert numbers["settings"]["weather_source"].endswith("723170TYA.CSV")


def test_settings_are_the_case_again(small):
    result, folder = small
    settings = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))["settings"]
    tables = {key: value for key, value in settings.items() if key in Case.model_fields}
    assert Case.model_validate(tables).model_dump() == result.case.model_dump()


def test_illuminance_has_its_dimensions_coordinates_and_errors(on_disk):
    E, _, _ = on_disk
    assert dict(E.sizes) == {"time": 440, "sensor": 25}
    assert set(E.data_vars) == VARIABLES | {f"{name}_se" for name in VARIABLES}
    assert set(E.coords) == {"time", "clock", "x", "y", "z", "shade_closed"}
    assert E["shade_closed"].dtype == bool
    for variable in E.data_vars.values():
        assert variable.dims == ("time", "sensor")
        assert variable.attrs["units"] == "lx"
        assert np.isfinite(variable).all()
        assert (variable >= 0).all()
    np.testing.assert_allclose(E["x"][:6], [0.8, 1.4, 2.0, 2.6, 3.2, 0.8])
    np.testing.assert_allclose(E["y"][4:6], [0.8, 1.4])
    np.testing.assert_array_equal(E["clock"], E["time"])
    assert E["time"][0] == np.datetime64("2015-03-02T08:00")


def test_bins_are_labelled(on_disk):
    _, C, L = on_disk
    labels = [str(label) for label in L["bin"].values]
    assert labels[:2] == ["ground", "sky_001"]
    assert labels[145] == "sky_145"
    assert all(SUN.fullmatch(label) for label in labels[146:])
    assert len(set(labels)) == len(labels)
    assert sorted(map(str, C["bin"].values)) == sorted(labels)
    assert list(C["state"].values) == ["open", "shaded"]
    assert C["direct"].dims == C["interreflected_se"].dims == ("state", "sensor", "bin")
    assert L["L"].dims == ("time", "bin")
    assert C["direct"].attrs["units"] == "sr"
    assert L["L"].attrs["units"] == "cd/m2"


def test_every_sun_shines_in_its_own_interval_only(on_disk):
    _, _, L = on_disk
    shines = L["sun"].values > 0  # others have no bin: there is nothing to multiply
    suns = L["L"].isel(bin=slice(146, None), time=np.flatnonzero(shines))
    time = np.array([label.removeprefix("sun_") for label in suns["bin"].values.astype(object)])
    assert (time == np.datetime_as_string(suns["time"].values, unit="m")).all()
    values = suns.values.copy()
    assert (np.diag(values) > 0).all()
    assert len(values) > 300
    np.fill_diagonal(values, 0)
    assert not values.any()
    assert not L["L"].isel(bin=slice(146, None), time=np.flatnonzero(~shines)).values.any()


def test_illuminance_is_coefficients_times_luminances(on_disk):
    E, C, L = on_disk
    both = C["direct"] + C["interreflected"]

    def times_luminance(coefficients):
        with xr.set_options(arithmetic_join="exact"):
            return xr.dot(coefficients.reindex(bin=L["bin"]), L["L"], dim="bin")

    is_sun = L["bin"].str.startswith("sun_")
    is_open = both.sel(state="open")
    for name, coefficients in (
        ("total_open", is_open),
        ("sky_open", is_open.where(~is_sun, 0)),
        ("sun_open", is_open.where(is_sun, 0)),
        ("direct_sun", C["straight"].sel(state="open").where(is_sun, 0)),
    ):
        expected = times_luminance(coefficients).transpose("time", "sensor")
        np.testing.assert_allclose(E[name], expected, rtol=2e-5, atol=1e-3, err_msg=name)
    shut = E["shade_closed"].values
    # Suns of other hours are NaN in the shaded state and black in these hours.
    behind = times_luminance(both.sel(state="shaded").fillna(0)).transpose("time", "sensor")
    np.testing.assert_allclose(E["total"][shut], behind[shut], rtol=2e-5, atol=1e-3)
    np.testing.assert_array_equal(E["total"][~shut], E["total_open"][~shut])
    assert float(E["total"][shut].mean()) < 0.5 * float(E["total_open"][shut].mean())


def test_suns_of_hours_that_may_close_are_known_behind_the_shade(on_disk):
    E, C, L = on_disk
    known = C["direct"].sel(state="shaded").notnull().all("sensor")
    suns = known["bin"].str.startswith("sun_")
    shut = {str(label) for label in L["sun_bin"].values[E["shade_closed"].values]} - {""}
    behind = {str(label) for label in known["bin"].values[(known & suns).values]}
    assert behind >= shut
    assert len(behind - shut) < 0.05 * len(shut)  # closed by a sensor or two at a shadow's edge
    assert known[~suns].all()


def test_numbers_are_those_of_the_illuminance(small, on_disk):
    result, _ = small
    E, _, _ = on_disk
    assert result.metrics["sDA"]["value"] == metrics.sda(E["total"])
    assert result.metrics["ASE"]["value"] == metrics.ase(E["direct_sun"])
    closed = metrics.shade_closed(E["direct_sun"])
    np.testing.assert_array_equal(closed, E["shade_closed"])
    assert result.metrics["shade_closed"]["value"] == pytest.approx(100 * float(closed.mean()))
    march = closed[closed["time"].dt.month == 3]
    monthly = result.metrics["shade_closed_monthly"]
    assert monthly[2]["value"] == pytest.approx(100 * float(march.mean()))


def test_all_files_are_there_and_nothing_else(small):
    result, folder = small
    plots = {"illuminance_plan.png", "autonomy_plan.png", "sun_plan.png", "monthly.png"}
    data = {"metrics.json", "plan.json", "illuminance.nc", "coefficients.zarr", "sky.zarr"}
    assert {p.name for p in folder.iterdir()} == plots | data
    assert all((folder / name).read_bytes().startswith(b"\x89PNG") for name in plots)
    plan = json.loads((folder / "plan.json").read_text(encoding="utf-8"))
    assert all(isinstance(effect["on"], bool) and effect["reason"] for effect in plan.values())
    assert {n: e for n, e in plan.items() if n != "cost"} == {
        n: e for n, e in result.plan.items() if n != "cost"
    }
    assert plan["shaded_state"]["on"]


def test_a_result_shows_itself(small):
    result, _ = small
    assert repr(result).startswith("<Result of 'small room': sDA ")
    assert len(repr(result)) < 200
    html = result._repr_html_()
    sda = result.metrics["sDA"]
    assert f"{sda['value']:.1f} % ({sda['low']:.1f} … {sda['high']:.1f})" in html
    assert "data:image/png;base64," in html


def test_saving_changes_no_result_and_returns_what_lies_on_disk(small, tmp_path):
    result, _ = small
    before = json.dumps([result.metrics, result.plan], default=str)
    (tmp_path / "compliance.json").write_text("{}")  # verdicts on an earlier evaluation
    saved = result.save(tmp_path)
    assert not (tmp_path / "compliance.json").exists()
    assert json.dumps([result.metrics, result.plan], default=str) == before
    assert "writing" not in result.metrics["seconds"]
    for name, numbers in (("metrics", saved.metrics), ("plan", saved.plan)):
        text = json.dumps(numbers, default=str)
        assert json.loads((tmp_path / f"{name}.json").read_text(encoding="utf-8")) == json.loads(
            text
        )
    files = [p for p in tmp_path.rglob("*") if p.is_file() and p.name != "plan.json"]
    assert saved.plan["cost"]["actual"]["disk_bytes"] == sum(p.stat().st_size for p in files)


def test_states_on_disk_are_joined_and_taken_apart_again(small, on_disk):
    result, _ = small
    _, C, _ = on_disk
    assert "is NaN in a state that the façade does not take" in C.attrs["not_simulated"]
    xr.testing.assert_equal(C, result.coefficients)
    apart = Coefficients.of(C)
    for state, data in result.by_state.states.items():
        xr.testing.assert_equal(apart.states[state], data)
        assert all(v.notnull().all() for v in data.values() if v.dtype.kind == "f")


def test_direct_sun_is_accumulated_once(small, monkeypatch):
    calls = []
    original = accumulate.direct_sun
    monkeypatch.setattr(
        accumulate, "direct_sun", lambda *given: calls.append(given) or original(*given)
    )
    drcmitsuba.evaluate(small[0].case)
    assert len(calls) == 1


# ---- the same by another way ------------------------------------------------------------------


def test_the_chain_of_verbs_gives_the_numbers_of_evaluate(
    small, on_disk, tmp_path, monkeypatch, capsys
):
    result, _ = small
    E, _, _ = on_disk
    case = tmp_path / "case.toml"
    case.write_text(CASE)
    run(monkeypatch, "sky", case, "-o", tmp_path)
    run(monkeypatch, "coefficients", case, "-o", tmp_path)
    parts = tmp_path / "coefficients.zarr", tmp_path / "sky.zarr"
    run(monkeypatch, "illuminance", *parts, "-o", tmp_path)
    run(monkeypatch, "metrics", tmp_path / "illuminance.nc", "-o", tmp_path)
    assert capsys.readouterr().err == ""
    chained = stored_arrays.open_dataset(tmp_path / "illuminance.nc").load()
    assert set(chained.variables) == set(E.variables)
    for name in E.data_vars:
        np.testing.assert_allclose(chained[name], E[name], rtol=1e-4, atol=0.05, err_msg=name)
    np.testing.assert_array_equal(chained["shade_closed"], E["shade_closed"])
    numbers = json.loads((tmp_path / "metrics.json").read_text())
    annual = ("sDA", "ASE", "shade_closed")
    monthly = ("msDA", "MSE", "shade_closed_monthly")
    # Only replicates tell which sensors are undecided.
    assert set(numbers) == {*annual, *monthly, "spaces", "building", "settings"}
    for name in annual:
        ours, theirs = result.metrics[name], numbers[name]
        assert theirs["value"] == ours["value"]
        assert theirs["low"] <= ours["low"] <= ours["high"] <= theirs["high"]
    for name in monthly:
        for ours, theirs in zip(result.metrics[name], numbers[name], strict=True):
            assert (ours is None) == (theirs is None)
            assert ours is None or theirs["value"] == ours["value"]
    run(monkeypatch, "lights", case, "--point", "1,1", "-o", tmp_path)  # of this evaluation
    for made in ("lights.nc", "lights_0.png"):
        (tmp_path / made).unlink()
    run(monkeypatch, "plan", case, "-o", tmp_path)
    run(monkeypatch, "plot", tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {
        "case.toml", "illuminance_mountain.png", "illuminance_section.png", "illuminance_year.png",
        "sun_path.png", *(p.name for p in small[1].iterdir()),
    }  # fmt: skip


def test_the_separate_verbs_know_the_thresholds_of_the_case(stamps, tmp_path, monkeypatch, capsys):
    thresholds = "[metrics]\nsda_threshold = 500.0\nase_hours = 2.0\n[accuracy]"
    hours = stamps("2015-03-21T09:00", "2015-03-21T12:00", "2015-06-21T12:00")
    (tmp_path / "case.toml").write_text(changed(hours, ("[accuracy]", thresholds)))
    run(monkeypatch, "evaluate", tmp_path / "case.toml", "-o", tmp_path / "r")
    file = tmp_path / "r" / "illuminance.nc"
    with xr.open_dataset(file) as E:
        about = {k: E.attrs[k] for k in ("case", "sda_threshold", "ase_hours", "latitude")}
        assert about == {
            "case": "small room", "sda_threshold": 500, "ase_hours": 2, "latitude": 36.1
        }  # fmt: skip
        assert E.attrs["version"]
        assert E.attrs["weather"].endswith("723170TYA.CSV")
        assert all(E[name].attrs["long_name"] for name in E.variables if name != "sensor")
        assert {E[axis].attrs["units"] for axis in "xyz"} == {"m"}
    capsys.readouterr()
    run(monkeypatch, "metrics", file, "-o", tmp_path / "m")
    assert "sDA 500 lx in 50 % of the hours, ASE 1000 lx in 2 h" in capsys.readouterr().out
    run(monkeypatch, "metrics", file, "-o", tmp_path / "n", "--sda-threshold", 800)
    settings = json.loads((tmp_path / "n" / "metrics.json").read_text())["settings"]
    assert settings["metrics"]["sda_threshold"] == 800
    assert settings["name"] == "small room"
    before = json.loads((tmp_path / "r" / "metrics.json").read_text())
    run(monkeypatch, "metrics", file, "-o", tmp_path / "r", "--sda-threshold", 800)
    after = json.loads((tmp_path / "r" / "metrics.json").read_text())
    assert after["settings"]["notes"] == before["settings"]["notes"] != []
    assert "undecided" in before
    assert "undecided" not in after  # by other thresholds
    run(monkeypatch, "report", tmp_path / "r", "--markdown", "-o", tmp_path / "r.md")
    assert "sDA at 800 lx" in (tmp_path / "r.md").read_text()


@pytest.mark.parametrize("settings", ["{", "[]", '{"a": NaN}'])
def test_damaged_settings_of_an_illuminance_file_are_refused(settings):
    with pytest.raises(InputError, match=r"E.nc: settings: .*compute the illuminance anew"):
        evaluate_metrics.settings_of({"settings": settings}, "E.nc", Metrics())


def test_points_too_close_to_call_are_listed_printed_and_drawn(tmp_path, monkeypatch, capsys):
    thresholds = "[metrics]\nsda_threshold = 1500.0\nase_hours = 60.0\n[accuracy]"
    (tmp_path / "case.toml").write_text(changed(("[accuracy]", thresholds)))
    folder = tmp_path / "r"
    folder.mkdir()
    (folder / "undecided_ase_plan.png").write_text("of an evaluation before this one")
    of_others = ("site_plan.png", "glare_plan.png", "illuminance_01-02_1200.png")
    for name in of_others:
        (folder / name).write_text("of a user, or of another command")
    run(monkeypatch, "evaluate", tmp_path / "case.toml", "-o", folder)
    numbers = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    E = stored_arrays.open_dataset(folder / "illuminance.nc").load()
    listed = numbers["undecided"]
    assert 0 < len(listed) < 25
    assert all(0.025 < one["probability"] < 0.975 for one in listed)
    of_sda = [one["sensor"] for one in listed if one["metric"] == "sDA"]
    count = (E["total"] >= 1500).sum("time").values
    assert int(abs(count - 220).argmin()) in of_sda  # of 440 hours half are needed
    assert float(E["x"][of_sda[0]]) == listed[0]["x"]
    lines = [line for line in capsys.readouterr().out.splitlines() if "too close to call" in line]
    assert lines == [
        f"points too close to call: {len(of_sda)} of sDA, {len(listed) - len(of_sda)} of ASE "
        "(metrics.json, undecided)"
    ]
    pictures = {p.name for p in folder.glob("undecided_*.png")}
    assert pictures == {f"undecided_{one['metric'].lower()}_plan.png" for one in listed}
    assert all((folder / name).exists() for name in of_others)
    (folder / "undecided_sda_plan.png").unlink()
    run(monkeypatch, "plot", folder)
    assert (folder / "undecided_sda_plan.png").read_bytes().startswith(b"\x89PNG")


def test_intervals_of_entries_are_students(small):
    result, _ = small
    assert result.illuminance.attrs["interval_factor"] == pytest.approx(3.1824, abs=1e-4)  # t(3)


def test_an_hour_that_may_close_has_its_sun_behind_the_shade(evaluate):
    """Few rays and a shade that two sensors close: some hours close in some draws only."""
    rough = "[accuracy]\nsensor_sun_samples = 1", '[shading]\nmaterial = "shade"\narea = 0.08'
    result = evaluate(changed(("[accuracy]", rough[0]), (SHADING.rstrip(), rough[1])))
    C = result.coefficients.sel(state="shaded")
    suns = C["bin"].str.startswith("sun_")
    known = set(C["bin"].values[(C["direct"].notnull().all("sensor") & suns).values])
    shut = result.illuminance["shade_closed"].values
    labels = {
        f"sun_{t}" for t in np.datetime_as_string(result.illuminance["time"].values[shut], "m")
    }
    assert labels & known < known
    assert result.metrics["shade_closed"]["low"] < result.metrics["shade_closed"]["high"]


def test_coefficients_of_another_period_are_refused(small, tmp_path, monkeypatch, capsys):
    _, folder = small
    case = tmp_path / "case.toml"
    case.write_text(changed((DAYS, "months = [3, 4, 6]")))
    run(monkeypatch, "sky", case, "-o", tmp_path)
    with pytest.raises(SystemExit) as stop:
        run(monkeypatch, "illuminance", folder / "coefficients.zarr", tmp_path / "sky.zarr")
    assert stop.value.code == 2
    assert "no 'sun_2015-04-01T08:00'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("site", "message"),
    [
        ("latitude = 36.3\nlongitude = -79.6\ntimezone = -5", None),
        ("latitude = 1.37\nlongitude = -79.95\ntimezone = -5", "latitude: 36.1, but 1.37 in the"),
        ("latitude = 36.1\nlongitude = -84\ntimezone = -5", "longitude: -79.95, but -84.0 in the"),
        ("latitude = 36.1\nlongitude = -79.95\ntimezone = -6", "timezone: -5.0, but -6.0 in the"),
    ],
)
def test_suns_of_another_place_are_refused(small, tmp_path, site, message):
    """A sun's label tells its time only; a neighbouring weather station's will do."""
    sky = '[sky]\nmodel = "cie"\ntype = "clear_with_sun"\n'
    (tmp_path / "case.toml").write_text(f"{CASE}{sky}[site]\n{site}\n")
    light = light_module.daylight(load_case(tmp_path / "case.toml"))
    case = small[0].case.with_dark_hours()
    C = simulation.coefficients(case, light_module.daylight(case))
    if message:
        with pytest.raises(InputError, match=message):
            illuminance.illuminance(C, light.sky)
    else:
        E = illuminance.illuminance(C, light.sky)  # more hours close than in the case's weather
        assert np.isfinite(E["total"]).all()
        assert E["shade_closed"].sum() > small[0].illuminance["shade_closed"].sum()


def test_the_same_seed_gives_the_same_numbers_and_another_one_others(evaluate, stamps):
    hours = stamps("2015-03-21T09:00", "2015-06-21T12:00")
    first, again = (evaluate(changed(hours)).illuminance for _ in range(2))
    other = evaluate(changed(hours, ("replicates = 4", "replicates = 4\nseed = 1"))).illuminance
    for name in VARIABLES:
        np.testing.assert_allclose(again[name], first[name], rtol=1e-4, atol=0.01)
    assert not np.allclose(other["total"], first["total"], rtol=1e-4, atol=0.01)
