"""Arrays of users are read by their labels, not by their places."""

import numpy as np
import pytest
import xarray as xr

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.labelled import in_order

TIME = np.arange("2015-01-01T08", "2015-01-01T12", dtype="datetime64[h]").astype("datetime64[ns]")
LABELS = {"time": TIME, "group": ("south", "east")}
VALUES = np.arange(8).reshape(4, 2)
GIVEN = xr.DataArray(VALUES, {"time": TIME, "group": ["south", "east"]}, ("time", "group"))


@pytest.mark.parametrize(
    "given",
    [
        VALUES, VALUES.tolist(), GIVEN, GIVEN.T, GIVEN[[2, 0, 3, 1]], GIVEN[:, ::-1],
        GIVEN.drop_vars("group"), GIVEN.to_pandas(), GIVEN.to_pandas()[["east", "south"]],
        GIVEN.assign_coords(group=[0, 1]), GIVEN.drop_indexes("time"),
        GIVEN.astype(float), GIVEN.rename(group="opening"),
        xr.concat([GIVEN, GIVEN.assign_coords(time=TIME + np.timedelta64(1, "D"))], "time"),
    ],
)  # fmt: skip
def test_values_follow_their_labels(given):
    assert (in_order(given, LABELS, "states") == VALUES).all()


def test_frames_may_have_further_columns():
    frame = GIVEN.to_pandas()[::-1]
    assert (in_order(frame, {"time": TIME}, "eyes") == VALUES).all()
    assert (in_order(frame["east"], {"time": TIME}, "eyes") == VALUES[:, 1]).all()


def test_labels_that_lack_or_come_twice_are_refused():
    with pytest.raises(InputError, match=r"states: time: none for 2015-01-01T11"):
        in_order(GIVEN[:3], LABELS, "states")
    with pytest.raises(InputError, match=r"states: group: none for east"):
        in_order(GIVEN.assign_coords(group=["south", "west"]), LABELS, "states")
    with pytest.raises(InputError, match=r"states: time: 2015-01-01 08:00:00 comes twice"):
        in_order(GIVEN[[0, 0, 1, 2, 3]], LABELS, "states")
