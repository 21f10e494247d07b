"""HBJSON models: surfaces, panes, shades and groups; areas, fronts and counts are exact."""

import json

import numpy as np
import pytest

from drcmitsuba.case.model_case import listing
from drcmitsuba.case.reading import load_case
from drcmitsuba.model import glass, honeybee
from drcmitsuba.model.honeybee.modifiers import DEFAULT_SET, GLASS, PLASTIC
from drcmitsuba.model.materials import DiffuserMaterial, Lambertian, MirrorMaterial
from drcmitsuba.model.model import View, areas
from drcmitsuba.model.polygon import area_vector
from drcmitsuba.plan.panes import most_reflecting
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.floors_of_model import rooms_of
from tests import SHARED, skips
from tests.unit.model import box_room as box

WALL, PANE = "generic_wall_0.50", "generic_exterior_window_vis_0.64"
SAMPLES = SHARED / "data" / "hbjson"
has_samples = skips.needs(SAMPLES)


def read(folder, *rooms, **fields):
    return honeybee.read(box.written(folder, box.model(*rooms, **fields)))


def shade(name, height, modifier=None, **fields):
    corners = [[0, 0, height], [2, 0, height], [2, 1, height], [0, 1, height]]
    return box.element("Shade", name, corners, modifier, **fields)


def test_a_box_has_its_areas_and_fronts_outside(tmp_path):
    model = read(tmp_path, box.room())
    assert box.area_of(model.layers) == pytest.approx(
        {
            ("generic_floor_0.20", "surface"): 24,
            (WALL, "surface"): 2 * 6 * 3 + 2 * 4 * 3 - 2,
            (PANE, "pane"): 2,
            ("generic_ceiling_0.80", "surface"): 24,
        }
    )
    centre = box.CORNERS.mean(axis=0)
    for layer in model.layers:
        for quad in layer.quads:
            assert area_vector(quad) @ (quad.mean(axis=0) - centre) > 0
    assert box.layer_of(model, PANE).quads.shape == (1, 4, 3)
    assert box.layer_of(model, WALL).place(0) == "Face Room_South"
    assert "generic_wall_0.50" in model.notes[0]


def test_control_characters_in_names_are_written_out(tmp_path):
    """A terminal that lists the materials of a case would obey them."""
    red = box.plastic("\x1b[31mfloor\x9b2J", 0.5, 0.5, 0.5)
    room = box.room()
    room["faces"][0]["properties"]["radiance"]["modifier"] = red["identifier"]
    room["faces"][1]["identifier"] = "South\nWall"
    grid = {"identifier": "\x07", "sensors": [{"pos": [1, 2, 1], "dir": [0, 0, 1]}]}
    file = box.written(
        tmp_path, box.model(room, radiance={"modifiers": [red], "sensor_grids": [grid]})
    )
    case = load_case(file)
    names = [layer.name for layer in case.building.layers]
    assert "\\x1b[31mfloor\\x9b2J" in names
    assert case.building.grids[0].name == "\\x07"
    places = [place for layer in case.building.layers for place in layer.places]
    assert "Face South\\nWall" in places
    assert all(
        map(str.isprintable, [*names, *places, *case.building.notes, *listing(case.building)])
    )


@pytest.mark.parametrize(
    ("unit", "metres"),
    [
        ("Meters", 1),
        ("Millimeters", 1e-3),
        ("Centimeters", 0.01),
        ("Feet", 0.3048),
        ("Inches", 0.0254),
    ],
)
def test_every_unit_becomes_metres(tmp_path, unit, metres):
    grid = {"identifier": "g", "sensors": [{"pos": [1, 2, 3], "dir": [0, 0, 2]}]}
    view = {"identifier": "v", "view_type": "l", "h_size": 2, "v_size": 4}
    view |= {"position": [1, 1, 1], "direction": [0, 1, 0], "up_vector": [0, 0, 1]}
    pane = box.element("Aperture", "Window", box.WINDOW)
    model = read(
        tmp_path, units=unit, orphaned_apertures=[pane],
        radiance={"sensor_grids": [grid], "views": [view]},
    )  # fmt: skip
    assert box.layer_of(model, PANE).quads[0] == pytest.approx(box.WINDOW * metres)
    assert model.grids[0].points == pytest.approx(np.array([[1, 2, 3]]) * metres)
    assert model.grids[0].normals.tolist() == [[0, 0, 1]]
    at = (metres, metres, metres)
    assert model.views == (View("v", "l", at, (0, 1, 0), (0, 0, 1), (2 * metres, 4 * metres)),)


def sensors(name, *points, **fields):
    listed = [{"pos": list(point), "dir": [0, 0, 1]} for point in points]
    return {"type": "SensorGrid", "identifier": name, "sensors": listed} | fields


def test_grids_of_one_identifier_are_joined_and_groups_kept_apart(tmp_path):
    """Honeybee does so; the second was refused, with three of its own sample models."""
    first, second, third = sensors("g", [1, 1, 1]), sensors("g", [2, 1, 1]), sensors("h", [3, 1, 1])
    grids = read(tmp_path, box.room(), radiance={"sensor_grids": [first, third, second]}).grids
    assert [grid.name for grid in grids] == ["g", "h"]
    assert grids[0].points.tolist() == [[1, 1, 1], [2, 1, 1]]
    assert grids[0].normals.shape == (2, 3)
    apart = [first | {"group_identifier": "A"}, second | {"group_identifier": "B"}]
    apart.append(third | {"group_identifier": "A"})
    grids = read(tmp_path, box.room(), radiance={"sensor_grids": apart}).grids
    assert [(grid.name, len(grid.points)) for grid in grids] == [("A/g", 1), ("B/g", 1), ("h", 1)]


def test_views_of_one_identifier_are_kept_apart(tmp_path):
    view = {
        "type": "View", "identifier": "v", "view_type": "h", "position": [1, 1, 1],
        "direction": [0, 1, 0], "up_vector": [0, 0, 1],
    }  # fmt: skip
    other = view | {"position": [2, 1, 1]}
    views = read(tmp_path, box.room(), radiance={"views": [view, view, other]}).views
    assert [(each.name, each.position[0]) for each in views] == [("v", 1), ("v 2", 2)]
    groups = [view | {"group_identifier": "A"}, other | {"group_identifier": "B"}]
    views = read(tmp_path, box.room(), radiance={"views": groups}).views
    assert [each.name for each in views] == ["A/v", "B/v"]


def test_a_modifier_may_stand_twice_with_equal_values(tmp_path):
    twice = [box.plastic("m", 0.3, 0.3, 0.3)] * 2
    shaded = [shade("s", 4, "m")]
    model = read(tmp_path, box.room(), orphaned_shades=shaded, radiance={"modifiers": twice})
    assert box.layer_of(model, "m").material == Lambertian(0.3)


def test_a_room_of_some_millimetres_is_in_metres(tmp_path):
    """One of Honeybee's samples states millimetres for a room of 6 by 12."""
    model = read(tmp_path, box.room(), units="Millimeters")
    assert np.ptp(np.concatenate([x.quads for x in model.layers]).reshape(-1, 3), axis=0).max() == 6
    assert any("units: Millimeters would make the rooms 6 mm long" in n for n in model.notes)


def touching(name, *others):
    return {"type": "Surface", "boundary_condition_objects": [name, *others]}


def two_rooms():
    """Two rooms side by side, whose wall between them has an aperture and a glass door."""
    first, second = box.room("A"), box.room("B", 4.0)
    hole = np.array([[4, 1, 1], [4, 2, 1], [4, 2, 2], [4, 1, 2.0]])
    door = hole + [0, 2, 0]
    east, west = first["faces"][2], second["faces"][4]
    east["boundary_condition"] = touching("B_West", "B")
    west["boundary_condition"] = touching("A_East", "A")
    for face, own, other, ring in (
        (east, "A", "B", slice(None)),
        (west, "B", "A", slice(None, None, -1)),
    ):
        on = {"boundary_condition": touching(f"{other}_Glass")}
        face["apertures"] = [box.element("Aperture", f"{own}_Glass", hole[ring], **on)]
        on = {"boundary_condition": touching(f"{other}_Door"), "is_glass": True}
        face["doors"] = [box.element("Door", f"{own}_Door", door[ring], **on)]
    return first, second


def test_walls_panes_and_doors_between_rooms_count_once(tmp_path):
    model = read(tmp_path, *two_rooms())
    areas = box.area_of(model.layers)
    assert areas[WALL, "surface"] == pytest.approx(3 * 6 * 3 - 2 + 4 * 4 * 3 - 4)
    between = box.layer_of(model, "generic_interior_window_vis_0.88")
    assert [between.place(k) for k in range(2)] == ["Aperture A_Glass", "Door A_Door"]
    wall = box.layer_of(model, WALL)
    places = {wall.place(k) for k in range(len(wall.quads))}
    assert "Face A_East" in places
    assert "Face B_West" not in places


def painted(face, name):
    face["properties"]["radiance"]["modifier"] = name
    return face


PAINTS = {"modifiers": [box.plastic("white", 0.9, 0.9, 0.9), box.plastic("black", 0.1, 0.1, 0.1)]}


@pytest.mark.parametrize("turned", [False, True])
def test_a_wall_between_rooms_has_the_reflectance_of_each_room_on_its_side(tmp_path, turned):
    """Both sides took the modifier of the face whose identifier comes first."""
    first, second = two_rooms()
    names = ("black", "white") if turned else ("white", "black")
    painted(first["faces"][2], names[0])
    painted(second["faces"][4], names[1])
    model = read(tmp_path, *((second, first) if turned else (first, second)), radiance=PAINTS)
    wall = box.layer_of(model, names[0])
    assert wall.names == names
    front, back = wall.material.sides
    assert (front, back) == ((0.1, 0.9) if turned else (0.9, 0.1))
    for quad in wall.quads:  # the front faces the room of the layer's own name, to the west
        assert area_vector(quad)[0] < 0
    assert sum(np.linalg.norm(area_vector(q)) for q in wall.quads) == pytest.approx(18 - 2)


@pytest.mark.usefixtures("variant")
def test_a_slab_is_the_ceiling_of_one_room_and_the_floor_of_another(tmp_path):
    """The upper room had the lower one's ceiling for a floor, and no sensors above it."""
    lower, upper = box.room("A"), box.room("B")
    for face in upper["faces"]:
        for each in (face, *face.get("apertures", ())):
            for corner in each["geometry"]["boundary"]:
                corner[2] += 3
    lower["faces"][5]["boundary_condition"] = touching("B_Bottom", "B")
    upper["faces"][0]["boundary_condition"] = touching("A_Top", "A")
    model = read(tmp_path, lower, upper)
    slab = next(layer for layer in model.layers if layer.behind)
    assert slab.names == ("generic_ceiling_0.80", "generic_floor_0.20")
    assert slab.material.sides == (0.8, 0.2)
    assert area_vector(slab.quads[0])[2] == pytest.approx(-24)
    rooms = rooms_of(model, ("*floor*",), 0.8, "case")
    assert [room.height for room in rooms] == [0, 3]
    assert [room.outline.area for room in rooms] == pytest.approx([24, 24])
    file = box.written(tmp_path, box.model(lower, upper))
    case = tmp_path / "case.toml"
    case.write_text(
        f"[model]\nfiles = [{json.dumps(file.name)}]\n"
        'reflectances = { "generic_floor_0.20" = 0.85 }\n[sensors]\nfloors = ["*floor*"]\n'
    )
    repainted = load_case(case)
    slab = next(layer for layer in repainted.building.layers if layer.behind)
    assert slab.material.sides == (0.8, 0.85)
    assert most_reflecting(repainted, (), beyond=False) == (0.85, "generic_floor_0.20")


def test_windows_in_one_place_count_once_where_the_file_does_not_say_so(tmp_path):
    """Light passed two panes where the file stated no adjacency, and one where it did."""
    first, second = two_rooms()
    for face in (first["faces"][2], second["faces"][4]):
        for each in (face, *face["apertures"], *face["doors"]):
            each["boundary_condition"] = {"type": "Outdoors"}
    model = read(tmp_path, first, second)
    panes = [layer for layer in model.layers if layer.role == "pane"]
    places = [layer.place(k) for layer in panes for k in range(len(layer.quads))]
    assert sorted(places) == [
        "Aperture A_Glass",
        "Aperture A_Window",
        "Aperture B_Window",
        "Door A_Door",
    ]
    assert any("Aperture B_Glass, Door B_Door" in note for note in model.notes)
    closed, _ = two_rooms()  # the wall of the other room has no opening
    closed["faces"][2]["boundary_condition"] = {"type": "Outdoors"}
    for each in (*closed["faces"][2]["apertures"], *closed["faces"][2]["doors"]):
        each["boundary_condition"] = {"type": "Outdoors"}
    second["faces"][4] |= {"apertures": [], "doors": []}
    model = read(tmp_path, closed, second)
    panes = [layer for layer in model.layers if layer.role == "pane"]
    assert {layer.place(k) for layer in panes for k in range(len(layer.quads))} == {
        "Aperture A_Window", "Aperture B_Window",
    }  # fmt: skip


@pytest.mark.parametrize("names", ["AB", "BA"])
def test_of_touching_walls_of_two_sizes_each_stands_where_it_is(tmp_path, names):
    """A room whose wall was longer than the one that touches it was open where that ended."""
    long, short = box.room(names[0]), box.room(names[1], 4.0)
    for face in short["faces"]:
        for corner in face["geometry"]["boundary"]:
            corner[1] *= 0.5
    east, west = painted(long["faces"][2], "white"), painted(short["faces"][4], "black")
    east["boundary_condition"] = touching(f"{names[1]}_West", names[1])
    west["boundary_condition"] = touching(f"{names[0]}_East", names[0])
    model = read(tmp_path, long, short, radiance=PAINTS)
    area = {layer.names: 0.0 for layer in model.layers}
    for layer in model.layers:
        area[layer.names] += sum(np.linalg.norm(area_vector(q)) for q in layer.quads)
    assert area["white",] == pytest.approx(9)
    both = ("white", "black") if names == "AB" else ("black", "white")
    assert area[both] == pytest.approx(9)
    shared = next(layer for layer in model.layers if layer.names == both)
    towards_white = area_vector(shared.quads[0])[0] < 0
    assert towards_white == (shared.name == "white")
    assert ("black",) not in area


def test_an_aperture_within_the_tolerance_of_its_face_is_cut_at_its_edge(tmp_path):
    """A window of 4.002 m in a wall of 4 m was refused."""
    room = box.room()
    room["faces"][1]["apertures"][0]["geometry"]["boundary"] = [
        [x, 0, z] for x, z in ((-0.001, 1), (4.001, 1), (4.001, 2), (-0.001, 2))
    ]
    model = read(tmp_path, room, tolerance=0.01)
    assert box.area_of(model.layers)[WALL, "surface"] == pytest.approx(60 - 4)
    assert any("reach beyond their face" in note for note in model.notes)
    room["faces"][1]["apertures"][0]["geometry"]["boundary"][0][0] = -0.02
    with pytest.raises(InputError, match="crosses"):
        read(tmp_path, room, tolerance=0.01)


def test_the_hole_of_an_aperture_is_wall_but_for_the_pane_in_it(tmp_path):
    """The hole was open, and refused as a leak: so was one of Honeybee's own samples."""

    def square(edge):
        low, high = 1.5 - edge / 2, 1.5 + edge / 2
        return [[low, 0, low], [high, 0, low], [high, 0, high], [low, 0, high]]

    room = box.room()
    pane = room["faces"][1]["apertures"][0]
    pane["geometry"] = box.geometry(square(2.0), [square(1.0)])
    areas = box.area_of(read(tmp_path, room).layers)
    assert areas[WALL, "surface"] == pytest.approx(60 - 3)
    assert areas[PANE, "pane"] == pytest.approx(3)
    room["faces"][1]["apertures"].append(box.element("Aperture", "Eye", square(0.5)))
    areas = box.area_of(read(tmp_path, room).layers)
    assert areas[WALL, "surface"] == pytest.approx(60 - 3.25)
    assert areas[PANE, "pane"] == pytest.approx(3.25)


def test_air_boundaries_and_void_modifiers_are_openings(tmp_path):
    first, second = two_rooms()
    first["faces"][2]["face_type"] = second["faces"][4]["face_type"] = "AirBoundary"
    first["faces"][1]["apertures"][0]["properties"]["radiance"]["modifier"] = "nothing"
    void = {"type": "Void", "identifier": "nothing"}
    model = read(tmp_path, first, second, radiance={"modifiers": [void]})
    areas = box.area_of(model.layers)
    assert areas[WALL, "surface"] == pytest.approx(2 * 6 * 3 - 2 + 4 * 4 * 3 - 2)
    assert areas[PANE, "pane"] == pytest.approx(2)


def test_doors_holes_and_openings_at_the_edge_are_cut_out(tmp_path):
    room = box.room()
    south, top = room["faces"][1], room["faces"][5]
    door = [[0.2, 0, 0], [0.8, 0, 0], [0.8, 0, 2], [0.2, 0, 2]]
    south["doors"] = [box.element("Door", "Door", door)]
    hole = [[1, 1, 3], [2, 1, 3], [2, 2, 3], [1, 2, 3]]
    top["geometry"] = box.geometry(box.CORNERS[box.FACES["Top"][1]], [hole])
    areas = box.area_of(read(tmp_path, room).layers)
    assert areas[WALL, "surface"] == pytest.approx(2 * 18 + 2 * 12 - 2 - 1.2)
    assert areas["generic_opaque_door_0.50", "surface"] == pytest.approx(1.2)
    assert areas["generic_ceiling_0.80", "surface"] == pytest.approx(23)


def test_rooms_without_faces_are_no_spaces(tmp_path):
    room, empty = box.room(), box.room()
    empty |= {"faces": [], "identifier": "Empty", "display_name": "Empty"}
    assert len(read(tmp_path, room, empty).spaces) == 1


def test_corners_within_the_tolerance_are_put_on_their_plane(tmp_path):
    room = box.room()
    window = room["faces"][1]["apertures"][0]
    window["geometry"]["boundary"][0][1] = 0.008
    layers = read(tmp_path, room, tolerance=0.01).layers
    assert box.area_of(layers)[WALL, "surface"] == pytest.approx(58)


def test_orphans_are_part_of_the_model(tmp_path):
    orphans = {
        "orphaned_faces": [box.element("Face", "F", box.WINDOW, face_type="Wall")],
        "orphaned_apertures": [box.element("Aperture", "P", box.WINDOW + 9)],
        "orphaned_doors": [box.element("Door", "D", box.WINDOW + 19)],
        "orphaned_shades": [shade("S", 5, is_detached=True)],
        "shade_meshes": [
            {
                "type": "ShadeMesh",
                "identifier": "M",
                "geometry": {"vertices": box.VERTICES.tolist(), "faces": [[0, 1, 5], [0, 2, 3, 1]]},
                "is_detached": detached,
                "properties": {},
            }
            | {"identifier": f"M{detached}"}
            for detached in (True, False)
        ],
    }
    assert box.area_of(read(tmp_path, **orphans).layers) == pytest.approx(
        {
            (WALL, "surface"): 2,
            (PANE, "pane"): 2,
            ("generic_opaque_door_0.50", "surface"): 2,
            ("generic_context_0.20", "context"): 2 + 6 + 24,
            ("generic_exterior_shade_0.35", "context"): 6 + 24,
        }
    )


def test_modifiers_of_object_room_and_model_come_in_turn(tmp_path):
    own, of_room, of_model = (
        box.plastic(name, v, v, v) for name, v in (("o", 0.1), ("r", 0.2), ("m", 0.3))
    )
    room_set = {
        "type": "ModifierSetAbridged",
        "identifier": "set",
        "wall_set": {"exterior_modifier": "r"},
    }
    whole = {"wall_set": {"exterior_modifier": "m"}, "floor_set": {"exterior_modifier": "m"}}
    whole |= {"type": "GlobalModifierSet", "modifiers": [of_model]}
    radiance = {
        "modifiers": [own, of_room],
        "modifier_sets": [room_set],
        "global_modifier_set": whole,
    }
    first, second = box.room("A"), box.room("B", 9.0)
    first["properties"] = {"radiance": {"modifier_set": "set"}}
    first["faces"][2]["properties"]["radiance"]["modifier"] = "o"
    areas = box.area_of(read(tmp_path, first, second, radiance=radiance).layers)
    assert areas["o", "surface"] == pytest.approx(18)
    assert areas["r", "surface"] == pytest.approx(58 - 18)
    assert areas["m", "surface"] == pytest.approx(58 + 2 * 24)


def test_modifiers_become_materials(tmp_path):
    glass = {f"{c}_transmissivity": 0.6975761815384331 for c in "rgb"}
    modifiers = [
        box.plastic("coloured", 0.6, 0.4, 0.2),
        box.plastic("glossy", 0.5, 0.5, 0.5, specularity=0.1, roughness=0.02),
        box.plastic("shiny", 0.9, 0.9, 0.9, type="Metal", specularity=0.95),
        {"type": "Mirror", "identifier": "mirror"},
        {"type": "Glass", "identifier": "glass", "refraction_index": None} | glass,
        box.plastic("sheet", 0.5, 0.5, 0.5, type="Trans", transmitted_diff=0.4),
        {"type": "Glow", "identifier": "lamp", "r_emittance": 1},
    ]
    shades = [shade(f"s{k}", 5 + k, each["identifier"]) for k, each in enumerate(modifiers)]
    model = read(tmp_path, orphaned_shades=shades, radiance={"modifiers": modifiers})
    made = {layer.name: layer.material for layer in model.layers}
    assert made["coloured"] == Lambertian((0.6, 0.4, 0.2))
    assert made["lamp"] == Lambertian(0.0)
    assert made["mirror"] == MirrorMaterial(type="mirror", reflectance=1)
    both = {"reflectance": 0.3, "outer_reflectance": 0.3}
    assert made["sheet"] == DiffuserMaterial(type="diffuser", transmittance=0.2, **both)
    assert made["glossy"].reflectance == pytest.approx(0.55)
    assert made["glossy"].specular == pytest.approx(0.1 / 0.55)
    assert made["shiny"].specular == pytest.approx(0.95)
    assert made["glass"].transmittance == pytest.approx(0.64, abs=1e-6)
    assert made["glass"].reflectance == pytest.approx(0.0616, abs=1e-4)
    assert any("lamps are black: Glow lamp" in note for note in model.notes)


def test_an_alternate_material_of_a_mirror_is_told_or_refused(tmp_path):
    mirror = {"type": "Mirror", "identifier": "mirror"}
    shades = [shade("s", 5, "mirror")]

    def noted(alternate):
        radiance = {"modifiers": [mirror | {"alternate_material": alternate}]}
        return read(tmp_path, orphaned_shades=shades, radiance=radiance).notes

    assert not any("alternate" in note for note in noted(None))
    assert any("alternate" in note for note in noted(box.plastic("matt", 0.5, 0.5, 0.5)))
    with pytest.raises(InputError, match="alternate_material: void"):
        noted({"type": "Void"})


def test_states_of_a_group_give_materials_and_shades_in_turn(tmp_path):
    room = box.room()
    states = [{"modifier": "clear"}, {"modifier": "dark", "shades": [shade("awning", 2)]}, {}]
    dynamic = {"dynamic_group_identifier": "south", "states": states}
    room["faces"][1]["apertures"][0]["properties"]["radiance"] = dynamic
    glass = [{f"{c}_transmissivity": t for c in "rgb"} for t in (0.9, 0.1)]
    modifiers = [
        {"type": "Glass", "identifier": name} | each
        for name, each in zip(("clear", "dark"), glass, strict=True)
    ]
    layer = box.layer_of(read(tmp_path, room, radiance={"modifiers": modifiers}), "clear")
    assert layer.group == "south"
    assert [state.name for state in layer.states] == ["clear", "dark", PANE]
    assert layer.states[0].material == layer.material
    assert layer.states[1].material.transmittance < 0.1
    assert [len(state.shades) for state in layer.states] == [0, 1, 0]
    assert layer.states[1].shades[0].quads.shape == (1, 4, 3)


def test_what_lets_light_through_is_a_pane_and_other_apertures_are_surfaces(tmp_path):
    room = box.room()
    glass = {"type": "Glass", "identifier": "g"} | {f"{c}_transmissivity": 0.5 for c in "rgb"}
    room["faces"][1]["properties"]["radiance"]["modifier"] = "g"
    room["faces"][1]["apertures"][0]["properties"]["radiance"]["modifier"] = "m"
    radiance = {"modifiers": [glass, box.plastic("m", 0.5, 0.5, 0.5)]}
    shade_of_glass = shade("s", 5, "g")
    model = read(tmp_path, room, radiance=radiance, orphaned_shades=[shade_of_glass])
    areas = box.area_of(model.layers)
    assert areas["g", "pane"] == pytest.approx(10)
    assert areas["m", "surface"] == pytest.approx(2)
    assert areas["g", "context"] == pytest.approx(2)


def test_shades_of_any_outline_keep_their_area_and_front(tmp_path):
    outlines = [
        box.L_SHAPE,
        box.L_SHAPE[:3],
        box.L_SHAPE[[0, 1, 2, 5]],
        box.L_SHAPE[[0, 1, 2, 4, 5]],
    ]
    shades = [shade(f"s{k}", 1) for k in range(len(outlines))]
    for each, outline in zip(shades, outlines, strict=True):
        each["geometry"] = box.geometry(outline)
    (layer,) = read(tmp_path, orphaned_shades=shades).layers
    for k, outline in enumerate(outlines):
        vector = sum(area_vector(quad) for quad in layer.quads[layer.polygon == k])
        assert vector == pytest.approx(area_vector(outline))


def test_polygons_without_area_are_left_out_with_a_note(tmp_path):
    line = shade("line", 5)
    line["geometry"] = box.geometry([[0, 0, 0], [1, 0, 0], [2, 0, 0]])
    model = read(tmp_path, orphaned_shades=[shade("s", 4), line])
    assert len(model.layers[0].quads) == 1
    assert "Polygons without area are left out: Shade line." in model.notes


COUNTS = {
    "model_complete_holes": {"generic_floor_0.20": 1, WALL: 9, "generic_ceiling_0.80": 1, PANE: 1,
                             "generic_context_0.20": 1},
    "model_complete_single_zone_office": {
        "generic_floor_0.20": 1, WALL: 4, "generic_ceiling_0.80": 1, PANE: 2,
        "generic_opaque_door_0.50": 1, "generic_exterior_shade_0.35": 2,
        "generic_interior_shade_0.50": 2, "generic_context_0.20": 1,
    },
    "model_energy_shoe_box": {"generic_floor_0.20": 1, WALL: 4, "generic_ceiling_0.80": 1, PANE: 2},
    "model_radiance_dynamic_states": {
        "generic_floor_0.20": 2, WALL: 7, "generic_ceiling_0.80": 2, "custom_triple_pane_0.3": 1,
        "generic_opaque_door_0.50": 1, "generic_exterior_shade_0.35": 1, "ElectrochromicState1": 1,
        "generic_interior_window_vis_0.88": 1, "outdoor_light_shelf_0.5": 1, "grass": 1,
        "SummerLeaves": 1,
    },
    "model_radiance_grid_views": {
        "generic_floor_0.20": 2, WALL: 7, "generic_ceiling_0.80": 2, PANE: 2,
        "generic_interior_shade_0.50": 1, "generic_exterior_shade_0.35": 1,
    },
    "model_with_shade_mesh": {
        "generic_floor_0.20": 1, WALL: 4, "generic_ceiling_0.80": 1, PANE: 2,
        "generic_opaque_door_0.50": 1, "generic_interior_shade_0.50": 1,
        "generic_exterior_shade_0.35": 1, "generic_context_0.20": 1,
    },
}  # fmt: skip
"""Polygons of each modifier in Honeybee's own samples, counted by hand; a mesh is one."""


@has_samples
@pytest.mark.parametrize("name", COUNTS)
def test_samples_of_honeybee_have_their_polygons(name):
    model = honeybee.read(SAMPLES / f"{name}.hbjson")
    assert {layer.name: len(set(layer.polygon)) for layer in model.layers} == COUNTS[name]


@has_samples
def test_sensors_views_and_states_of_the_samples_are_those_of_their_files():
    model = honeybee.read(SAMPLES / "model_radiance_grid_views.hbjson")
    assert {grid.name: len(grid.points) for grid in model.grids} == {
        "Tiny_House_Zone": 200,
        "Tiny_Garage": 200,
    }
    assert model.grids[0].points[0].tolist() == [4.75, 0.25, 1]
    assert [view.direction for view in model.views] == [(0, -1, 0), (0, 1, 0)]
    model = honeybee.read(SAMPLES / "model_radiance_dynamic_states.hbjson")
    groups = {layer.group: len(layer.states) for layer in model.layers if layer.group}
    assert groups == {
        "ElectrochromicWindow": 4,
        "DynamicLightShelf": 2,
        "SeasonalGround": 2,
        "DeciduousTree": 2,
    }


@has_samples
def test_the_default_set_is_the_one_that_honeybee_writes():
    text = (SAMPLES / "model_with_shade_mesh.hbjson").read_text()
    written = json.loads(text)["properties"]["radiance"]["global_modifier_set"]
    for key, inner in DEFAULT_SET.items():
        own = written[key]
        assert inner == (
            {k: v for k, v in own.items() if k != "type"} if isinstance(own, dict) else own
        )
    modifiers = {each["identifier"]: each for each in written["modifiers"]}
    assert set(modifiers) == {*GLASS, *PLASTIC, "air_boundary"}
    for name, reflectance in PLASTIC.items():
        assert modifiers[name]["r_reflectance"] == reflectance
    for name, transmittance in GLASS.items():
        pane = glass.transmissivity(transmittance, 1.52)
        assert modifiers[name]["r_transmissivity"] == pytest.approx(pane, abs=1e-6)


def test_faces_in_one_place_are_one_sheet_in_whole_or_in_part(tmp_path):
    """A hall above two rooms, which the file does not tell: shared parts, and what is left."""

    def room(name, low, high, rho):
        (x, y, z), (u, v, w) = low, high
        rings = {
            "Floor": [[x, y, z], [x, v, z], [u, v, z], [u, y, z]],
            "RoofCeiling": [[x, y, w], [u, y, w], [u, v, w], [x, v, w]],
        }
        modifier = {"type": "Plastic", "identifier": f"of {name}"}
        modifier |= {f"{c}_reflectance": rho for c in "rgb"}
        return {
            "type": "Room", "identifier": name, "properties": {"type": "RoomProperties"},
            "faces": [
                {"type": "Face", "identifier": f"{name}_{kind}", "face_type": kind,
                 "geometry": {"type": "Face3D", "boundary": ring},
                 "boundary_condition": {"type": "Outdoors"},
                 "properties": {"type": "FaceProperties", "radiance": {
                     "type": "FaceRadianceProperties", "modifier": modifier}}}
                for kind, ring in rings.items()
            ],
        }  # fmt: skip

    ground = [[-1, 0, 0], [3, 0, 0], [3, 4, 0], [-1, 4, 0]]
    shade = {"type": "Shade", "identifier": "ground", "is_detached": True,
             "geometry": {"type": "Face3D", "boundary": ground},
             "properties": {"type": "ShadeProperties"}}  # fmt: skip
    made = {
        "type": "Model", "identifier": "house", "units": "Meters", "tolerance": 0.01,
        "orphaned_shades": [shade],
        "rooms": [room("a", (0, 0, 0), (3, 4, 3), 0.8), room("b", (3, 0, 0), (6, 4, 3), 0.5),
                  room("c", (1, -1, 3), (7, 4, 6), 0.2)],
        "properties": {"type": "ModelProperties", "radiance": {
            "type": "ModelRadianceProperties"}},
    }  # fmt: skip
    (tmp_path / "house.hbjson").write_text(json.dumps(made))
    model = honeybee.read(tmp_path / "house.hbjson")
    area = {}
    for layer in model.layers:
        area[layer.names] = area.get(layer.names, 0) + areas(layer.quads).sum()
    # Floors and ceilings of 12, 12 and 30 m²; 8 and 12 m² are shared, 12 m² lie on the ground.
    assert area == pytest.approx({
        ("of a", "of c"): 8, ("of b", "of c"): 12, ("of a",): 12 + 4, ("of b",): 12,
        ("of c",): 30 + 30 - 20, ("generic_context_0.20",): 16 - 12,
    })  # fmt: skip
    assert any("in one place" in note for note in model.notes)
