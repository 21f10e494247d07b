"""New windows in walls with an inner and an outer face, against windows that are drawn by hand.

A room of 4 m by 6 m by 3 m stands in a shell of brick, 0.3 m outside of it. What the search knows
of its tiles, what a table of windows draws, and what a file of Radiance draws with holes in both
faces and reveals between them, have to be one light.
"""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import drcmitsuba
from drcmitsuba.design.model_layout import ModelLayout
from drcmitsuba.design.model_windows import panes_of
from drcmitsuba.runtime import backend
from tests.system.test_windows_of_models import CASE, compare_with_windows
from tests.unit.model import box_room as box

MATERIALS = """void plastic floor 0 0 5 .2 .2 .2 0 0
void plastic plaster 0 0 5 .6 .6 .6 0 0
void plastic brick 0 0 5 .3 .3 .3 0 0
void glass glass 0 0 3 .72 .72 .72
"""
DEEP = 0.3
FINER = {"replicates": 4, "paths": 256}
WINDOW = [[1, 0, 2.5], [3, 0, 2.5], [3, 0, 1], [1, 0, 1]]
"""Corners of a window in the southern wall [m], front to the room."""


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def polygon(material, name, *rings):
    """Polygon with holes, to which seams lead."""
    corners = [*rings[0]]
    for hole in rings[1:]:
        corners += [rings[0][0], *hole, hole[0]]
    corners += [rings[0][0]] if len(rings) > 1 else []
    numbers = " ".join(f"{x:g}" for corner in corners for x in corner)
    return f"{material} polygon {name} 0 0 {3 * len(corners)} {numbers}\n"


def shell(x, y, z, materials, holes=()):
    """Text of a box between corners [m]; the holes are those of its southern side."""
    low = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])]
    floor, walls, ceiling = materials
    text = polygon(floor, f"{walls}_f", [(*p, z[0]) for p in low])
    text += polygon(ceiling, f"{walls}_c", [(*p, z[1]) for p in low])
    for k in range(4):
        a, b = low[k], low[(k + 1) % 4]
        ring = [(*a, z[0]), (*b, z[0]), (*b, z[1]), (*a, z[1])]
        text += polygon(walls, f"{walls}_{k}", ring, *(holes if k == 0 else ()))
    return text


def room(folder, window=False, more=""):
    """Case of the room, with a window by hand if wanted."""
    inner = [WINDOW] if window else []
    outer = [[(x, y - DEEP, z) for x, y, z in ring] for ring in inner]
    d = DEEP
    text = MATERIALS
    text += shell((0, 4), (0, 6), (0, 3), ("floor", "plaster", "plaster"), inner)
    text += shell((-d, 4 + d), (-d, 6 + d), (-d, 3 + d), ("brick",) * 3, outer)
    if window:
        text += polygon("glass", "w", WINDOW)
        for k in range(4):
            a, b = WINDOW[k], WINDOW[(k + 1) % 4]
            ring = [a, b, (b[0], -d, b[2]), (a[0], -d, a[2])]
            text += polygon("brick", f"reveal{k}", ring)
    (folder / "room.rad").write_text(text)
    grid = CASE[CASE.index("corner") : CASE.index("[metrics]")]
    tables = CASE.replace(grid, 'floors = ["floor"]\nspacing = 1.0\n').format(**FINER)
    tables = tables.replace("months = [3]", "months = [12]")
    tables += f'[model]\nfiles = ["room.rad"]\n{more}'
    (folder / "case.toml").write_text(tables)
    return drcmitsuba.load_case(folder / "case.toml")


def test_a_table_of_windows_draws_what_is_drawn_by_hand(tmp_path):
    header = "window,material," + ",".join(f"{a}{k}" for k in range(1, 5) for a in "xyz")
    corners = ",".join(f"{x:g}" for corner in WINDOW for x in corner)
    (tmp_path / "windows.csv").write_text(f"{header},depth\n0,glass,{corners},{DEEP}\n")
    results = []
    for window in (False, True):
        more = "" if window else 'windows = "windows.csv"\n'
        case = room(tmp_path, window, more)
        results.append(drcmitsuba.evaluate(case.with_tables(design=None)).illuminance)
    for name in ("total_open", "direct_sun"):
        a, b = (E[name].values for E in results)
        error = np.hypot(*(E[f"{name}_se"].values for E in results))
        assert a.mean() == pytest.approx(b.mean(), rel=0.01), name
        assert (np.abs(a - b) > 6 * error + 0.01 * b + 1e-3).mean() < 0.01, name
    assert results[0].total_open.mean() > 100


@pytest.fixture(scope="module")
def layout(tmp_path_factory):
    """Layout of a search over the southern wall, four tiles."""
    backend.select()
    return ModelLayout.of(room(tmp_path_factory.mktemp("deep")))


def test_panes_of_a_composition_keep_within_their_tiles(layout):
    """Film above clear glass in the lower tiles, clear glass in the upper ones, by halves."""
    walls = layout.openings.walls
    share = np.array([[0, 0.5, 0.5], [0, 0.5, 0.5], [0.5, 0.5, 0], [0, 1, 0]])
    panes = panes_of(walls, share, ("wall", "glass", "opal"), "opal")
    assert sum(pane.shape.area for pane in panes) == pytest.approx(7)
    assert [pane.depth for pane in panes] == pytest.approx([DEEP] * len(panes))
    for pane in panes:
        (own,) = [t for t in walls.tiles if t.shape.intersection(pane.shape).area > 1e-3]
        assert own.shape.buffer(1e-6).contains(pane.shape)
    drawn = walls.with_windows(walls.windows(panes)).building
    assert box.area_of(drawn.layers)["plaster", "surface"] == pytest.approx(84 - 7)


@pytest.mark.slow
def test_shares_are_windows_that_are_drawn_in_both_faces(layout):
    walls = layout.openings.walls
    assert walls.area == pytest.approx(12)  # by the inner face
    assert [tile.depth for tile in walls.tiles] == pytest.approx([DEEP] * 4)
    year = layout.year()
    closed = np.array([[name == "wall" for name in year.materials]] * 4, np.float32)
    dark = year.illuminance(mi.TensorXf(closed))
    assert dr.all(dark.open.array == 0)  # the sun on outer reveals does not shine in
    compare_with_windows(layout, year)
