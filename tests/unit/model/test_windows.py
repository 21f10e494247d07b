"""New windows: cut out of walls, listed in a table, read again."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from drcmitsuba.model.materials import Lambertian
from drcmitsuba.model.polygon import area_vector
from drcmitsuba.model.window_table import COLUMNS, read_windows, rows_of
from drcmitsuba.model.windows import NewWindow, materials_around, with_windows
from drcmitsuba.runtime.errors import InputError
from tests.model_rooms import GLASS, house
from tests.unit.model import box_room as box

LOW = np.array([[5.0, 0, 0.2], [7, 0, 0.2], [7, 0, 0.8], [5, 0, 0.8]])
"""Below the window of the eastern room of the house, fronts to the outside."""


def window(corners, name="glass"):
    return NewWindow(name, np.asarray(corners, float)[None][:, ::-1], "here")


def test_the_wall_around_a_window_keeps_its_front_and_its_area():
    before = house().building
    after = with_windows(before, [window(LOW)], {"glass": GLASS})
    areas = [box.area_of(model.layers) for model in (before, after)]
    assert areas[1]["walls", "surface"] == pytest.approx(areas[0]["walls", "surface"] - 1.2)
    assert areas[1]["glass", "pane"] == pytest.approx(areas[0]["glass", "pane"] + 1.2)
    # The sum of normals times areas is that of the same polygons less the window.
    sums = [
        np.sum([area_vector(quad) for quad in box.layer_of(model, "walls").quads], axis=0)
        for model in (before, after)
    ]
    assert sums[0] - sums[1] == pytest.approx(np.array([0, 1.2, 0]), abs=1e-9)
    walls = box.layer_of(after, "walls")
    assert walls.place(len(walls.quads) - 1) == "walls 0"
    assert box.layer_of(after, "glass").places[-1] == "here"


def test_a_table_of_windows_gives_the_same_windows_again(tmp_path):
    made = [window(LOW), replace(window(LOW + [-4, 0, 0], "opal"), depth=0.3)]
    rows = rows_of(made)
    pd.DataFrame(rows, columns=COLUMNS).to_csv(tmp_path / "windows.csv", index=False)
    again = read_windows(tmp_path / "windows.csv", ["glass", "opal"])
    assert [w.name for w in again] == ["glass", "opal"]
    for ours, theirs in zip(made, again, strict=True):
        assert theirs.quads == pytest.approx(ours.quads)
        assert theirs.depth == ours.depth


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: "", "windows.csv: windows: it holds no window; give a CSV file with the"),
        (lambda text: text.replace("material", "name"), "windows.csv: windows: 'material'; give"),
        (lambda text: text.replace("0.2", "low"), "could not convert string to float: 'low'"),
        (lambda text: text.replace("glass", "glas"), 'no pane has the material "glas"; did you'),
        (lambda text: text.replace("0.2", "nan"), "window 0: a corner that is no point"),
        (lambda text: text.replace("7.0,0.0,0.2", "7.0,1.0,0.2"), "its corners lie in no plane"),
        (
            lambda text: text.replace("0.0\n", "-0.3\n"),
            "window 0: a depth of -0.3 m; give 0 to 1 m",
        ),
        (lambda text: "window\n\x00\n", "windows.csv: windows:"),
    ],
)
def test_unfit_tables_are_refused_in_one_line(tmp_path, change, message):
    file = tmp_path / "windows.csv"
    pd.DataFrame(rows_of([window(LOW)]), columns=COLUMNS).to_csv(file, index=False)
    file.write_text(change(file.read_text()))
    with pytest.raises(InputError) as error:
        read_windows(file, ["glass", "opal"])
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_a_window_in_no_wall_is_refused():
    with pytest.raises(InputError, match="here: no wall lies in its plane; give corners"):
        with_windows(house().building, [window(LOW + [0, -1, 0])], {"glass": GLASS})


def test_a_window_without_its_outer_face_is_refused():
    deep = replace(window(LOW), depth=0.3)
    message = "no outer face of the wall lies 0.3 m behind it; give corners counter-clockwise"
    with pytest.raises(InputError, match=message):
        with_windows(house().building, [deep], {"glass": GLASS})


def test_the_wall_around_a_pane_is_known_by_its_material():
    model = house().building
    around = materials_around(model, box.layer_of(model, "glass").quads[:1])
    assert around == {Lambertian(0.6): "walls"}
