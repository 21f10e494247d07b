"""Periods whose hours can be counted by eye in a calendar of 2015 (1 January is a Thursday)."""

import dataclasses

import numpy as np
import pytest

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky.period import EVALDRC, LM83, Period, read_timestamps

YEAR = np.arange("2015-01-01", "2016-01-01", dtype="datetime64[h]").astype("datetime64[ns]")


def hours(time):
    return (time - time.astype("datetime64[D]")) / np.timedelta64(1, "h")


def test_evaldrc_has_261_weekdays_of_ten_hours():
    time, clock = EVALDRC.select(YEAR, 1.0)
    assert len(time) == 2610
    np.testing.assert_array_equal(time, clock)
    assert time[0] == np.datetime64("2015-01-01T08:00")
    assert time[-1] == np.datetime64("2015-12-31T17:00")
    assert np.datetime64("2015-01-02T17:00") in time  # Friday
    assert np.datetime64("2015-01-03T12:00") not in time  # Saturday
    assert np.datetime64("2015-01-04T12:00") not in time  # Sunday
    assert np.datetime64("2015-01-05T12:00") in time  # Monday


def test_lm83_has_365_days_of_ten_hours():
    assert len(LM83.select(YEAR, 1.0)[0]) == 3650


@pytest.mark.parametrize(("days", "count"), [(1, 52), (3, 156), (4, 209), (6, 313), (7, 365)])
def test_days_per_week_count_from_monday(days, count):
    # 2015 has 53 Thursdays and 52 of every other weekday.
    assert len(Period(days_per_week=days, hours=(12, 13)).select(YEAR, 1.0)[0]) == count


def test_daylight_saving_moves_the_clock_one_hour_ahead():
    period = Period(days_per_week=7, daylight_saving=("03-29", "10-25"))
    time, clock = period.select(YEAR, 1.0)
    assert len(time) == 3650
    assert set(hours(clock)) == set(range(8, 18))
    day = time.astype("datetime64[D]")
    winter, summer = set(range(8, 18)), set(range(7, 17))
    for date, expected in [
        ("2015-03-28", winter),
        ("2015-03-29", summer),  # the first day, inclusive
        ("2015-10-24", summer),
        ("2015-10-25", winter),  # the last day, exclusive
    ]:
        here = day == np.datetime64(date)
        assert set(hours(time[here])) == expected
        offset = clock[here] - time[here]
        assert set(offset) == {np.timedelta64(3600 * (expected == summer), "s")}


def test_southern_daylight_saving_crosses_the_turn_of_the_year():
    period = Period(days_per_week=7, daylight_saving=("10-04", "04-05"))
    time, clock = period.select(YEAR, 1.0)
    ahead = (clock - time) == np.timedelta64(3600, "s")
    months = time.astype("datetime64[M]").astype(int) % 12 + 1
    assert ahead[np.isin(months, (1, 2, 3, 11, 12))].all()
    assert not ahead[np.isin(months, (5, 6, 7, 8, 9))].any()


def test_the_weekday_is_the_clocks():
    # Sunday 5 July 23:00 standard time is Monday 6 July 0:00 on the clock.
    period = Period(days_per_week=1, hours=(0, 1), daylight_saving=("03-29", "10-25"))
    time, clock = period.select(YEAR, 1.0)
    here = time == np.datetime64("2015-07-05T23:00")
    assert here.sum() == 1
    assert clock[here][0] == np.datetime64("2015-07-06T00:00")


def test_months_select_january_and_december():
    time, _ = Period(months=(1, 12), days_per_week=7).select(YEAR, 1.0)
    assert len(time) == 620
    assert set(time.astype("datetime64[M]").astype(str)) == {"2015-01", "2015-12"}


@pytest.mark.parametrize("minutes", [1, 10, 15, 20, 30])
def test_a_finer_step_covers_the_same_time(minutes):
    time = np.arange("2015-06-01", "2015-06-15", np.timedelta64(minutes, "m"), "datetime64[s]")
    kept, _ = EVALDRC.select(time, minutes / 60)
    assert len(kept) * minutes == 10 * 10 * 60  # ten weekdays of ten hours
    assert kept[0] == np.datetime64("2015-06-01T08:00")
    assert kept[-1] + np.timedelta64(minutes, "m") == np.datetime64("2015-06-12T18:00")


def test_an_interval_belongs_where_its_middle_lies():
    day = YEAR[:24]
    kept, _ = Period(hours=(8.5, 17.5)).select(day, 1.0)
    assert hours(kept).tolist() == list(range(8, 17))


def test_lists_become_tuples_and_the_period_stays_frozen():
    period = Period(months=[6], hours=[9, 17], daylight_saving=["03-29", "10-25"])
    assert period == Period(months=(6,), hours=(9, 17), daylight_saving=("03-29", "10-25"))
    assert len({period, period}) == 1
    with pytest.raises(dataclasses.FrozenInstanceError):
        period.days_per_week = 7


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("months", ()),
        ("months", (0,)),
        ("months", (13,)),
        ("months", (1, 1)),
        ("months", (1.5,)),
        ("months", (True,)),
        ("months", "June"),
        ("months", 6),
        ("hours", (18, 8)),
        ("hours", (8, 8)),
        ("hours", (-1, 8)),
        ("hours", (8, 25)),
        ("hours", (8, float("nan"))),
        ("hours", (8,)),
        ("hours", ("8", "18")),
        ("days_per_week", 0),
        ("days_per_week", 8),
        ("days_per_week", True),
        ("days_per_week", 5.5),
        ("daylight_saving", ("03-29",)),
        ("daylight_saving", ("3-29", "10-25")),
        ("daylight_saving", ("02-29", "10-25")),
        ("daylight_saving", ("03-29", "13-01")),
        ("daylight_saving", ("03-29", "03-29")),
        ("daylight_saving", "03-29"),
        ("daylight_saving", (329, 1025)),
        ("daylight_saving", 5),
    ],
)
def test_a_bad_field_is_named(field, value):
    with pytest.raises(InputError) as caught:
        Period(**{field: value})
    assert (caught.value.source, caught.value.field) == ("period", field)


def test_nothing_left_is_an_error():
    night = np.array(["2015-06-01T03:00"], dtype="datetime64[s]")
    with pytest.raises(InputError, match="none of 1 time stamps"):
        EVALDRC.select(night, 1.0)
    with pytest.raises(InputError, match="none of 0 time stamps"):
        EVALDRC.select(night[:0], 1.0)


@pytest.mark.parametrize("step", [0.0, -1.0, float("nan"), float("inf"), 25.0])
def test_a_bad_step_is_named(step):
    with pytest.raises(InputError) as caught:
        EVALDRC.select(YEAR, step)
    assert caught.value.field == "step"


def timestamps(folder, text):
    path = folder / "times.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return read_timestamps(path)


def test_timestamps_map_to_the_nominal_year(tmp_path):
    text = "\ufefftime\r\n2014-01-05T10:00\r\n2015-03-21 10:00:30\r\n2011-12-31T23:30\r\n\r\n"
    time = timestamps(tmp_path, text)
    expected = ["2015-01-05T10:00", "2015-03-21T10:00:30", "2015-12-31T23:30"]
    np.testing.assert_array_equal(time, np.array(expected, dtype="datetime64[ns]"))
    assert time.dtype == np.dtype("datetime64[ns]")


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("date\n2015-03-21T10:00\n", "line 1"),
        ("time,dni\n2015-03-21T10:00,3\n", "line 1"),
        ("2015-03-21T10:00\n", "line 1"),
        ("time\n", "time"),
        ("time\n2015-03-21T10:00\nnoon\n", "line 3, time"),
        ("time\n\n2015-03-21T10:00,5\n", "line 3, time"),
        ("time\n2015-03-21\n", "line 2, time"),
        ("time\n2015-03-21T10:00Z\n", "line 2, time"),
        ("time\n2015-03-21T10:00+01:00\n", "line 2, time"),
        ("time\n2015-03-21T24:00\n", "line 2, time"),
        ("time\n2015-02-30T10:00\n", "line 2, time"),
        ("time\n2016-02-29T10:00\n", "line 2, time"),
        ("time\n2015-03-21T10:00\n2015-03-21T10:00\n", "line 3, time"),
        ("time\n2015-03-21T10:00\n2015-03-20T10:00\n", "line 3, time"),
        ("time\n2015-03-21T10:00:10\n2015-03-21T10:00:40\n", "line 3, time"),
        ("time\n2014-12-31T10:00\n2015-01-01T10:00\n", "line 3, time"),
        ("", "file"),
        (b"time\0", "file"),
        (b"\xff\xfe\x93\x10\n", "line 1"),
    ],
)
def test_bad_timestamps_name_their_line(tmp_path, text, field):
    with pytest.raises(InputError) as caught:
        timestamps(tmp_path, text)
    assert caught.value.field == field
    assert caught.value.source.endswith("times.csv")
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_timestamps(tmp_path / "none.csv")
