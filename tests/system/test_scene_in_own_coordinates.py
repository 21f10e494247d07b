"""The picture of a scene shows the coordinates of the user's file, however it is turned."""

import json
import re

import numpy as np
import pytest
import xarray as xr

from drcmitsuba.case.reading import load_case
from drcmitsuba.report import scene_view
from drcmitsuba.report.captions import turned_text
from drcmitsuba.report.document.packing import unpacked
from tests.system.test_several_grids import CASE, ROOMS

FAR = np.array([4_600, 57_000, 300])
"""Where the model stands in its map [m]."""


@pytest.fixture
def shown(monkeypatch):
    """Whatever is drawn: positional arguments and options of `scene_view`."""
    calls = []
    drawing = scene_view.scene_view

    def drawn(*arguments, **options):
        calls.append((*arguments, options))
        return drawing(*arguments, **options)

    monkeypatch.setattr(scene_view, "scene_view", drawn)
    return calls


@pytest.mark.parametrize("north", [0, 30])
def test_a_model_of_a_map_is_drawn_where_it_stands(run, tmp_path, shown, north):
    x, y, z = FAR
    (tmp_path / "origin.rad").write_text(ROOMS)
    (tmp_path / "rooms.rad").write_text(f"!xform -t {x} {y} {z} origin.rad\n")
    seat = f"{x + 2} {y + 4} {z + 1.2}"
    (tmp_path / "seat.vf").write_text(f"rvu -vtl -vp {seat} -vd 0 -1 0 -vh 3 -vv 2\n")
    text = CASE.replace("[period]", f"north = {north}\n[period]", 1)
    (tmp_path / "case.toml").write_text(text)
    code, _, err = run("case", tmp_path / "case.toml", "-o", tmp_path / "out")
    assert code == 0, err
    ((drawn, sensors, options),) = shown
    corners = np.concatenate([one.quads.reshape(-1, 3) for one in drawn])
    np.testing.assert_allclose(corners.min(axis=0), FAR, atol=1e-2)
    np.testing.assert_allclose(corners.max(axis=0), FAR + (8, 5, 3), atol=1e-2)
    assert (sensors > FAR).all()
    assert (sensors < FAR + (8, 5, 3)).all()
    position, direction = options["views"]["seat"]
    np.testing.assert_allclose(position, FAR + (2, 4, 1.2))
    np.testing.assert_allclose(direction, (0, -1, 0))
    turn = np.radians(north)
    np.testing.assert_allclose(options["north"], (np.sin(turn), np.cos(turn)), atol=1e-12)


def test_captions_tell_how_a_plan_is_turned(tmp_path):
    (tmp_path / "rooms.rad").write_text(f"!xform -t {FAR[0]} {FAR[1]} {FAR[2]} origin.rad\n")
    (tmp_path / "origin.rad").write_text(ROOMS)
    (tmp_path / "seat.vf").write_text("rvu -vtl -vp 2 4 1.2 -vd 0 -1 0 -vh 3 -vv 2\n")
    for north, words in ((0, ""), (30, "turned by 30° counterclockwise about (4600, 57000)")):
        text = CASE.replace("[period]", f"north = {north}\n[period]", 1)
        (tmp_path / "case.toml").write_text(text)
        told = turned_text(load_case(tmp_path / "case.toml"))
        assert words in told
        assert bool(told) is bool(words)


def test_results_of_a_model_of_a_map_are_read_again(run, tmp_path):
    """Northings of UTM exceed all other numbers of a result."""
    (tmp_path / "origin.rad").write_text(ROOMS)
    (tmp_path / "rooms.rad").write_text("!xform -t 500000 9000000 120 origin.rad\n")
    (tmp_path / "seat.vf").write_text("rvu -vtl -vp 2 4 1.2 -vd 0 -1 0 -vh 3 -vv 2\n")
    (tmp_path / "case.toml").write_text(CASE)
    out = tmp_path / "out"
    code, _, err = run("evaluate", tmp_path / "case.toml", "-o", out)
    assert code == 0, err
    for command in (["plot", out], ["report", out], ["export", out, "--csv", tmp_path / "E.csv"]):
        code, _, err = run(*command)
        assert code == 0, err
    page = (out / "report.html").read_text(encoding="utf-8")
    (data,) = re.findall(r'<script type="application/json"[^>]*>(.*?)</script>', page, re.S)
    (facade,) = json.loads(data)["facades"]
    with xr.open_dataset(out / "illuminance.nc") as E:
        np.testing.assert_allclose(unpacked(facade["y"])[0] / 1000, E["y"], atol=6e-4)
