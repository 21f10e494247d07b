"""Daylight of a case: remarks on its period."""

import pytest

from drcmitsuba.case.case import Case
from drcmitsuba.model.model import Location, Model
from drcmitsuba.sky.daylight import daylight, place_notes
from drcmitsuba.sky.weather import Site


def notes_of(**period):
    sensors = {"corner": (0, 0, 1), "count": (2, 2)}
    return daylight(Case.model_validate({"sensors": sensors, "period": period})).notes[1:]


def test_a_year_by_day_needs_no_remark():
    assert notes_of() == ()


def test_a_part_of_the_year_is_remarked_upon():
    (note,) = notes_of(months=[6, 7])
    assert note == (
        "the period is 450 h in 2 of 12 months, no year: the 250 h of ASE are not scaled to it"
    )


@pytest.mark.parametrize(("hours", "dark"), [((20, 24), True), ((8, 18), False)])
def test_hours_without_daylight_are_remarked_upon(hours, dark):
    noted = [note for note in notes_of(hours=hours) if "have no daylight" in note]
    assert bool(noted) == dark


def test_own_time_stamps_are_no_year(tmp_path):
    (tmp_path / "stamps.csv").write_text("time\n2015-06-21T12:00\n2015-06-21T23:00\n")
    year, dark = notes_of(timestamps=tmp_path / "stamps.csv")
    assert year.startswith("the period is 2 time stamps of 60 min each, no year")
    assert dark == "1 of 2 time stamps have no daylight; sDA and msDA count them"


@pytest.mark.parametrize(
    ("stamps", "step"),
    [
        (["06-21T12:00"], 1.0),
        (["06-21T11:45", "06-21T12:00", "06-22T12:05"], 0.25),
        (["06-21T09:00", "06-21T12:00"], 1.0),  # no more than the weather's own
        (["06-21T23:50", "06-22T00:10"], 1.0),  # of two days
    ],
)
def test_a_time_stamp_counts_as_the_least_gap_of_a_day(tmp_path, stamps, step):
    text = "".join(f"2015-{stamp}\n" for stamp in stamps)
    (tmp_path / "stamps.csv").write_text("time\n" + text)
    sensors = {"corner": (0, 0, 1), "count": (2, 2)}
    period = {"timestamps": tmp_path / "stamps.csv"}
    light = daylight(Case.model_validate({"sensors": sensors, "period": period}))
    assert light.step_hours == step


DENVER = Site("Denver", 39.76, -104.86, -7, 1600)


@pytest.mark.parametrize(
    ("latitude", "longitude", "count"),
    [(39.76, -104.86, 0), (40.2, -104.0, 0), (40.4, -104.86, 1), (39.76, 104.86, 1)],
)
def test_a_place_that_is_not_the_weathers_is_remarked_upon(latitude, longitude, count):
    case = Case.model_validate({"sensors": {"corner": (0, 0, 1), "count": (2, 2)}})
    case._building = Model(location=Location(latitude, longitude, "Site A"))
    notes = place_notes(case, DENVER)
    assert len(notes) == count
    assert all("Site A" in note and "Denver" in note for note in notes)


def test_a_zone_that_does_not_fit_the_place_is_remarked_upon():
    sensors, site = {"corner": (0, 0, 1), "count": (2, 2)}, {"latitude": 36, "timezone": -5}
    for longitude, count in ((-80, 0), (80, 1)):
        tables = {"sensors": sensors, "site": {**site, "longitude": longitude}}
        case = Case.model_validate(tables | {"sky": {"model": "cie", "type": "overcast"}})
        notes = [note for note in daylight(case).notes if "check their signs" in note]
        assert len(notes) == count


def test_places_across_the_date_line_are_near():
    case = Case.model_validate({"sensors": {"corner": (0, 0, 1), "count": (2, 2)}})
    case._building = Model(location=Location(-17.0, 179.8))
    assert place_notes(case, Site("Taveuni", -17.0, -179.8, 12, 0)) == ()
