"""Notes on weather that contradicts itself, and on stamps that are no year."""

from dataclasses import replace

import numpy as np
import pytest

from drcmitsuba.case.case import Case
from drcmitsuba.sky import weather
from drcmitsuba.sky.consistency import notes_on
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.sky.sun import sun_position

SITE = weather.Site("Town", 46.25, 6.13, 1.0, 416.0)


def year(site=SITE, shift=0, **changes):
    """The default year moved to a site, whose columns agree to rounding but for the changes."""
    w = replace(weather.default(), site=site)
    times = w.data["time"].values + np.timedelta64(shift, "m")
    cosine = np.maximum(sun_position(times, 1.0, site)["direction"].values[:, 2], 0)
    dni = np.where(cosine > 0, 400.0, 0.0)
    dhi = 200 * cosine
    columns = {"dni": dni, "dhi": dhi, "ghi": dhi + dni * cosine} | changes
    data = w.data.assign({name: ("time", values + 0 * dni) for name, values in columns.items()})
    return replace(w, data=data)


def test_a_year_that_agrees_with_itself_has_no_note():
    assert notes_on(year()) == ()
    assert notes_on(weather.default()) == ()


@pytest.mark.parametrize("minutes", [-60, -30, 30, 60])
def test_a_sun_that_stood_elsewhere_is_named_with_both_numbers(minutes):
    note = notes_on(year(shift=minutes))[0]  # maybe before one on light at night
    assert f"{abs(minutes)} min {'later' if minutes > 0 else 'earlier'} by 0" in note


def test_a_latitude_of_the_wrong_sign_is_named():
    south = replace(SITE, latitude=-46.25)
    note = notes_on(replace(year(), site=south))[0]
    assert "at latitude 46.25 by 0" in note


def test_a_column_that_is_scaled_or_lost_is_told():
    right = year().data
    assert notes_on(year(dni=2 * right.dni.values))[0].endswith("one of the three columns is wrong")
    assert "no direct irradiance in any row" in notes_on(year(dni=0.0))[0]
    assert "no diffuse irradiance in any row" in notes_on(year(dhi=0.0))[0]


def test_direct_light_at_night_is_told_with_its_share():
    right = year().data
    hour = right["time"].dt.hour.values
    dni = np.where(hour >= 22, 300.0, right.dni.values)
    night, day = 300 * 2 * 365 / 1000, right.dni.values.sum() / 1000
    assert notes_on(year(dni=dni)) == (
        f"{night:.0f} of {night + day:.0f} kWh/m² of direct light fall into hours without sun, and "
        "count nowhere",
    )


def test_global_irradiance_may_be_missing():
    assert notes_on(year(ghi=np.nan)) == ()


WEA = """place Geneva
latitude 46.25
longitude -6.13
time_zone -15.0
site_elevation 416.0
weather_data_file_units 1
"""


def of_stamps(tmp_path, *rows):
    path = tmp_path / "some.wea"
    path.write_text(WEA + "\n".join(rows) + "\n")
    case = Case.model_validate(
        {
            "room": {"size": [4.0, 5.0, 3.0]},
            "sensors": {"corner": [1, 1, 0.8], "count": [1, 1], "spacing": 1.0},
            "weather": {"file": str(path)},
            "period": {"days_per_week": 7},
        }
    )
    return daylight(case)


@pytest.mark.parametrize(
    ("hours", "moments"), [(("9.000", "15.000"), True), (("9.500", "15.500"), False)]
)
def test_single_stamps_are_moments_or_hours_and_none_is_lost(tmp_path, hours, moments):
    days = ("3 21", "9 21")
    light = of_stamps(tmp_path, *(f"{day} {hour} 600 120" for day in days for hour in hours))
    assert light.sky.sizes["time"] == 4
    assert light.step_hours == 1
    (note,) = [n for n in light.notes if "of the period's" in n]
    assert "4 of the period's 3650 hours" in note
    assert ("a moment each" in note) == moments


def test_hours_of_a_day_may_have_gaps(tmp_path):
    light = of_stamps(
        tmp_path, *(f"6 1 {hour} 500 100" for hour in ("8.5", "10.5", "11.5", "15.5"))
    )
    assert light.sky.sizes["time"] == 4
    assert light.step_hours == 1


def test_stamps_that_fill_their_days_keep_their_step(tmp_path):
    light = of_stamps(tmp_path, *(f"6 1 {hour}.5 500 100" for hour in range(0, 24, 3)))
    assert light.step_hours == 3
