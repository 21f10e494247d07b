"""A building in gbXML from the command line: results by space, by storey, and by area."""

import json

import pytest
import xarray as xr

from tests.unit.model import gbxml_building as house

CASE = """
name = "house"
[model]
files = ["house.xml"]
[period]
months = [3]
[sensors]
spaces = ["*"]
spacing = 1.0
[spaces."大厅"]
use = "foyer"
[spaces."Office (Level 1, 2)"]
threshold = 200
hours = [9, 12]
[uses.office]
power = 8
[accuracy]
replicates = 4
paths = 16
cell_size = 0.8
"""
GROUND, UPPER = 20.0, 40.0
"""Floor area of a room below, and of the one above [m²]."""


@pytest.fixture
def folder(tmp_path):
    """Building with a window in one room below and one in the room above."""
    house.written(tmp_path, house.text(house.with_window_above().values()))
    (tmp_path / "case.toml").write_text(CASE, encoding="utf-8")
    return tmp_path


def test_results_are_by_space_storey_and_area(folder, run):
    code, out, err = run("evaluate", folder / "case.toml", "-o", folder / "out")
    assert code == 0, err
    numbers = json.loads((folder / "out" / "metrics.json").read_text())
    spaces = numbers["spaces"]
    assert [(s["name"], s["use"], s["storey"]) for s in spaces] == [
        ("Office (Level 1, 1)", "OfficeOpenPlan", "Level 1"),
        ("Office (Level 1, 2)", "OfficeOpenPlan", "Level 1"),
        ("大厅", "foyer", "Level 2"),
    ]
    areas = [s["floor_area"] for s in spaces]
    assert areas == pytest.approx([GROUND, GROUND, UPPER], abs=0.01)
    lit, dark, hall = (s["sDA"]["value"] for s in spaces)
    assert lit > 0 == dark
    mean = (GROUND * (lit + dark) + UPPER * hall) / (2 * GROUND + UPPER)
    assert numbers["building"]["sDA"]["value"] == pytest.approx(mean, abs=0.05)
    assert numbers["building"]["sensors"] == sum(s["sensors"] for s in spaces)
    assert [(s["target"], s["hours"]) for s in spaces] == [
        (500, [7, 18]), (200, [9, 12]), (100, [7, 18]),
    ]  # fmt: skip
    assert "office 500 lx, 7 to 18 h (1 space); entrance hall 100 lx" in out
    lamps = [s["electric_light"] for s in spaces]
    assert [light["hours"] for light in lamps] == [220, 66, 220]  # 22 working days of March
    assert [light["hours_off"]["value"] > 0 for light in lamps] == [True, False, True]
    full = 66 * 8 * GROUND / 1000  # [kWh]: no light, and none in any replicate
    assert lamps[1]["energy"] == pytest.approx({"value": full, "low": full, "high": full})
    saved, whole = lamps[0]["hours_saved"], numbers["building"]["electric_light"]["hours_saved"]
    assert saved["low"] < saved["value"] < saved["high"] < 220
    assert whole["low"] < whole["value"] < whole["high"]
    assert [s["name"] for s in numbers["storeys"]] == ["Level 1", "Level 2"]
    assert numbers["storeys"][0]["sDA"]["value"] == pytest.approx((lit + dark) / 2)
    assert "building," in out
    with xr.open_dataset(folder / "out" / "illuminance.nc") as E:
        assert set(E["space"].values.astype(str)) == {s["name"] for s in spaces}
    csv, page = folder / "report.csv", folder / "report.html"
    assert run("report", folder / "out", "-o", csv)[0] == 0
    assert '"Office (Level 1, 2)",,"electric light, hours",66' in csv.read_text(encoding="utf-8")
    assert "大厅" in csv.read_text(encoding="utf-8")
    assert run("report", folder / "out", "-o", page)[0] == 0
    assert ", 9–12 h" in page.read_text(encoding="utf-8")
    code, _, err = run("metrics", folder / "out" / "illuminance.nc", "-o", folder / "steps")
    assert code == 0, err
    again = json.loads((folder / "steps" / "metrics.json").read_text())["spaces"]
    for whole, alone in zip(spaces, again, strict=True):  # E alone: all errors in one direction
        assert [alone[key] for key in ("target", "hours")] == [
            whole[key] for key in ("target", "hours")
        ]
        assert alone["DA"]["value"] == pytest.approx(whole["DA"]["value"])
        for name, light in whole["electric_light"].items():
            value, other = (n if name == "hours" else n["value"] for n in
                            (light, alone["electric_light"][name]))  # fmt: skip
            assert other == pytest.approx(value, rel=1e-5, abs=1e-5)


@pytest.mark.slow
def test_a_year_that_is_summed_tells_the_same_of_its_spaces(folder, run):
    assert run("evaluate", folder / "case.toml", "-o", folder / "out")[0] == 0
    text = (folder / "case.toml").read_text(encoding="utf-8")
    summed = text.replace("[period]", '[output]\nilluminance = "metrics"\n[period]')
    (folder / "summed.toml").write_text(summed, encoding="utf-8")
    code, _, err = run("evaluate", folder / "summed.toml", "-o", folder / "summed")
    assert code == 0, err
    whole, sums = (json.loads((folder / f / "metrics.json").read_text()) for f in ("out", "summed"))
    for a, b in zip(whole["spaces"], sums["spaces"], strict=True):
        assert a["DA"] == pytest.approx(b["DA"])
        for name, light in a["electric_light"].items():
            assert light == pytest.approx(b["electric_light"][name], rel=1e-5, abs=1e-5)
    assert whole["building"]["DA"] == pytest.approx(sums["building"]["DA"])
    with xr.open_dataset(folder / "summed" / "sensors.nc") as sensors:
        hall = sensors["space"].values.astype(str) == "大厅"
        mean = float(sensors["DA"].values[hall].mean())
    assert mean == pytest.approx(whole["spaces"][2]["DA"]["value"])


def test_a_building_is_a_case_by_itself(folder, run):
    code, _, err = run("case", folder / "house.xml", "-o", folder / "made")
    assert code == 0, err
    text = (folder / "made" / "house.toml").read_text(encoding="utf-8")
    assert 'spaces = ["*"]' in text
    assert "Double" in text
    assert "#   Office (Level 1, 1), OfficeOpenPlan, Level 1, 20.0 m², 500 lx, 7 to 18 h\n" in text
    assert run("plan", folder / "made" / "house.toml")[0] == 0


def test_what_is_unfit_is_one_line(folder, refused):
    file = folder / "house.xml"
    file.write_text(file.read_text(encoding="utf-8").replace("<Space ", "<Room "), encoding="utf-8")
    assert "house.xml" in refused("plan", folder / "case.toml")


@pytest.mark.slow
def test_glare_is_told_by_space(folder, run):
    """A view at the window below, one at its back wall, one above; the third room has none."""
    views = {"window": (2, 2, 1.2, 0, -1), "door": (2, 3, 1.2, 0, 1), "hall": (3, 3, 4.2, 0, -1)}
    text = (folder / "case.toml").read_text(encoding="utf-8")
    text = text.replace("[period]\nmonths = [3]", '[period]\ntimestamps = "times.csv"')
    for name, (x, y, z, *along) in views.items():
        position, direction = [x, y, z], [*along, 0]
        text += f"[views.{name}]\nposition = {position}\ndirection = {direction}\n"
    (folder / "times.csv").write_text("time\n2015-01-20T12:00\n2015-12-21T12:00\n")
    (folder / "glare.toml").write_text(text, encoding="utf-8")
    code, _, err = run("evaluate", folder / "glare.toml", "-o", folder / "out")
    assert code == 0, err
    code, out, err = run("glare", folder / "glare.toml", "-o", folder / "out")
    assert code == 0, err
    assert "worst view of each space" in out
    numbers = json.loads((folder / "out" / "glare.json").read_text())
    ((state, rows),) = numbers["DGP"].items()
    lower, upper = "Office (Level 1, 1)", "大厅"
    assert {name: row["space"] for name, row in rows.items()} == {
        "window": lower, "door": lower, "hall": upper,
    }  # fmt: skip
    worst = numbers["spaces"][state]
    assert {name: (row["worst"], row["views"]) for name, row in worst.items()} == {
        lower: ("window", 2), upper: ("hall", 1),
    }  # fmt: skip
    with xr.open_dataset(folder / "out" / "glare.nc") as saved:
        assert saved["space"].values.astype(str).tolist() == [lower, lower, upper]
    page = folder / "report.html"
    assert run("report", folder / "out", "-o", page)[0] == 0
    assert "Worst view of each space" in page.read_text(encoding="utf-8")
