"""Intervals of single sensors and eyes hold in every quarter of brightness; see `calibration`."""

import pytest

from drcmitsuba.runtime import backend
from tests.validation.calibration.comparison import PLACES
from tests.validation.calibration.rooms import ROOMS


@pytest.mark.slow
@pytest.mark.parametrize("name", ROOMS)
def test_intervals_hold_in_every_quarter_of_brightness(name):
    backend.select()
    room = ROOMS[name]()
    for row in (row for of_places in PLACES.values() for row in of_places(room, 12)):
        print(name, row)
        # Sensors of a seed share its random numbers: shares of some 40 sensors move by 2 to 3 %.
        assert row.covered > 0.90
        assert abs(row.bias) < row.stated / 3 + 3 * row.bias_error
