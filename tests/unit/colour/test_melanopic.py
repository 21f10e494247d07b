"""Mornings with enough light, and verdicts from their share."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from drcmitsuba.colour.melanopic import RULES, _verdict, mornings


def hours(first: int, last: int, days: int = 2) -> xr.DataArray:
    each = [np.datetime64("2015-03-01") + np.timedelta64(24 * d + h, "h")
            for d in range(days) for h in range(first, last)]  # fmt: skip
    return xr.DataArray(np.array(each, "datetime64[ns]"), dims="time")


@pytest.mark.parametrize(
    ("lit", "share"),
    [
        ({9, 10, 11, 12}, 50.0),
        ({12, 13, 14, 15}, 50.0),  # begins at noon
        ({13, 14, 15, 16, 17}, 0.0),  # begins later
        ({9, 10, 12, 13, 14}, 0.0),  # a dark hour between
        ({9, 10, 11}, 0.0),  # too short
        (set(), 0.0),
    ],
)
def test_four_hours_on_end_that_begin_by_noon_count(lit, share):
    clock = hours(8, 18)
    of_day = [h in lit for h in range(8, 18)]
    assert mornings(np.array(of_day + 10 * [False]), clock, 1.0) == share


def test_a_gap_between_time_stamps_ends_a_run():
    clock = hours(8, 18).isel(time=[0, 1, 4, 5, 10, 11, 12, 13])
    assert mornings(np.ones(8, bool), clock, 1.0) == 50.0


def test_quarters_of_an_hour_count_as_such():
    clock = hours(8, 18, 1)
    fine = (clock.values[:, None] + np.arange(4) * np.timedelta64(15, "m")).ravel()
    enough = np.zeros(40, bool)
    enough[3:19] = True
    assert mornings(enough, xr.DataArray(fine, dims="time"), 0.25) == 100.0
    enough[18] = False
    assert mornings(enough, xr.DataArray(fine, dims="time"), 0.25) == 0.0


@pytest.mark.parametrize(
    ("low", "high", "met"), [(100, 100, "yes"), (99, 100, "open"), (40, 99.9, "no")]
)
def test_a_rule_is_open_where_its_interval_holds_both(low, high, met):
    days = {"value": low, "low": low, "high": high}
    assert _verdict(RULES[0], days)["met"] == met
