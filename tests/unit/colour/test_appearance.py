"""Colour of light as lighting states it: what light far from any white has not."""

import numpy as np
import pytest

from drcmitsuba.colour.appearance import Appearance, temperatures
from drcmitsuba.colour.bands import TRISTIMULUS, Bands, d65, responses

BANDS = Bands.of(9)


def test_daylight_has_its_temperature_and_renders_all_colours():
    made = Appearance.of(np.ones(9), BANDS)
    assert made.cct == pytest.approx(6504, abs=10)
    assert made.fidelity == pytest.approx(100, abs=0.5)


@pytest.mark.parametrize("light", [*np.eye(9)[[0, 8]], np.linspace(1, 0.05, 9)])
def test_light_far_from_any_white_has_no_temperature(light):
    assert Appearance.of(light, BANDS) == (None, None, None, None)
    power = (light @ BANDS.splines) * d65()
    X, Y, Z = (responses()[name] @ power for name in TRISTIMULUS)
    both = temperatures(*(np.array([v / (X + Y + Z)]) for v in (X, Y)))
    assert np.isnan(both).all()
