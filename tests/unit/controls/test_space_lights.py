"""Electric light of two spaces by their targets and hours, against sums by hand."""

import pytest

from drcmitsuba.case.metrics import Metrics
from drcmitsuba.controls import continuous_dimming
from drcmitsuba.controls.space_lights import with_electric_light
from drcmitsuba.metrics.evaluate_metrics import summarise
from drcmitsuba.metrics.intervals import Rules
from drcmitsuba.metrics.space_years import SpaceYears
from drcmitsuba.metrics.spaces import sensors_by_space
from tests.unit.metrics.test_space_tasks import ROWS, year

RULES = Rules(Metrics(sda_threshold=300), 1000.0, 0.02, 1.0)


def lit(E, **options):
    """Metrics with the electric light of the spaces of E."""
    spaces = sensors_by_space(E)
    years = SpaceYears.of_errors(E, spaces, RULES)
    numbers = summarise(E, RULES, years=years)
    return with_electric_light(numbers, years, spaces, E, 1.0, **options)


def values(light):
    """Electric light without its intervals."""
    return {name: n["value"] if isinstance(n, dict) else n for name, n in light.items()}


def test_each_space_has_lamps_of_its_own():
    """West at 500 lx, 9 to 11 h: off at 9 h (mean 500 lx), 0.3 of the power at 10 h (499.5 lx).

    East at 300 lx, all four hours: a third of the target at 8 h, off at 9 h, 0.3 at 10 h, off at
    11 h. Lamps of which 2/3 of the light is wanted take 0.3 + 0.7 · (2/3 − 0.2)/0.8 of the power.
    """
    numbers = lit(year())
    west, east = (values(row["electric_light"]) for row in numbers["spaces"])
    assert west == {"hours": 2, "hours_saved": 1.7, "hours_off": 1, "energy": pytest.approx(0.036)}
    two_thirds = 0.3 + 0.7 * (2 / 3 - 0.2) / 0.8
    assert east["hours_saved"] == pytest.approx(4 - two_thirds - 0.3)
    assert (east["hours"], east["hours_off"]) == (4, 2)
    assert "energy" not in east  # nothing tells their power
    building = values(numbers["building"]["electric_light"])
    assert building["hours"] == pytest.approx((12 * 2 + 4 * 4) / 16)
    assert building["hours_off"] == pytest.approx((12 * 1 + 4 * 2) / 16)
    assert "energy" not in building


def test_ends_have_all_errors_of_daylight_in_one_direction():
    """West with ±1 lx: at 9 h 499 lx need light, at 10 h 500.5 lx need none."""
    off = lit(year(0.5))["spaces"][0]["electric_light"]["hours_off"]
    assert off == {"value": 1, "low": 0, "high": 2}


def test_storeys_have_the_light_of_their_spaces():
    numbers = lit(year(rows=[{**ROWS[0], "storey": "low"}, {**ROWS[1], "storey": "high"}]))
    for storey, space in zip(numbers["storeys"], numbers["spaces"], strict=True):
        assert storey["electric_light"] == space["electric_light"]


def test_energy_of_the_building_is_the_sum_where_all_is_known():
    numbers = lit(year(rows=[ROWS[0], {**ROWS[1], "power": 5.0}]))
    parts = [row["electric_light"]["energy"]["value"] for row in numbers["spaces"]]
    assert parts[1] == pytest.approx(5 * 4 / 1000 * (1 + 0.3 + 0.7 * (2 / 3 - 0.2) / 0.8 - 0.7))
    energy = numbers["building"]["electric_light"]["energy"]
    assert energy["value"] == pytest.approx(sum(parts))


def test_lamps_may_be_dimmed_in_other_ways():
    numbers = lit(year(), dimming=continuous_dimming)
    assert numbers["spaces"][0]["electric_light"]["hours_off"]["value"] == 0


def test_without_spaces_nothing_is_added():
    assert "electric_light" not in lit(year().drop_vars("space"))
