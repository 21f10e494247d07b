"""When the plan solves light between surfaces on cells, and what it says."""

import pytest

from drcmitsuba.case.case import Case
from drcmitsuba.plan import plan
from drcmitsuba.runtime import backend
from drcmitsuba.sky.daylight import daylight

CASE = {
    "room": {"size": [4.0, 5.0, 3.0]},
    "facade": {"south": {"strips": [{"bottom": 0.9, "top": 2.4, "material": "glass"}]}},
    "materials": {"glass": {"type": "glazing", "transmittance": 0.65}},
    "sensors": {"corner": [0.5, 0.5, 0.8], "count": [6, 7], "spacing": 0.5},
    "period": {"months": [3], "days_per_week": 1},
}


def decided(**tables):
    backend.select()
    case = Case.model_validate(CASE | tables)
    planned = plan(case, daylight(case))
    effect = planned.effects["solved_cells"]
    assert planned.scope.solved_cells == effect.on
    return effect


def test_many_sensors_share_the_light_between_cells():
    effect = decided()
    assert effect.on
    assert "42 sensors share the light between some 464 cells" in effect.reason


def test_few_sensors_of_a_usual_room_do_so_too_but_those_of_a_hall_do_not():
    two = {"sensors": {"corner": [2, 2, 0.8], "count": [1, 2]}}
    assert decided(**two).on
    hall = decided(**two, room={"size": [40.0, 50.0, 12.0]})
    assert not hall.on
    assert "2 sensors and some" in hall.reason


@pytest.mark.parametrize(
    ("tables", "reason"),
    [
        ({"accuracy": {"target": "0.2 %"}}, "0.2 % of the mean"),
        ({"accuracy": {"target": "0.2 % at each sensor"}}, "0.2 % at each sensor"),
        ({"accuracy": {"cell_size": 0.02, "cell_paths": 256}}, "GiB"),
        ({"effects": {"solved_cells": "off"}}, "overruled"),
    ],
)
def test_paths_follow_all_bounces_where_cells_do_not_pay(tables, reason):
    if "cell_size" in tables.get("accuracy", {}):
        tables["sensors"] = {"corner": [0.5, 0.5, 0.8], "count": [170, 200], "spacing": 0.02}
    effect = decided(**tables)
    assert not effect.on
    assert reason in effect.reason


def test_a_black_room_solves_nothing():
    black = {"size": [4.0, 5.0, 3.0], "floor": 0.0, "walls": 0.0, "ceiling": 0.0}
    bare = {"glass": {"type": "glazing", "transmittance": 0.65, "reflectance": 0.0}}
    assert not decided(room=black, materials=bare).on
