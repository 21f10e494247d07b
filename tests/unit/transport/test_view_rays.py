"""View out of EN 17037: rays in rooms whose angles and distances are known, and counts by hand."""

import numpy as np
import pytest
import xarray as xr

import drcmitsuba
from drcmitsuba import metrics
from drcmitsuba.case.case import Case
from tests.unit.transport.exact_scenes import CLOTH, GLASS

EYE = (3.0, 4.0, 1.2)
WALL = {"name": "house", "corner": [-100, -13, -5], "size": [206, 1, 4], "reflectance": 0.5}


def office(material="glass", **more):
    strips = [{"bottom": 0.6, "top": 2.6, "material": material}]
    tables = {
        "room": {"size": [6, 8, 3]}, "facade": {"south": {"strips": strips}},
        "materials": {"glass": GLASS, "cloth": CLOTH},
        "sensors": {"corner": [1, 1, 0.8], "count": [2, 2], "spacing": 1.0},
    }  # fmt: skip
    return Case.model_validate(tables | more)


def test_the_sight_angle_is_that_of_the_window():
    for case in (office(), office("open")):
        seen = drcmitsuba.view_distances(case, [EYE, (3.0, 1.0, 1.2)], azimuths=3600)
        exact = 2 * np.degrees(np.arctan(3 / np.array([4.0, 1.0])))
        assert metrics.sight_angle(seen).values == pytest.approx(exact, abs=0.15)
        assert np.isinf(metrics.outside_distance(seen)).all()
        assert metrics.view_layers(seen).values.all()
        assert metrics.view_level(seen).values.tolist() == [3, 3]


def test_a_wall_opposite_is_as_far_as_it_stands():
    high = WALL | {"size": [206, 1, 30]}
    seen = drcmitsuba.view_distances(office(furniture=[high]), [EYE])
    ahead = seen.sel(azimuth=180, elevation=0).item()
    assert ahead == pytest.approx(12.0, rel=1e-5)
    assert metrics.outside_distance(seen).item() == pytest.approx(
        np.median(12.0 / np.cos(np.radians(np.arange(0, 37)))), rel=0.01
    )
    layers = metrics.view_layers(seen).isel(sensor=0)
    assert layers.values.tolist() == [False, True, False]  # it hides the ground, too
    assert metrics.view_level(seen).item() == 1
    turned = office(furniture=[high], room={"size": [6, 8, 3], "rotation": 90.0})
    west = drcmitsuba.view_distances(turned, [EYE])
    assert west.sel(azimuth=270, elevation=0).item() == pytest.approx(12.0, rel=1e-5)


def test_cloth_and_walls_give_no_view():
    seen = drcmitsuba.view_distances(office("cloth"))
    assert seen.sizes["sensor"] == 4
    assert np.isnan(seen).all()
    for metric in (metrics.sight_angle, metrics.outside_distance, metrics.view_level):
        assert (metric(seen) == 0).all()


def fan(rows):
    """One point that looks by 8 azimuths and elevations −10, 0 and 10."""
    return xr.DataArray(
        np.array(rows, float)[None],
        {"azimuth": np.arange(8) * 45.0, "elevation": [-10.0, 0.0, 10.0]},
        ("sensor", "azimuth", "elevation"),
    )


def test_counts_by_hand():
    nan, inf = np.nan, np.inf
    seen = fan([[nan] * 3] * 5 + [[5, 6, nan], [nan, 20, inf], [nan, nan, 50]])
    assert metrics.sight_angle(seen).item() == 3 * 45
    assert metrics.outside_distance(seen).item() == 20
    assert metrics.view_layers(seen).values.ravel().tolist() == [True, True, False]
    assert metrics.view_level(seen).item() == 2  # 20 m is a tie, 135° wide, two layers
    assert metrics.view_level(seen.where(seen != 20, 19.9)).item() == 1
    sky = fan([[nan, nan, inf]] + [[nan] * 3] * 7)
    assert metrics.view_level(sky).item() == 0  # no landscape


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda d: d.isel(elevation=0), "give sensor, azimuth, elevation"),
        (lambda d: d.isel(azimuth=slice(0, 5)), "give them all around"),
        (lambda d: d.drop_vars("azimuth"), "give both in degrees"),
        (lambda d: d.assign_coords(elevation=[0.0, 60.0, 120.0]), "give -90 to 90 degrees"),
        (lambda d: d - 1e9, "give metres"),
        (lambda d: d.values, "give an xarray DataArray"),
    ],
)
def test_unfit_rays_are_refused(change, line):
    seen = fan([[1.0, 2.0, 3.0]] * 8)
    for metric in (metrics.sight_angle, metrics.view_level):
        with pytest.raises(drcmitsuba.InputError, match=line):
            metric(change(seen))


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ({"points": [(9, 9, 9)]}, "wall of the room"),
        ({"points": [(1, 1)]}, "give x, y and z"),
        ({"points": [(np.nan, 1, 1)]}, "give x, y and z"),
        ({"azimuths": 1}, "4 to 3600"),
        ({"elevations": [95]}, "less than 90"),
        ({"elevations": []}, "1 to 180"),
    ],
)
def test_unfit_points_and_angles_are_refused(arguments, line):
    with pytest.raises(drcmitsuba.InputError, match=line):
        drcmitsuba.view_distances(office(), **arguments)
