"""`drcmitsuba optimise` of lamellae in a small room."""

import json

import pandas as pd
import pytest

RECIPE = """
[structure]
kind = "lamellae"
period = 100
width = 100
turn = -30
reflectance = 0.9
specular = 1
"""
CASE = """
name = "small room"
[period]
timestamps = "stamps.csv"
[room]
size = [4.0, 4.0, 3.0]
[facade.south]
strips = [{ bottom = 1.8, top = 2.8, material = "lamellae" }]
[components.lamellae]
type = "structure"
recipe = "slats.toml"
[sensors]
corner = [0.5, 0.5, 0.8]
count = [4, 4]
spacing = 0.75
[metrics]
sda_threshold = 2500.0
ase_hours = 1.0
[accuracy]
replicates = 4
paths = 32
photons = 256
sensor_sky_rays = 256
[design]
component = "lamellae"
tilt = [-10.0, 30.0]
tilt_step = 2.0
"""


@pytest.fixture
def case(tmp_path):
    (tmp_path / "slats.toml").write_text(RECIPE)
    (tmp_path / "stamps.csv").write_text("time\n2015-03-20T12:00\n2015-06-20T10:00\n")
    file = tmp_path / "case.toml"
    file.write_text(CASE)
    return file


def test_a_search_for_a_tilt_leaves_its_files_and_prints_its_optimum(run, case, tmp_path):
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / "pareto.csv").write_text("of another search")
    code, out, _ = run("optimise", case, "-o", tmp_path / "d")
    assert code == 0
    names = {"optimum.json", "history.csv", "tilt.png", "search.png", "fresh_metrics.json"}
    assert {f.name for f in (tmp_path / "d").iterdir()} == names
    optimum = json.loads((tmp_path / "d" / "optimum.json").read_text())
    history = pd.read_csv(tmp_path / "d" / "history.csv")
    assert optimum["feasible"]
    assert -10 <= optimum["tilt"] <= 30
    assert optimum["simulations"] == history.tilt.nunique() == len(history)
    assert f"{optimum['simulations']} tilts simulated" in out
    held = history[history.ASE <= 10]
    assert optimum["value"] == pytest.approx(held.value.max(), rel=1e-4)
    assert {"grid", "section", "beside"} >= set(history.search)
    fresh = json.loads((tmp_path / "d" / "fresh_metrics.json").read_text())
    assert fresh["settings"]["components"]["lamellae"]["tilt"] == optimum["tilt"]
    assert fresh["settings"]["accuracy"]["seed"] != 0
    assert f"{fresh['sDA']['value']:.1f} (" in out


def test_keys_of_a_window_are_refused_in_one_line(refused, case, tmp_path):
    case.write_text(CASE + "pareto = 3\n")
    line = refused("optimise", case, "-o", tmp_path / "d")
    assert line.endswith(
        "design.pareto: the tilt of a component is searched, not a façade; leave it out"
    )
    assert not (tmp_path / "d").exists()
