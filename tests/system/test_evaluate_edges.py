"""Evaluations at the edge: dark, black and coloured rooms, other skies, sites and times."""

import re
import shutil

import numpy as np
import pytest
import xarray as xr

import drcmitsuba
from drcmitsuba import load_case, metrics, schema
from drcmitsuba.metrics import stored_arrays
from drcmitsuba.report.outlines import outlines_in_plan
from drcmitsuba.report.sheets import sheets
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky import daylight as light_module
from drcmitsuba.sky import luminances
from drcmitsuba.sky.sun_models import Suns
from tests import ROOT
from tests.made_weather import clear_year
from tests.system.small_room import CASE, DAYS, SHADING, SITE, STRIPS, VARIABLES, changed, run

# ---- cases at the edge ------------------------------------------------------------------------


def test_a_room_without_opening_is_dark_not_unknown(evaluate, stamps):
    result = evaluate(changed(stamps("2015-03-21T09:00", "2015-06-21T12:00"), (STRIPS, "")))
    for name in result.illuminance.data_vars:
        np.testing.assert_array_equal(result.illuminance[name], 0, err_msg=name)
    for name in ("sDA", "ASE", "shade_closed"):
        assert result.metrics[name] == {"value": 0, "low": 0, "high": 0}


def test_a_black_room_has_direct_light_only(evaluate, stamps):
    black = "size = [4.0, 5.0, 3.0]\nfloor = 0\nceiling = 0\nwalls = 0"
    frame = "frame = 0.1\nframe_reflectance = 0"
    changes = ("size = [4.0, 5.0, 3.0]", black), ("frame = 0.1", frame), (SHADING, "")
    result = evaluate(changed(stamps("2015-03-21T12:00"), *changes))
    np.testing.assert_array_equal(result.coefficients["interreflected"], 0)
    assert float(result.illuminance["total"].min()) > 0


def test_sensors_under_the_free_sky_get_what_the_weather_says(tmp_path, same):
    """E = diffuse + direct normal · cos Z, without any room around the sensors."""
    text = "[period]\nmonths = [3]\n[sensors]\ncorner = [0, 0, 0]\ncount = [2, 2]\n"
    (tmp_path / "case.toml").write_text(text)
    case = load_case(tmp_path / "case.toml")
    light = light_module.daylight(case)
    result = drcmitsuba.evaluate(case)
    coefficients = result.coefficients["replicates"].sel(state="open")
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

    E = result.illuminance
    np.testing.assert_allclose(E["sky_open"], by_sky.mean("replicate"), rtol=1e-5, atol=1e-3)
    np.testing.assert_allclose(E["sun_open"][rows], by_sun.mean(axis=0), rtol=1e-5)
    np.testing.assert_allclose(E["direct_sun"], E["sun_open"], rtol=1e-5)
    assert result.metrics["sDA"]["value"] == 100
    assert result.metrics["shade_closed"]["value"] == 0


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
        stored_arrays.open_dataset(tmp_path / name / "illuminance.nc").load()
        for name in ("r", "again")
    )
    for name in E.data_vars:
        np.testing.assert_allclose(again[name], E[name], rtol=1e-4, atol=0.05, err_msg=name)
    assert capsys.readouterr().err == ""


# ---- skies, sites and times -------------------------------------------------------------------


def test_a_cie_sky_needs_no_weather_file(evaluate, stamps):
    sky = '[sky]\nmodel = "cie"\ntype = 5\ndiffuse_horizontal_illuminance = 10000\n'
    hours = stamps("2015-03-21T12:00", "2015-06-21T12:00")
    result = evaluate(changed(hours) + sky + SITE)
    E = result.illuminance
    # Type 5 has no sun and is uniform in azimuth and height: the same at all times of the day.
    np.testing.assert_allclose(E["total"][0], E["total"][1], rtol=1e-5)
    np.testing.assert_array_equal(E["sun_open"], 0)
    assert result.metrics["settings"]["weather_source"] == "site, no weather file"
    (note,) = result.metrics["settings"]["notes"]
    assert note.startswith("the period is 2 time stamps of 60 min each, no year")


def test_a_cie_sky_without_its_illuminance_is_refused_with_the_case(evaluate):
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
    result = evaluate(changed(stamps("2015-03-21T10:20", "2015-03-21T10:40", "2015-03-21T23:00")))
    E = result.illuminance
    assert list(E["time"].dt.minute.values) == [20, 40, 0]
    assert list(result.sky["bin"].values[146:]) == ["sun_2015-03-21T10:20", "sun_2015-03-21T10:40"]
    assert not np.allclose(E["direct_sun"][0], E["direct_sun"][1])
    np.testing.assert_array_equal(E["total"][2], 0)
    light = light_module.daylight(result.case)
    np.testing.assert_array_equal(light.sun["instant"].values, E["time"].values)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (
            ["2015-03-21T10:00:10", "2015-03-21T10:00:40"],
            "line 3, time: two time stamps in one minute",
        ),
        (["2015-03-21T25:00"], "line 2, time: '2015-03-21T25:00'"),
        (["noon"], "line 2, time: 'noon'"),
    ],
)
def test_unfit_time_stamps_are_refused(evaluate, stamps, rows, message):
    with pytest.raises(InputError, match=f"times.csv: {re.escape(message)}"):
        evaluate(changed(stamps(*rows)))


@pytest.mark.parametrize(
    ("period", "message"),
    [
        ("hours = [18, 8]", "hours: .18, 8.; give two"),
        ("months = [3, 3]", "months: .3, 3.; give each month once"),
        ('daylight_saving = ["29-03", "25-10"]', "daylight_saving: "),
        ("hours = [3, 3]", "hours: "),
    ],
)
def test_an_unfit_period_is_refused_with_the_case(evaluate, period, message):
    with pytest.raises(InputError, match=rf"case.toml: period.{message}") as caught:
        evaluate(changed((DAYS, period)))
    assert str(caught.value).isprintable()


@pytest.fixture
def barrow(tmp_path):
    """The place in Alaska, under clear skies."""
    file = clear_year(tmp_path / "barrow.epw", 71.286, -156.767, -9.0)
    return f"[weather]\nfile = '{file}'\n"


def test_polar_night_is_dark(evaluate, barrow):
    result = evaluate(changed((DAYS, "months = [12]")) + barrow)
    assert result.illuminance.sizes["time"] == 230
    assert (result.illuminance["sun_open"] == 0).all()
    assert not any(str(label).startswith("sun") for label in result.sky["bin"].values)
    for name in ("sDA", "ASE", "shade_closed"):
        assert result.metrics[name]["value"] == 0
    assert result.metrics["msDA"][11]["value"] == 0
    assert result.metrics["msDA"][10] is None


def test_the_midnight_sun_shines_through_a_northern_window_only(evaluate, barrow):
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
    L = luminances.luminances(light)
    assert L.sizes["bin"] == 146 + int((light.sky["sun"] > 0).sum())
    everything = light_module.daylight(load_case(tmp_path / "case.toml").with_dark_hours())
    assert everything.suns.labels == Suns.of(light.sun, 0.5).labels
    back = luminances.from_luminances(L)
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


SKYLIGHT = """void plastic black 0 0 5 0 0 0 0 0
void BSDF film 6 0 prism.xml 0 1 0 . 0 0
black polygon floor 0 0 12  0 0 0  4 0 0  4 5 0  0 5 0
black polygon south 0 0 12  0 0 0  0 0 3  4 0 3  4 0 0
black polygon east  0 0 12  4 0 0  4 0 3  4 5 3  4 5 0
black polygon north 0 0 12  0 5 0  4 5 0  4 5 3  0 5 3
black polygon west  0 0 12  0 0 0  0 5 0  0 5 3  0 0 3
black polygon a 0 0 12  0 0 3  0 2 3  4 2 3  4 0 3
black polygon b 0 0 12  0 3 3  0 5 3  4 5 3  4 3 3
black polygon c 0 0 12  0 2 3  0 3 3  1.5 3 3  1.5 2 3
black polygon d 0 0 12  2.5 2 3  2.5 3 3  4 3 3  4 2 3
film polygon pane 0 0 12  1.5 2 3  1.5 3 3  2.5 3 3  2.5 2 3
"""
TURNED = """
[model]
files = ["room.rad"]
north = {north}
[site]
latitude = 46.0
longitude = 6.0
timezone = 1
[sky]
model = "cie"
type = "overcast"
diffuse_horizontal_illuminance = 10000.0
[period]
months = [6]
hours = [12, 13]
days_per_week = 1
[sensors]
points = [[2, 0.5, 0.8], [2, 4.5, 0.8], [0.5, 2.5, 0.8], [3.5, 2.5, 0.8]]
[accuracy]
replicates = 4
paths = 16
"""


def test_a_film_in_a_roof_turns_with_its_model(tmp_path):
    """Under a sky that is the same all around, light within does not depend on north."""
    shutil.copy(ROOT / "scenes" / "films" / "prism.xml", tmp_path)
    (tmp_path / "room.rad").write_text(SKYLIGHT)
    found = []
    for north in (0, 90, 217):
        (tmp_path / "case.toml").write_text(TURNED.format(north=north))
        result = drcmitsuba.evaluate(tmp_path / "case.toml")
        E = result.illuminance.isel(time=0)
        found.append((E["total"].values, E["total_se"].values))
    at = np.column_stack([E["x"].values, E["y"].values])
    (sheet,) = sheets(result.illuminance)
    assert len(outlines_in_plan(result.case, at, sheet)["glazing"]) == 4  # plans show it
    (first, error), *others = found
    assert abs(first[0] - first[1]) > 5 * np.hypot(*error[:2])  # the film has a direction
    for turned, own in others:
        assert (np.abs(turned - first) < 5 * np.hypot(own, error)).all(), (first, turned)
