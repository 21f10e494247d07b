"""Façades cut into tiles: those of variants, and grids."""

import numpy as np
import pytest

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.facade_rectangles import FRAME, fill_at
from drcmitsuba.scene.panes_in_state import grouped_panes
from drcmitsuba.scene.shared_facades import refuse_unlike
from drcmitsuba.scene.surfaces import surfaces_of
from drcmitsuba.scene.tiled_facades import TiledFacades
from tests.tiled_room import MATERIALS, MIXED, PLAIN, room


def areas(quads):
    n = np.cross(quads[:, 1] - quads[:, 0], quads[:, 3] - quads[:, 0])
    return np.linalg.norm(n, axis=1)


def area_by_tile(tiled):
    return [float(np.prod(r[:, 1::2] - r[:, ::2], axis=1).sum()) for r in tiled.rectangles]


def area_of(tiled, variant, name):
    """Area of a fill in a variant [m²]."""
    shares = tiled.drawn[variant]
    return sum(
        area * shares[g][names.index(name)]
        for g, (names, area) in enumerate(zip(tiled.fills, area_by_tile(tiled), strict=True))
        if name in names
    )


def test_tiles_of_variants_are_what_they_have_in_common():
    cases = [room(PLAIN), room(MIXED)]
    tiled = TiledFacades.of_variants(cases)
    assert sum(area_by_tile(tiled)) == pytest.approx(4.0 * 1.8)
    assert len(tiled.fills) == 4
    assert [names[-1] for names in tiled.fills].count("shade") == 3  # glass or a hole in a variant
    for i, case in enumerate(cases):
        assert all(row.sum() == 1 for row in tiled.drawn[i].values())
        for name in ("glass", "fabric"):
            parts = [s.quads for s in surfaces_of(case) if s.name.startswith(name)]
            assert area_of(tiled, i, name) == pytest.approx(areas(np.concatenate(parts)).sum())


def test_equal_tiles_of_all_segments_are_one():
    tiled = TiledFacades.of_variants([room(PLAIN)])
    assert area_by_tile(tiled) == pytest.approx([3.6, 3.6])


@pytest.mark.parametrize("side", ["south", "east", "north", "west"])
@pytest.mark.parametrize("frame", [0.0, 0.1])
def test_tiles_and_the_wall_around_them_are_the_wall(side, frame):
    case = room(PLAIN, side, frame)
    tiled = TiledFacades.of_variants([case])
    length, height = case.room.wall(side)
    around = areas(tiled.panes.sides[side].wall).sum()
    assert around + sum(area_by_tile(tiled)) == pytest.approx(length * height)
    for name, word in ((FRAME, "frame"), ("glass", "glass")):
        quads = [s.quads for s in surfaces_of(case) if s.name.startswith(word)]
        drawn = areas(np.concatenate(quads)).sum() if quads else 0
        assert area_of(tiled, 0, name) == pytest.approx(drawn)
    assert (area_of(tiled, 0, FRAME) > 0) == (frame > 0)


def test_windows_of_all_sides_are_tiles():
    facade = {side: {"strips": PLAIN} for side in ("south", "west")}
    tiled = TiledFacades.of_variants([room(PLAIN, facade=facade)])
    assert sorted(tiled.panes.states.names) == ["south 0", "south 1", "west 0", "west 1"]
    assert set(tiled.panes.sides) == {"south", "west"}


def test_every_tile_of_a_grid_may_have_every_fill():
    facade = {side: {"strips": PLAIN} for side in ("south", "west")}
    case = room(PLAIN, facade=facade)
    heights = np.array([0.9, 1.8, 2.7])
    tiled = TiledFacades.of_grid(case, "south", heights, 3, ("wall", "glass", "fabric"))
    assert tiled.fills[:6] == (("wall", "glass", "fabric", "shade"),) * 6
    assert area_by_tile(tiled)[:6] == pytest.approx([4 / 3 * 0.9] * 6)
    np.testing.assert_allclose(tiled.rectangles[4], [[4 / 3, 8 / 3, 1.8, 2.7]])
    assert areas(tiled.panes.sides["south"].wall).sum() == pytest.approx(4 * (0.9 + 0.3))
    # The other side stays as drawn: its glass may have the shade before it, its fabric not.
    assert sorted(tiled.fills[6:]) == [("fabric",), ("glass", "shade")]
    assert all(tiled.drawn[0][g][0] == 1 for g in range(8))


def test_a_grid_as_high_as_its_wall_has_no_wall_around_it():
    tiled = TiledFacades.of_grid(room(PLAIN), "south", np.array([0.0, 3.0]), 1, ("wall", "glass"))
    assert len(tiled.panes.sides["south"].wall) == 0
    quads = grouped_panes(tiled.case, groups=tiled.panes)
    assert sum(areas(each.quads).sum() for each in quads) == pytest.approx(12.0)


def test_fills_at_points():
    case = room(MIXED, frame=0.1)
    x, z = np.array([1.0, 3.0, 1.0, 3.0, 0.02, 1.0]), np.array([1.2, 1.2, 2.0, 2.0, 1.2, 0.4])
    names = fill_at(case.facade["south"], 4.0, x, z)
    assert list(names) == ["glass", "wall", "hole", "fabric", FRAME, "wall"]


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"room": {"size": [4.0, 6.0, 3.0]}}, "room"),
        ({"sensors": {"corner": [0.5, 0.5, 0.7], "count": [3, 4], "spacing": 1.0}}, "sensors"),
        ({"materials": MATERIALS | {"glass": {"type": "glazing", "transmittance": 0.5}}}, "glass"),
    ],
)
def test_variants_that_differ_in_more_are_refused(change, field):
    with pytest.raises(InputError, match=field):
        refuse_unlike([room(PLAIN), room(MIXED, **change)])


def test_variants_of_one_name_and_two_materials_are_refused():
    """Also where the first case knows no such material."""
    other = MATERIALS | {"fabric": {"type": "diffuser", "transmittance": 0.9}}
    clear = [{"bottom": 0.9, "top": 1.8, "material": "glass"}]
    first = room(clear, materials={k: m for k, m in MATERIALS.items() if k != "fabric"})
    with pytest.raises(InputError, match="another material of this name"):
        refuse_unlike([first, room(PLAIN), room(PLAIN, materials=other)])


def test_frames_are_those_of_the_side_with_windows():
    facade = {
        "north": {"frame_reflectance": 0.0},
        "south": {"strips": PLAIN, "frame": 0.1, "frame_reflectance": 0.9},
    }
    tiled = TiledFacades.of_variants([room(PLAIN, facade=facade)])
    g = next(g for g, names in enumerate(tiled.fills) if names[0] == FRAME)
    assert tiled.panes.drawn[g].reflectance == 0.9


def test_cases_without_windows_are_refused():
    with pytest.raises(InputError, match="no window"):
        TiledFacades.of_variants([room([])])
