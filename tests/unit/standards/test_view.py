"""Levels of the view out at points, from distances that are known."""

import numpy as np
import pytest
import xarray as xr

from drcmitsuba import standards
from drcmitsuba.runtime.errors import InputError

ELEVATIONS = [-30.0, 0.0, 30.0]


def seen(*points):
    """Distances of points that see so many degrees, so far at the horizon, and as many layers."""
    out = np.full((len(points), 360, 3), np.nan)
    for i, (width, far, layers) in enumerate(points):
        out[i, :width, 1] = far
        if layers > 1:
            out[i, :width, 0] = np.inf
        if layers > 2:
            out[i, :width, 2] = np.inf
    coords = {"azimuth": np.arange(360.0), "elevation": ELEVATIONS}
    return xr.DataArray(out, coords, ("sensor", "azimuth", "elevation"))


def test_each_criterion_is_counted_by_itself_and_the_lowest_decides():
    out = standards.view_out(seen((60, 60.0, 3), (60, 10.0, 3), (20, 60.0, 3), (60, 60.0, 1)))
    assert out.share == {"minimum": 100.0, "medium": 25.0, "high": 25.0}
    assert out.criteria["width"] == {"minimum": 100.0, "medium": 75.0, "high": 75.0}
    assert out.criteria["distance"] == {"minimum": 100.0, "medium": 75.0, "high": 75.0}
    assert out.criteria["layers"] == {"minimum": 100.0, "medium": 75.0, "high": 75.0}
    assert out.median == {"width": 60.0, "distance": 60.0, "layers": 3.0}
    darker = standards.view_out(seen((60, 10.0, 3), (60, 5.9, 3)))
    assert darker.share == {"minimum": 50.0, "medium": 0.0, "high": 0.0}
    assert "what decides minimum: the distance, 50.0 % of the points" in darker.text()


def test_ties_pass_and_nothing_outside_is_without_end():
    out = standards.view_out(seen((14, 6.0, 1), (54, np.inf, 3)))
    assert out.share == {"minimum": 100.0, "medium": 50.0, "high": 50.0}
    assert out.median["distance"] == 6.0
    free = standards.view_out(seen((54, np.inf, 3)))
    assert free.to_dict()["median"]["distance"] is None
    assert "no end outside" in " ".join(free.text())


def test_points_without_a_view_have_no_level():
    out = standards.view_out(seen((0, 1.0, 1)))
    assert out.share == {"minimum": 0.0, "medium": 0.0, "high": 0.0}
    with pytest.raises(InputError, match="give an xarray DataArray"):
        standards.view_out(np.ones(3))
