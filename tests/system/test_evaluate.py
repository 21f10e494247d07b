"""From a case to the files on disk: a small room, few hours, every promise about the results."""

import json
import re

import numpy as np
import pytest
import xarray as xr

import drcmitsuba
from drcmitsuba import load_case, metrics, schema
from drcmitsuba.annual import simulation
from drcmitsuba.case.case import Case
from drcmitsuba.case.metrics import Metrics
from drcmitsuba.cli import main
from drcmitsuba.metrics import accumulate, evaluate_metrics, illuminance
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky import daylight as light_module
from drcmitsuba.sky.sun_models import Suns
from tests import SHARED

WEATHER = SHARED / "data" / "weather"
CASE = """
name = "small room"
[period]
months = [3, 6]
[room]
size = [4.0, 5.0, 3.0]
[facade.south]
segments = 2
frame = 0.1
strips = [{ bottom = 0.9, top = 2.7, material = "glass" }]
[materials.glass]
type = "glazing"
transmittance = 0.65
[materials.shade]
type = "diffuser"
transmittance = 0.1
[sensors]
corner = [0.5, 0.5, 0.8]
count = [5, 5]
spacing = 0.6
[shading]
material = "shade"
[accuracy]
replicates = 4
paths = 32
cell_size = 0.6
cell_sky_rays = 16
sensor_sky_rays = 64
pane_points = 16
"""
SITE = "\n[site]\nlatitude = 46.25\nlongitude = 6.13\ntimezone = 1\n"
STRIPS = 'strips = [{ bottom = 0.9, top = 2.7, material = "glass" }]'
SHADING = '[shading]\nmaterial = "shade"\n'
DAYS = "months = [3, 6]"
VARIABLES = {"total", "total_open", "sky_open", "sun_open", "direct_sun"}
SUN = re.compile(r"sun_2015-\d\d-\d\dT\d\d:\d\d")


def changed(*changes):
    text = CASE
    for old, new in changes:
        assert text.count(old) == 1, f"{old!r} does not name one place"
        text = text.replace(old, new)
    return text


@pytest.fixture
def evaluate(tmp_path):
    """Evaluate the text of a case."""

    def evaluate(text):
        file = tmp_path / "case.toml"
        file.write_text(text, encoding="utf-8")
        return drcmitsuba.evaluate(load_case(file))

    return evaluate


@pytest.fixture
def stamps(tmp_path):
    """Period of own time stamps in the place of months: a few hours are quicker than two months."""

    def stamps(*times):
        (tmp_path / "times.csv").write_text("\n".join(["time", *times]) + "\n")
        return DAYS, 'timestamps = "times.csv"'

    return stamps


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """Result of the small case and the folder that it is saved in."""
    folder = tmp_path_factory.mktemp("small")
    (folder / "case.toml").write_text(CASE)
    found = drcmitsuba.evaluate(load_case(folder / "case.toml"))
    found.save(folder / "results")
    return found, folder / "results"


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
    others = {"undecided", "settings", "seconds", "peak_memory_bytes"}
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
    found, folder = small
    settings = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))["settings"]
    tables = {key: value for key, value in settings.items() if key in Case.model_fields}
    assert Case.model_validate(tables).model_dump() == found.case.model_dump()


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
    found, _ = small
    E, _, _ = on_disk
    assert found.metrics["sDA"]["value"] == metrics.sda(E["total"])
    assert found.metrics["ASE"]["value"] == metrics.ase(E["direct_sun"])
    closed = metrics.shade_closed(E["direct_sun"])
    np.testing.assert_array_equal(closed, E["shade_closed"])
    assert found.metrics["shade_closed"]["value"] == pytest.approx(100 * float(closed.mean()))
    march = closed[closed["time"].dt.month == 3]
    monthly = found.metrics["shade_closed_monthly"]
    assert monthly[2]["value"] == pytest.approx(100 * float(march.mean()))


def test_all_files_are_there_and_nothing_else(small):
    found, folder = small
    plots = {"illuminance_plan.png", "autonomy_plan.png", "sun_plan.png", "monthly.png"}
    data = {"metrics.json", "plan.json", "illuminance.nc", "coefficients.zarr", "sky.zarr"}
    assert {p.name for p in folder.iterdir()} == plots | data
    assert all((folder / name).read_bytes().startswith(b"\x89PNG") for name in plots)
    plan = json.loads((folder / "plan.json").read_text(encoding="utf-8"))
    assert all(isinstance(effect["on"], bool) and effect["reason"] for effect in plan.values())
    assert {n: e for n, e in plan.items() if n != "cost"} == {
        n: e for n, e in found.plan.items() if n != "cost"
    }
    assert plan["shaded_state"]["on"]


def test_a_result_shows_itself(small):
    found, _ = small
    assert repr(found).startswith("<Result of 'small room': sDA ")
    assert len(repr(found)) < 200
    html = found._repr_html_()
    sda = found.metrics["sDA"]
    assert f"{sda['value']:.1f} % ({sda['low']:.1f} … {sda['high']:.1f})" in html
    assert "data:image/png;base64," in html


def test_saving_changes_no_result_and_returns_what_lies_on_disk(small, tmp_path):
    found, _ = small
    before = json.dumps([found.metrics, found.plan], default=str)
    saved = found.save(tmp_path)
    assert json.dumps([found.metrics, found.plan], default=str) == before
    assert "writing" not in found.metrics["seconds"]
    for name, numbers in (("metrics", saved.metrics), ("plan", saved.plan)):
        text = json.dumps(numbers, default=str)
        assert json.loads((tmp_path / f"{name}.json").read_text(encoding="utf-8")) == json.loads(
            text
        )
    files = [p for p in tmp_path.rglob("*") if p.is_file() and p.name != "plan.json"]
    assert saved.plan["cost"]["actual"]["disk_bytes"] == sum(p.stat().st_size for p in files)


def test_states_on_disk_are_joined_and_taken_apart_again(small, on_disk):
    found, _ = small
    _, C, _ = on_disk
    assert "is NaN in state shaded" in C.attrs["not_simulated"]
    xr.testing.assert_equal(C, found.coefficients)
    apart = Coefficients.of(C)
    for state, data in found.by_state.states.items():
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


def run(monkeypatch, *arguments):
    monkeypatch.setattr("sys.argv", ["drcmitsuba", *map(str, arguments)])
    main.main()


def test_the_chain_of_verbs_gives_the_numbers_of_evaluate(
    small, on_disk, tmp_path, monkeypatch, capsys
):
    found, _ = small
    E, _, _ = on_disk
    case = tmp_path / "case.toml"
    case.write_text(CASE)
    run(monkeypatch, "sky", case, "-o", tmp_path)
    run(monkeypatch, "coefficients", case, "-o", tmp_path)
    parts = tmp_path / "coefficients.zarr", tmp_path / "sky.zarr"
    run(monkeypatch, "illuminance", *parts, "-o", tmp_path)
    run(monkeypatch, "metrics", tmp_path / "illuminance.nc", "-o", tmp_path)
    assert capsys.readouterr().err == ""
    chained = storage.open_dataset(tmp_path / "illuminance.nc").load()
    assert set(chained.variables) == set(E.variables)
    for name in E.data_vars:
        np.testing.assert_allclose(chained[name], E[name], rtol=1e-4, atol=0.05, err_msg=name)
    np.testing.assert_array_equal(chained["shade_closed"], E["shade_closed"])
    numbers = json.loads((tmp_path / "metrics.json").read_text())
    annual = ("sDA", "ASE", "shade_closed")
    monthly = ("msDA", "MSE", "shade_closed_monthly")
    # Only replicates tell which sensors are undecided.
    assert set(numbers) == {*annual, *monthly, "settings"}
    for name in annual:
        ours, theirs = found.metrics[name], numbers[name]
        assert theirs["value"] == ours["value"]
        assert theirs["low"] <= ours["low"] <= ours["high"] <= theirs["high"]
    for name in monthly:
        for ours, theirs in zip(found.metrics[name], numbers[name], strict=True):
            assert (ours is None) == (theirs is None)
            assert ours is None or theirs["value"] == ours["value"]
    run(monkeypatch, "plan", case, "-o", tmp_path)
    run(monkeypatch, "plot", tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {
        "case.toml", *(p.name for p in small[1].iterdir())
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


@pytest.mark.parametrize("settings", ["{", "[]", '{"a": NaN}'])
def test_damaged_settings_of_an_illuminance_file_are_told(settings):
    with pytest.raises(InputError, match=r"E.nc: settings: .*compute the illuminance anew"):
        evaluate_metrics.settings_of({"settings": settings}, "E.nc", Metrics())


def test_points_too_close_to_call_are_listed_printed_and_drawn(tmp_path, monkeypatch, capsys):
    thresholds = "[metrics]\nsda_threshold = 1500.0\nase_hours = 60.0\n[accuracy]"
    (tmp_path / "case.toml").write_text(changed(("[accuracy]", thresholds)))
    folder = tmp_path / "r"
    folder.mkdir()
    (folder / "undecided_ase_plan.png").write_text("of an evaluation before this one")
    run(monkeypatch, "evaluate", tmp_path / "case.toml", "-o", folder)
    numbers = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    E = storage.open_dataset(folder / "illuminance.nc").load()
    listed = numbers["undecided"]
    assert 0 < len(listed) < 25
    assert all(0.025 < one["probability"] < 0.975 for one in listed)
    of_sda = [one["sensor"] for one in listed if one["metric"] == "sDA"]
    count = (E["total"] >= 1500).sum("time").values
    assert int(abs(count - 220).argmin()) in of_sda  # of 440 hours half are needed
    assert float(E["x"][of_sda[0]]) == listed[0]["x"]
    told = [line for line in capsys.readouterr().out.splitlines() if "too close to call" in line]
    assert told == [
        f"points too close to call: {len(of_sda)} of sDA, {len(listed) - len(of_sda)} of ASE "
        "(metrics.json, undecided)"
    ]
    pictures = {p.name for p in folder.glob("undecided_*.png")}
    assert pictures == {f"undecided_{one['metric'].lower()}_plan.png" for one in listed}
    (folder / "undecided_sda_plan.png").unlink()
    run(monkeypatch, "plot", folder)
    assert (folder / "undecided_sda_plan.png").read_bytes().startswith(b"\x89PNG")


def test_intervals_of_entries_are_students(small):
    found, _ = small
    assert found.illuminance.attrs["interval_factor"] == pytest.approx(3.1824, abs=1e-4)  # t(3)


def test_an_hour_that_may_close_has_its_sun_behind_the_shade(evaluate):
    """Few rays and a shade that two sensors close: some hours close in some draws only."""
    rough = "[accuracy]\nsensor_sun_samples = 1", '[shading]\nmaterial = "shade"\narea = 0.08'
    found = evaluate(changed(("[accuracy]", rough[0]), (SHADING.rstrip(), rough[1])))
    C = found.coefficients.sel(state="shaded")
    suns = C["bin"].str.startswith("sun_")
    known = set(C["bin"].values[(C["direct"].notnull().all("sensor") & suns).values])
    shut = found.illuminance["shade_closed"].values
    labels = {
        f"sun_{t}" for t in np.datetime_as_string(found.illuminance["time"].values[shut], "m")
    }
    assert labels & known < known
    assert found.metrics["shade_closed"]["low"] < found.metrics["shade_closed"]["high"]


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
    ("site", "told"),
    [
        ("latitude = 36.3\nlongitude = -79.6\ntimezone = -5", None),
        ("latitude = 1.37\nlongitude = -79.95\ntimezone = -5", "latitude: 36.1, but 1.37 in the"),
        ("latitude = 36.1\nlongitude = -84\ntimezone = -5", "longitude: -79.95, but -84.0 in the"),
        ("latitude = 36.1\nlongitude = -79.95\ntimezone = -6", "timezone: -5.0, but -6.0 in the"),
    ],
)
def test_suns_of_another_place_are_refused(small, tmp_path, site, told):
    """A sun's label tells its time only; a neighbouring weather station's will do."""
    sky = '[sky]\nmodel = "cie"\ntype = "clear_with_sun"\n'
    (tmp_path / "case.toml").write_text(f"{CASE}{sky}[site]\n{site}\n")
    light = light_module.daylight(load_case(tmp_path / "case.toml"))
    case = small[0].case.with_dark_hours()
    C = simulation.coefficients(case, light_module.daylight(case))
    if told:
        with pytest.raises(InputError, match=told):
            illuminance.illuminance(C, light.sky)
    else:
        with pytest.raises(InputError, match=r"no 'sun_"):  # other hours close
            illuminance.illuminance(C, light.sky)
        bare = Coefficients(C.open.assign_attrs(has_shade=0))
        assert np.isfinite(illuminance.illuminance(bare, light.sky)["total"]).all()


def test_the_same_seed_gives_the_same_numbers_and_another_one_others(evaluate, stamps):
    hours = stamps("2015-03-21T09:00", "2015-06-21T12:00")
    first, again = (evaluate(changed(hours)).illuminance for _ in range(2))
    other = evaluate(changed(hours, ("replicates = 4", "replicates = 4\nseed = 1"))).illuminance
    for name in VARIABLES:
        np.testing.assert_allclose(again[name], first[name], rtol=1e-4, atol=0.01)
    assert not np.allclose(other["total"], first["total"], rtol=1e-4, atol=0.01)


# ---- cases at the edge ------------------------------------------------------------------------


def test_a_room_without_opening_is_dark_not_unknown(evaluate, stamps):
    found = evaluate(changed(stamps("2015-03-21T09:00", "2015-06-21T12:00"), (STRIPS, "")))
    for name in found.illuminance.data_vars:
        np.testing.assert_array_equal(found.illuminance[name], 0, err_msg=name)
    for name in ("sDA", "ASE", "shade_closed"):
        assert found.metrics[name] == {"value": 0, "low": 0, "high": 0}


def test_a_black_room_has_direct_light_only(evaluate, stamps):
    black = "size = [4.0, 5.0, 3.0]\nfloor = 0\nceiling = 0\nwalls = 0"
    frame = "frame = 0.1\nframe_reflectance = 0"
    changes = ("size = [4.0, 5.0, 3.0]", black), ("frame = 0.1", frame), (SHADING, "")
    found = evaluate(changed(stamps("2015-03-21T12:00"), *changes))
    np.testing.assert_array_equal(found.coefficients["interreflected"], 0)
    assert float(found.illuminance["total"].min()) > 0


def test_sensors_under_the_free_sky_get_what_the_weather_says(tmp_path, same):
    """E = diffuse + direct normal · cos Z, without any room around the sensors."""
    text = "[period]\nmonths = [3]\n[sensors]\ncorner = [0, 0, 0]\ncount = [2, 2]\n"
    (tmp_path / "case.toml").write_text(text)
    case = load_case(tmp_path / "case.toml")
    light = light_module.daylight(case)
    found = drcmitsuba.evaluate(case)
    coefficients = found.coefficients["replicates"].sel(state="open")
    diffuse = light.sky["diffuse_horizontal_illuminance"].values
    cos_zenith = light.sun["direction"].sel(axis="z").values
    direct = light.sky["direct_normal_illuminance"].values * cos_zenith

    patches = coefficients.sel(bin=light.sky["bin"].values)
    by_sky = xr.dot(patches, light.sky["sky"], dim="bin").transpose("replicate", "time", "sensor")
    # Hours share their coefficients: three of different skies stand for all of them.
    rows = np.flatnonzero(diffuse > 1000)[[0, 70, -1]]
    same(by_sky.values[:, rows], exact=np.repeat(diffuse[rows, None], 4, axis=1), within=0.01)

    # The sun is round, and its lower edge above the horizon, in these hours.
    rows = np.flatnonzero((direct > 10) & (cos_zenith > np.sin(np.radians(0.25))))
    assert len(rows) > 100
    suns = coefficients.sel(bin=light.sky["sun_bin"].values[rows]) * light.sky["sun"].values[rows]
    by_sun = suns.transpose("replicate", "bin", "sensor").values
    same(by_sun, exact=np.repeat(direct[rows, None], 4, axis=1), within=0.001)

    E = found.illuminance
    np.testing.assert_allclose(E["sky_open"], by_sky.mean("replicate"), rtol=1e-5, atol=1e-3)
    np.testing.assert_allclose(E["sun_open"][rows], by_sun.mean(axis=0), rtol=1e-5)
    np.testing.assert_allclose(E["direct_sun"], E["sun_open"], rtol=1e-5)
    assert found.metrics["sDA"]["value"] == 100
    assert found.metrics["shade_closed"]["value"] == 0


def test_without_shading_nothing_closes(evaluate, stamps):
    hours = stamps("2015-03-21T12:00", "2015-12-21T12:00")
    bare, shaded = evaluate(changed(hours, (SHADING, ""))), evaluate(changed(hours))
    assert shaded.illuminance["shade_closed"].all()
    assert not bare.illuminance["shade_closed"].any()
    assert bare.metrics["shade_closed"] == {"value": 0, "low": 0, "high": 0}
    assert list(bare.coefficients["state"].values) == ["open"]
    assert not bare.plan["shaded_state"]["on"]
    np.testing.assert_array_equal(bare.illuminance["total"], bare.illuminance["total_open"])


def test_each_channel_of_a_coloured_room_is_the_grey_room_of_its_reflectance(evaluate, stamps):
    hours = stamps("2015-03-21T09:00", "2015-06-21T12:00")

    def floor(value):
        return evaluate(changed(hours, ("[room]", f"[room]\nfloor = {value}")))

    coloured = floor("[0.5, 0.3, 0.1]")
    assert list(coloured.illuminance["channel"].values) == ["red", "green", "blue"]
    for data in (coloured.illuminance["total"], coloured.coefficients["direct"], coloured.sky["L"]):
        assert data.sizes["channel"] == 3
    for channel, value in zip(("red", "green", "blue"), (0.5, 0.3, 0.1), strict=True):
        grey = floor(value)
        assert "channel" not in grey.illuminance.dims
        one = coloured.illuminance.sel(channel=channel)
        for name in VARIABLES:
            np.testing.assert_allclose(one[name], grey.illuminance[name], rtol=1e-4, atol=0.05)
    weighed = schema.luminance(coloured.illuminance["total"])
    numbers = metrics.sda(weighed)
    assert coloured.metrics["sDA"]["value"] == numbers


def test_equal_channels_are_grey(evaluate, stamps):
    hours = stamps("2015-03-21T09:00")
    equal, grey = (
        evaluate(changed(hours, ("[room]", f"[room]\nfloor = {value}"))).illuminance
        for value in ("[0.3, 0.3, 0.3]", "0.3")
    )
    assert "channel" not in equal.dims
    np.testing.assert_allclose(equal["total"], grey["total"], rtol=1e-4)


def test_a_coloured_case_goes_through_the_verbs(tmp_path, monkeypatch, capsys):
    (tmp_path / "times.csv").write_text("time\n2015-03-21T12:00\n2015-06-21T12:00\n")
    floor = "[room]", "[room]\nfloor = [0.5, 0.3, 0.1]"
    text = changed((DAYS, 'timestamps = "times.csv"'), floor)
    (tmp_path / "case.toml").write_text(text)
    run(monkeypatch, "evaluate", tmp_path / "case.toml", "-o", tmp_path / "r")
    files = tmp_path / "r" / "coefficients.zarr", tmp_path / "r" / "sky.zarr"
    run(monkeypatch, "illuminance", *files, "-o", tmp_path / "again")
    run(monkeypatch, "metrics", tmp_path / "again" / "illuminance.nc")
    E, again = (
        storage.open_dataset(tmp_path / name / "illuminance.nc").load() for name in ("r", "again")
    )
    for name in E.data_vars:
        np.testing.assert_allclose(again[name], E[name], rtol=1e-4, atol=0.05, err_msg=name)
    assert capsys.readouterr().err == ""


# ---- skies, sites and times -------------------------------------------------------------------


def test_a_cie_sky_needs_no_weather_file(evaluate, stamps):
    sky = '[sky]\nmodel = "cie"\ntype = 5\ndiffuse_horizontal_illuminance = 10000\n'
    hours = stamps("2015-03-21T12:00", "2015-06-21T12:00")
    found = evaluate(changed(hours) + sky + SITE)
    E = found.illuminance
    # Type 5 has no sun and is uniform in azimuth and height: the same at all times of the day.
    np.testing.assert_allclose(E["total"][0], E["total"][1], rtol=1e-5)
    np.testing.assert_array_equal(E["sun_open"], 0)
    assert found.metrics["settings"]["weather_source"] == "site, no weather file"
    (note,) = found.metrics["settings"]["notes"]
    assert note.startswith("the period is 2 time stamps, no year")


def test_a_cie_sky_without_its_illuminance_is_told_with_the_case(evaluate):
    with pytest.raises(InputError, match=r"case.toml: sky.diffuse_horizontal_illuminance: nothing"):
        evaluate(CASE + '[sky]\nmodel = "cie"\ntype = 5\n' + SITE)


def test_a_sunshine_sky_follows_its_probability(evaluate, stamps):
    hours = stamps(*(f"2015-03-{day:02}T12:00" for day in range(1, 29)))
    shares = []
    for probability in (0.0, 1.0):
        sky = f'[sky]\nmodel = "sunshine"\nprobability = {[probability] * 12}\n'
        E = evaluate(changed(hours) + sky + SITE).illuminance
        shares.append(float((E["sun_open"].sum("sensor") > 0).mean()))
    assert shares == [0, 1]


def test_a_perez_sky_without_weather_file_says_whose_weather_it_takes(evaluate, stamps):
    hours = stamps("2015-03-21T12:00")
    note, _ = evaluate(changed(hours)).metrics["settings"]["notes"]
    assert note.startswith("no weather file: the typical year of GREENSBORO")
    note, _ = evaluate(changed(hours) + SITE).metrics["settings"]["notes"]
    assert "not [site]" in note


def test_own_time_stamps_take_the_sun_of_their_instant(evaluate, stamps, tmp_path):
    found = evaluate(changed(stamps("2015-03-21T10:20", "2015-03-21T10:40", "2015-03-21T23:00")))
    E = found.illuminance
    assert list(E["time"].dt.minute.values) == [20, 40, 0]
    assert list(found.sky["bin"].values[146:]) == ["sun_2015-03-21T10:20", "sun_2015-03-21T10:40"]
    assert not np.allclose(E["direct_sun"][0], E["direct_sun"][1])
    np.testing.assert_array_equal(E["total"][2], 0)
    light = light_module.daylight(found.case)
    np.testing.assert_array_equal(light.sun["instant"].values, E["time"].values)


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        (["2015-03-21T10:00:10", "2015-03-21T10:00:40"], "time: two time stamps in one minute"),
        (["2015-03-21T25:00"], "line 2, time: '2015-03-21T25:00'"),
        (["noon"], "line 2, time: 'noon'"),
    ],
)
def test_unfit_time_stamps_are_told(evaluate, stamps, rows, told):
    with pytest.raises(InputError, match=f"times.csv: {re.escape(told)}"):
        evaluate(changed(stamps(*rows)))


@pytest.mark.parametrize(
    ("period", "told"),
    [
        ("hours = [18, 8]", "hours: .18, 8.; give two"),
        ("months = [3, 3]", "months: .3, 3.; give each month once"),
        ('daylight_saving = ["29-03", "25-10"]', "daylight_saving: "),
        ("hours = [3, 3]", "hours: "),
    ],
)
def test_an_unfit_period_is_told_with_the_case(evaluate, period, told):
    with pytest.raises(InputError, match=rf"case.toml: period.{told}") as caught:
        evaluate(changed((DAYS, period)))
    assert str(caught.value).isprintable()


def weather(name):
    file = WEATHER / name
    if not file.exists():
        pytest.skip("the shared weather files are not beside the repository")
    return f"[weather]\nfile = '{file}'\n"


def test_polar_night_is_dark(evaluate):
    barrow = weather("USA_AK_Barrow.700260_TMY3.epw")
    found = evaluate(changed((DAYS, "months = [12]")) + barrow)
    assert found.illuminance.sizes["time"] == 230
    assert (found.illuminance["sun_open"] == 0).all()
    assert not any(str(label).startswith("sun") for label in found.sky["bin"].values)
    for name in ("sDA", "ASE", "shade_closed"):
        assert found.metrics[name]["value"] == 0
    assert found.metrics["msDA"][11]["value"] == 0
    assert found.metrics["msDA"][10] is None


def test_the_midnight_sun_shines_through_a_northern_window_only(evaluate):
    barrow = weather("USA_AK_Barrow.700260_TMY3.epw")
    midnight = DAYS, "months = [6]\nhours = [0, 1]"
    north = evaluate(changed(midnight, ("facade.south", "facade.north")) + barrow)
    assert north.sky.sizes["bin"] == 146 + int((north.daylight.sky["sun"] > 0).sum())
    assert (
        north.daylight.suns.labels
        == Suns.of(north.daylight.sun, 0.5).only(north.sky["sun_bin"].values).labels
    )
    assert float(north.illuminance["direct_sun"].max()) > 100
    south = evaluate(changed(midnight) + barrow)
    np.testing.assert_array_equal(south.illuminance["direct_sun"], 0)
    assert float(south.illuminance["total"].min()) > 0


@pytest.mark.parametrize(("calendar", "hours"), [("EvalDRC", 2610), ("LM-83", 3650)])
def test_calendars_have_their_hours(tmp_path, calendar, hours):
    (tmp_path / "case.toml").write_text(changed((DAYS, f'calendar = "{calendar}"')))
    light = light_module.daylight(load_case(tmp_path / "case.toml"))
    assert light.sky.sizes["time"] == hours
    L = light_module.luminances(light)
    assert L.sizes["bin"] == 146 + int((light.sky["sun"] > 0).sum())
    everything = light_module.daylight(load_case(tmp_path / "case.toml").with_dark_hours())
    assert everything.suns.labels == Suns.of(light.sun, 0.5).labels
    back = light_module.from_luminances(L)
    np.testing.assert_allclose(back["sky"], light.sky["sky"], rtol=1e-6)
    np.testing.assert_allclose(back["sun"], light.sky["sun"], rtol=1e-6)


def test_working_hours_are_clock_hours_under_daylight_saving(evaluate):
    saving = 'months = [3]\nhours = [8, 10]\ndaylight_saving = ["03-29", "10-25"]'
    E = evaluate(changed((DAYS, saving))).illuminance
    assert set(E["clock"].dt.hour.values) == {8, 9}
    ahead = (E["clock"] - E["time"]) / np.timedelta64(1, "h")
    last = E["time"].values >= np.datetime64("2015-03-29")
    assert last.sum() == 4  # Monday 30 and Tuesday 31 March
    np.testing.assert_array_equal(ahead, last)
    assert set(E["time"].dt.hour.values[last]) == {7, 8}
