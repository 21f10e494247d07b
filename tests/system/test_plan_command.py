"""`drcmitsuba plan`: the table, plan.json, and what is wrong with a case in one line."""

import json

import pytest

from drcmitsuba.plan.forecast import cost

CASE = """
name = "small room"
[period]
months = [6]
days_per_week = 1
[room]
size = [3.0, 4.0, 3.0]
[facade.north]
strips = [{ bottom = 0.9, top = 2.7, material = "glass" }]
[materials.glass]
type = "glazing"
transmittance = 0.65
[sensors]
corner = [0.5, 0.5, 0.8]
count = [3, 3]
spacing = 0.6
[accuracy]
replicates = 2
paths = 16
"""
OVERCAST = """
[sky]
model = "cie"
type = "overcast"
[site]
latitude = 46.0
longitude = 6.0
timezone = 1
"""


@pytest.fixture
def case(tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(CASE + OVERCAST)
    return file


def test_a_table_with_reasons_and_a_forecast(run, case, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    code, out, err = run("plan", case)
    assert (code, err) == (0, "")
    lines = {line.split()[0]: line for line in out.splitlines() if line.strip()}
    assert " yes " in lines["sky"]
    assert "no sun of the period has a radiance" in lines["suns"]
    assert "–" in lines["suns"].split("no sun")[0]
    assert "no panes with a measured BSDF" in lines["films"]
    for unit in (" s, ", "MiB of memory", "MB on disk", "million rays"):
        assert unit in lines["forecast:"]
    assert not list(case.parent.glob("*.json"))


def test_the_plan_is_written_as_evaluate_writes_it(run, case, tmp_path, monkeypatch):
    monkeypatch.setattr(cost, "SHORT", 0)
    assert run("plan", case, "-o", tmp_path / "p")[0] == 0
    assert run("evaluate", case, "-o", tmp_path / "e")[0] == 0
    before, after = (json.loads((tmp_path / name / "plan.json").read_text()) for name in ("p", "e"))
    assert list(before) == list(after)
    for name in before:
        assert before[name]["on"] == after[name]["on"]
        if name != "cost":
            assert before[name]["reason"] == after[name]["reason"]
    for unit in ("rays", "memory_bytes", "disk_bytes", "items", "files"):
        assert before["cost"]["forecast"][unit] == after["cost"]["forecast"][unit]
    assert "actual" not in before["cost"]


def test_json_alone_on_the_screen(run, case):
    code, out, _ = run("plan", case, "--json")
    assert code == 0
    report = json.loads(out)
    assert report["suns"] == {
        "on": False, "reason": "no sun of the period has a radiance",
        "suns": 0, "reaching": 0, "largest_ns": report["suns"]["largest_ns"], "share": 0.0,
    }  # fmt: skip
    assert report["cost"]["forecast"]["rays"]["photon"] == 0


def test_mistakes_give_one_line(refused, case, tmp_path):
    assert "no such file" in refused("plan", tmp_path / "none.toml")
    case.write_text(CASE.replace('material = "glass"', 'material = "glas"'))
    assert "glass" in refused("plan", case)
    case.write_text(CASE.replace("corner = [0.5, 0.5, 0.8]", "corner = [-9.0, 0.5, 0.8]"))
    assert "sensors" in refused("plan", case)
    case.write_text(CASE + '\n[effects]\nsuns = "some"\n')
    assert "effects.suns" in refused("plan", case)
    case.write_text(CASE)
    assert "no such file" in refused("plan", case, "--weather", tmp_path / "none.epw").lower()
    assert "is a file" in refused("plan", case, "-o", case)
