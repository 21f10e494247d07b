"""Arrays that the page's script draws: exact counts, tiles, hours; bounded whatever the results."""

import json

import numpy as np
import pytest
import xarray as xr

from drcmitsuba.case.reading import load_case
from drcmitsuba.report.document import EvaluatedFacade, Report, hours, plans
from drcmitsuba.report.document.hours import Hours
from drcmitsuba.report.document.packing import unpacked

HALF = {"value": 50.0, "low": 40.0, "high": 60.0}


def facade(*, days=30, sensors=12, groups=True, spread=False):
    """Façade of the classroom with made illuminances, of whole days from 1 March."""
    rng = np.random.default_rng(3)
    time = np.datetime64("2015-03-01T00:00", "ns") + np.arange(24 * days) * np.timedelta64(1, "h")
    at = np.arange(sensors)
    x, y = (rng.random((2, sensors)) * 8) if spread else (1.0 + at % 4 * 0.5, 2.0 + at // 4 * 0.5)
    E = rng.lognormal(6, 1, (len(time), sensors)).astype(np.float32)
    sun = (E * (rng.random(E.shape) < 0.3)).astype(np.float32)
    coords = {
        "time": time, "x": ("sensor", x), "y": ("sensor", y),
        "z": ("sensor", np.full(sensors, 0.8)),
    }  # fmt: skip
    attributes = {"step_hours": 1.0, "has_shade": 1, "shade_threshold": 1e3, "shade_area": 0.02}
    if groups:
        states = [["open", "blind", "fabric"], ["open", "fabric"]]
        attributes["groups"] = json.dumps({"names": ["south", "east"], "states": states})
        taken = np.column_stack([rng.integers(0, 3, len(time)), rng.integers(0, 2, len(time))])
        coords["facade_state"] = (("time", "group"), taken.astype(np.float32))
    light = {"total": (("time", "sensor"), E), "direct_sun": (("time", "sensor"), sun)}
    numbers = dict.fromkeys(("sDA", "ASE", "shade_closed"), HALF)
    numbers |= {name: [HALF] * 12 for name in ("msDA", "MSE", "shade_closed_monthly")}
    numbers |= {"settings": {}, "undecided": [{"sensor": 5, "metric": "sDA", "probability": 0.25}]}
    case = load_case("classroom/existing")
    return EvaluatedFacade(case, xr.Dataset(light, coords, attributes), numbers, {}, [])


def test_counts_of_the_plans_are_those_of_the_illuminance():
    one = facade()
    t, E = one.case.metrics, one.illuminance
    shown = plans.shown_points(one)
    drawn = plans.plans(one, shown)
    np.testing.assert_array_equal(shown, np.arange(12))
    enough = (E["total"] >= t.sda_threshold).sum("time")
    np.testing.assert_array_equal(unpacked(drawn["enough"])[0], enough)
    in_sun = (E["direct_sun"] >= t.ase_threshold).sum("time")
    np.testing.assert_array_equal(unpacked(drawn["in_sun"])[0], in_sun)
    mean = E["total"].mean("time", dtype=float)
    np.testing.assert_allclose(unpacked(drawn["mean"])[0] / 10, mean, atol=0.05)
    p = unpacked(drawn["probability"]["sDA"])[0] / 10_000
    counts = enough.values >= drawn["needed"]
    np.testing.assert_array_equal(p, np.where(np.arange(12) == 5, 0.25, counts))
    assert drawn["needed"] == 24 * 30 / 2


def corners_of(one):
    """Corners of the tiles of a façade's points [m], (point, 4, 2), as the script has them."""
    drawn = plans.plans(one, plans.shown_points(one))
    at = np.column_stack([unpacked(drawn[axis]).ravel() for axis in "xy"])
    away = unpacked(drawn["tiles"]).T.reshape(-1, 4, 2)
    return (at[:, None] + away) / 1000


def test_tiles_of_a_grid_touch_and_other_points_are_diamonds():
    one = facade()
    corners = corners_of(one)
    np.testing.assert_allclose(corners[0], [[0.75, 1.75], [1.25, 1.75], [1.25, 2.25], [0.75, 2.25]])
    np.testing.assert_allclose(corners[1, 0], corners[0, 1])
    one = facade(spread=True)
    corners = corners_of(one)
    at = np.column_stack([one.illuminance[axis] for axis in "xy"])
    np.testing.assert_allclose(corners.mean(axis=1), at, atol=1e-3)


def test_more_points_than_a_page_holds_are_thinned():
    one = facade(sensors=13)
    shown = plans.shown_points(one, 6)
    np.testing.assert_array_equal(shown, np.arange(0, 13, 3))
    np.testing.assert_array_equal(unpacked(plans.plans(one, shown)["sensor"])[0], shown)


def test_outlines_are_bounded_and_those_of_the_room_come_first():
    one = facade()
    every = plans.plans(one, plans.shown_points(one))["sheets"][0]["outlines"]
    assert len(every["furniture"]) > 10
    few = plans.plans(one, plans.shown_points(one), 10)["sheets"][0]["outlines"]
    assert few["room"] == every["room"]
    assert sum(len(line) // 2 for kind in few.values() for line in kind) <= 10


def test_hours_hold_light_sun_and_states():
    one = facade()
    points = plans.shown_points(one)
    told = Hours(one, points).to_dict(10**6)
    E = one.illuminance
    number = unpacked(told["light"])
    lux = (1 + told["step"]) ** (number - 1.0)
    np.testing.assert_allclose(lux, E["total"], rtol=told["step"] / 2 + 1e-6)
    sun = np.unpackbits(unpacked(told["sun"]).astype(np.uint8), axis=1, bitorder="little")[:, :12]
    np.testing.assert_array_equal(sun, E["direct_sun"] >= one.case.metrics.ase_threshold)
    assert told["first"] == "2015-03-01T00:00"
    np.testing.assert_array_equal(unpacked(told["minutes"])[0], 60 * np.arange(24 * 30))
    states = [unpacked(group["state"])[0] for group in told["groups"]]
    np.testing.assert_array_equal(np.transpose(states), E["facade_state"])
    assert [group["states"] for group in told["groups"]] == [
        ["open", "blind", "fabric"],
        ["open", "fabric"],
    ]
    assert told["days"] == 1


def test_hours_that_do_not_fit_are_of_fewer_days(monkeypatch):
    one = facade(days=64)
    points = plans.shown_points(one)
    told = Hours(one, points).to_dict(6000)
    minutes = unpacked(told["minutes"])[0]
    assert told["days"] > 1
    np.testing.assert_array_equal(np.unique(minutes // 1440) % told["days"], 0)
    assert len(told["light"]["text"]) + len(told["sun"]["text"]) <= 6000
    assert Hours(one, points).to_dict(10) is None
    monkeypatch.setattr(hours, "MOST_VALUES", 24 * 12 * 4)
    assert unpacked(Hours(one, points).to_dict(10**6)["light"]).size <= 24 * 12 * 4


def test_groups_without_their_states_are_refused_and_a_single_shade_is_told():
    one = facade()
    without = EvaluatedFacade(
        one.case, one.illuminance.drop_vars("facade_state"), one.numbers, {}, []
    )
    assert Hours(without, np.arange(12)).to_dict(10**6)["groups"] == []
    one = facade(groups=False)
    closed = np.arange(one.illuminance.sizes["time"]) % 3 == 0
    E = one.illuminance.assign_coords(shade_closed=("time", closed))
    (group,) = Hours(EvaluatedFacade(one.case, E, one.numbers, {}, []), np.arange(12)).to_dict(
        10**6
    )["groups"]
    assert (group["name"], group["states"]) == ("shade", ["open", "shaded"])
    np.testing.assert_array_equal(unpacked(group["state"])[0], closed)


@pytest.mark.parametrize("count", [1, 2, 12])
def test_the_page_of_many_facades_stays_small(count):
    report = Report([facade(days=365, sensors=100)] * count)
    assert len(report.html().encode()) < 2_000_000
    assert len(set(report.names)) == count
