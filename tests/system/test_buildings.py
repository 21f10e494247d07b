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
    parts = house.surfaces()
    above = house.opening("w2", house.WINDOW[::-1] + [2, 0, 3])
    ring = house.rect(1, 0, (3, 0), (6, 8))[::-1]
    parts["south c"] = house.surface("south c", "ExteriorWall", ring, ["c"], above)
    house.written(tmp_path, house.text(parts.values()))
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
    assert [s["name"] for s in numbers["storeys"]] == ["Level 1", "Level 2"]
    assert numbers["storeys"][0]["sDA"]["value"] == pytest.approx((lit + dark) / 2)
    assert "building," in out
    with xr.open_dataset(folder / "out" / "illuminance.nc") as E:
        assert set(E["space"].values.astype(str)) == {s["name"] for s in spaces}
    csv = folder / "report.csv"
    assert run("report", folder / "out", "-o", csv)[0] == 0
    assert "大厅" in csv.read_text(encoding="utf-8")


def test_a_building_is_a_case_by_itself(folder, run):
    code, _, err = run("case", folder / "house.xml", "-o", folder / "made")
    assert code == 0, err
    text = (folder / "made" / "house.toml").read_text(encoding="utf-8")
    assert 'spaces = ["*"]' in text
    assert "Double" in text
    assert run("plan", folder / "made" / "house.toml")[0] == 0


def test_what_is_unfit_is_one_line(folder, refused):
    file = folder / "house.xml"
    file.write_text(file.read_text(encoding="utf-8").replace("<Space ", "<Room "), encoding="utf-8")
    assert "house.xml" in refused("plan", folder / "case.toml")
