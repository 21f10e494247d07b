"""Groups of panes that belong to a space close by the sun on its own sensors alone."""

import json

import numpy as np
import pytest
import xarray as xr

from drcmitsuba.case.groups import GroupStates
from drcmitsuba.metrics.facade_states import FacadeStates
from drcmitsuba.metrics.watched_groups import spaces_of_groups, watched
from drcmitsuba.runtime.errors import InputError

GROUPS = GroupStates(("south", "east"), (("open", "closed"),) * 2)
NAMES = np.repeat(np.array(["west", "hall"], object), 2)


def attributes(**groups):
    rows = [{"name": name, "groups": groups.get(name, [])} for name in ("west", "hall", "attic")]
    rule = {"has_shade": 1, "shade_threshold": 1000.0, "shade_area": 0.5}
    return rule | GROUPS.attributes() | {"spaces": json.dumps(rows)}


def sun(attrs):
    """Sun through the south on all four sensors, then through the east on those of the hall."""
    group = np.array([[0, 0, 0, 0], [-1, -1, 1, 1]], np.float32)
    E = np.where(group >= 0, 2000.0, 0.0)
    times = np.array(["2015-01-01T12", "2015-01-01T13"], "datetime64[ns]")
    at = {"space": ("sensor", NAMES), "grid": ("sensor", NAMES)}
    dims = ("time", "sensor")
    arrays = {"direct_sun": (dims, E), "sun_group": (dims, group)}
    return xr.Dataset(arrays, {"time": times, **at}, attrs)


@pytest.mark.parametrize(
    ("groups", "seen", "closed"),
    [
        ({}, [[0, 0, 0, 0], [-1, -1, 1, 1]], [[1, 0], [0, 1]]),
        ({"west": ["south"]}, [[0, 0, -1, -1], [-1, -1, 1, 1]], [[1, 0], [0, 1]]),
        ({"west": ["east"]}, [[0, 0, 0, 0], [-1, -1, -1, -1]], [[1, 0], [0, 0]]),
        ({"attic": ["south"]}, [[-1, -1, -1, -1], [-1, -1, 1, 1]], [[0, 0], [0, 1]]),
        ({"west": ["east"], "hall": ["east"]}, [[0, 0, 0, 0], [-1, -1, 1, 1]], [[1, 0], [0, 1]]),
    ],
)
def test_sun_through_a_group_of_another_space_closes_none(groups, seen, closed):
    direct = sun(attributes(**groups))
    for dims in (("time", "sensor"), ("sensor", "time")):
        through = watched(direct["sun_group"].transpose(*dims), direct)
        assert through.transpose("time", "sensor").values.tolist() == seen
    states = FacadeStates.of(direct.attrs, direct.assign(sun_group=through))
    assert states.of_group.tolist() == closed


def test_a_damaged_list_is_named():
    with pytest.raises(InputError, match="spaces"):
        spaces_of_groups({"spaces": '[{"groups": ["south"]}]'})
    assert spaces_of_groups({}) == {}
