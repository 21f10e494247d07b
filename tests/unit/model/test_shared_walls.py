"""Faces of two rooms in one place: their common and other parts, with the right fronts."""

import numpy as np
import pytest
import shapely

from drcmitsuba.model.plane import Plane
from drcmitsuba.model.polygon import area_vector
from drcmitsuba.model.shared_walls import RoomFace, sheets_of, single_panes, uncovered

TOLERANCE = 0.01


def wall(x, y, facing, z=(0.0, 3.0)):
    """Wall of a room over x (from, to) at y that faces out of it to the north (1) or south (−1)."""
    corners = [[x[0], y, z[0]], [x[1], y, z[0]], [x[1], y, z[1]], [x[0], y, z[1]]]
    ring = np.array(corners, float)
    return ring[::-1] if facing > 0 else ring


def area(rings):
    """Area [m²] and whether the polygon faces north."""
    whole = Plane.of(rings[0]).polygon(rings).area
    return whole, area_vector(rings[0])[1] > 0


def sums(sheets):
    """Area of each face, by what lies behind it."""
    out = {}
    for sheet in sheets:
        out[sheet.behind] = out.get(sheet.behind, 0) + area(sheet.rings)[0]
    return out


def test_a_corridor_has_a_side_for_each_of_its_rooms():
    corridor = RoomFace((wall((0, 9), 2, 1),), "corridor")
    rooms = [RoomFace((wall((x, x + 3), 2, -1, (0, top)),), f"{x}")
             for x, top in ((0, 3.0), (3, 3.0), (6, 2.5))]  # fmt: skip
    first, *others = sheets_of([corridor, *rooms], TOLERANCE)
    assert sums(first) == pytest.approx({1: 9.0, 2: 9.0, 3: 7.5, None: 1.5})
    assert others == [[], [], []]  # each lies behind the corridor's wall as a whole
    for sheet in first:  # shared parts face the corridor, the rest looks out of it
        assert area(sheet.rings)[1] == (sheet.behind is None)


def test_holes_stay_open_and_parts_may_be_many():
    """A room above with a hole over two rooms: what is left of them has its front as before."""

    def level(low, high, z, up):
        ring = np.array([[low[0], low[1], z], [high[0], low[1], z],
                         [high[0], high[1], z], [low[0], high[1], z]], float)  # fmt: skip
        return ring if up else ring[::-1]

    hole = level((3.5, 1.5), (4.5, 2.5), 3, False)
    floor = RoomFace((level((1, 1), (7, 3), 3, False), hole), "above")
    ceilings = [RoomFace((level((x, 0), (x + 4, 4), 3, True),), f"{x}") for x in (0, 4)]
    west, east, above = sheets_of([*ceilings, floor], TOLERANCE)
    for own in (west, east):
        assert sums(own) == pytest.approx({2: 5.5, None: 16 - 5.5})
        assert sum(area_vector(s.rings[0])[2] > 0 for s in own if s.behind is None) >= 1
    assert above == []


@pytest.mark.parametrize(
    "other",
    [
        wall((3, 6), 2, -1),  # beside it
        wall((0, 3), 2.05, -1),  # further away than the tolerance
        wall((0, 3), 2, 1),  # of the same side
    ],
)
def test_what_touches_nothing_stays_as_it_is(other):
    faces = [RoomFace((wall((0, 3), 2, 1),), "a"), RoomFace((other,), "b")]
    for face, sheets in zip(faces, sheets_of(faces, TOLERANCE), strict=True):
        assert len(sheets) == 1
        assert sheets[0].rings is face.rings
        assert sheets[0].behind is None


def test_random_faces_cover_what_they_covered():
    """Area by room is that of the faces, whatever overlaps; no two sheets overlap."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        faces = []
        for k in range(8):
            x, z = np.sort(rng.uniform(0, 6, 2)), np.sort(rng.uniform(0, 3, 2))
            facing = 1 if k % 2 else -1
            shape = wall((x[0], x[1] + 0.5), 2, facing, (z[0], z[1] + 0.5))
            faces.append(RoomFace((shape,), f"{k}"))
        sheets = sheets_of(faces, TOLERANCE)
        plane = Plane.of(wall((0, 1), 2, 1))
        for side in (0, 1):
            own = [f.rings for f in faces[side::2]]
            covered = shapely.union_all([plane.polygon(r) for r in own])
            parts = [s.rings for own in sheets[side::2] for s in own]
            parts += [s.rings for own in sheets[1 - side :: 2] for s in own if s.behind is not None]
            made = shapely.union_all([plane.polygon(r) for r in parts])
            assert covered.symmetric_difference(made).area < 0.05


def test_what_lies_on_others_is_left_out_there():
    """The part of a shade beside a wall in its plane remains; a shade apart stays as it is."""
    shade, apart = (wall((2, 5), 2, 1),), (wall((2, 5), 2.5, 1),)
    covers = [(wall((0, 3), 2, -1),), (wall((4, 4.5), 2, 1, (0, 1)),)]
    cut, whole = uncovered([shade, apart], covers, TOLERANCE)
    assert sum(area(rings)[0] for rings in cut) == pytest.approx(9 - 3 - 0.5)
    assert all(area(rings)[1] for rings in cut)
    assert whole[0] is apart
    assert uncovered([shade], [(wall((0, 9), 2, -1),)], TOLERANCE) == [[]]


def test_windows_of_two_rooms_in_one_place_are_one():
    """The second pane is 1 m further and 0.5 m higher: its part beyond the first one stays."""
    first, second = (wall((1, 3), 2, 1, (1, 2)),), (wall((2, 4), 2.004, -1, (1, 2.5)),)
    kept, parts = single_panes([first, second], [], TOLERANCE)
    assert kept == [first]
    assert sum(area(rings)[0] for rings in parts) == pytest.approx(3 - 1)
    assert not any(area(rings)[1] for rings in parts)
    assert single_panes([first, first], [], TOLERANCE)[1] == []
    beside = (wall((3, 4), 2, -1, (1, 2)),)
    assert single_panes([first, beside], [], TOLERANCE) == [[first], [beside]]


def test_a_window_that_looks_at_a_wall_is_left_out_there():
    """Its own wall has a hole where it is; the other room's wall ends in the middle of it."""
    pane = wall((1, 3), 2, 1, (1, 2))
    own = (wall((0, 4), 2, 1), pane)
    assert single_panes([(pane,)], [own], TOLERANCE) == [[(pane,)]]
    [left] = single_panes([(pane,)], [own, (wall((2, 6), 2, -1),)], TOLERANCE)
    assert [area(rings) for rings in left] == [(pytest.approx(1.0), True)]
