"""The classroom of Bauer & Wittkopf: published numbers come out, and the seasons make sense.

Published (Geneva, 500 lx in half of the hours, existing façade): sDA 70.2 % [1]_, ASE 34 % [2]_;
façade O1, with half of the façade glazed: sDA below 55 %, ASE 21 % [2]_. The reflectances were not
published; those of the reference cases are what was agreed for comparison. Façades O2 and O3 carry
a film that is not the paper's (its BSDF was not published): only the order of the façades and the
story over the months are compared.

References
----------
.. [1] Z. T. Kazanasmaz, L. O. Grobe, C. Bauer, M. Krehel, S. Wittkopf, Building and Environment 102
   (2016) 243-256.
.. [2] C. Bauer, S. Wittkopf, Journal of Facade Design and Engineering (2016), section 4.2.
"""

import pytest

import drcmitsuba
from tests import SHARED, skips

GENEVA = SHARED / "data/weather/CHE_Geneva.067000_IWEC.epw"
WINTER, SUMMER = (11, 12, 1, 2), (5, 6, 7, 8)


def evaluate(name):
    skips.data(GENEVA)
    case = drcmitsuba.load_case(f"classroom/reference/{name}").with_weather(GENEVA)
    return drcmitsuba.evaluate(case)


@pytest.fixture(scope="module")
def existing():
    return evaluate("existing")


@pytest.fixture(scope="module")
def o1():
    return evaluate("o1")


@pytest.fixture(scope="module")
def o2():
    return evaluate("o2")


@pytest.fixture(scope="module")
def o3():
    return evaluate("o3")


def monthly(result, name, months):
    return [result.metrics[name][month - 1]["value"] for month in months]


def mean(values):
    return sum(values) / len(values)


def test_a_year_of_working_hours_on_the_whole_grid(existing):
    assert dict(existing.illuminance.sizes) == {"time": 2610, "sensor": 576}


def test_the_existing_facade_has_its_published_autonomy_and_exposure(existing):
    assert existing.metrics["sDA"]["value"] == pytest.approx(70.2, abs=2)
    assert existing.metrics["ASE"]["value"] == pytest.approx(34, abs=2)


def test_less_glass_costs_autonomy_and_saves_exposure(o1):
    assert o1.metrics["sDA"]["value"] < 55
    assert o1.metrics["ASE"]["value"] == pytest.approx(21, abs=2)


def test_the_interval_of_each_number_is_narrow_enough_to_tell_the_facades_apart(existing, o1):
    for name in ("sDA", "ASE"):
        assert o1.metrics[name]["high"] < existing.metrics[name]["low"]


def test_autonomy_rises_to_summer(existing):
    winter, summer = (monthly(existing, "msDA", months) for months in (WINTER, SUMMER))
    assert mean(summer) > mean(winter) + 10
    assert min(summer) > existing.metrics["msDA"][11]["value"]


def test_the_low_sun_of_winter_comes_deeper_into_the_room(existing, o1):
    for result in (existing, o1):
        winter, summer = (monthly(result, "MSE", months) for months in (WINTER, SUMMER))
        assert min(winter) > max(summer)


def test_less_glass_lowers_autonomy_by_twenty_points_except_about_midsummer(existing, o1):
    """Published: about 20 points, almost evenly over the year but for June and July [2]_."""
    months = range(1, 13)
    pairs = zip(monthly(existing, "msDA", months), monthly(o1, "msDA", months), strict=True)
    differences = {month: a - b for month, (a, b) in zip(months, pairs, strict=True)}
    others = [differences[month] for month in months if month not in (5, 6, 7)]
    assert mean(others) == pytest.approx(20, abs=5)
    assert min(others) > 10
    assert max(others) < 30
    assert max(differences[6], differences[7]) < min(others)


@pytest.mark.slow
def test_films_raise_autonomy_above_the_glass_that_they_replace(existing, o1, o2, o3):
    """Published: O2 far above the preferred 75 %, O3 about 80 % where O1 has below 55 % [2]_."""
    results = {"e": existing, "o1": o1, "o2": o2, "o3": o3}
    sda = {name: result.metrics["sDA"] for name, result in results.items()}
    assert sda["o2"]["low"] > 75
    assert sda["o2"]["low"] > sda["e"]["high"] > sda["o1"]["high"]
    assert sda["o3"]["low"] > sda["e"]["high"]
    assert sda["o3"]["value"] == pytest.approx(80, abs=6)


@pytest.mark.slow
def test_the_height_of_clear_glass_alone_sets_the_exposure(o1, o2, o3):
    """A film without a straight-through peak adds no direct sun anywhere [2]_."""
    for result in (o1, o2):
        assert (result.illuminance["direct_sun"] > 0).any()
    assert (o1.illuminance["direct_sun"] == o2.illuminance["direct_sun"]).all()
    assert o3.metrics["ASE"]["value"] == pytest.approx(5.5, abs=2)


@pytest.mark.slow
def test_films_gain_in_spring_and_autumn_and_little_in_winter(existing, o1, o2, o3):
    for with_film, without in ((o2, existing), (o3, o1)):
        gain = [
            a - b
            for a, b in zip(
                monthly(with_film, "msDA", range(1, 13)),
                monthly(without, "msDA", range(1, 13)),
                strict=True,
            )
        ]
        equinox = mean([gain[m - 1] for m in (3, 4, 9)])
        winter = mean([gain[m - 1] for m in (11, 12, 1)])
        assert equinox > 10
        assert equinox > winter + 10
        assert abs(winter) < 8


@pytest.mark.slow
def test_the_little_clear_glass_of_o3_needs_no_shade_from_april_to_july(o3):
    assert max(monthly(o3, "shade_closed_monthly", (4, 5, 6, 7))) == 0
    assert max(monthly(o3, "shade_closed_monthly", (12, 1, 2, 3))) > 10
