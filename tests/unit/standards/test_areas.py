"""Verdicts within a space are by area: points of a finer grid count for less of the floor."""

import json
from dataclasses import replace

import numpy as np
import pytest

from drcmitsuba import standards
from drcmitsuba.standards.year import StandardYear
from tests.unit.standards.made_year import WHOLE, WORKING, evidence, median_reached

FINE, COARSE = 0.3, 0.6
"""Spacings [m]: 16 points of the fine grid stand for 1.44 m², those of the coarse one for 5.76."""
ENOUGH = 400 / median_reached(WORKING)


def of_two_grids(fine, coarse, *, times=WORKING, spaces=("hall",), error=0.0):
    """Evidence of 16 points of a fine grid beside 16 of a coarse one, in a hall, or a room each."""
    known = evidence(np.repeat([fine, coarse], 16).astype(float), error, times=times, rooms=2)
    x, y = np.divmod(np.arange(16), 4)
    spacing = np.repeat([FINE, COARSE], 16)
    at = {"x": np.tile(x, 2) * spacing + np.repeat([0, 20], 16), "y": np.tile(y, 2) * spacing}
    at["grid"] = np.repeat(np.array(["fine", "coarse"], object), 16)
    at["space"] = np.repeat(np.array([*spaces, *spaces][:2], object), 16)
    coords = {name: ("sensor", values) for name, values in at.items()}
    names = [*dict.fromkeys(spaces), "attic"]
    rows = [{"name": n, "use": "", "storey": "", "floor_area": 10.0 + 20 * i}
            for i, n in enumerate(names)]  # fmt: skip
    E = known.illuminance.assign_coords(coords).assign_attrs(spaces=json.dumps(rows))
    return replace(known, illuminance=E)


def test_shares_of_a_space_are_of_its_floor():
    """The fine grid is a fifth of the hall: 20 % where its points pass, 80 % where they fail."""
    for lit, share in (((ENOUGH, 0), 20), ((0, ENOUGH), 80)):
        verdict = standards.verdict("leed-v4.1", of_two_grids(*lit))
        sda = verdict.quantities["sDA"]
        assert (sda.value, sda.low, sda.high) == pytest.approx((share,) * 3)
        assert not any("spacing" in note for note in verdict.notes)


def test_so_many_points_change_a_share_as_have_its_floor():
    """40 % of the area asks for 20 % more: four points of the coarse grid, 5 % each."""
    deciding = standards.verdict("leed-v4.1", of_two_grids(ENOUGH, 0.5 * ENOUGH)).deciding
    assert (deciding.holds, deciding.count) == (False, 4)
    assert deciding.light == pytest.approx(2 * 300 / 400, rel=1e-3)
    # 80 % is 5 % above the 75 % of the highest level: two coarse points would fail it.
    deciding = standards.verdict("leed-v4.1", of_two_grids(0, ENOUGH)).deciding
    assert (deciding.holds, deciding.count) == (True, 2)


def test_draws_count_the_same_floor():
    """Draws move 20 % of the area, by points of the fine grid near the threshold."""
    half = 300 / median_reached(WORKING)
    sda = standards.verdict("leed-v4.1", of_two_grids(half, 0, error=0.05)).quantities["sDA"]
    assert 0 <= sda.low < sda.high <= 20.0 + 1e-9


def test_the_mean_of_a_space_is_by_area():
    """900 lx on a fifth of the floor and 200 lx on the rest: 340 lx, not 550."""
    enough = median_reached(WHOLE, 2000 / 8760)
    for coarse, mean in ((200, 340), (140, 292)):
        known = of_two_grids(900 / enough, coarse / enough, times=WHOLE)
        outcome = standards.verdict("breeam-hea01", known).levels[0]
        assert outcome.reached == (mean > 300)


def test_spaces_count_by_their_floors():
    """Rooms of 10 and 30 m² with as many points each: a quarter of the area."""
    known = of_two_grids(ENOUGH, 0, spaces=("small", "large"))
    assert standards.verdict("leed-v4.1", known).quantities["sDA"].value == pytest.approx(25)
    year = StandardYear(known, np.arange(len(WORKING)))
    np.testing.assert_allclose(year.space_areas, [10, 30])


def test_equal_spacings_are_counted_point_by_point():
    year = StandardYear(evidence(np.ones(200), times=WORKING, rooms=2), np.arange(len(WORKING)))
    assert (year.area == 1).all()
    assert year.share(np.arange(200) < 55)[0] == 27.5
