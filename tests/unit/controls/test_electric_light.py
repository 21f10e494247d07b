"""Dimming on series that can be counted by eye, and its energy against an hour-by-hour sum."""

import math

import numpy as np
import pytest
import xarray as xr

from drcmitsuba import controls
from drcmitsuba.runtime.errors import InputError


def daylight(*values):
    """E of a single zone [lx]."""
    return xr.DataArray(
        np.array(values, float)[:, None], {"zone": np.array(["desk"], object)}, ("time", "zone")
    )


def powers(out):
    return out.values[:, 0].round(12).tolist()


def test_continuous_dimming_has_a_least_power():
    """At 30 % power lamps give 20 % of their light; between, power is linear."""
    E = daylight(0, 200, 400, 450, 500, 9000)
    assert powers(controls.continuous_dimming(E)) == [1, 0.65, 0.3, 0.3, 0.3, 0.3]
    assert powers(controls.dimming_to_off(E)) == [1, 0.65, 0.3, 0.3, 0, 0]
    ideal = controls.continuous_dimming(E, least_light=0, least_power=0)
    assert powers(ideal) == [1, 0.6, 0.2, 0.1, 0, 0]


def test_steps_switch_where_daylight_lacks_a_step():
    E = daylight(0, 100, 249, 250, 251, 499, 500, 600)
    assert powers(controls.stepped_dimming(E, steps=2)) == [1, 1, 1, 0.5, 0.5, 0.5, 0, 0]
    assert powers(controls.stepped_dimming(E, steps=1)) == [1, 1, 1, 1, 1, 1, 0, 0]
    thirds = controls.stepped_dimming(daylight(0, 100, 200, 299), 300.0, steps=3)
    assert powers(thirds) == [1, 0.666666666667, 0.333333333333, 0.333333333333]


def test_zones_are_the_grids_or_those_that_are_named():
    E = xr.DataArray(
        [[0.0, 100.0, 300.0]], {"grid": ("sensor", ["a", "a", "b"])}, ("time", "sensor")
    )
    assert controls.zone_illuminance(E).values.tolist() == [[50, 300]]
    assert controls.zone_illuminance(E.drop_vars("grid")).zone.values.tolist() == ["all"]
    named = controls.zone_illuminance(E, {"window": np.array([0, 2])})
    assert named.values.tolist() == [[150]]
    with pytest.raises(InputError, match="zone without sensors"):
        controls.zone_illuminance(E, {"none": np.array([], int)})
    with pytest.raises(InputError, match="zone without sensors"):
        controls.zone_illuminance(E, {"none": np.zeros(3, bool)})
    for unfit in (np.array([3]), np.ones(2, bool)):
        with pytest.raises(InputError, match="no such sensors, 'far'; give indices from 0 to 2"):
            controls.zone_illuminance(E, {"far": unfit})


def test_energy_of_three_hours():
    """50 m² · 8 W/m² = 400 W; 1 h full, ½ h of power in two half steps, one hour off."""
    power = controls.stepped_dimming(daylight(0, 250, 600), steps=2)
    out = controls.lighting_energy(power, 8.0, {"desk": 50.0}, step_hours=1.0)
    assert out["energy"].item() == pytest.approx(0.6)
    assert out["saved"].item() == pytest.approx(0.6)
    assert out["hours_saved"].item() == 1.5
    assert out["hours_off"].item() == 1.0
    only = controls.lighting_energy(power, 8.0, {"desk": 50.0}, occupied=[True, False, False])
    assert (only["energy"].item(), only["saved"].item()) == (pytest.approx(0.4), 0.0)


@pytest.mark.parametrize("kind", ["continuous", "off", "stepped"])
def test_a_year_of_zones_equals_an_hour_by_hour_sum(kind):
    rng = np.random.default_rng(8)
    E = xr.DataArray(
        rng.lognormal(5.5, 1.2, (8760, 3)), {"zone": ["a", "b", "c"]}, ("time", "zone")
    )
    occupied = rng.random(8760) < 0.4
    areas, density, step = {"a": 12.0, "b": 30.5, "c": 7.0}, 6.5, 0.5
    power = {
        "continuous": lambda: controls.continuous_dimming(E, 400.0, 0.1, 0.2),
        "off": lambda: controls.dimming_to_off(E, 400.0, 0.1, 0.2),
        "stepped": lambda: controls.stepped_dimming(E, 400.0, 4),
    }[kind]()
    out = controls.lighting_energy(power, density, areas, step, occupied)
    for z, (zone, area) in enumerate(areas.items()):
        energy = saved = off = 0.0
        for e, here in zip(E.values[:, z].tolist(), occupied.tolist(), strict=True):
            if not here:
                continue
            wanted = max(0.0, (400 - e) / 400)
            if kind == "stepped":
                share = math.ceil(wanted * 4 - 1e-9) / 4
            elif wanted == 0 and kind == "off":
                share = 0.0
            elif wanted <= 0.1:
                share = 0.2
            else:
                share = 0.2 + 0.8 * (wanted - 0.1) / 0.9
            energy += share * area * density * step / 1000
            saved += (1 - share) * area * density * step / 1000
            off += step * (share == 0)
        at = out.sel(zone=zone)
        assert at["energy"].item() == pytest.approx(energy, rel=1e-10)
        assert at["saved"].item() == pytest.approx(saved, rel=1e-10)
        assert at["hours_saved"].item() == pytest.approx(saved * 1000 / (area * density), rel=1e-9)
        assert at["hours_off"].item() == off


@pytest.mark.parametrize(
    ("call", "complaint"),
    [
        (lambda: controls.continuous_dimming(daylight(1), 0.0), "set_point"),
        (lambda: controls.continuous_dimming(daylight(np.nan)), "NaN"),
        (lambda: controls.continuous_dimming(daylight(1), least_power=1.0), "least_power"),
        (lambda: controls.stepped_dimming(daylight(1), steps=0), "1 to 100"),
        (lambda: controls.stepped_dimming(daylight(1), steps=2.5), "whole number from 1 to 100"),
        (lambda: controls.lighting_energy(daylight(1), 8, {}), "none for zone 'desk'"),
        (lambda: controls.lighting_energy(daylight(1.1), 8, {"desk": 1}), "not from 0 to 1"),
        (lambda: controls.lighting_energy(daylight(1), 8, {"desk": -1}), "areas above 0"),
        (lambda: controls.lighting_energy(daylight(1), -8, {"desk": 1}), "density"),
        (
            lambda: controls.lighting_energy(daylight(1), 8, {"desk": 1}, occupied=[True] * 2),
            "give 1 truth values",
        ),
    ],
)
def test_unfit_numbers_are_refused(call, complaint):
    with pytest.raises(InputError, match=complaint):
        call()
