"""Pictures of an evaluation: they show the case's room as it stands and say what they are of."""

import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import QuadMesh
from matplotlib.text import Text

from drcmitsuba.case.case import Case
from drcmitsuba.report import figures
from drcmitsuba.report.captions import caption, is_rated, month_names
from drcmitsuba.report.style import LINES
from drcmitsuba.scene.sensors import sensor_points

GLASS = {"glass": {"type": "glazing", "transmittance": 0.65}}
SHADE = {"shade": {"type": "diffuser", "transmittance": 0.1, "reflectance": 0.4}}
FACADE = {"south": {"strips": [{"bottom": 0.9, "top": 2.8, "material": "glass"}]}}
LM_83 = {"calendar": "LM-83"}


def case_of(rotation=0.0, furniture=(), shaded=True, **tables):
    shading = {"shading": {"material": "shade"}} if shaded else {}
    tables = {
        "name": "office",
        "room": {"size": (4.0, 6.0, 3.0), "rotation": rotation},
        "facade": FACADE,
        "materials": GLASS | SHADE,
        "furniture": furniture,
        "sensors": {"corner": (0.5, 0.5, 0.8), "count": (6, 10), "spacing": 0.5},
        **shading,
        **tables,
    }
    return Case.model_validate(tables)


def year_of(case, stamps=400):
    """E and numbers of a case: sensors near the glazing see sun and reach the threshold."""
    points, _ = sensor_points(case)
    depth = np.repeat(np.arange(10), 6)
    hour = np.arange(stamps)
    E = np.where(hour[:, None] < stamps * (1 - depth / 10), 600.0, 100.0)
    sun = np.where(hour[:, None] < 320 - 30 * depth, 2000.0, 0.0)
    time = np.datetime64("2015-01-01T08:00", "ns") + hour * np.timedelta64(20, "h")
    data = {"total": (("time", "sensor"), E), "direct_sun": (("time", "sensor"), sun)}
    coords = {"time": time} | {axis: ("sensor", points[:, i]) for i, axis in enumerate("xy")}
    return xr.Dataset(data, coords), numbers()


def numbers():
    def interval(value):
        return {"value": value, "low": value - 1, "high": value + 1}

    names = ("sDA", "ASE", "shade_closed", "msDA", "MSE", "shade_closed_monthly")
    values = [interval(v) for v in (60.0, 30.0, 20.0)] + [[interval(50.0)] * 12] * 3
    settings = {"weather_source": "/data/Geneva.epw", "notes": []}
    return dict(zip(names, values, strict=True)) | {"settings": settings}


def drawn(case):
    E, numbers = year_of(case)
    return figures.pictures(case, E, numbers)


def line(figure, name):
    """Points of a kind of line in a plan, or None."""
    colour, width = LINES[name]["color"], LINES[name]["linewidth"]
    for kind in figure.axes[0].lines:
        if (kind.get_color(), kind.get_linewidth()) == (colour, width):
            return kind.get_xydata()
    return None


def texts(figure):
    return [text.get_text() for text in figure.findobj(Text) if text.get_text()]


def said(figure):
    return " ".join(texts(figure)).replace("\n", " ").replace("\N{NO-BREAK SPACE}", " ")


DESK = {"name": "desk", "corner": (1.0, 1.0, 0.0), "size": (1.6, 0.8, 0.7)}
BUILDING = {"name": "building", "corner": (-10.0, -25.0, 0.0), "size": (30.0, 10.0, 20.0)}


@pytest.mark.parametrize("rotation", [0.0, 30.0, -90.0])
def test_a_turned_room_is_drawn_turned(rotation):
    case = case_of(rotation, [DESK])
    plan = drawn(case)["sun_plan.png"]
    angle = np.radians(rotation)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])  # clockwise
    for name, corners in (
        ("room", [[0, 0], [4, 0], [4, 6], [0, 6], [0, 0]]),
        ("furniture", [[1, 1], [2.6, 1], [2.6, 1.8], [1, 1.8], [1, 1]]),
        ("glazing", [[0, 0], [4, 0]]),
    ):
        points = line(plan, name)
        np.testing.assert_allclose(points[:-1], np.array(corners) @ turn.T, atol=1e-9)
    assert {"room", "furniture", "glazing", "250 h (ASE)"} <= set(texts(plan))
    mesh = next(c for c in plan.axes[0].collections if isinstance(c, QuadMesh))
    assert mesh.get_array().size == 60


def test_surroundings_leave_the_room_as_large_as_it_was():
    alone, beside = (
        drawn(case_of(furniture=f))["sun_plan.png"] for f in ([DESK], [DESK, BUILDING])
    )
    assert beside.axes[0].get_xlim() == alone.axes[0].get_xlim()
    assert beside.axes[0].get_ylim() == alone.axes[0].get_ylim()
    assert "surroundings" not in texts(beside)  # 15 m away: out of view
    np.testing.assert_array_equal(line(beside, "furniture"), line(alone, "furniture"))
    near = drawn(case_of(furniture=[DESK, BUILDING | {"corner": (-10.0, -10.1, 0.0)}]))
    assert "surroundings" in texts(near["sun_plan.png"])
    assert near["sun_plan.png"].axes[0].get_ylim() == alone.axes[0].get_ylim()


def test_limits_part_the_sensors_that_count():
    pictures = drawn(case_of())
    sun, autonomy = pictures["sun_plan.png"], pictures["autonomy_plan.png"]
    # 320 − 30 k hours in the k-th row: rows 0 to 2 reach 250 h; the line lies after the third.
    assert np.unique(line(sun, "limit")[:, 1][::3]).tolist() == [2.0]
    assert sun.axes[1].lines[-1].get_ydata() == [250, 250]
    # 1 − k/10 of the hours: rows 0 to 5 reach one half of them.
    assert np.unique(line(autonomy, "limit")[:, 1][::3]).tolist() == [3.5]
    assert autonomy.axes[1].get_ylim() == (0, 100)
    assert "hours [h]" in texts(sun)


def test_every_picture_names_weather_period_and_accuracy():
    for name, figure in drawn(case_of(period={"months": [3, 4, 5, 9]})).items():
        words = said(figure)
        assert "Geneva.epw; Mar–May, Sep, Mon–Fri, 8–18 h: 400 h;" in words, name
        assert "sDA 59.0–61.0 %, ASE 29.0–31.0 %" in words, name


def test_a_part_of_the_year_is_no_year():
    whole, part = (drawn(case_of(period=p))["monthly.png"] for p in ({}, {"months": [6, 7]}))
    assert "year" in texts(whole)
    assert "shade closed for 20.0 % of the year's hours" in texts(whole)
    assert "Jun–Jul" in texts(part)
    assert "shade closed for 20.0 % of the period's hours" in texts(part)
    assert "year" not in said(part)


@pytest.mark.parametrize(
    ("tables", "rated"),
    [
        ({"period": LM_83}, True),
        ({}, False),
        ({"period": LM_83 | {"months": [1]}}, False),
        ({"period": LM_83 | {"hours": (9, 17)}}, False),
        ({"period": LM_83, "metrics": {"sda_threshold": 500}}, False),
        ({"period": LM_83, "metrics": {"sda_fraction": 0.4}}, False),
    ],
)
def test_levels_of_lm_83_are_drawn_for_its_own_numbers(tables, rated):
    case = case_of(**tables)
    assert is_rated(case) == rated
    assert ("preferred" in said(drawn(case)["monthly.png"])) == rated


def test_no_shade_is_named_where_there_is_none():
    bare, shaded = drawn(case_of(shaded=False)), drawn(case_of())
    assert any("shade applied" in said(figure) for figure in shaded.values())
    for name, figure in bare.items():
        assert "shade" not in said(figure), name
    E, numbers = year_of(case_of())
    off = figures.pictures(case_of(), E.assign_attrs(has_shade=0), numbers)
    assert "shade" not in said(off["monthly.png"])


def test_time_stamps_of_the_user(tmp_path):
    case = case_of(period={"timestamps": tmp_path / "stamps.csv"})
    E, numbers = year_of(case)
    assert "400 time stamps of stamps.csv" in caption(case, E, numbers)
    assert "time stamps" in texts(figures.monthly(case, E, numbers))


def test_names_of_months():
    assert month_names(tuple(range(1, 13))) == "Jan–Dec"
    assert month_names((12, 6, 1, 7)) == "Jan, Jun–Jul, Dec"
