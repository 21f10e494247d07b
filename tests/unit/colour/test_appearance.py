"""Colour of light as lighting states it: what light far from any white has not."""

import numpy as np
import pytest

from drcmitsuba.colour.appearance import Appearance
from drcmitsuba.colour.bands import Bands

BANDS = Bands.of(9)


def test_daylight_has_its_temperature_and_renders_all_colours():
    made = Appearance.of(np.ones(9), BANDS)
    assert made.cct == pytest.approx(6504, abs=10)
    assert made.fidelity == pytest.approx(100, abs=0.5)


@pytest.mark.parametrize("band", [0, 8])
def test_light_of_one_end_of_the_spectrum_has_numbers_or_none(band):
    made = Appearance.of(np.eye(9)[band], BANDS)
    assert None in made
    assert all(value is None or np.isfinite(value) for value in made)
