"""A model of two rooms from the command line: metrics, tables and plans by room; views; place."""

import json

import numpy as np
import pytest
import xarray as xr
from matplotlib.image import imread

from tests.made_weather import clear_year

ROOMS = """
void plastic floor  0 0 5 .2 .2 .2 0 0
void plastic walls  0 0 5 .5 .5 .5 0 0
void glass   pane   0 0 3 .75 .75 .75
floor polygon f1 0 0 12   0 0 0   4 0 0   4 5 0   0 5 0
floor polygon f2 0 0 12   4 0 0   8 0 0   8 5 0   4 5 0
walls polygon c  0 0 12   0 0 3   0 5 3   8 5 3   8 0 3
walls polygon w  0 0 12   0 0 0   0 5 0   0 5 3   0 0 3
walls polygon e  0 0 12   8 0 0   8 0 3   8 5 3   8 5 0
walls polygon n  0 0 12   0 5 0   8 5 0   8 5 3   0 5 3
walls polygon m  0 0 12   4 0 0   4 5 0   4 5 3   4 0 3
walls polygon s1 0 0 30   0 0 0   0 0 3   4 0 3   4 0 0   0 0 0
                          1 0 1   3 0 1   3 0 2   1 0 2   1 0 1
walls polygon s2 0 0 30   4 0 0   4 0 3   8 0 3   8 0 0   4 0 0
                          5 0 1   5.5 0 1   5.5 0 2   5 0 2   5 0 1
pane polygon  p1 0 0 12   1 0 1   3 0 1   3 0 2   1 0 2
pane polygon  p2 0 0 12   5 0 1   5.5 0 1   5.5 0 2   5 0 2
"""
CASE = """
name = "two rooms"
[model]
files = ["rooms.rad", "seat.vf"]
[period]
months = [3]
[materials.shade]
type = "diffuser"
transmittance = 0.1
[shading]
material = "shade"
[sensors]
floors = ["floor"]
spacing = 1.0
margin = "EN 17037"
[accuracy]
replicates = 4
paths = 16
cell_size = 0.8
"""


def written(folder, more=""):
    (folder / "rooms.rad").write_text(ROOMS)
    (folder / "seat.vf").write_text("rvu -vtl -vp 2 4 1.2 -vd 0 -1 0 -vh 3 -vv 2\n")
    (folder / "case.toml").write_text(CASE + more)
    return folder / "case.toml"


@pytest.fixture
def evaluated(run, tmp_path):
    code, out, _ = run("evaluate", written(tmp_path), "-o", tmp_path / "out")
    assert code == 0
    return tmp_path / "out", out


def test_results_tell_the_rooms_apart(evaluated, run):
    folder, out = evaluated
    numbers = json.loads((folder / "metrics.json").read_text())
    large, small = numbers["grids"].values()
    assert list(numbers["grids"]) == ["floor 1", "floor 2"]
    assert (large["sensors"], small["sensors"]) == (12, 12)
    assert large["sDA"]["value"] > small["sDA"]["value"]
    mean = (large["sDA"]["value"] + small["sDA"]["value"]) / 2
    assert mean == pytest.approx(numbers["sDA"]["value"])
    assert "floor 2" in out
    with xr.open_dataset(folder / "illuminance.nc", engine="h5netcdf") as E:
        assert np.unique(E["grid"].values.astype(str)).tolist() == ["floor 1", "floor 2"]
        assert "nz" not in E.coords
    # The steps, which have no draws, tell the same numbers.
    code, again, _ = run("metrics", folder / "illuminance.nc", "-o", folder / "steps")
    assert code == 0
    assert "floor 2" in again
    stepped = json.loads((folder / "steps" / "metrics.json").read_text())["grids"]
    for name, grid in numbers["grids"].items():
        for metric in ("sDA", "ASE"):
            assert stepped[name][metric]["value"] == grid[metric]["value"]


@pytest.mark.slow
def test_plans_are_drawn_again_with_rooms_while_the_model_can_be_read(
    evaluated, run, tmp_path, drawn
):
    folder, _ = evaluated
    first = imread(folder / "sun_plan.png")
    code, out, _ = run("plot", folder)
    assert code == 0
    assert "note" not in out
    np.testing.assert_array_equal(imread(folder / "sun_plan.png"), first)
    (tmp_path / "rooms.rad").unlink()
    code, out, _ = run("plot", folder)
    assert code == 0
    assert "note: the plans have no rooms, since the model cannot be read" in out


def test_a_case_lists_grids_views_and_north(run, tmp_path):
    code, out, _ = run("case", written(tmp_path), "-o", tmp_path / "out")
    assert code == 0
    assert "grid floor 1: 12 points" in out
    assert "view seat: parallel, 3 m × 2 m, from (2, 4, 1.2) along (0, -1, 0)" in out
    assert "north: 0°, clockwise from the model's y axis" in out


def test_another_place_than_the_weathers_is_told(run, tmp_path):
    clear_year(tmp_path / "denver.epw", 39.76, -104.86, -7.0, place="Denver")
    place = '[weather]\nfile = "denver.epw"\n[site]\nname = "Geneva"\ntimezone = 1\n'
    file = written(tmp_path, place + "latitude = 46.2\nlongitude = 6.1\n")
    for verb in ("case", "plan"):
        _, out, _ = run(verb, file, "-o", tmp_path / "out")
        (note,) = (line for line in out.splitlines() if "[site]" in line)
        assert "Geneva (latitude 46.2, longitude 6.1) is not the weather's place, Denver" in note


@pytest.mark.parametrize(
    ("margin", "complaint"),
    [
        ('"LM-83"', "sensors.margin: got \"LM-83\"; input should be a valid number or 'EN 17037'"),
        ("-1", "sensors.margin: got -1; input should be greater than or equal to 0"),
    ],
)
def test_an_unknown_margin_is_refused(refused, tmp_path, margin, complaint):
    file = written(tmp_path)
    file.write_text(CASE.replace('"EN 17037"', margin))
    assert complaint in refused("plan", file)


OWN = """
[groups.all]
panes = ["pane"]
states = ["shade"]
[spaces.west]
outline = [[0, 0], [4, 0], [4, 5], [0, 5]]
height = 3.0
[spaces.east]
outline = [[4, 0], [8, 0], [8, 5], [4, 5]]
height = 3.0
groups = ["all"]
"""


def test_a_group_of_a_space_closes_by_its_sun_alone(run, tmp_path):
    """The group is the only one; the west has more sun than the east, which it belongs to."""
    closed, in_sun = {}, {}
    for name, more in (("own", OWN), ("any", OWN.replace('groups = ["all"]\n', ""))):
        (folder := tmp_path / name).mkdir()
        code, _, err = run("evaluate", written(folder, more), "-o", folder / "out")
        assert code == 0, err
        with xr.open_dataset(folder / "out" / "illuminance.nc", engine="h5netcdf") as E:
            closed[name] = E["facade_state"].isel(group=0).values > 0
            reached = E["direct_sun"] >= 1000
            if name == "own":  # sun in the west comes through a group of another space
                assert (E["sun_group"].values[:, E["space"].values == "west"] == -1).all()
                reached &= E["sun_group"] == 0
            sunlit = reached.groupby("space").mean("sensor").load()
            in_sun[name] = {at: sunlit.sel(space=at).values >= 0.02 for at in ("east", "west")}
    east, west = in_sun["any"].values()
    np.testing.assert_array_equal(closed["own"], in_sun["own"]["east"])
    np.testing.assert_array_equal(closed["any"], east | west)
    assert not (closed["own"] & ~east).any()
    assert 0 < closed["own"].sum() < closed["any"].sum()


def test_a_group_of_a_space_is_one_of_the_case(refused, tmp_path):
    more = OWN.replace('["all"]', '["al"]')
    assert 'spaces.east.groups: there is no group "al"; did you mean "all"?' in refused(
        "plan", written(tmp_path, more)
    )
