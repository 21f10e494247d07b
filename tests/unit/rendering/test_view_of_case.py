"""Instants and sizes of pictures, as users give them."""

from datetime import UTC, datetime

import numpy as np
import pandas as pd
import pytest

from drcmitsuba.case.case import Case
from drcmitsuba.case.views import ViewTable
from drcmitsuba.picture.view import PictureView
from drcmitsuba.rendering.view_of_case import (
    instant_of,
    picture_view,
    shape_of,
    with_square_pixels,
)
from drcmitsuba.runtime.errors import InputError

NOON = np.datetime64("2015-03-20T12:00")


@pytest.mark.parametrize("when", [
    "03-20 12:00", " 2015-03-20T12:00:00 ", NOON, datetime(2015, 3, 20, 12),
    pd.Timestamp("2024-03-20 12:00"),
])  # fmt: skip
def test_times_of_text_numpy_pandas_and_python_are_one(when):
    assert instant_of(when) == NOON
    assert instant_of(when).dtype == "datetime64[ns]"


@pytest.mark.parametrize("when", [
    "noon", "02-30 12:00", None, 12, pd.NaT, np.datetime64("NaT", "ns"),
    datetime(2015, 3, 20, 12, tzinfo=UTC), pd.date_range("2015-03-20 12:00", periods=2),
])  # fmt: skip
def test_what_is_no_local_standard_time_is_refused(when):
    with pytest.raises(InputError, match="give month, day and local standard time"):
        instant_of(when)


@pytest.mark.parametrize("size", [24, np.int64(24), (24, 12), np.array([24, 12])])
def test_sizes_are_columns_or_columns_and_rows(size):
    view = PictureView("equidistant")
    assert shape_of(view, size) == ((24, 24) if np.ndim(size) == 0 else (12, 24))


def test_pixels_of_a_perspective_are_square_where_one_angle_is_told():
    one = ViewTable(position=(1, 1, 1), direction=(0, 1, 0), kind="perspective", angle=80)
    views = {
        "one": one, "both": one.model_copy(update={"angle": (80.0, 80.0)}),
        "fisheye": one.model_copy(update={"kind": "equidistant"}),
    }  # fmt: skip
    case = Case.model_validate(
        {
            "room": {"size": [4, 4, 3]}, "views": views,
            "sensors": {"corner": [1, 1, 0.8], "count": [1, 1]},
        }
    )  # fmt: skip
    for name in views:
        _, view = picture_view(case, name)
        square = with_square_pixels(case, name, view, 30, 60)
        assert square.angles[0] == 80
        ratio = square.half_size[1] / square.half_size[0]
        assert ratio == pytest.approx(0.5 if name == "one" else 1.0)


@pytest.mark.parametrize(
    "size",
    [
        "24",
        "24x12",
        24.0,
        None,
        (24, 12, 3),
        0,
        (10**5, 10**5),
        ((24, 12), (1, 2)),
        [[1], [2, 3]],
    ],
)
def test_sizes_that_are_none_are_refused(size):
    with pytest.raises(InputError, match="picture: size"):
        shape_of(PictureView("equidistant"), size)
