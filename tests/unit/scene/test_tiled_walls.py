"""Outer walls of models, cut into tiles: which walls, which pieces, and what is refused."""

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import drcmitsuba
from drcmitsuba.case.design import Design
from drcmitsuba.case.shading import Shading
from drcmitsuba.model.materials import DiffuserMaterial, Lambertian
from drcmitsuba.model.model import areas
from drcmitsuba.model.polygon import area_vector
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.leaks import crack_notes, refuse_leaks
from drcmitsuba.scene.like_panes import like_panes
from drcmitsuba.scene.panes_of_model import panes_of_model
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.space_walls import walls_of
from drcmitsuba.scene.tiled_walls import TiledWalls, WallPane
from tests import ROOT
from tests.model_rooms import GLASS, case_of, house, l_room, layer, prism
from tests.unit.model import box_room as box


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def design(**keys):
    return Design(film="opal", wwr=(0.1, 0.5), **keys)


def honeybee(folder, *rooms):
    box.written(folder, box.model(*rooms), "rooms.hbjson")
    text = '[model]\nfiles = ["rooms.hbjson"]\n[sensors]\nspaces = ["*"]\nspacing = 1.0\n'
    (folder / "case.toml").write_text(text)
    return drcmitsuba.load_case(folder / "case.toml")


def adjoining():
    """Two rooms of Honeybee with a wall between them."""
    west, east = box.room("Office"), box.room("Studio", shift=4.0)
    for room, face, other in ((west, 2, "Studio_West"), (east, 4, "Office_East")):
        names = [other, other.split("_")[0]]
        surface = {"type": "Surface", "boundary_condition_objects": names}
        room["faces"][face]["boundary_condition"] = surface
    return west, east


def walls_in_words(case):
    return sorted((wall.space, wall.facing) for wall in walls_of(case))


def test_a_wall_is_cut_by_its_grid_and_its_panes_stay(tmp_path):
    """The room's southern wall, 4 m by 3 m, has a window from 1 m to 3 m and from 1 m to 2 m."""
    case = honeybee(tmp_path, box.room("Room"))
    tiled = TiledWalls.of(case, design(side="south"), 3, 4)
    assert tiled.area == pytest.approx(12)
    assert tiled.openings == pytest.approx(2)
    assert len(tiled.tiles) == 10  # two of twelve are window altogether
    assert [tile.shape.area for tile in tiled.tiles] == pytest.approx([1.0] * 10)
    assert tiled.tiles[0].name == "Room window 1"
    assert tiled.tiles[5].bounds == pytest.approx((3, 4, 1, 2))
    before, after = box.area_of(case.building.layers), box.area_of(tiled.case.building.layers)
    wall, pane = ("generic_wall_0.50", "surface"), ("generic_exterior_window_vis_0.64", "pane")
    assert after[wall] == pytest.approx(before[wall] - 10)
    assert after[pane] == before[pane]
    panes = panes_of_model(tiled.case.building)
    mine = np.isin(panes.layer, tiled.layers)
    assert panes.outside[mine].all()
    assert panes.front[mine] == pytest.approx(np.tile([0.0, 1.0, 0.0], (10, 1)))
    opened = [tiled.case.building.layers[i] for i in tiled.layers]
    assert {x.material for x in opened} == {Lambertian(0.5)}


def test_rooms_whose_names_are_nearly_alike_have_tiles_and_shades_of_their_own(tmp_path):
    rooms = box.room("one", display_name="A/1"), box.room("two", 5.0, display_name="A-1")
    case = honeybee(tmp_path, *rooms)
    tiles = TiledWalls.of(case, design(side="south"), 1, 1).tiles
    assert len({tile.name for tile in tiles}) == len(tiles) == 2
    fabric = DiffuserMaterial(type="diffuser", transmittance=0.1)
    shaded = case.with_tables(
        materials={**case.materials, "fabric": fabric},
        shading=Shading(material="fabric", groups="spaces"),
    )
    assert prepared(shaded).groups.states.names == ("A/1 south", "A-1 south")


def test_the_gable_of_the_page_is_cut_along_the_roof(tmp_path):
    """Six tiles between 0.9 m and 3.9 m, of which the roof cuts the upper three."""
    page = (ROOT / "docs" / "howto" / "sizing.md").read_text("utf-8")
    for name in ("workshop.rad", "workshop.toml"):
        (block,) = re.findall(rf"^```\w+ {name}\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
        (tmp_path / name).write_text(block)
    case = drcmitsuba.load_case(tmp_path / "workshop.toml")
    tiled = TiledWalls.of(case, case.design, case.design.rows, case.design.segments)
    gable = 6 * 2.6 + 6 * 1.5 / 2
    assert tiled.area == pytest.approx(gable)
    above = 0.2 * 0.8 / 2
    under_the_eaves = 2 * (0.2 + 1.2) / 2
    areas_of_tiles = [tile.shape.area for tile in tiled.tiles]
    assert areas_of_tiles[:3] == pytest.approx([2 * 1.5] * 3)
    assert areas_of_tiles[3::2] == pytest.approx([under_the_eaves] * 2)
    assert sum(areas_of_tiles) == pytest.approx(gable - 6 * 0.9 - above)


def test_tiles_follow_the_band_and_the_height_of_rows(tmp_path):
    case = honeybee(tmp_path, box.room("Room"))
    keys = {"side": "west", "band": (0.8, 2.8), "row_height": 0.5}
    tiled = TiledWalls.of(case, design(**keys), 6, 1)
    z = [0.8, 1.3, 1.8, 2.3, 2.8]
    expected = [(0, 6, low, high) for low, high in pairwise(z)]
    assert np.array([tile.bounds for tile in tiled.tiles]) == pytest.approx(np.array(expected))


def test_walls_may_be_tiles_altogether(tmp_path):
    """Far from the origin and turned, as on a map: every wall becomes a tile, and no crack."""
    turn = np.array([[0.96, -0.28, 0], [0.28, 0.96, 0], [0, 0, 1]])
    room = box.room("Room")
    for face in (*room["faces"], *room["faces"][1]["apertures"]):
        rings = [face["geometry"]["boundary"], *face["geometry"].get("holes", ())]
        for ring in rings:
            ring[:] = (np.array(ring) @ turn.T + [512345.678, 5234567.89, 400.0]).tolist()
    case = honeybee(tmp_path, room)
    tiled = TiledWalls.of(case, design(), 1, 1)
    assert [tile.shape.area for tile in tiled.tiles] == pytest.approx([18, 10, 18, 12], rel=1e-6)
    assert "generic_wall_0.50" not in [layer.name for layer in tiled.case.building.layers]
    assert [tiled.case.building.layers[i].name for i in tiled.layers] == [
        tile.name for tile in tiled.tiles
    ]
    refuse_leaks(tiled.case)
    assert list(crack_notes(tiled.case)) == []


def test_walls_between_rooms_are_none(tmp_path):
    case = honeybee(tmp_path, *adjoining())
    sides = ["north", "south"]
    expected = [("Office", side) for side in (*sides, "west")]
    expected += [("Studio", side) for side in ("east", *sides)]
    assert walls_in_words(case) == sorted(expected)
    tiled = TiledWalls.of(case, design(spaces=("Stu*",)), 1, 1)
    assert {wall.space for wall in tiled.walls} == {"Studio"}
    assert sum(wall.outline.area for wall in tiled.walls) == pytest.approx(12 + 12 + 18)


def clerestory(foot):
    """Room of 6 m by 6 m: a roof at 2.6 m, and behind a wall at y = 3 m one at 3.8 m.

    The wall begins at its foot [m] above the floor.
    """
    low, high = (2.6, 3.8)
    floor, _, _ = prism([(0, 0), (6, 0), (6, 6), (0, 6)], low)
    side = [[0, 0], [3, 0], [6, 0], [6, high], [3, high], [3, low], [0, low]]  # y and z
    west = [[0, y, z] for y, z in side]
    east = [[6, y, z] for y, z in side[::-1]]
    south = [[6, 0, 0], [0, 0, 0], [0, 0, low], [6, 0, low]]
    north = [[0, 6, 0], [6, 6, 0], [6, 6, high], [0, 6, high]]
    above = [[6, 3, foot], [0, 3, foot], [0, 3, high], [6, 3, high]]
    roofs = [[[0, y, z], [6, y, z], [6, y + 3, z], [0, y + 3, z]] for y, z in ((0, low), (3, high))]
    screen = [[1, 4.5, 0], [3, 4.5, 0], [3, 4.5, 2], [1, 4.5, 2]]
    hole = np.array([[4.0, 3.0, 2.8], [5.0, 3.0, 2.8], [5.0, 3.0, 3.6], [4.0, 3.0, 3.6]])
    return case_of(
        layer("floor", Lambertian(0.3), floor),
        layer("roof", Lambertian(0.7), *roofs),
        layer("walls", Lambertian(0.5), above, south, north, west, east, screen, holes=[hole]),
        layer("glass", GLASS, hole),
        sensors={"floors": ["floor"], "spacing": 1.0},
    )


@pytest.mark.parametrize("foot", [2.6, 0.0])
def test_a_clerestory_is_a_wall_of_its_space_and_a_screen_is_none(foot):
    """Whether its wall ends at the lower roof, or goes on below it between two parts of a room."""
    case = clerestory(foot)
    above = [wall for wall in walls_of(case) if wall.plane.corner[1] == pytest.approx(3)]
    assert [(wall.facing, wall.floor) for wall in above] == [("south", 0)]
    assert above[0].outline.area == pytest.approx(6 * 1.2)
    assert above[0].openings.area == pytest.approx(0.8)
    assert {wall.facing for wall in walls_of(case)} == {"east", "north", "south", "west"}
    assert not [wall for wall in walls_of(case) if wall.plane.corner[1] == pytest.approx(4.5)]
    tiled = TiledWalls.of(case, design(side="south", band=(2.6, 3.8)), 1, 3)
    assert [tile.shape.area for tile in tiled.tiles] == pytest.approx([2.4, 2.4, 2.4 - 0.8])
    assert [tile.bounds[2] for tile in tiled.tiles] == pytest.approx([2.6] * 3)
    panes = panes_of_model(tiled.case.building)
    mine = np.isin(panes.layer, tiled.layers)
    assert panes.front[mine] == pytest.approx(np.tile([0.0, 1.0, 0.0], (3, 1)))


def test_one_polygon_before_two_rooms_is_a_wall_of_each():
    """The house's southern wall is one polygon; its rooms are the parts of the floor."""
    tiled = TiledWalls.of(house(), design(side="south", walls=("walls",)), 1, 2)
    names = {wall.space: wall for wall in tiled.walls}
    assert sorted(names) == ["floor 1", "floor 2", "floor 3"]
    for name, wide, high, openings in (("floor 1", 4, 3, 2.8), ("floor 3", 8, 2, 0)):
        assert names[name].outline.area == pytest.approx(wide * high, rel=0.01)
        assert names[name].openings.area == pytest.approx(openings, abs=0.01)
    lowest = [tile for tile in tiled.tiles if tiled.walls[tile.wall].space == "floor 3"]
    assert [tile.bounds[2] for tile in lowest] == pytest.approx([0, 0])  # above its own floor


def test_rooms_of_any_shape_have_walls_around(tmp_path):
    """The L-shaped room, turned by 30°; a post and a partition within are no outer walls."""
    case = l_room(north=30.0)
    layers = case.building.layers
    found = {layers[i].name for wall in walls_of(case) for i in wall.shapes}
    assert found == {"south wall", "east wall", "walls"}
    assert {wall.facing for wall in walls_of(case)} == {"south-west", "south-east", "north-east",
                                                        "north-west"}  # fmt: skip
    tiled = TiledWalls.of(case, design(walls=("*",)), 1, 1)
    around = 2 * (6 + 7) * 3
    assert tiled.area == pytest.approx(around, rel=0.01)
    assert sum(tile.shape.area for tile in tiled.tiles) == pytest.approx(
        around - 7.2 - 1.9, rel=0.02
    )


def test_both_sides_of_a_wall_keep_their_reflectance():
    """A wall that is dark outside is dark behind its tiles, whichever side was its front."""
    for turned in (False, True):
        floor, ceiling, walls = prism([(0, 0), (4, 0), (4, 3), (0, 3)], 3.0)
        south = walls[0][::-1] if turned else walls[0]
        two = Lambertian(0.1, 0.7) if turned else Lambertian(0.7, 0.1)
        case = case_of(
            layer("floor", Lambertian(0.3), floor),
            layer("south", two, south),
            layer("others", Lambertian(0.5), ceiling, *walls[1:]),
            sensors={"floors": ["floor"], "spacing": 1.0},
        )
        tiled = TiledWalls.of(case, design(side="south"), 1, 1)
        assert tiled.case.building.layers[-1].material == Lambertian(0.7, 0.1)
        assert area_vector(tiled.case.building.layers[-1].quads[0])[1] > 0  # towards the room


def test_windows_become_panes_of_their_material_beside_those_that_are_there():
    case = house(materials={"opal": {"type": "diffuser", "transmittance": 0.5}})
    tiled = TiledWalls.of(case, design(side="south", spaces=("floor 3",)), 2, 2)
    panes = [
        (name, t.wall, t.shape) for name, t in zip(("glass", "opal"), tiled.tiles, strict=False)
    ]
    built = tiled.with_windows(tiled.windows([WallPane(*pane) for pane in panes]))
    added = box.area_of(built.building.layers)
    before = box.area_of(case.building.layers)
    assert added["glass", "pane"] == pytest.approx(before["glass", "pane"] + 4)
    assert added["opal", "pane"] == pytest.approx(4)
    assert added["walls", "surface"] == pytest.approx(before["walls", "surface"] - 8)
    assert [str(p) for p in like_panes(built)].count("glass (south)") == 1
    assert all((areas(x.quads) > 0).all() for x in built.building.layers)


def shell(e, slant=0.0):
    """Faces of a body around the room `thick`, at a distance, its southern one slanted [m]."""
    low = [(-e, -e - slant), (4 + e, -e), (4 + e, 3 + e), (-e, 3 + e)]
    base, top, outer = prism(low, 3.0 + e)
    return [base, top, *outer]


def thick(*gaps, slant=0.0):
    """Room with further faces around it, at distances [m]; the southern ones are slanted."""
    floor, ceiling, walls = prism([(0, 0), (4, 0), (4, 3), (0, 3)], 3.0)
    shells = [polygon for gap in gaps for polygon in shell(gap, slant)]
    return case_of(
        layer("floor", Lambertian(0.3), floor),
        layer("plaster", Lambertian(0.7), ceiling, *walls),
        layer("brick", Lambertian(0.3), *shells),
        sensors={"floors": ["floor"], "spacing": 1.0},
    )


@pytest.mark.parametrize("turned", [False, True])
def test_a_hole_goes_on_through_the_outer_face_between_reveals(turned):
    """Two tiles of 2 m by 1 m side by side, 0.3 m deep: one sheet stands between them.

    The outer face shows its back to the outdoors, or its front when turned; so do the reveals.
    """
    case = thick(0.3)
    if turned:
        floor, plaster, brick = case.building.layers
        brick = replace(brick, quads=brick.quads[:, ::-1])
        case = case.with_building(replace(case.building, layers=(floor, plaster, brick)))
    tiled = TiledWalls.of(case, design(side="south", band=(1.0, 2.0)), 1, 2)
    assert [tile.depth for tile in tiled.tiles] == pytest.approx([0.3, 0.3])
    assert [tile.shape.area for tile in tiled.tiles] == pytest.approx([2, 2])
    assert tiled.area == pytest.approx(12)
    before, after = box.area_of(case.building.layers), box.area_of(tiled.case.building.layers)
    wall, brick = ("plaster", "surface"), ("brick", "surface")
    assert after[wall] == pytest.approx(before[wall] - 4)
    edges = 4 * 2 + 3 * 1
    assert after[brick] == pytest.approx(before[brick] - 4 + 0.3 * edges)
    (bricks,) = [x for x in tiled.case.building.layers if x.name == "brick"]
    n = np.cross(bricks.quads[:, 1] - bricks.quads[:, 0], bricks.quads[:, 2] - bricks.quads[:, 0])
    y = bricks.quads[:, :, 1]
    is_reveal = (np.ptp(y, axis=1) > 0.1) & (y.max(axis=1) < 0.01)
    middle = bricks.quads[is_reveal].mean(axis=1)[:, [0, 2]] - [2, 1.5]
    around = np.abs(middle).max(axis=1) > 0.4  # all but the sheet between the tiles
    assert is_reveal.sum() == 7
    along = np.einsum("qi,qi->q", middle, n[is_reveal][:, [0, 2]])[around]
    assert (along < 0 if turned else along > 0).all()
    panes = panes_of_model(tiled.case.building)
    assert panes.outside[np.isin(panes.layer, tiled.layers)].all()
    refuse_leaks(tiled.case)


def test_a_window_ends_where_its_outer_face_does():
    """The outer face has a niche of 2 m² behind the middle of the wall."""
    case = thick(0.3)
    floor, plaster, brick = case.building.layers
    south = [[-0.3, -0.3, 0], [-0.3, -0.3, 3.3], [4.3, -0.3, 3.3], [4.3, -0.3, 0]]
    at = np.flatnonzero((np.abs(brick.quads[:, :, 1] + 0.3) < 1e-6).all(axis=1))
    rest = [quad for i, quad in enumerate(brick.quads) if i not in at]
    hole = np.array([[1.0, -0.3, 0.5], [1.0, -0.3, 2.5], [2.0, -0.3, 2.5], [2.0, -0.3, 0.5]])
    niche = [
        [a, b, b + [0, 0.2, 0], a + [0, 0.2, 0]]
        for a, b in zip(hole, np.roll(hole, 1, axis=0), strict=True)
    ]
    brick = layer("brick", brick.material, south, *rest, *niche, hole + [0, 0.2, 0], holes=[hole])
    case = case.with_building(replace(case.building, layers=(floor, plaster, brick)))
    tiled = TiledWalls.of(case, design(side="south", band=(0.5, 2.5)), 1, 1)
    (tile,) = tiled.tiles
    assert tile.shape.area == pytest.approx(8 - 2)


def round_room(sides):
    """Room over a regular polygon of so many sides."""
    angle = 2 * np.pi * (np.arange(sides) + 0.5) / sides
    floor, ceiling, walls = prism(np.stack([3 * np.cos(angle), 3 * np.sin(angle)], 1).tolist(), 3.0)
    return case_of(
        layer("floor", Lambertian(0.3), floor),
        layer("ceiling", Lambertian(0.7), ceiling),
        layer("drum", Lambertian(0.5), *walls),
        sensors={"floors": ["floor"], "spacing": 1.0},
    )


def test_facets_of_a_polygon_are_walls_of_their_own():
    tiled = TiledWalls.of(round_room(8), design(), 1, 1)
    assert len(tiled.walls) == 8


@pytest.mark.parametrize(
    ("case", "keys", "message"),
    [
        (lambda: thick(0.1, 0.3), {}, '"plaster" of "floor" has 2 further faces within 1 m'),
        (lambda: thick(0.3, slant=0.2), {"side": "south"}, "has no outer face in one plane"),
        (lambda: round_room(32), {}, '"drum" of "floor" bends to'),
        (lambda: round_room(4), {"side": "south-west"}, "no outer wall faces south-west"),
        (house, {"walls": ("brick*",)}, 'design.walls: none is called "brick*"; choose from'),
        (house, {"spaces": ("hall",)}, 'design.spaces: none is called "hall"'),
        (house, {"spaces": ("floor 1",), "side": "east"}, "no wall has this side, space and"),
        (house, {"band": (4.0, 5.0), "side": "south"}, "design.band: no wall from 4 to 5 m"),
        (
            lambda: house(sensors={"points": [[2.0, 2.0, 0.8]]}), {},
            "design.spaces: the model has no spaces",
        ),
    ],
)  # fmt: skip
def test_walls_that_cannot_be_cut_are_refused_in_one_line(case, keys, message):
    with pytest.raises(InputError) as error:
        TiledWalls.of(case(), design(**keys), 2, 2)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_a_search_of_too_many_tiles_is_refused():
    with pytest.raises(InputError, match=r"design.rows: \d+ tiles; at most 500: name fewer"):
        TiledWalls.of(house(), design(), 10, 10)


def test_walls_against_another_body_are_left_out():
    """A block 5 mm before the eastern wall leaves no outdoors there."""
    floor, ceiling, walls = prism([(0, 0), (4, 0), (4, 3), (0, 3)], 3.0)
    base, top, block = prism([(4.005, -1), (9, -1), (9, 4), (4.005, 4)], 4.0)
    case = case_of(
        layer("floor", Lambertian(0.3), floor),
        layer("walls", Lambertian(0.5), ceiling, *walls),
        layer("block", Lambertian(0.3), base, top, *block),
        sensors={"floors": ["floor"], "spacing": 1.0},
    )
    tiled = TiledWalls.of(case, design(), 1, 1)
    assert sorted(wall.facing for wall in tiled.walls) == ["north", "south", "west"]
