"""Metrics of spaces, storeys and a building: by area, from draws that all spaces share."""

import json

import numpy as np
import pytest
import xarray as xr

from drcmitsuba.metrics.evaluate_metrics import summarise
from drcmitsuba.metrics.metrics_of_spaces import darkest_first
from drcmitsuba.metrics.spaces import sensors_by_space
from drcmitsuba.runtime.errors import InputError
from tests.unit.metrics.test_grids import ASKED, GRIDS, in_doubt
from tests.unit.metrics.test_intervals import drawn

SPACES = [
    {"name": "west", "use": "office", "storey": "L1", "floor_area": 30.0},
    {"name": "east", "use": "", "storey": "L2", "floor_area": 10.0},
    {"name": "empty", "use": "", "storey": "L1", "floor_area": 99.0},
]
NAMES = np.where(GRIDS == "south", "west", "east").astype(object)


def told(spaces=SPACES):
    """E, rules and draws of five sensors near all limits, three in the west and two in the east."""
    C = in_doubt(shaded=False).assign_coords(space=("sensor", NAMES))
    E, draws = drawn(C, ASKED)
    return E.assign_attrs(spaces=json.dumps(spaces)), draws


def test_spaces_have_the_metrics_of_their_sensors():
    E, draws = told()
    numbers = summarise(E, ASKED, draws)
    west, east = numbers["spaces"]
    assert (west["name"], west["use"], west["storey"], west["sensors"]) == (
        "west", "office", "L1", 3,
    )  # fmt: skip
    for space, grid in ((west, "south"), (east, "north")):
        for name in ("sDA", "ASE", "msDA", "MSE"):
            assert space[name] == numbers["grids"][grid][name]


def test_the_building_is_the_mean_by_area():
    E, draws = told()
    numbers = summarise(E, ASKED, draws)
    west, east = numbers["spaces"]
    building, draw = numbers["building"], draws.grids
    assert (building["spaces"], building["floor_area"], building["sensors"]) == (2, 40.0, 5)
    for name in ("sDA", "ASE"):
        value = 0.75 * west[name]["value"] + 0.25 * east[name]["value"]
        assert building[name]["value"] == pytest.approx(value)
        joint = 0.75 * draw["south"].annual[name] + 0.25 * draw["north"].annual[name]
        low, high = np.quantile(joint, [0.025, 0.975])
        assert building[name]["low"] <= low + 1e-9
        assert building[name]["high"] >= high - 1e-9
        assert np.ptp(joint) > 0
    for month, each in enumerate(building["msDA"]):
        parts = west["msDA"][month], east["msDA"][month]
        if each is None:
            assert None in parts
        else:
            value = 0.75 * parts[0]["value"] + 0.25 * parts[1]["value"]
            assert each["value"] == pytest.approx(value)
    assert any(each is not None for each in building["msDA"])
    assert [storey["name"] for storey in numbers["storeys"]] == ["L1", "L2"]
    for storey, space in zip(numbers["storeys"], (west, east), strict=True):
        assert storey["sDA"]["value"] == pytest.approx(space["sDA"]["value"])


def test_one_space_has_all_sensors():
    E, draws = told(SPACES[:1])
    numbers = summarise(E, ASKED, draws)
    [space] = numbers["spaces"]
    assert space["sensors"] == 5
    assert "storeys" not in numbers
    for part in (space, numbers["building"]):
        assert part["sDA"] == pytest.approx(numbers["sDA"])
        assert part["ASE"] == pytest.approx(numbers["ASE"])


def test_without_draws_ends_are_means_by_area():
    E, _ = told()
    numbers = summarise(E, ASKED)
    west, east = numbers["spaces"]
    for end in ("value", "low", "high"):
        mean = 0.75 * west["sDA"][end] + 0.25 * east["sDA"][end]
        assert numbers["building"]["sDA"][end] == pytest.approx(mean)


def test_arrays_without_spaces_have_none():
    E, draws = told()
    for bare in (E.assign_attrs(spaces="[]"), E.drop_vars("space")):
        assert sensors_by_space(bare) == ()
        assert "building" not in summarise(bare, ASKED, draws)


@pytest.mark.parametrize("words", ["{", "[1]", '[{"name": "a"}]', "[" * 10**5])
def test_a_damaged_list_is_named(words):
    E = xr.Dataset(coords={"sensor": [0]}, attrs={"spaces": words})
    with pytest.raises(InputError, match="spaces"):
        sensors_by_space(E)


def test_the_darkest_space_is_first_also_where_sda_is_the_same():
    spaces = [
        {"name": name, "sDA": {"value": sda}, **({"DA": {"value": da}} if da else {})}
        for name, sda, da in (("a", 100.0, 94.0), ("b", 100.0, 90.0), ("c", 97.5, 99.0))
    ]
    assert [space["name"] for space in darkest_first(spaces)] == ["c", "b", "a"]
