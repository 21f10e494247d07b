"""E as text: parsed back with six digits, each row at its time."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from drcmitsuba.export.tables import save_csv, save_ill

TIMES = np.array(["2015-01-31T23:00", "2015-02-01T00:00", "2016-02-29T12:30"], "datetime64[ns]")
VALUES = np.array([[0.0, 1234.5678], [1e5 / 3, 1e-3], [99999.96, 7.0]], np.float32)


@pytest.fixture
def E():
    at = {axis: ("sensor", [0.1 + i, 1 / 3 + i]) for i, axis in enumerate("xyz")}
    return xr.Dataset(
        {"total": (("time", "sensor"), VALUES)}, {"time": TIMES, **at}, {"step_hours": 1.0}
    )


def test_a_row_of_ill_has_its_date_and_the_middle_of_its_hour(E, tmp_path):
    save_ill(E, tmp_path / "e.ill")
    table = np.loadtxt(tmp_path / "e.ill")
    np.testing.assert_allclose(table[:, :3], [[1, 31, 23.5], [2, 1, 0.5], [2, 29, 13]])
    np.testing.assert_allclose(table[:, 3:], VALUES, rtol=5e-6)


@pytest.mark.parametrize(("sun_time", "hour"), [("middle", 23 + 1 / 12), ("instant", 23)])
def test_the_hour_is_that_of_the_sun(E, tmp_path, sun_time, hour):
    save_ill(E.assign_attrs(step_hours=1 / 6, sun_time=sun_time), tmp_path / "e.ill")
    assert np.loadtxt(tmp_path / "e.ill")[0, 2] == pytest.approx(hour, abs=6e-4)


def test_csv_comes_back_with_the_positions_of_the_sensors(E, tmp_path):
    save_csv(E, tmp_path / "e.csv")
    table = pd.read_csv(tmp_path / "e.csv", header=[0, 1, 2, 3], index_col=0)
    assert list(table.columns.get_level_values(0)) == ["sensor_0", "sensor_1"]
    for level, axis in enumerate("xyz", start=1):
        read = [float(v) for v in table.columns.get_level_values(level)]
        np.testing.assert_allclose(read, E[axis].values, rtol=1e-8)
    np.testing.assert_allclose(table.values, VALUES, rtol=5e-6)
    assert list(pd.to_datetime(table.index)) == list(pd.to_datetime(TIMES))


def test_colours_are_weighed_to_luminance(E, tmp_path):
    share = xr.DataArray([1.0, 2.0, 3.0], dims="channel")
    coloured = E.assign(total=(E["total"] * share).transpose("channel", ...))
    save_ill(coloured, tmp_path / "e.ill")
    weight = 0.2126 + 2 * 0.7152 + 3 * 0.0722
    np.testing.assert_allclose(np.loadtxt(tmp_path / "e.ill")[:, 3:], weight * VALUES, rtol=1e-5)
