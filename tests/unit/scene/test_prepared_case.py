"""A case made ready: each part is found once, and is what the functions that find it say."""

import os
from collections import Counter

import numpy as np
import pytest

import drcmitsuba
from drcmitsuba import glare_year
from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import Lambertian
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene import prepared_case
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.prepared_case import KEPT, prepared
from drcmitsuba.scene.sensors import sensor_coordinates, sensor_points
from tests.model_rooms import case_of, layer, prism


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
    other = case.with_tables(name="another room")
    assert prepared(other).receivers is not prepared(case).receivers
    assert case.with_tables(name=case.name, materials=dict(case.materials)) is case
    finer = case.with_tables(accuracy=case.accuracy.model_copy(update={"seed": 3}))
    assert finer is not case
    assert prepared(finer) is prepared(case)
    first = prepared(case).receivers
    for _ in range(KEPT):
        prepared(room())
    again = prepared(case).receivers
    assert again is not first  # the oldest one has gone, and was found again
    np.testing.assert_array_equal(again.points, first.points)


def test_rays_that_find_the_sensors_of_a_model_have_a_variant(monkeypatch):
    """Who asks for them first need not know: `lights` of a point was the first to do so."""
    chosen, (floor, *_) = [], prism([(0, 0), (4, 0), (4, 5), (0, 5)], 3.0)
    model = case_of(layer("floor", Lambertian(0.5), floor), sensors={"floors": ["floor"]})
    monkeypatch.setattr(prepared_case.mi, "variant", lambda: None)
    monkeypatch.setattr(prepared_case.backend, "select", lambda: chosen.append("llvm"))
    prepared(room())
    assert not chosen
    prepared(model)
    assert chosen


def test_a_run_finds_no_part_twice(monkeypatch):
    """All rooms of an evaluation, and of a year of glare, read the same prepared case."""
    names = ("placed_sensors", "sensor_coordinates", "sensor_points", "spaces_of", "views")
    counts = Counter()

    def counted(name, function):
        def call(*arguments, **options):
            counts[name] += 1
            return function(*arguments, **options)

        return call

    for name in names:
        monkeypatch.setattr(prepared_case, name, counted(name, getattr(prepared_case, name)))
    monkeypatch.setattr(PaneGroups, "of", staticmethod(counted("groups", PaneGroups.of)))
    few = {"paths": 16, "sensor_sky_rays": 64, "cell_sky_rays": 16}
    view = {"a": {"position": [2, 3, 1.2], "direction": [0, -1, 0]}}
    shade = {"cloth": {"type": "diffuser", "transmittance": 0.1}}
    case = room(
        views=view, period={"months": [3], "hours": [11, 13]}, accuracy=few,
        shading={"material": "cloth"}, materials={**room().materials, **shade},
    )  # fmt: skip
    drcmitsuba.evaluate(case)
    glare_year.glare(case)
    assert counts == dict.fromkeys([*names, "groups"], 1)


def test_receivers_are_the_same_for_all_and_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        prepared(room()).receivers.points[0] = 0


def test_unfit_sensors_are_refused_each_time():
    case = room(sensors={"corner": [0.5, 0.5, 4.0], "count": [3, 2], "spacing": 1.0})
    for _ in range(2):
        with pytest.raises(InputError, match="beyond a wall"):
            prepared(case).check()


def test_a_model_whose_files_were_not_read_is_refused():
    sensors = {"corner": [0.5, 0.5, 0.8], "count": [1, 1], "spacing": 1.0}
    made = Case.model_validate({"model": {"files": ["room.rad"]}, "sensors": sensors, "unit": "m"})
    with pytest.raises(InputError, match="model: its files were not read; take load_case"):
        prepared(made)


def test_a_case_whose_tables_change_is_prepared_anew():
    case = room(groups={"south": {"panes": ["glass"], "states": ["opal"]}}, materials={
        "glass": {"type": "glazing", "transmittance": 0.7},
        "opal": {"type": "diffuser", "transmittance": 0.3},
    })  # fmt: skip
    assert prepared(case).groups.states.names == ("south",)
    case.facade["north"] = case.facade["south"]
    assert set(prepared(case).groups.facings[0]) == {"south", "north"}
    del case.groups["south"]
    assert not len(prepared(case).groups)


def test_points_of_a_file_are_read_anew_when_it_changes(tmp_path):
    file = tmp_path / "points.pts"
    file.write_text("1 1 0.8 0 0 1\n")
    case = room(sensors={"points": str(file)})
    assert prepared(case).receivers.points[:, 1].tolist() == [1.0]
    file.write_text("1 2 0.8 0 0 1\n")
    os.utime(file, ns=(0, 0))
    assert prepared(case).receivers.points[:, 1].tolist() == [2.0]


def test_points_of_a_file_of_a_model_are_read_anew_when_it_changes(tmp_path):
    file = tmp_path / "points.pts"
    file.write_text("1 1 0.8 0 0 1\n")
    low, high, walls = prism([(0, 0), (4, 0), (4, 5), (0, 5)], 3.0)
    polygons = layer("wall", Lambertian(0.5), low, high, *walls)
    case = case_of(polygons, sensors={"points": str(file)}, model={"leaks": "allow"})
    assert prepared(case).receivers.points[:, 1].tolist() == [1.0]
    file.write_text("1 2.5 0.8 0 0 1\n")
    assert prepared(case).receivers.points[:, 1].tolist() == [2.5]
