"""Pictures: what is drawn where, that files are whole, and that no input makes text collide."""

import itertools
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PathCollection, QuadMesh
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.image import imread

from drcmitsuba.report import plots, style
from drcmitsuba.report.standing import DrawnParts
from drcmitsuba.report.tiles import SensorTiles
from drcmitsuba.runtime.errors import InputError


def sensors(x, y, values=None):
    x, y = np.ravel(x), np.ravel(y)
    values = 100.0 + 40 * x + 300 * y if values is None else values
    attrs = {"long_name": "illuminance", "units": "lx"}
    coords = {"x": ("sensor", x), "y": ("sensor", y)}
    return xr.DataArray(values, coords, ("sensor",), "E", attrs)


def grid(columns, rows, spacing=0.5):
    x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    return sensors(x * spacing, y * spacing)


def rectangle(width, depth):
    return np.array([[0, 0], [width, 0], [width, depth], [0, depth]])


def interval(value, half=2.0):
    return {"value": value, "low": max(0.0, value - half), "high": min(100.0, value + half)}


def year(sda=70.5, ase=34.2, msda=None):
    months = [interval(50.0 + 3 * m) for m in range(12)]
    return {
        "sDA": interval(sda),
        "ASE": interval(ase),
        "shade_closed": interval(41.3),
        "msDA": months if msda is None else msda,
        "MSE": months[::-1],
        "shade_closed_monthly": [interval(40.0)] * 12,
    }


def collection(figure, kind):
    return next((c for c in figure.axes[0].collections if isinstance(c, kind)), None)


def drawn_texts(figure):
    """Boxes [pixel] of all texts that show, after drawing."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    texts = [t for t in figure.findobj(lambda a: hasattr(a, "get_text")) if t.get_text().strip()]
    # An axis keeps tick labels beyond its limits, which it does not draw.
    ticks = {label for ax in figure.axes for axis in (ax.xaxis, ax.yaxis) for label in _all(axis)}
    shown = {label for ax in figure.axes for axis in (ax.xaxis, ax.yaxis) for label in _drawn(axis)}
    texts = [t for t in texts if t.get_visible() and (t not in ticks or t in shown)]
    return {t.get_text(): t.get_window_extent(canvas.get_renderer()) for t in texts}


def _all(axis):
    return [t for tick in (*axis.majorTicks, *axis.minorTicks) for t in (tick.label1, tick.label2)]


def _drawn(axis):
    low, high = sorted(axis.get_view_interval())
    ticks = [t for t in axis.get_major_ticks() if low <= t.get_loc() <= high]
    return [t.label1 for t in ticks]


def assert_texts_are_clear(figure):
    boxes = drawn_texts(figure)
    assert len(boxes) > 5
    width, height = figure.bbox.size
    for text, box in boxes.items():
        assert 0 <= box.x0 <= box.x1 <= width, text
        assert 0 <= box.y0 <= box.y1 <= height, text
    for (a, box_a), (b, box_b) in itertools.combinations(boxes.items(), 2):
        assert not box_a.overlaps(box_b), f"{a!r} lies on {b!r}"


# ---- plan ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("columns", "rows"), [(24, 24), (5, 7), (1, 6), (2, 1)])
def test_grid_becomes_tiles_with_the_values_in_place(columns, rows):
    E = grid(columns, rows)
    shuffled = E.isel(sensor=np.random.default_rng(1).permutation(E.size))
    mesh = collection(plots.plan(shuffled), QuadMesh)
    corners = mesh.get_coordinates()
    middle = (corners[1:, 1:] + corners[:-1, :-1]).reshape(-1, 2) / 2
    at = np.lexsort((middle[:, 0], middle[:, 1]))
    np.testing.assert_allclose(middle[at], np.column_stack([E.x, E.y]), atol=1e-9)
    np.testing.assert_allclose(np.ravel(mesh.get_array())[at], E.values)


def test_turned_grid_becomes_tiles():
    E, angle = grid(6, 4), np.radians(25)
    turned = sensors(
        E.x * np.cos(angle) - E.y * np.sin(angle),
        E.x * np.sin(angle) + E.y * np.cos(angle),
        E.values,
    )
    mesh = collection(plots.plan(turned), QuadMesh)
    corners = mesh.get_coordinates()
    assert mesh.get_array().size == 24
    sides = np.linalg.norm(np.diff(corners, axis=0), axis=-1)
    np.testing.assert_allclose(sides, 0.5)


def test_gap_in_a_grid_stays_empty():
    E = grid(6, 6)
    mesh = collection(plots.plan(E.where(~((E.x > 2) & (E.y > 2)), drop=True)), QuadMesh)
    assert mesh.get_array().size == 36
    assert np.ma.count_masked(mesh.get_array()) == 4


def test_a_gap_holds_no_number_that_colours_could_overflow_with(monkeypatch):
    """Masked entries are coloured before they are hidden; memory that none wrote holds anything."""
    empty = np.empty

    def huge(*arguments, **options):
        made = empty(*arguments, **options)
        made.fill(1e308 if made.dtype.kind == "f" else 0)
        return made

    x, y = (np.delete(a.ravel(), 5) for a in np.meshgrid(range(4), range(3)))
    tiles = SensorTiles.of(1.0 * x, 1.0 * y)
    monkeypatch.setattr(np, "empty", huge)
    assert (tiles.grid(np.ones(11)).data <= 1).all()


def test_scattered_sensors_become_discs():
    rng = np.random.default_rng(2)
    E = sensors(rng.uniform(0, 9, 40), rng.uniform(0, 8, 40))
    discs = collection(plots.plan(E), PathCollection)
    np.testing.assert_allclose(discs.get_offsets(), np.column_stack([E.x, E.y]))
    np.testing.assert_allclose(discs.get_array(), E.values)


def test_one_sensor(tmp_path):
    figure = plots.plan(sensors([1.5], [2.5], [1723.0]), room=[rectangle(3, 5)])
    assert "1723" in drawn_texts(figure)
    assert imread(plots.save(figure, tmp_path / "one.png"))[..., :3].std() > 0.02


def test_values_of_sensors_that_do_not_face_up_are_legible_on_paper():
    E = sensors([1.0, 2.5], [1.0, 1.0], [100.0, 900.0])
    for axis, part in {"nx": 1.0, "ny": 0.0, "nz": 0.0}.items():
        E = E.assign_coords({axis: ("sensor", [part] * 2)})
    written = {t.get_text(): t for t in plots.plan(E).axes[0].texts}
    for number in ("100", "900"):
        assert written[number].get_color() == style.INK
        assert written[number].get_path_effects()


def test_colour_scale():
    E = grid(5, 7)
    own = LogNorm(200, 900)
    bar = plots.plan(E, norm=own).axes[1]
    assert bar.get_ylim() == pytest.approx((200, 900))
    assert (own.vmin, own.vmax) == (200, 900)
    assert "illuminance [lx]" in drawn_texts(plots.plan(E))
    assert "hours [%]" in drawn_texts(plots.plan(E, label="hours [%]", norm=Normalize(0, 100)))


@pytest.mark.parametrize("value", [0.0, 5.0, np.nan])
def test_plan_of_one_value_everywhere(value, tmp_path):
    E = grid(3, 3)
    figure = plots.plan(E.copy(data=np.full(9, value)))
    mesh = collection(figure, QuadMesh)
    assert mesh.norm.vmin == 0
    assert mesh.norm.vmax == (value if value > 0 else 1)
    assert np.ma.count_masked(mesh.get_array()) == 9 * np.isnan(value)
    assert mesh.get_array().compressed().tolist() == [value] * 9 * (not np.isnan(value))
    assert imread(plots.save(figure, tmp_path / "same.png"))[..., :3].std() > 0.02


def test_a_name_hides_the_labels_of_contours_under_it():
    values = grid(9, 9)
    values[:] = 100.0 * values["y"].values / values["y"].values.max()
    shown = []
    for texts in ({}, {"": "a long name\nof a room"}):
        figure = plots.plan(values, contours=(25, 50, 75), texts=texts)
        written = [text for text in figure.axes[0].texts if text.get_text() in ("25", "50", "75")]
        shown.append([text.get_text() for text in written if text.get_visible()])
    assert sorted(shown[0]) == ["25", "50", "75"]
    assert sorted(shown[1]) == ["25", "75"]


def test_plan_refuses_what_is_no_plan():
    E = grid(3, 3)
    with pytest.raises(InputError, match="dims"):
        plots.plan(E.expand_dims(time=2))
    with pytest.raises(InputError, match="plan: y"):
        plots.plan(E.drop_vars("y"))


@pytest.mark.parametrize(("columns", "rows"), [(24, 24), (5, 7), (30, 2), (2, 30), (1, 1)])
def test_plan_is_readable(columns, rows):
    room = rectangle(columns / 2, rows / 2)
    title = "Classroom, existing façade: mean illuminance from 8 to 18 h, five-day weeks, Geneva"
    lines = {"room": [room], "furniture": [room / 3], "glazing": [room[:2]]}
    figure = plots.plan(grid(columns, rows), title=title, **lines)
    assert_texts_are_clear(figure)
    assert {"N", "room", "furniture", "glazing"} <= set(drawn_texts(figure))
    assert figure.axes[0].get_aspect() == 1.0


# ---- monthly ---------------------------------------------------------------------------------


@pytest.mark.parametrize("sda", [0.0, 3.0, 13.0, 54.0, 76.0, 100.0])
def test_monthly_is_readable(sda):
    figure = plots.monthly(year(sda=sda, ase=100 - sda), title="Classroom, existing façade")
    texts = drawn_texts(figure)
    assert {f"{sda:.1f} %", f"{100 - sda:.1f} %"} <= set(texts)
    assert_texts_are_clear(figure)


def test_monthly_draws_the_numbers():
    left, right = plots.monthly(year()).axes
    assert [bar.get_height() for bar in left.patches] == [70.5, 34.2]
    whiskers = [c.get_segments()[0] for c in left.collections]
    np.testing.assert_allclose([w[:, 1] for w in whiskers], [[68.5, 72.5], [32.2, 36.2]])
    lines = dict(zip(("msDA", "MSE", "shade"), right.get_lines(), strict=True))
    np.testing.assert_allclose(lines["msDA"].get_ydata(), 50.0 + 3 * np.arange(12))
    assert [line.get_linestyle() for line in lines.values()] == ["-", "-", "--"]
    assert right.get_ylim() == left.get_ylim() == (0, 100)
    assert "shade closed for 41.3 % of the year's hours" in drawn_texts(left.figure)


def test_month_without_hours_breaks_the_line():
    months = [None if m == 4 else interval(60.0) for m in range(12)]
    line = plots.monthly(year(msda=months)).axes[1].get_lines()[0]
    assert np.flatnonzero(np.isnan(line.get_ydata())).tolist() == [4]
    assert np.isnan(plots.monthly(year(msda=[None] * 12)).axes[1].get_lines()[0].get_ydata()).all()


# ---- files -----------------------------------------------------------------------------------


def test_save_writes_a_png_and_nothing_else(tmp_path):
    path = tmp_path / "year.png"
    path.write_text("older")
    assert plots.save(plots.monthly(year()), path) == path
    assert path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    picture = imread(path)
    assert picture.shape[:2] == (645, 1440)
    assert picture[..., :3].std() > 0.05
    assert [p.name for p in tmp_path.iterdir()] == ["year.png"]
    assert plots.save(plots.monthly(year()), tmp_path / "office v1.2").is_file()
    with pytest.raises(InputError, match="of another format than PNG"):
        plots.save(plots.monthly(year()), tmp_path / "year.pdf")


def test_save_that_fails_keeps_the_older_file(tmp_path, monkeypatch):
    path = tmp_path / "year.png"
    path.write_text("older")

    def full_disk(pixels, part):
        part.write_bytes(b"half")
        raise OSError("no space left on device")

    monkeypatch.setattr(style, "write", full_disk)
    with pytest.raises(OSError, match="no space"):
        plots.save(plots.monthly(year()), path)
    with pytest.raises(OSError, match="no space"):
        plots.save_all({"year.png": plots.monthly(year())}, tmp_path)
    assert path.read_text() == "older"
    assert [p.name for p in tmp_path.iterdir()] == ["year.png"]


def test_figures_that_are_saved_together_are_the_files_of_each(tmp_path):
    figures = {f"{month}.png": plots.monthly(year(), title=f"month {month}") for month in (1, 2, 3)}
    shares = []
    saved = plots.save_all(figures, tmp_path, shares.append)
    assert saved == [tmp_path / name for name in figures]
    for name, figure in figures.items():
        assert (tmp_path / name).read_bytes() == plots.save(figure, tmp_path / "one").read_bytes()
    np.testing.assert_allclose(shares, [1 / 3, 2 / 3, 1])


def test_a_picture_is_as_large_as_its_figure_whatever_the_user_set(tmp_path):
    with rc_context({"savefig.bbox": "tight"}):
        path = plots.save(plots.monthly(year()), tmp_path / "year.png")
    assert imread(path).shape[:2] == (645, 1440)


def test_a_picture_does_not_replace_a_folder(tmp_path):
    with pytest.raises(IsADirectoryError):
        plots.save(Figure(), tmp_path)
    assert tmp_path.is_dir()


def test_nothing_global_is_touched():
    code = "import sys, drcmitsuba.report.plots; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.slow
def test_standing_parts_that_another_figure_drew_leave_every_pixel_as_it_is(tmp_path):
    wide, deep = grid(6, 4), grid(4, 6)
    figures = {
        "high.png": plots.plan(wide, title="high", caption="a", limit=500),
        "low.png": plots.plan(0.5 * wide, title="low", caption="b", limit=500, contours=(200,)),
        "free.png": plots.plan(wide, title="low", caption="b"),
        "deep.png": plots.plan(deep, title="deep", caption="c", limit=500, limit_label="level"),
        "year.png": plots.monthly(year(), title="year"),
        "other.png": plots.monthly(year() | {"sDA": year()["ASE"]}, title="other", shade=False),
        "last.png": plots.monthly(year() | {"sDA": year()["ASE"]}, title="last", rated=True),
    }
    drawn = DrawnParts()
    for name, figure in figures.items():
        for folder in ("first", "again"):
            plots.save_all({name: figure}, tmp_path / folder, drawn=drawn)
            whole = plots.save(figure, tmp_path / "whole.png").read_bytes()
            assert (tmp_path / folder / name).read_bytes() == whole
