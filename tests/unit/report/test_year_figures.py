"""Further pictures: what is drawn are the arrays' values, at their places and times."""

import numpy as np
import pandas as pd
import pvlib
import pytest
import xarray as xr
from matplotlib.colors import LogNorm
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from drcmitsuba.report import glare_plots, plots
from drcmitsuba.report.section import sensors_along, through_middle
from drcmitsuba.report.sun_path import radius
from drcmitsuba.report.temporal_map import day_by_hour
from drcmitsuba.report.year_figures import site_of, year_figures
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.nearest_sensors import nearest_sensors
from drcmitsuba.sky.weather import Site
from tests.unit.report.test_figures import case_of, said, year_of
from tests.unit.report.test_plots import grid, sensors

GENEVA = Site("Geneva", 46.2, 6.1, 1.0, 0.0)


def hours(*stamps):
    return np.array(stamps, "datetime64[ns]")


def of_time(values, time):
    attrs = {"long_name": "illuminance", "units": "lx"}
    return xr.DataArray(np.asarray(values, float), {"time": time}, ("time",), "E", attrs)


def weekdays():
    """Value of every hour from 8 to 18 h of the weekdays of a year: its own number."""
    time = pd.date_range("2015-01-01", "2015-12-31 23:00", freq="h")
    time = time[(time.hour >= 8) & (time.hour < 18) & (time.day_of_week < 5)]
    return of_time(np.arange(len(time)), time.values)


# ---- temporal maps ----------------------------------------------------------------------------


def test_a_cell_of_a_temporal_map_holds_the_value_of_its_hour():
    values = weekdays()
    ax = plots.temporal_map(values)
    cells = ax.images[0].get_array()
    assert cells.shape == (10, 261)
    days = np.unique(values["time"].values.astype("datetime64[D]"))
    for i in (0, 1, 1234, 2609):
        stamp = pd.Timestamp(values["time"].values[i])
        assert cells[stamp.hour - 8, np.searchsorted(days, stamp.normalize().to_datetime64())] == i
    assert np.sort(cells.compressed()).tolist() == np.arange(2610).tolist()
    assert ax.images[0].get_extent() == [0, 261, 8, 18]


def test_labels_stand_at_the_first_day_of_each_month():
    values = weekdays()
    ax = plots.temporal_map(values)
    days = np.unique(values["time"].values.astype("datetime64[D]"))
    names = [text.get_text() for text in ax.get_xticklabels()]
    assert [names[0], names[6], names[11]] == ["Jan", "Jul", "Dec"]
    assert [str(days[int(at)]) for at in ax.get_xticks()[[0, 1, 7]]] == [
        "2015-01-01", "2015-02-02", "2015-08-03"
    ]  # fmt: skip


def test_half_hours_have_cells_of_their_own_and_gaps_stay_blank():
    values = of_time(
        [1, 2, 3, np.nan], hours("2015-03-01T08", "2015-03-01T08:30", "2015-03-03T09:30",
                                 "2015-03-03T08"),
    )  # fmt: skip
    days, minutes, cells = day_by_hour(values)
    assert [str(day) for day in days] == ["2015-03-01", "2015-03-03"]
    assert minutes.tolist() == [480, 510, 540, 570]
    np.testing.assert_array_equal(cells, [[1, np.nan], [2, np.nan], [np.nan, np.nan], [np.nan, 3]])
    ax = plots.temporal_map(values)
    assert ax.images[0].get_extent() == [0, 2, 8, 10]
    assert [text.get_text() for text in ax.get_xticklabels()] == ["1 Mar", "3 Mar"]
    assert said(ax.figure).count("illuminance [lx]") == 1


def test_irregular_stamps_have_cells_that_are_seen():
    values = of_time([1, 2, 3], hours("2015-03-01T09:07", "2015-03-01T12:30", "2015-03-02T15:00"))
    _, minutes, cells = day_by_hour(values)
    assert (np.isfinite(cells).sum(axis=0) * (minutes[1] - minutes[0])).tolist() == [120, 60]
    assert minutes[0] == 9 * 60 + 7
    assert minutes[-1] + 1 == 16 * 60


def test_values_beyond_a_scale_take_the_colour_of_its_end_and_the_bar_says_so():
    ax = plots.temporal_map(weekdays(), norm=LogNorm(10, 1000))
    cells, bar = ax.images[0].get_array(), ax.images[0].colorbar
    assert (cells.min(), cells.max(), cells.mask.sum()) == (10, 1000, 0)
    assert bar.extend == "both"


def test_a_map_of_glare_is_a_temporal_map_in_classes():
    values = weekdays() / 2610
    image = glare_plots.year(values).axes[0].images[0]
    np.testing.assert_array_equal(
        image.get_array(), plots.temporal_map(values).images[0].get_array()
    )
    classes = [image.norm(v) for v in (0.2, 0.349, 0.351, 0.41, 0.46)]
    assert classes == [0, 0, 1, 2, 3]


# ---- sections ---------------------------------------------------------------------------------


def test_a_section_shows_the_values_of_the_sensors_on_it_and_their_interval():
    values = grid(4, 6)
    error = values / 50
    ax = plots.section(values, error, start=(0.75, 0), end=(0.75, 3))
    at = np.flatnonzero(values["x"].values == 0.75)
    x, y = ax.lines[0].get_data()
    np.testing.assert_allclose(x, values["y"][at])
    np.testing.assert_array_equal(y, values[at])
    band = ax.collections[0].get_paths()[0].vertices
    low = values[at].values * (1 - 1.959964 / 50)
    for place, value in zip(values["y"].values[at], low, strict=True):
        assert np.abs(band - [place, value]).sum(axis=1).min() < 1e-5
    assert ax.get_ylabel() == "illuminance [lx]"


def test_a_section_between_rows_takes_each_place_once_and_a_turned_one_measures_along_itself():
    values = grid(4, 6)
    at, distance = sensors_along(values, (0.6, 0), (0.6, 3))
    assert set(values["x"].values[at]) == {0.75}
    np.testing.assert_allclose(distance, np.arange(6) * 0.5 + 0.25)
    at, distance = sensors_along(values, (0, 0), (2, 2))
    np.testing.assert_allclose(distance, np.hypot(0.25, 0.25) + np.arange(4) * np.hypot(0.5, 0.5))
    np.testing.assert_allclose(values["x"].values[at], values["y"].values[at])


def test_the_middle_line_goes_from_the_first_sensor_to_the_last():
    start, end = through_middle(grid(3, 6), (0, 2))
    np.testing.assert_allclose([start, end], [[0.75, 0.25], [0.75, 2.75]])


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (((1, 1), (1, 1)), "give two places"),
        (((0, np.nan), (1, 1)), "give two places"),
        (((9, 0), (9, 3)), r"no sensor from 9, 0 to 9, 3; .*one stands at 1.75, "),
    ],
)
def test_a_line_without_sensors_is_refused(line, message):
    with pytest.raises(InputError, match=message):
        plots.section(grid(4, 6), start=line[0], end=line[1])


# ---- mountains and contours -------------------------------------------------------------------


def faces(values):
    """Mean of the corners of the faces between the sensors of a 4 × 5 grid, without gaps."""
    z = values.values.reshape(5, 4)
    return np.nanmean([z[1:, 1:], z[1:, :-1], z[:-1, 1:], z[:-1, :-1]], axis=0).ravel()


def test_a_mountain_is_as_high_as_the_values():
    values = grid(4, 5)
    ax = plots.mountain(values)
    (surface,) = (c for c in ax.collections if isinstance(c, Poly3DCollection))
    np.testing.assert_allclose(surface.get_array(), faces(values))
    assert ax.get_zlim() == (0, float(values.max()))
    assert ax.get_xlim()[0] <= 0.25 < 1.75 <= ax.get_xlim()[1]


def test_a_gap_is_a_gap_in_the_mountain_and_scattered_sensors_are_refused():
    values = grid(4, 5)
    values[5] = np.nan  # four faces lose a corner
    (surface,) = plots.mountain(values).collections
    np.testing.assert_allclose(surface.get_array(), faces(values))
    x, y = np.random.default_rng(1).random((2, 9))
    with pytest.raises(InputError, match="no grid of rows and columns; draw a plan"):
        plots.mountain(sensors(x, y))


def test_contours_run_where_the_interpolated_value_is_theirs():
    values = grid(5, 6)  # 100 + 40 x + 300 y
    figure = plots.plan(values, contours=(200, 400, 700))
    (lines,) = (c for c in figure.axes[0].collections if hasattr(c, "levels"))
    assert lines.levels.tolist() == [200, 400, 700]
    for level, path in zip(lines.levels, lines.get_paths(), strict=True):
        x, y = path.vertices.T
        assert len(x) >= 2
        np.testing.assert_allclose(100 + 40 * x + 300 * y, level)


# ---- suns -------------------------------------------------------------------------------------


def test_suns_stand_where_pvlib_has_them_and_those_of_the_shade_are_marked():
    time = np.arange("2015-01-01", "2016-01-01", 7, dtype="datetime64[h]").astype("datetime64[ns]")
    closed = xr.DataArray(np.arange(len(time)) % 3 == 0, {"time": time}, ("time",))
    ax = plots.sun_path(closed, GENEVA, sun_time="instant")
    stamps = pd.DatetimeIndex(time).tz_localize("Etc/GMT-1")
    at = pvlib.solarposition.get_solarposition(stamps, 46.2, 6.1, altitude=0)
    for name, which in (("open", ~closed.values), ("closed", closed.values)):
        (dots,) = (c for c in ax.collections if str(c.get_label()).startswith(f"shade {name}"))
        seen = at[which & (at["zenith"].values < 90)]
        drawn = dots.get_offsets()
        assert len(drawn) == len(seen) > 200
        np.testing.assert_allclose(drawn[:, 0], np.radians(seen["azimuth"]), atol=1e-6)
        np.testing.assert_allclose(drawn[:, 1], np.tan(np.radians(seen["zenith"]) / 2), atol=1e-6)
        assert dots.get_label() == f"shade {name}: {len(seen)} h with the sun up"
    assert (ax.get_theta_offset(), ax.get_theta_direction()) == (np.pi / 2, -1)


def test_heights_of_the_rings_are_those_of_the_projection():
    ax = plots.sun_path(xr.zeros_like(weekdays(), dtype=bool), GENEVA)
    rings = dict(zip([t.get_text() for t in ax.get_yticklabels()], ax.get_yticks(), strict=True))
    assert rings["30°"] == pytest.approx(np.tan(np.pi / 6))
    assert radius(90.0) == pytest.approx(1.0)


def test_suns_dots_in_the_dome_have_their_places_and_values():
    direction = np.array([[0, 0, -1.0]] + [[0, 0, 1.0]] * 145 + [[0.0, -1, 0], [1, 0, 1]])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    values = xr.DataArray(np.arange(148.0), dims="bin", attrs={"long_name": "C", "units": "sr"})
    ax = plots.sky_dome(values, xr.DataArray(direction, dims=("bin", "axis")))
    patches, suns = ax.collections[0], ax.collections[-1]
    assert patches.get_array().tolist() == list(range(146))
    np.testing.assert_allclose(suns.get_offsets(), [[0, -1], [0.5, 0]], atol=1e-12)
    assert suns.get_array().tolist() == [146, 147]


# ---- all of an evaluation ---------------------------------------------------------------------


def illuminance_of_a_year():
    case = case_of()
    E, numbers = year_of(case)
    E["total_se"] = E["total"] / 100
    closed = ("time", (E["direct_sun"] > 0).any("sensor").values)
    E.attrs |= {"latitude": 46.2, "longitude": 6.1, "timezone": 1.0}
    return case, E.assign_coords(shade_closed=closed), numbers


def test_an_evaluation_gets_pictures_that_name_case_place_period_and_metric():
    case, E, numbers = illuminance_of_a_year()
    drawn = year_figures(case, E, numbers, points=[(1.2, 1.3)])
    assert sorted(drawn) == [
        "illuminance_mountain.png", "illuminance_section.png", "illuminance_year.png",
        "illuminance_year_7.png", "sun_path.png",
    ]  # fmt: skip
    for name, figure in drawn.items():
        text = said(figure)
        for words in ("office", "Geneva.epw", "46.2° N, 6.1° E", "Jan–Dec"):
            assert words in text, name
    assert "[lx]" in said(drawn["illuminance_section.png"])
    mean = E["total"].mean("time")
    column = np.flatnonzero(E["x"] == E["x"][2])
    line = drawn["illuminance_section.png"].axes[0].lines[0].get_ydata()
    np.testing.assert_allclose(line, mean[column])  # from the glazing in the south inwards
    cells = drawn["illuminance_year_7.png"].axes[0].images[0].get_array()
    assert np.ma.mean(cells) == pytest.approx(float(mean[7]))
    suns = drawn["sun_path.png"].axes[0].collections
    assert sum(len(c.get_offsets()) for c in suns) > 0


def test_points_far_from_sensors_and_places_off_the_earth_are_refused():
    _, E, _ = illuminance_of_a_year()
    assert nearest_sensors(E, [(0.7, 0.7), (0.8, 0.7), (2.2, 1.3)], "x") == [0, 9]
    with pytest.raises(InputError, match=r"no sensor within 1 m of 40, 0.*one is at 3.25, "):
        nearest_sensors(E, [(40.0, 0.0)], "x")
    with pytest.raises(InputError, match="latitude: 91"):
        site_of("x", E.assign_attrs(latitude=91.0))
    assert site_of("x", E.drop_attrs()) is None


def test_a_single_sensor_and_sensors_of_a_wall_have_neither_mountain_nor_section():
    case, E, numbers = illuminance_of_a_year()
    normal = {"nx": 1.0, "ny": 0.0, "nz": 0.0}
    upright = {axis: ("sensor", [part] * 3) for axis, part in normal.items()}
    wall = E.isel(sensor=[0, 1, 2]).assign_coords(upright)
    for few in (E.isel(sensor=[3]), wall):
        assert sorted(year_figures(case, few, numbers)) == ["illuminance_year.png", "sun_path.png"]


def test_each_storey_has_a_section_of_its_own():
    case, E, numbers = illuminance_of_a_year()
    heights = (("sensor", np.full(E.sizes["sensor"], z)) for z in (0.8, 3.8))
    lower, upper = (E.assign_coords(z=z) for z in heights)
    both = xr.concat([lower, upper.assign(total=2 * E["total"])], "sensor", data_vars="minimal")
    x, y = (E[axis].values for axis in "xy")
    line = ((x[2], y.min()), (x[2], y.max()))
    drawn = year_figures(case, both, numbers, points=[(x[7], y[7], 3.8)], line=line)
    assert f"illuminance_year_{len(x) + 7}.png" in drawn
    one = E["total"].mean("time")[np.flatnonzero(x == x[2])]
    for k, factor in ((1, 1), (2, 2)):
        figure = drawn[f"illuminance_section_{k}.png"]
        np.testing.assert_allclose(figure.axes[0].lines[0].get_ydata(), factor * one)
        assert f"plan {k} of 2" in said(figure)
    with pytest.raises(InputError, match="no sensor from"):
        year_figures(case, both, numbers, line=((90.0, 0.0), (91.0, 0.0)))
