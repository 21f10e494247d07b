"""A case made ready: each part is found once, and is what the functions that find it say."""

import numpy as np
import pytest

from drcmitsuba.case.case import Case
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.prepared_case import KEPT, prepared
from drcmitsuba.scene.sensors import sensor_coordinates, sensor_points


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def room(**changes):
    tables = {
        "room": {"size": [4.0, 5.0, 3.0]},
        "facade": {"south": {"strips": [{"bottom": 1.0, "top": 2.0, "material": "glass"}]}},
        "materials": {"glass": {"type": "glazing", "transmittance": 0.7}},
        "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 2], "spacing": 1.0},
    }
    return Case.model_validate(tables | changes)


def test_parts_are_what_their_functions_find():
    case = room()
    receivers, (points, normals) = prepared(case).receivers, sensor_points(case)
    np.testing.assert_array_equal(receivers.points, points)
    np.testing.assert_array_equal(receivers.normals, normals)
    assert receivers.coordinates.identical(sensor_coordinates(case))
    assert len(receivers) == 6
    np.testing.assert_array_equal(receivers.at([4, 1])[0], points[[4, 1]])
    assert prepared(case).groups.states == PaneGroups.of(case).states
    assert len(prepared(case).windows) == 1


def test_parts_are_found_once_for_a_case_and_anew_for_another():
    case = room()
    assert prepared(case).receivers is prepared(case).receivers
    other = case.with_tables(site=None)
    assert prepared(other).receivers is not prepared(case).receivers
    first = prepared(case).receivers
    for _ in range(KEPT):
        prepared(room())
    again = prepared(case).receivers
    assert again is not first  # the oldest one has gone, and was found again
    np.testing.assert_array_equal(again.points, first.points)


def test_receivers_are_the_same_for_all_and_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        prepared(room()).receivers.points[0] = 0


def test_unfit_sensors_are_refused_each_time():
    case = room(sensors={"corner": [0.5, 0.5, 4.0], "count": [3, 2], "spacing": 1.0})
    for _ in range(2):
        with pytest.raises(InputError, match="beyond a wall"):
            prepared(case).check()
