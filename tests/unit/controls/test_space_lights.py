"""Electric light of two spaces by their targets and hours, against sums by hand."""

import pytest

from drcmitsuba.case.metrics import Metrics
from drcmitsuba.controls import continuous_dimming
from drcmitsuba.controls.space_lights import of_year, with_electric_light
from drcmitsuba.metrics.intervals import Rules
from drcmitsuba.metrics.space_tasks import at_target, summed_daylight, tasks
from drcmitsuba.metrics.spaces import sensors_by_space
from tests.unit.metrics.test_space_tasks import ROWS, year

RULES = Rules(Metrics(sda_threshold=300), 1000.0, 0.02, 1.0)


def rows(E):
    """Numbers with the rows of the two spaces."""
    spaces = sensors_by_space(E)
    told = tasks(at_target(E, spaces, RULES), spaces, RULES)
    of = [{"name": s.name, "storey": s.name, "floor_area": s.floor_area, **told[s.name]}
          for s in spaces]  # fmt: skip
    return {"spaces": of, "storeys": [{"name": s.name} for s in spaces], "building": {}}


def test_each_space_has_lamps_of_its_own():
    """West at 500 lx, 9 to 11 h: off at 9 h (mean 500 lx), 0.3 of the power at 10 h (499.5 lx).

    East at 300 lx, all four hours: a third of the target at 8 h, off at 9 h, 0.3 at 10 h, off at
    11 h. Lamps of which 2/3 of the light is wanted take 0.3 + 0.7 · (2/3 − 0.2)/0.8 of the power.
    """
    numbers = of_year(rows(year()), year())
    west, east = (row["electric_light"] for row in numbers["spaces"])
    assert west == {"hours": 2, "hours_saved": 1.7, "hours_off": 1, "energy": pytest.approx(0.036)}
    two_thirds = 0.3 + 0.7 * (2 / 3 - 0.2) / 0.8
    assert east["hours_saved"] == pytest.approx(4 - two_thirds - 0.3)
    assert (east["hours"], east["hours_off"]) == (4, 2)
    assert "energy" not in east  # nothing tells their power
    building = numbers["building"]["electric_light"]
    assert building["hours"] == pytest.approx((12 * 2 + 4 * 4) / 16)
    assert building["hours_off"] == pytest.approx((12 * 1 + 4 * 2) / 16)
    assert "energy" not in building
    assert numbers["storeys"][0]["electric_light"] == west


def test_energy_of_the_building_is_the_sum_where_all_is_known():
    E = year(rows=[ROWS[0], {**ROWS[1], "power": 5.0}])
    numbers = of_year(rows(E), E)
    parts = [row["electric_light"]["energy"] for row in numbers["spaces"]]
    assert parts[1] == pytest.approx(5 * 4 / 1000 * (1 + 0.3 + 0.7 * (2 / 3 - 0.2) / 0.8 - 0.7))
    assert numbers["building"]["electric_light"]["energy"] == pytest.approx(sum(parts))


def test_lamps_may_be_dimmed_in_other_ways():
    E = year()
    spaces = sensors_by_space(E)
    numbers = with_electric_light(
        rows(E), summed_daylight(E, spaces), spaces, E, 1.0, continuous_dimming
    )
    assert numbers["spaces"][0]["electric_light"]["hours_off"] == 0


def test_without_spaces_nothing_is_added():
    E = year().drop_vars("space")
    assert of_year({"sDA": 1}, E) == {"sDA": 1}
