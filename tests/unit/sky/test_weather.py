"""Readers: every format ends in the same clock, and what is damaged is refused in one line."""

from pathlib import Path

import numpy as np
import pandas as pd
import pvlib
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky import weather
from tests import SHARED, skips

SHARED = SHARED / "data" / "weather"
PVLIB = Path(pvlib.__file__).parent / "data"
HOURS = pd.date_range("2015-01-01", "2015-12-31 23:00", freq="h")
LEAP_HOURS = pd.date_range("2016-01-01", "2016-12-31 23:00", freq="h")
LOCATION = "LOCATION,Town,-,XXX,made,000000,46.25,6.13,1.0,416.0"


def shared(name):
    path = skips.data(SHARED / name)
    return weather.read(path)


def dni_of(hour):
    """A value that tells its hour: month and hour of the day, a hundred for the day's parity."""
    return hour.month * 24 + hour.hour + 400 * (hour.day % 2)


def epw_row(hour, year=1999):
    stamp = f"{year},{hour.month},{hour.day},{hour.hour + 1},60,?9?9"
    rest = ",".join("0" * 19)
    return f"{stamp},20.0,7.5,50,98100,0,0,300,{dni_of(hour)},{dni_of(hour)},5,{rest}"


def epw(hours=HOURS, location=LOCATION, comment="COMMENTS 1,none"):
    head = [location, "DESIGN CONDITIONS,0", "TYPICAL/EXTREME PERIODS,0", "GROUND TEMPERATURES,0"]
    head += ["HOLIDAYS/DAYLIGHT SAVINGS,No,0,0,0", comment, "COMMENTS 2,"]
    head += ["DATA PERIODS,1,1,Data,Sunday,1/1,12/31"]
    return head + [epw_row(hour) for hour in hours]


def tmy3(hours=HOURS, midnight="24:00"):
    columns = "Date (MM/DD/YYYY),Time (HH:MM),GHI (W/m^2),DNI (W/m^2),DHI (W/m^2),Dew-point (C)"
    rows = ['723170,"TOWN, SOMEWHERE",NC,-5.5,36.100,-79.950,273', columns]
    for hour in hours:
        day = hour if midnight == "24:00" else hour + pd.Timedelta("1h")
        end = f"{hour.hour + 1:02}:00" if hour.hour < 23 else midnight
        year = 1996 if hour.month == 2 else 1980 + hour.month  # a leap February, then another year
        rows.append(f"{day:%m/%d}/{year},{end},{dni_of(hour)},{dni_of(hour)},5,-9900")
    return rows


def wea(*rows, **changes):
    head = {
        "place": "Some Town",
        "latitude": "37.62",
        "longitude": "122.40",
        "time_zone": "112.5",
        "site_elevation": "2.0",
        "weather_data_file_units": "1",
    }
    head |= changes
    return [f"{key} {value}" for key, value in head.items() if value is not None] + list(rows)


def write(folder, suffix, content):
    path = folder / f"made{suffix}"
    if not isinstance(content, bytes):
        content = ("\n".join(content) + "\n").encode("latin-1")
    path.write_bytes(content)
    return path


def refused(folder, suffix, content):
    path = write(folder, suffix, content)
    with pytest.raises(InputError) as caught:
        weather.read(path)
    assert caught.value.source == str(path)
    assert "\n" not in str(caught.value)
    return caught.value


# ---- what each file means ---------------------------------------------------------------------


def test_an_epw_hour_starts_one_before_its_label(tmp_path):
    read = weather.read(write(tmp_path, ".epw", epw()))
    np.testing.assert_array_equal(read.data.time, HOURS.to_numpy())
    np.testing.assert_array_equal(read.data.dni, [dni_of(hour) for hour in HOURS])
    assert read.site == weather.Site("Town", 46.25, 6.13, 1.0, 416.0)
    assert (read.step, read.notes, read.data.attrs["sun_time"]) == (1.0, (), "middle")
    assert set(read.data.dew_point.values) == {7.5}
    assert {name: array.dtype for name, array in read.data.data_vars.items()} == dict.fromkeys(
        ("dni", "dhi", "ghi", "dew_point"), np.dtype(float)
    )


@pytest.mark.parametrize("midnight", ["24:00", "00:00"])
def test_a_tmy3_hour_is_labelled_by_its_end(tmp_path, midnight):
    read = weather.read(write(tmp_path, ".CSV", tmy3(midnight=midnight)))
    np.testing.assert_array_equal(read.data.time, HOURS.to_numpy())
    np.testing.assert_array_equal(read.data.dni, [dni_of(hour) for hour in HOURS])
    assert read.site == weather.Site("TOWN, SOMEWHERE", 36.1, -79.95, -5.5, 273.0)
    assert np.isnan(read.data.dew_point).all()
    assert read.notes == ("no dew point in 8760 of 8760 rows",)


def test_an_hourly_wea_is_labelled_by_its_middle(tmp_path):
    read = weather.read(write(tmp_path, ".wea", wea("6 1 9.500 10 20", "6 1 10.500 30 40")))
    starts = np.array(["2015-06-01T09:00", "2015-06-01T10:00"], dtype="datetime64[ns]")
    np.testing.assert_array_equal(read.data.time, starts)
    assert read.site == weather.Site("Some Town", 37.62, -122.4, -7.5, 2.0)
    assert (read.step, read.data.attrs["sun_time"]) == (1.0, "middle")
    assert read.data.dni.values.tolist() == [10, 30]
    assert read.data.dhi.values.tolist() == [20, 40]
    assert np.isnan(read.data.ghi).all()
    assert np.isnan(read.data.dew_point).all()


@pytest.mark.parametrize("stamps", [("9.17", "9.33", "9.5"), ("9.167", "9.333", "9.500")])
def test_a_finer_wea_stamps_the_suns_instant(tmp_path, stamps):
    # Stamps of a second day need not follow at once.
    rows = [f"6 1 {stamp} 1 2" for stamp in stamps] + ["6 7 12.0 1 2"]
    read = weather.read(write(tmp_path, ".wea", wea(*rows)))
    times = ["2015-06-01T09:10", "2015-06-01T09:20", "2015-06-01T09:30", "2015-06-07T12:00"]
    np.testing.assert_array_equal(read.data.time, np.array(times, dtype="datetime64[ns]"))
    assert read.step == pytest.approx(1 / 6)
    assert read.data.attrs["sun_time"] == "instant"


def test_hourly_stamps_on_the_hour_are_instants(tmp_path):
    read = weather.read(write(tmp_path, ".wea", wea("1 1 0 0 0", "1 1 1 0 1")))
    assert read.data.time.values[0] == np.datetime64("2015-01-01T00:00")
    assert (read.step, read.data.attrs["sun_time"]) == (1.0, "instant")


def test_29_february_is_dropped_with_a_note(tmp_path):
    for suffix, content in [(".epw", epw(LEAP_HOURS)), (".csv", tmy3(LEAP_HOURS))]:
        read = weather.read(write(tmp_path, suffix, content))
        np.testing.assert_array_equal(read.data.time, HOURS.to_numpy())
        np.testing.assert_array_equal(read.data.dni, [dni_of(hour) for hour in HOURS])
        assert any("29 February dropped (24 rows)" in note for note in read.notes)
    read = weather.read(write(tmp_path, ".wea", wea("2 28 12.5 1 1", "2 29 12.5 9 9")))
    assert read.data.dni.values.tolist() == [1]
    assert any("29 February dropped (1 rows)" in note for note in read.notes)


def test_head_lines_that_mislead_pvlib(tmp_path):
    content = epw(location=LOCATION.replace("Town", '"Köln, Süd"'), comment='COMMENTS 1,"open')
    content[8:] = [row + ",36th," for row in content[8:]]
    read = weather.read(write(tmp_path, ".epw", b"\r\n".join(x.encode("cp1252") for x in content)))
    assert read.site.name == "Köln, Süd"
    assert read.site.latitude == 46.25
    np.testing.assert_array_equal(read.data.dni, [dni_of(hour) for hour in HOURS])


def test_columns_of_mixed_type_do_not_matter(tmp_path):
    content = epw()
    for i in range(8, 8768, 2):
        fields = content[i].split(",")
        fields[16:19] = ["none", "", "999900"]
        content[i] = ",".join(fields)
    assert weather.read(write(tmp_path, ".epw", content)).data.dhi.mean() == 5


def test_a_missing_dew_point_is_nan_with_a_note(tmp_path):
    content = epw()
    content[10] = content[10].replace("20.0,7.5", "20.0,99.9")
    read = weather.read(write(tmp_path, ".epw", content))
    assert np.flatnonzero(np.isnan(read.data.dew_point)).tolist() == [2]
    assert read.notes == ("no dew point in 1 of 8760 rows",)


def test_a_longitude_of_the_wrong_sign_is_noted(tmp_path):
    read = weather.read(write(tmp_path, ".wea", wea("6 1 9.5 1 1", longitude="-122.4")))
    assert "check their signs" in read.notes[0]
    east_of_the_date_line = wea("6 1 9.5 1 1", longitude="157", time_zone="-210")
    assert weather.read(write(tmp_path, ".wea", east_of_the_date_line)).notes == ()


def test_no_irradiance_is_noted(tmp_path):
    read = weather.read(write(tmp_path, ".wea", wea("6 1 9.5 0 0")))
    assert read.notes == ("no irradiance in any row",)


# ---- real files -------------------------------------------------------------------------------


def raw_epw(name, column):
    """The column as csv alone sees it."""
    lines = (SHARED / name).read_bytes().decode("latin-1").splitlines()[8:]
    rows = [line.split(",") for line in lines]
    return [float(row[column]) for row in rows if (int(row[1]), int(row[2])) != (2, 29)]


@pytest.mark.parametrize(
    ("name", "latitude", "longitude", "timezone"),
    [
        ("CHE_Geneva.067000_IWEC.epw", 46.25, 6.13, 1.0),
        ("Singapore-Changi_1990_2010_TMY.epw", 1.367, 103.983, 8.0),
        ("USA_AK_Barrow.700260_TMY3.epw", 71.286, -156.767, -9.0),
        ("denver.epw", 39.76, -104.86, -7.0),
        ("los_angeles_no_leap_field.epw", 34.212, -118.491, -8.0),
        ("mannheim.epw", 49.52, 8.55, 1.0),
    ],
)
def test_every_shared_epw_reads(name, latitude, longitude, timezone):
    read = shared(name)
    site = read.site
    assert (site.latitude, site.longitude, site.timezone) == (latitude, longitude, timezone)
    np.testing.assert_array_equal(read.data.time, HOURS.to_numpy())
    for variable, column in [("ghi", 13), ("dni", 14), ("dhi", 15), ("dew_point", 7)]:
        np.testing.assert_array_equal(read.data[variable], raw_epw(name, column))


def test_los_angeles_loses_only_29_february():
    assert shared("los_angeles_no_leap_field.epw").notes == (
        "29 February dropped (24 rows): the year has 365 days",
    )


def test_the_day_is_centred_on_solar_noon():
    """Mean time of Geneva's global irradiance, hours weighted at their middle, is solar noon.

    Longitude 6.13° in zone +1 puts mean solar noon at 12:35; the weather of mornings and
    afternoons and the equation of time leave a few minutes. An hour off would be seen.
    """
    data = shared("CHE_Geneva.067000_IWEC.epw").data
    middle = data.time.dt.hour + 0.5
    noon = float((data.ghi * middle).sum() / data.ghi.sum())
    assert noon == pytest.approx(12 + 1 - 6.13 / 15, abs=0.2)


def test_barrow_has_a_polar_night():
    dark = shared("USA_AK_Barrow.700260_TMY3.epw").data.sel(time="2015-12")
    assert float(dark.ghi.max()) == 0.0


def test_san_francisco_every_ten_minutes():
    read = shared("san_francisco_10min.wea")
    times = np.arange("2015-01-01", "2016-01-01", np.timedelta64(10, "m"), "datetime64[m]")
    np.testing.assert_array_equal(read.data.time, times.astype("datetime64[ns]"))
    assert read.site == weather.Site("San Francisco Intl Ap", 37.62, -122.4, -8.0, 2.0)
    assert read.step == pytest.approx(1 / 6)
    assert read.data.attrs["sun_time"] == "instant"
    assert float(read.data.dni.sel(time="2015-01-01T07:40")) == 137.0
    assert read.notes == ()


def test_the_default_is_greensboro():
    read = weather.default()
    assert read.site == weather.Site("GREENSBORO PIEDMONT TRIAD INT", 36.1, -79.95, -5.0, 273.0)
    np.testing.assert_array_equal(read.data.time, HOURS.to_numpy())
    raw = pd.read_csv(PVLIB / "723170TYA.CSV", skiprows=1)
    np.testing.assert_array_equal(read.data.dni, raw["DNI (W/m^2)"])
    assert read.notes == ()


def test_a_tmy2_reads():
    read = weather.read(PVLIB / "12839.tm2")
    rows = (PVLIB / "12839.tm2").read_text().splitlines()[1:]
    np.testing.assert_array_equal(read.data.time, HOURS.to_numpy())
    np.testing.assert_array_equal(read.data.ghi, [float(row[17:21]) for row in rows])
    np.testing.assert_array_equal(read.data.dni, [float(row[23:27]) for row in rows])
    np.testing.assert_array_equal(read.data.dhi, [float(row[29:33]) for row in rows])
    assert read.site == weather.Site("MIAMI", 25.8, -(80 + 16 / 60), -5.0, 2.0)
    assert read.data.dew_point.values[0] == 15.0  # 150A7


def test_a_tmy2_city_may_have_spaces(tmp_path):
    text = (PVLIB / "12839.tm2").read_text().replace("MIAMI      ", "MIAMI BEACH")
    read = weather.read(write(tmp_path, ".tm2", text.encode()))
    assert (read.site.name, read.site.latitude) == ("MIAMI BEACH", 25.8)


# ---- what is refused --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("column", "value", "what"),
    [
        (14, "9999", "missing"),
        (15, "-9900", "missing"),
        (15, "-1", "negative"),
        (14, "1501", "implausible"),
        (14, "sun", "not a number"),
        (14, "1_0", "not a number"),
        (14, "", "not a number"),
        (15, "nan", "not a number"),
    ],
)
def test_a_bad_irradiance_names_row_and_value(tmp_path, column, value, what):
    content = epw()
    for line in (101, 201):  # counted from one, as an editor does
        fields = content[line - 1].split(",")
        fields[column] = value
        content[line - 1] = ",".join(fields)
    error = refused(tmp_path, ".epw", content)
    assert error.field == f"line 101, {['dni', 'dhi'][column - 14]}"
    assert what in error.got
    assert "rows like it: 2" in error.got
    assert value in error.got or not value


@pytest.mark.parametrize("value", ["999999", "2500", "inf", "", "-1"])
def test_global_irradiance_may_be_missing_since_nothing_needs_it(tmp_path, value):
    content = epw()
    fields = content[100].split(",")
    fields[13] = value
    content[100] = ",".join(fields)
    ghi = weather.read(write(tmp_path, ".epw", content)).data["ghi"].values
    assert np.isnan(ghi[92])
    assert np.isnan(ghi).sum() == 1


def test_a_dew_point_of_text_is_refused(tmp_path):
    content = epw()
    content[10] = content[10].replace("20.0,7.5", "20.0,wet")
    assert refused(tmp_path, ".epw", content).field == "line 11, dew point"


@pytest.mark.parametrize("made", [epw, tmy3])
def test_incomplete_years_are_refused(tmp_path, made):
    content, suffix = made(), ".epw" if made is epw else ".csv"
    head = 8 if made is epw else 2
    error = refused(tmp_path, suffix, content[:5000])
    assert error.field == "rows"
    assert f"{5000 - head} hours" in error.got
    for gone in (100, 1000, head + 58 * 24 + 23):  # the last is the hour before 28 February ends
        error = refused(tmp_path, suffix, content[:gone] + content[gone + 1 :])
        assert error.field == f"line {gone + 1}"
    twice = content[:1000] + content[999:]
    assert refused(tmp_path, suffix, twice).field == "line 1001"
    assert refused(tmp_path, suffix, content + content[head:]).field == "rows"
    assert refused(tmp_path, suffix, content[:head]).field == "rows"


@pytest.mark.parametrize("made", [epw, tmy3])
@pytest.mark.parametrize("end", [head_rows * 60 for head_rows in (1, 3, 10)])
def test_a_cut_last_row_is_refused(tmp_path, made, end):
    content, suffix = made(), ".epw" if made is epw else ".csv"
    content[-1] = content[-1][: min(end, len(content[-1])) // 2]
    assert refused(tmp_path, suffix, content).field.startswith("line 87")


@pytest.mark.parametrize("end", [100, 3000, 700_000, -1000, -40])
def test_a_cut_tmy2_is_refused(tmp_path, end):
    refused(tmp_path, ".tm2", (PVLIB / "12839.tm2").read_bytes()[:end])


@pytest.mark.parametrize(
    "date", ["1999,13,2,5", "1999,1,32,5", "1999,1,2,25", "1999,1,2,0", "1999,a,2,5", "1999,,2,5"]
)
def test_a_bad_date_names_its_line(tmp_path, date):
    content = epw()
    assert content[36].startswith("1999,1,2,5,")
    content[36] = content[36].replace("1999,1,2,5", date, 1)
    assert refused(tmp_path, ".epw", content).field.startswith("line 37")


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("46.25", "91", "latitude"),
        ("46.25", "north", "latitude"),
        ("46.25", "nan", "latitude"),
        ("6.13", "-181", "longitude"),
        ("1.0,", "15,", "time zone"),
        ("1.0,", ",", "time zone"),
        ("416.0", "inf", "elevation"),
        ("LOCATION", "PLACE", "header"),
        (",1.0,416.0", "", "header"),
    ],
)
def test_a_bad_site_is_named(tmp_path, old, new, field):
    content = epw(HOURS[:24], LOCATION.replace(old, new))
    assert refused(tmp_path, ".epw", content).field == field


def test_quarter_hourly_epw_is_refused(tmp_path):
    content = epw()
    content[7] = "DATA PERIODS,1,4,Data,Sunday,1/1,12/31"
    assert refused(tmp_path, ".epw", content).field == "line 8"


def test_a_csv_that_is_no_tmy3_is_refused(tmp_path):
    assert refused(tmp_path, ".csv", ["time,dni", "2015-01-01,5"]).field == "header"
    assert refused(tmp_path, ".csv", ["time"]).field == "header"
    lacking = [line.replace("DNI (W/m^2)", "DNI") for line in tmy3(HOURS[:24])]
    assert "DNI (W/m^2)" in refused(tmp_path, ".csv", lacking).got


@pytest.mark.parametrize(
    ("content", "field"),
    [
        (wea("6 1 9.5 1 1", weather_data_file_units="2"), "weather_data_file_units"),
        (wea("6 1 9.5 1 1", latitude=None), "header"),
        (wea("6 1 9.5 1 1", humidity="3"), "header"),
        (wea("6 1 9.5 1 1", latitude="-91"), "latitude"),
        (wea("6 1 9.5 1 1", longitude="181"), "longitude (degrees west)"),
        (wea("6 1 9.5 1 1", time_zone="-8 h"), "time_zone (degrees west)"),
        (wea(), "rows"),
        (wea("6 1 9.5 1"), "line 7"),
        (wea("6 1 9.5 1 1", "6 1 10.5 1"), "line 8"),
        (wea("6 1 9.5 1 1", "6 31 10.5 1 1"), "line 8, date"),
        (wea("6 1 9.5 1 1", "6 1 24 1 1"), "line 8, hour"),
        (wea("6 1 9.5 1 1", "6 1 1e308 1 1"), "line 8, hour"),
        (wea("6 1 9.5 1 1", "6 1 nan 1 1"), "line 8, hour"),
        (wea("6 1 9.5 1 1", "6 1 ten 1 1"), "line 8, hour"),
        (wea("6 1 9.508 1 1"), "line 7, hour"),
        (wea("6 1 9.5 1 1", "6 1 9.5 1 1"), "line 8"),
        (wea("6 1 9.5 1 1", "6 1 8.5 1 1"), "line 8"),
        (wea("12 31 9.5 1 1", "1 1 9.5 1 1"), "line 8"),
        (wea("6 1 9 1 1", "6 1 9.5 1 1", "6 1 12.5 1 1"), "line 9"),
        (wea("6 1 9.5 1 1", "6 1 10.5 9999 1"), "line 8, dni"),
        (wea("6 1 9.5 1 1", "6 1 10.5 1 -3"), "line 8, dhi"),
        (wea("6 1 9.5 1 1", "6 1 10.5 1 x"), "line 8, dhi"),
    ],
)
def test_a_bad_wea_is_refused(tmp_path, content, field):
    assert refused(tmp_path, ".wea", content).field == field


def test_files_that_are_none(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        weather.read(tmp_path / "none.epw")
    with pytest.raises(InputError, match="no such file"):
        weather.read("http://localhost/weather.epw")
    folder = tmp_path / "folder.epw"
    folder.mkdir()
    with pytest.raises(InputError, match="no such file"):
        weather.read(folder)
    assert refused(tmp_path, ".txt", epw(HOURS[:24])).field == "suffix"
    huge = tmp_path / "huge.wea"
    with huge.open("wb") as file:
        file.write(b"place x\n")
        file.truncate(80 * 2**20)
    with pytest.raises(InputError, match="more than 32 MiB"):
        weather.read(huge)
    assert "lines" in refused(tmp_path, ".wea", b"1\n" * 700_000).got


@pytest.mark.parametrize("suffix", [".epw", ".csv", ".tm2", ".wea"])
def test_empty_and_binary_files(tmp_path, suffix):
    noise = np.random.default_rng(1).integers(0, 256, 5000, dtype=np.uint8)
    assert refused(tmp_path, suffix, b"").got == "empty"
    assert refused(tmp_path, suffix, b" \r\n\r\n").got == "empty"
    assert "binary" in refused(tmp_path, suffix, noise.tobytes()).got
    refused(tmp_path, suffix, noise[noise > 0].tobytes())
    refused(tmp_path, suffix, b"," * 200_000)
    refused(tmp_path, suffix, b'"' * 200_000)


@settings(
    max_examples=200,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    suffix=st.sampled_from([".epw", ".csv", ".tm2", ".wea"]),
    at=st.integers(0, 400),
    length=st.integers(0, 20),
    noise=st.binary(max_size=12),
)
@example(suffix=".wea", at=0, length=0, noise=b"")
def test_damage_is_refused_or_harmless(tmp_path, suffix, at, length, noise):
    """Bytes of a short file are replaced: it reads as finite irradiance or is refused."""
    made = {
        ".epw": epw(HOURS[:24]),
        ".csv": tmy3(HOURS[:24]),
        ".tm2": (PVLIB / "12839.tm2").read_text().splitlines()[:4],
        ".wea": wea(*(f"6 {day} {hour}.5 100 50" for day in (1, 2) for hour in range(9, 17))),
    }[suffix]
    whole = "\n".join(made).encode()
    path = write(tmp_path, suffix, whole[:at] + noise + whole[at + length :])
    try:
        read = weather.read(path)
    except InputError:
        return
    assert np.isfinite(read.data.dni).all()
    assert (np.diff(read.data.time) > np.timedelta64(0, "ns")).all()
