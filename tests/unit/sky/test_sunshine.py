"""Sunshine-probability sky: frequencies, reproducibility, and the sky that each draw gives."""

import numpy as np
import pytest
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.case import Case
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky import CieSky, Sunshine, radiance, sun_position
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.sky.weather import Site

GENEVA = Site("Geneva", 46.25, 6.13, 1.0, 416.0)
YEAR = np.arange("2015-01-01", "2016-01-01", dtype="datetime64[h]").astype("datetime64[ns]")
MONTHLY = tuple(np.linspace(0.2, 0.75, 12))


def test_frequencies_are_the_probabilities():
    sky = Sunshine(MONTHLY, intermediate=0.3, seed=11)
    minutes = np.arange("2015-01-01", "2016-01-01", 10, dtype="datetime64[m]")
    kinds = sky.kinds(minutes.astype("datetime64[ns]"))
    month = minutes.astype("datetime64[M]").astype(int) % 12
    for m, p in enumerate(MONTHLY):
        drawn = kinds[month == m]
        shares = {"clear_with_sun": p, "intermediate": (1 - p) * 0.3, "overcast": (1 - p) * 0.7}
        for kind, share in shares.items():
            deviation = np.sqrt(share * (1 - share) / len(drawn))
            assert abs((drawn == kind).mean() - share) < 4 * deviation, (m, kind)


@pytest.mark.parametrize(
    ("p", "intermediate", "kind"),
    [(1.0, 0.5, "clear_with_sun"), (0.0, 0.0, "overcast"), (0.0, 1.0, "intermediate")],
)
def test_certainties(p, intermediate, kind):
    assert (Sunshine((p,) * 12, intermediate).kinds(YEAR) == kind).all()


def test_a_time_keeps_its_sky_in_any_period_and_order():
    sky = Sunshine(MONTHLY, seed=3)
    whole = sky.kinds(YEAR)
    np.testing.assert_array_equal(sky.kinds(YEAR[4000:4100]), whole[4000:4100])
    order = np.random.default_rng(0).permutation(len(YEAR))
    np.testing.assert_array_equal(sky.kinds(YEAR[order]), whole[order])
    np.testing.assert_array_equal(Sunshine(MONTHLY, seed=3).kinds(YEAR), whole)


def test_seeds_differ_and_times_are_independent():
    a, b = (Sunshine((0.5,) * 12, seed=s).kinds(YEAR) == "clear_with_sun" for s in (1, 2))
    # Agreement of independent coins is 0.5 ± 0.5/√n.
    assert abs((a == b).mean() - 0.5) < 4 * 0.5 / np.sqrt(len(YEAR))
    assert abs((a[1:] == a[:-1]).mean() - 0.5) < 4 * 0.5 / np.sqrt(len(YEAR))


def test_each_time_is_the_cie_sky_that_was_drawn():
    time = YEAR[4000:4060]
    sun = sun_position(time, 1.0, GENEVA)
    data = xr.Dataset(coords={"time": time})
    sky = Sunshine((0.4,) * 12, seed=5)
    kinds = sky.kinds(time)
    assert len(set(kinds)) == 3
    mixed = radiance(data, sun, model=sky)
    for kind in set(kinds):
        pure = radiance(data, sun, model=CieSky(kind))
        np.testing.assert_allclose(mixed.sky[kinds == kind], pure.sky[kinds == kind], rtol=1e-12)
        np.testing.assert_allclose(mixed["sun"][kinds == kind], pure["sun"][kinds == kind])
    up = sun.solar_zenith.to_numpy() < 90
    np.testing.assert_array_equal(
        mixed.direct_normal_illuminance.to_numpy() > 0, (kinds == "clear_with_sun") & up
    )
    illuminance = mixed.sky.to_numpy()[:, 1:] @ Patches().projected_solid_angles[1:]
    np.testing.assert_allclose(illuminance, mixed.diffuse_horizontal_illuminance, rtol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (((0.5,) * 11,), "11 values"),
        (((0.5,) * 11 + (1.2,),), "1.2"),
        (((0.5,) * 11 + (float("nan"),),), "nan"),
        (((0.5,) * 12, -0.1), "intermediate"),
        (((0.5,) * 12, 0.5, -1), "seed: -1"),
    ],
)
def test_wrong_input_is_refused(arguments, match):
    with pytest.raises(InputError, match=match):
        Sunshine(*arguments)


def test_an_instant_has_the_sky_of_its_hour(tmp_path):
    """Pictures at half past show the sky that the hour has in the year."""
    tables = {
        "sensors": {"corner": (0, 0, 1), "count": (2, 2)},
        "sky": {"model": "sunshine", "probability": [0.5] * 12},
        "site": {"latitude": 46.25, "longitude": 6.13, "timezone": 1.0},
    }
    case = Case.model_validate(tables)
    hours = YEAR[11 + 24 * np.arange(60)]
    of_hours, of_instants = (
        daylight(case, hours + np.timedelta64(minutes, "m")).sky["sun"].values > 0
        for minutes in (0, 30)
    )
    np.testing.assert_array_equal(of_hours, of_instants)
    assert 0 < of_hours.sum() < len(hours)
