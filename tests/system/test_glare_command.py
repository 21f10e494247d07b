"""`drcmitsuba glare` as a user runs it: its tables, files and refusals."""

import json
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import drcmitsuba
from drcmitsuba import load_case
from drcmitsuba.annual.adaptive_sampling import of_hours
from drcmitsuba.glare_year import GlareYear, Rule
from tests.unit.glare_year.glare_room import TIMES, case_in

SHADE = """
[materials.shade]
type = "diffuser"
transmittance = 0.1
[shading]
material = "shade"
"""


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return case_in(tmp_path_factory.mktemp("office"), more=SHADE, times=("01-20T01:00", *TIMES))


@pytest.fixture(scope="module")
def year(case):
    return drcmitsuba.glare(case)


def test_every_state_has_the_dgp_of_every_view_and_time_stamp(year):
    assert year.states == ("open", "shaded", "applied")
    assert year.views == ("window", "side", "door")
    assert year.hours["dgp"].dims == ("state", "time", "view")
    assert ((year.hours["dgp"] >= 0.159) & (year.hours["dgp"] <= 1)).all()
    window = year.hours.sel(view="window")
    assert (window["illuminance"].sel(state="shaded") <= window["illuminance"][0]).all()
    assert year.worst("open") in ("window", "side")


def test_nights_have_the_constant_of_dgp_alone(year):
    night = year.hours.isel(time=0).sel(state="open")
    assert (night["illuminance"] == 0).all()
    np.testing.assert_allclose(night["dgp"], 0.159, atol=1e-6)


def test_the_shade_takes_the_states_that_an_evaluation_gives_it(case, year):
    closed = drcmitsuba.evaluate(case).illuminance["shade_closed"].values
    assert closed.any()
    assert not closed.all()
    dgp = year.hours["dgp"]
    expected = xr.where(xr.DataArray(closed, dims="time"), dgp[1], dgp[0])
    np.testing.assert_array_equal(dgp.sel(state="applied").values, expected.values)


def test_shares_and_classes_are_countable(year):
    dgp = year.hours["dgp"].sel(state="open", view="window").values
    row = year.numbers()["DGP"]["open"]["window"]
    # One of the seven time stamps is at night, which was counted before.
    np.testing.assert_array_equal(year.hours["daylight"].values, [0, 1, 1, 1, 1, 1, 1])
    assert row["above"]["0.40"]["value"] == pytest.approx(100 * (dgp > 0.4).sum() / 6)
    assert row["above"]["0.40"]["low"] <= row["above"]["0.40"]["value"]
    assert row["class"] == ("none" if (dgp > 0.45).any() else "minimum")
    assert sum(row["probability"].values()) == pytest.approx(1)
    with pytest.raises(drcmitsuba.InputError, match="limit: 2"):
        year.share(2)


def test_the_numbers_say_which_hours_are_counted(year):
    hours = year.numbers()["hours"]
    assert hours == {
        "period": 7, "counted": 6, "which": "6 h, those with daylight of the period's 7 h",
    }  # fmt: skip
    assert "6 h, those with daylight of the period's 7 h" in year._repr_html_()


def test_a_class_allows_a_twentieth_of_the_hours_with_daylight(case):
    """DGP is 0.5 in one of 20 hours of daylight, or in two: with 20 nights both were "high"."""
    lit, made = np.arange(40) < 20, []
    for bright in (1, 2):
        dgp = np.where(np.arange(40) < bright, 0.5, 0.2)[None, :, None].astype(np.float32)
        hours = xr.Dataset(
            {"dgp": (("state", "time", "view"), dgp)},
            {"state": ["open"], "view": ["desk"], "daylight": ("time", lit.astype(np.int8))},
            {"step_hours": 1.0},
        )
        made.append(GlareYear(case, hours, np.stack([dgp] * 4), {"seed": 0}, {}))
        assert made[-1].share(0.4).item() == pytest.approx(bright / 20)
    assert [year.classes()["rating"].item() for year in made] == ["high", "none"]
    hours = made[-1].hours.assign_coords(daylight=("time", np.zeros(40)))
    nights = GlareYear(case, hours, made[-1].replicates, {"seed": 0}, {})
    assert nights.share(0.4).item() == pytest.approx(2 / 40)  # there is nothing else to count


def test_the_command_writes_tables_files_and_plots(run, tmp_path):
    case = case_in(tmp_path)
    code, out, _ = run("glare", case.source, "-o", tmp_path / "glare", "--around", "2 3 1.2")
    assert "forecast" in out
    assert code == 0
    assert "above 0.40" in out
    assert "SW" in out
    assert "hours counted: 6 h, all of the period's 6 h; EN 17037 allows 5 % of them" in out
    names = {"glare.nc", "glare.json", "glare_year.png", "glare_plan.png"}
    assert {file.name for file in (tmp_path / "glare").iterdir()} == names
    numbers = json.loads((tmp_path / "glare" / "glare.json").read_text())
    assert list(numbers["DGP"]["open"]) == ["N", "NE", "E", "SE", "S", "SW", "W", "NW"]
    with xr.open_dataset(tmp_path / "glare" / "glare.nc") as saved:
        assert saved["dgp"].sizes == {"state": 1, "time": 6, "view": 8}
        assert saved["illuminance"].attrs["units"] == "lx"


def test_each_storey_has_a_plan_of_its_views(year, tmp_path):
    high = year.hours["z"].values + [0.0, 3.0, 0.2]
    plans = replace(year, hours=year.hours.assign_coords(z=("view", high))).plan_plots()
    assert list(plans) == ["glare_plan_1.png", "glare_plan_2.png"]
    for name in ("glare_plan.png", "glare_plan_of_mine.png"):
        (tmp_path / name).write_text("drawn before")
    replace(year, hours=year.hours.assign_coords(z=("view", high))).save(tmp_path)
    drawn = {file.name for file in tmp_path.glob("glare_plan*")}
    assert drawn == {*plans, "glare_plan_of_mine.png"}
    arrows = [[t for t in f.axes[0].texts if t.get_text().isdigit()] for f in plans.values()]
    assert [len(each) for each in arrows] == [2, 1]
    assert "plan 2 of 2, eyes from" in plans["glare_plan_2.png"].axes[0].get_title(loc="left")


def test_a_year_of_glare_shows_itself(year):
    html = year._repr_html_()
    assert "EN 17037" in html
    assert "data:image/png" in html
    assert repr(year).startswith("<GlareYear of 'office': 3 views × 7 time stamps")
    with pytest.raises(drcmitsuba.InputError, match="choose one of window, side, door"):
        year.year_plot("none")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--around", "2 3"], "command line: --around: '2 3'; give x,y,z"),
        (["--around", "2 7 1.2"], "views: view 'point 1' at (2, 7, 1.2) lies in, on or beyond"),
        (["--around", "nan 1 1"], "points"),
        (["--threshold", "-1"], "threshold: -1"),
        (["--threshold", "inf"], "threshold: inf; give a finite number"),
    ],
)
def test_unfit_arguments_are_refused_in_one_line(arguments, complaint, refused, case):
    assert complaint in refused("glare", case.source, *arguments)


def test_a_rule_without_peaks_is_written_as_json():
    rule = Rule(peak=float("inf"))
    assert json.loads(json.dumps(rule.to_dict(), allow_nan=False))["peak"] is None


def test_a_case_without_views_is_refused(refused, case, tmp_path):
    text = (case._folder / "office.toml").read_text()
    kept = [part for part in text.split("\n[") if not part.startswith("views")]
    (tmp_path / "times.csv").write_text((case._folder / "times.csv").read_text())
    (tmp_path / "blind.toml").write_text("\n[".join(kept))
    assert load_case(tmp_path / "blind.toml").views == {}
    assert "views: no view; add a table" in refused("glare", tmp_path / "blind.toml")


def test_a_target_of_each_sensor_is_reached_at_the_eyes(case, year):
    first = [float(of_hours(*each, 6).max()) for each in at_eyes(year)]
    wanted = round(0.8 * max(first), 3)
    asked = {"target": f"{wanted} % at each sensor"}
    accuracy = case.accuracy.model_copy(update=asked)
    again = drcmitsuba.glare(case.with_tables(accuracy=accuracy))
    assert max(float(of_hours(*each, 6).max()) for each in at_eyes(again)) <= wanted
    (note,) = (n for n in again.settings["notes"] if "at the widest eye" in n)
    assert f"wanted ±{wanted:g} %" in note
    assert "after 1 round," not in note


@pytest.mark.slow
def test_hours_of_glare_are_known_as_well_as_a_target_asks(tmp_path):
    """Shares of the hours against a run of thirty times the paths, which shares no rays."""
    days = [f"{month:02d}-{day}" for month in range(1, 13) for day in ("04", "18")]
    case = case_in(tmp_path, times=[f"{d}T{h:02d}:30" for d in days for h in (9, 11, 13, 15)])

    def glare(**accuracy):
        changed = case.accuracy.model_copy(update=accuracy)
        return drcmitsuba.glare(case.with_tables(accuracy=changed))

    few, wanted = {"replicates": 8, "paths": 16}, 1.6
    before, after = glare(**few), glare(**few, target=f"{wanted} points of glare hours")
    truth = glare(replicates=16, paths=512, seed=9)
    assert before.half_widths().max() > wanted >= after.half_widths().max()
    (note,) = (n for n in after.settings["notes"] if n.startswith("hours of glare: "))
    assert f"wanted ±{wanted} points" in note
    assert (after.hours["dgp_se"] <= before.hours["dgp_se"]).mean() > 0.5
    for limit in (0.35, 0.40, 0.45):
        (a, b) = (year.interval(limit) for year in (after, truth))
        reach = ((a["high"] - a["low"]) + (b["high"] - b["low"])) / 2
        assert (abs(a["value"] - b["value"]) <= reach + 1e-6).all()


def test_a_target_of_sensors_is_said_to_be_none_of_glare(case, run):
    accuracy = case.accuracy.model_copy(update={"target": "1 point"})
    notes = drcmitsuba.glare(case.with_tables(accuracy=accuracy)).settings["notes"]
    assert 'accuracy.target: "1 point" is one of an evaluation; glare adds no rounds toward it' in (
        notes
    )


def test_the_forecasts_tell_of_rounds_toward_their_own_targets(run, tmp_path):
    case = case_in(tmp_path)
    text = (tmp_path / "office.toml").read_text()
    told = '; then rounds toward "90 points of glare hours", until 7 s are over'
    aimed = text + 'target = "90 points of glare hours"\ntime_limit = 7\n'
    (tmp_path / "office.toml").write_text(aimed)
    _, out, _ = run("glare", case.source, "-o", tmp_path / "glare")
    assert told in out
    assert "hours of glare: ±" in out
    _, out, _ = run("plan", case.source)
    assert told not in out
    (tmp_path / "office.toml").write_text(text + 'target = "2 %"\n')
    _, out, _ = run("plan", case.source)
    assert '; then rounds toward "2 %", until 600 s are over' in out


def at_eyes(year):
    """Illuminance at the eyes and its error (time, view), by state."""
    names = ("illuminance", "illuminance_se")
    states = (state for state in year.hours["state"].values if state != "applied")
    for state in states:
        here = year.hours.sel(state=state)
        yield [here[name].transpose("time", "view").values for name in names]
