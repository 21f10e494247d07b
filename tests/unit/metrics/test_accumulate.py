"""E = C·L on numbers that can be checked by hand, and nothing that is missing passes in silence."""

import numpy as np
import pytest
import xarray as xr

from drcmitsuba.metrics import accumulate
from drcmitsuba.runtime.errors import InputError

TIMES = np.array(["2015-03-21T10:00", "2015-03-21T11:00", "2015-03-21T23:00"], "datetime64[ns]")
SUNS = ["sun_2015-03-21T10:00", "sun_2015-03-21T11:00"]
BINS = ["ground", "sky_001", *SUNS]
# Two replicates, one sensor: ground, patch, two suns [sr].
OPEN = np.array([[[0.1, 1.0, 1e-5, 2e-5]], [[0.3, 1.0, 3e-5, 2e-5]]], np.float32)
STRAIGHT = np.array([[0.0, 0.5, 1e-5, 0.0]], np.float32)


def coefficients(replicates=OPEN, straight=STRAIGHT):
    return xr.Dataset(
        {
            "replicates": (("replicate", "sensor", "bin"), replicates),
            "straight": (("sensor", "bin"), straight),
            "straight_se": (("sensor", "bin"), straight / 10),
        },
        coords={
            "bin": np.array(BINS, object),
            **{axis: ("sensor", [float(i)]) for i, axis in enumerate("xyz")},
        },
    )


def sky():
    return xr.Dataset(
        {
            "sky": (("time", "bin"), np.array([[100.0, 1000.0], [200.0, 2000.0], [0.0, 0.0]])),
            "sun": ("time", np.array([1e8, 2e8, 0.0])),
        },
        coords={
            "time": TIMES,
            "bin": np.array(BINS[:2], object),
            "sun_bin": ("time", np.array([*SUNS, ""], object)),
            "clock": ("time", TIMES + np.timedelta64(1, "h")),
        },
    )


def closed(*hours):
    """State of every hour: 0 open, 1 closed."""
    return np.array(hours, int)


def test_two_patches_and_two_suns_by_hand():
    E = accumulate.by_source(coefficients(), sky())
    # 10 h: 0.2·100 + 1·1000 by the sky, 2e-5·1e8 by the sun; 11 h: 0.2·200 + 2000 and 2e-5·2e8.
    np.testing.assert_allclose(E["sky"], [[1020], [2040], [0]], rtol=1e-6)
    np.testing.assert_allclose(E["sun"], [[2000], [4000], [0]], rtol=1e-6)
    np.testing.assert_allclose(E["total"], [[3020], [6040], [0]], rtol=1e-6)


def test_the_error_is_that_of_the_mean_of_the_replicates():
    E = accumulate.by_source(coefficients(), sky())
    # Replicates at 10 h: sky 1010 and 1030, sun 1000 and 3000, together 2010 and 4030.
    np.testing.assert_allclose(E["sky_se"].values[:, 0], [10, 20, 0], rtol=1e-5)
    np.testing.assert_allclose(E["sun_se"].values[:, 0], [1000, 0, 0], rtol=1e-5)
    np.testing.assert_allclose(E["total_se"].values[:, 0], [1010, 20, 0], rtol=1e-5)


def test_replicates_of_some_sensors_have_the_mean_and_error_of_all():
    two = xr.concat([coefficients(), coefficients(2 * OPEN)], "sensor", data_vars="minimal")
    two["replicates"] = two["replicates"].transpose("replicate", "sensor", "bin")
    expected = accumulate.by_source(two, sky())
    values = accumulate.replicates(two, sky(), np.array([1]))
    assert values.shape == (2, 3, 1)
    np.testing.assert_allclose(values.mean(axis=0)[:, 0], expected["total"][:, 1], rtol=1e-6)
    error = values.std(axis=0, ddof=1) / np.sqrt(2)
    np.testing.assert_allclose(error[:, 0], expected["total_se"][:, 1], rtol=1e-5)


def test_direct_sun_takes_straight_coefficients_of_the_sun_only():
    E = accumulate.direct_sun(coefficients(), sky())
    np.testing.assert_allclose(E["direct_sun"], [[1000], [0], [0]], rtol=1e-6)
    np.testing.assert_allclose(E["direct_sun_se"], [[100], [0], [0]], rtol=1e-6)
    assert E["direct_sun"].attrs["units"] == "lx"


@pytest.mark.parametrize("order", [[3, 1, 0, 2], [1, 0, 3, 2], [2, 3, 1, 0]])
def test_bins_are_matched_by_label(order):
    for function in (accumulate.by_source, accumulate.direct_sun):
        expected = function(coefficients(), sky())
        xr.testing.assert_equal(function(coefficients().isel(bin=order), sky()), expected)
    swapped = sky().isel(bin=[1, 0])
    expected = accumulate.by_source(coefficients(), sky())
    xr.testing.assert_allclose(accumulate.by_source(coefficients(), swapped), expected)


def test_labels_from_disk_match_whatever_kind_of_string_they_are():
    fixed = coefficients().assign_coords(bin=np.array(BINS, "U25"))
    expected = accumulate.by_source(coefficients(), sky())
    xr.testing.assert_equal(accumulate.by_source(fixed, sky()), expected)


@pytest.mark.parametrize(
    ("missing", "message"),
    [
        (0, "no 'ground' .1 bins missing.; compute sky and coefficients with the same"),
        (3, "no 'sun_2015-03-21T11:00' .1 bins missing.; compute coefficients for the time"),
    ],
)
def test_a_bin_without_coefficients_is_refused(missing, message):
    kept = [i for i in range(4) if i != missing]
    with pytest.raises(InputError, match=message):
        accumulate.by_source(coefficients().isel(bin=kept), sky())
    if missing == 3:
        with pytest.raises(InputError, match=message):
            accumulate.direct_sun(coefficients().isel(bin=kept), sky())


def test_a_sun_that_does_not_shine_needs_no_coefficients():
    dull = sky()
    dull["sun"][1] = 0.0
    E = accumulate.by_source(coefficients().isel(bin=[0, 1, 2]), dull)
    np.testing.assert_allclose(E["sun"], [[2000], [0], [0]], rtol=1e-6)


def test_hours_that_close_take_the_shaded_state():
    shaded = coefficients(OPEN / 10)
    E = accumulate.illuminance(coefficients(), [shaded], sky(), closed(False, True, False))
    np.testing.assert_allclose(E["total_open"], [[3020], [6040], [0]], rtol=1e-6)
    np.testing.assert_allclose(E["total"], [[3020], [604], [0]], rtol=1e-6)
    np.testing.assert_allclose(E["total_se"].values[:, 0], [1010, 2, 0], rtol=1e-5)
    np.testing.assert_allclose(E["sky_open"] + E["sun_open"], E["total_open"], rtol=1e-6)
    np.testing.assert_array_equal(E["shade_closed"], [False, True, False])
    np.testing.assert_allclose(E["direct_sun"], [[1000], [0], [0]], rtol=1e-6)  # never shaded
    names = {"total", "total_open", "sky_open", "sun_open", "direct_sun"}
    assert set(E.data_vars) == names | {f"{name}_se" for name in names}
    assert all(variable.attrs["units"] == "lx" for variable in E.data_vars.values())
    assert {"time", "x", "y", "z", "clock", "shade_closed"} == set(E.coords)


def test_without_a_closed_hour_the_shaded_state_is_not_needed():
    E = accumulate.illuminance(coefficients(), [None], sky(), closed(False, False, False))
    xr.testing.assert_equal(E["total"], E["total_open"].rename("total"))


def test_a_closed_hour_without_shaded_state_is_refused():
    with pytest.raises(
        InputError, match="state: a state is missing; 2 time stamps take it; compute"
    ):
        accumulate.illuminance(coefficients(), [None], sky(), closed(True, True, False))


@pytest.mark.parametrize("bin", [0, 1, 3])
def test_nan_in_the_shaded_state_is_never_used_in_silence(bin):
    gap = OPEN / 10
    gap[:, :, bin] = np.nan
    with pytest.raises(InputError, match="bin: no numbers for 1 time stamps, 2015-03-21T11:00"):
        accumulate.illuminance(
            coefficients(), [coefficients(gap)], sky(), closed(False, True, False)
        )


def test_nan_for_a_sun_of_an_open_hour_does_not_matter():
    gap = OPEN / 10
    gap[:, :, 2] = np.nan  # the sun of 10 h, when the shade is open
    args = sky(), closed(False, True, False)
    E = accumulate.illuminance(coefficients(), [coefficients(gap)], *args)
    expected = accumulate.illuminance(coefficients(), [coefficients(OPEN / 10)], *args)
    xr.testing.assert_equal(E, expected)


def test_nan_in_the_open_state_is_refused():
    gap = OPEN.copy()
    gap[1, 0, 1] = np.nan
    with pytest.raises(InputError, match="no numbers for 3 time stamps"):
        accumulate.by_source(coefficients(gap), sky())
    gap = STRAIGHT.copy()
    gap[0, 2] = np.nan
    with pytest.raises(InputError, match="no numbers for 1 time stamps, 2015-03-21T10:00"):
        accumulate.direct_sun(coefficients(straight=gap), sky())
