"""Draws of the quantities are those of whole years of E, drawn one by one."""

import numpy as np
import pytest

from drcmitsuba.case.case import Case
from drcmitsuba.metrics.intervals.autonomy import multipliers
from drcmitsuba.runtime.toml import tomllib
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.standards.coverage import diffuse_horizontal, hours_of
from drcmitsuba.standards.quantities import count
from drcmitsuba.standards.standard import Quantity, read
from drcmitsuba.standards.year import StandardYear
from tests.system.small_room import CASE
from tests.unit.standards.made_year import WHOLE, WORKING, evidence, median_reached, zenith

DRAWN = 40
"""Draws that are computed whole."""


def whole_years(E):
    """Yield E* (time, sensor) of the first draws, from the replicates of C and the zenith."""
    C = E.coefficients.open["replicates"].values[:, :, -1].astype(float)
    weights = multipliers(len(C), E.drawing["seed"]).replicates.astype(float)
    L = zenith(E.sky["time"].values)
    mean = C.mean(axis=0)
    for i in range(DRAWN):
        yield np.outer(L, mean + weights[:, i] @ (C - mean))


def made(rooms=2, error=0.06, times=WORKING):
    around = np.exp(np.random.default_rng(6).normal(0, 0.15, 16 * rooms))
    return evidence(around * 300 / median_reached(times), error, times=times, rooms=rooms, seed=3)


@pytest.mark.parametrize(("threshold", "fraction"), [(300.0, 0.5), (200.0, 0.7)])
@pytest.mark.parametrize("light", ["open", "total"])
def test_shares_of_points(light, threshold, fraction):
    E = made()
    quantity = (
        read("lm-83-12")
        .quantities["sDA"]
        .model_copy(update={"light": light, "threshold": threshold, "fraction": fraction})
    )
    counted = count(quantity, StandardYear(E, np.arange(len(WORKING))))
    needed = np.ceil(fraction * len(WORKING))
    for i, drawn in enumerate(whole_years(E)):
        passed = (drawn >= threshold).sum(axis=0) >= needed
        assert counted.drawn.all[i] == pytest.approx(100 * passed.mean())
        of_rooms = 100 * passed.reshape(2, 16).mean(axis=1)
        np.testing.assert_allclose(counted.drawn.by_space[:, i], of_rooms)
    assert np.ptp(counted.drawn.all[:DRAWN]) > 5


def test_hours_of_the_mean():
    E = made(times=WHOLE)
    quantity = Quantity(
        meaning="", light="open", of="mean", threshold=300.0, hours=2000.0, source="",
        sure="second-hand",
    )  # fmt: skip
    counted = count(quantity, StandardYear(E, np.arange(len(WHOLE))))
    for i, drawn in enumerate(whole_years(E)):
        hours = (drawn.reshape(len(WHOLE), 2, 16).mean(axis=2) >= 300).sum(axis=0)
        # Light in single precision may differ at the threshold.
        np.testing.assert_allclose(counted.drawn.by_space[:, i], hours, atol=1)
    assert np.ptp(counted.drawn.all[:DRAWN]) > 20


def test_some_hours_of_a_year_are_counted_as_alone():
    whole, alone = made(times=WHOLE), made(times=WORKING)
    at = np.flatnonzero(np.isin(WHOLE, WORKING))
    quantity = read("lm-83-12").quantities["sDA"]
    part = count(quantity, StandardYear(whole, at))
    C = alone.coefficients.open["replicates"]
    same = StandardYear(
        type(alone)(
            whole.illuminance.isel(time=at), whole.coefficients, whole.sky.isel(time=at),
            alone.drawing, "alone",
        ),
        np.arange(len(at)),
    )  # fmt: skip
    by_itself = count(quantity, same)
    assert C.shape == whole.coefficients.open["replicates"].shape
    np.testing.assert_array_equal(part.drawn.all, by_itself.drawn.all)
    np.testing.assert_array_equal(part.hours, by_itself.hours)


def test_daylight_hours_are_those_of_the_weather():
    text = CASE.replace("months = [3, 6]", 'calendar = "LM-83"\nhours = [0, 24]')
    light = daylight(Case(**tomllib.loads(text)))
    diffuse = diffuse_horizontal(light.sky)
    known = light.sky["diffuse_horizontal_illuminance"].values
    np.testing.assert_allclose(diffuse.values, known, rtol=1e-4, atol=0.1)
    chosen = hours_of(read("en-17037"), light.sky, 1.0, "case", light.sky)
    assert len(chosen) == 4380
    assert known[chosen].min() >= np.sort(known)[::-1][4379] - 0.1
