"""Rays of an eye sum up the light of mirror lamellae as photons that reach the eye do.

Rationale: DGP takes E_v from photons that lamellae send to the eye, and luminances and the images
of the sun from rays that leave it. Both follow the same light from opposite ends.

Method: the classroom with curved mirror lamellae, tilted so that they throw the sun down to the
eyes, 96 hours of a year, six places, eight views from each. Pixels and images of the sun times the
cosine of their angle add up to E_v.

Expected: equal in the mean over hours and places. In single hours a strip of light, narrower than
the square of 0.3 m that photons cross, falls on an eye or beside it.
"""

import numpy as np
import pytest

from drcmitsuba import load_case
from drcmitsuba.annual.run import Run
from drcmitsuba.case.weather import PeriodTable
from drcmitsuba.glare_year.eyes import eyes
from drcmitsuba.glare_year.state import at_eyes, places
from drcmitsuba.plan import plan
from drcmitsuba.runtime import backend
from drcmitsuba.sky.daylight import daylight
from tests.unit.glare_year.glare_room import by_suns, sum_over

TIMES = [f"2015-{month:02d}-{day}T{hour:02d}:30" for month in range(1, 13) for day in ("07", "21")
         for hour in (9, 11, 12, 14)]  # fmt: skip
PLACES = [[4.4, 3.0, 1.2], [3.1, 3.3, 1.2], [5.5, 2.7, 1.3], [2.2, 4.1, 1.25], [6.3, 4.4, 1.15],
          [4.9, 5.2, 1.2]]  # fmt: skip


@pytest.mark.slow
def test_pixels_and_suns_add_up_to_the_illuminance_at_the_eye(tmp_path):
    (tmp_path / "times.csv").write_text("time\n" + "\n".join(TIMES))
    case = load_case("lamella/lamella")
    period = PeriodTable(timestamps=str(tmp_path / "times.csv"))
    down = case.components["lamellae"].model_copy(update={"tilt": 30.0})
    case = case.with_tables(shading=None, period=period, components={"lamellae": down})
    backend.select()
    light, looking = daylight(case), eyes(case, PLACES)
    run = Run.of(case, plan(case, light).scope)
    E = at_eyes(case, "open", light, looking, run)
    by_rays = np.zeros(E.shape[1:])
    for place in places(case, "open", light, looking, run):
        L = place.known.at(np.arange(len(TIMES)))
        for view in place.views:
            forward = looking.forward[view]
            by_rays[:, view] = sum_over(place.known.seen, L, forward) + by_suns(
                place.known, forward
            )
    shape = (len(TIMES), len(PLACES), 8)
    ratio = by_rays.reshape(shape).mean((0, 1)) / E.mean(axis=0).reshape(shape).mean((0, 1)) - 1
    at_once = E.mean(axis=(1, 2))
    error = at_once.std(ddof=1) / np.sqrt(len(E)) / at_once.mean()
    print(f"by direction {(100 * ratio).round(1).tolist()} %, error of all {100 * error:.2f} %")
    print(f"all {100 * (by_rays.mean() / E.mean() - 1):+.2f} %")
    assert abs(by_rays.mean() / E.mean() - 1) < 0.005 + 3 * error
    assert np.abs(ratio).max() < 0.03
