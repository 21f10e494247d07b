"""Geometry of a case: areas add up, fronts face the room, states differ by the shade only."""

import numpy as np
import pytest

from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import DiffuserMaterial, GlazingMaterial, Lambertian
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene import geometry, scene
from drcmitsuba.scene.sensors import placed_sensors, sensor_points
from drcmitsuba.scene.surfaces import surfaces_of

SIZE = np.array([4.0, 5.0, 3.0])
GLASS = {"type": "glazing", "transmittance": 0.65}
FABRIC = {"type": "diffuser", "transmittance": 0.3}
SHADE = {"type": "diffuser", "transmittance": 0.1}
FACADE = {
    "segments": 3,
    "frame": 0.1,
    "strips": [
        {"bottom": 2.2, "top": 2.8, "material": "fabric"},
        {"bottom": 0.9, "top": 2.2, "material": "glass"},
    ],
}


def case(**changes):
    tables = {
        "room": {"size": list(SIZE)},
        "materials": {"glass": GLASS, "fabric": FABRIC, "shade": SHADE},
        "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 4], "spacing": 1.0},
    }
    return Case.model_validate(tables | changes)


def with_facade(side="south", **changes):
    return case(facade={side: FACADE | changes}, shading={"material": "shade"})


def normals_and_areas(quads):
    crossed = np.cross(quads[:, 1] - quads[:, 0], quads[:, 3] - quads[:, 0])
    areas = np.linalg.norm(crossed, axis=1)
    return crossed / areas[:, None], areas


def area(surfaces, *words):
    named = [s for s in surfaces if any(word in s.name for word in words)]
    return sum(normals_and_areas(s.quads)[1].sum() for s in named)


def wall_area(side):
    return SIZE[2] * (SIZE[0] if side in ("south", "north") else SIZE[1])


SIDES = ["south", "east", "north", "west"]


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("frame", [0.0, 0.1])
def test_a_facade_is_wall_and_frame_and_panes_and_nothing_else(side, frame):
    surfaces = surfaces_of(with_facade(side, frame=frame))
    on_side = [s for s in surfaces if s.name.endswith(side)]
    assert area(on_side, "") == pytest.approx(wall_area(side), rel=1e-12)
    width = wall_area(side) / SIZE[2]
    glass, fabric = ((width - 3 * frame) * (height - frame) for height in (1.3, 0.6))
    assert area(on_side, "glass") == pytest.approx(glass, rel=1e-12)
    assert area(on_side, "fabric") == pytest.approx(fabric, rel=1e-12)
    assert area(on_side, "frame") == pytest.approx(width * 1.9 - glass - fabric, abs=1e-12)


@pytest.mark.parametrize("side", SIDES)
def test_quads_of_a_facade_lie_in_its_plane_and_do_not_overlap(side):
    axis, at = {"south": (1, 0.0), "north": (1, 5.0), "west": (0, 0.0), "east": (0, 4.0)}[side]
    parts = [s.quads for s in surfaces_of(with_facade(side)) if s.name.endswith(side)]
    quads = np.concatenate(parts)
    np.testing.assert_allclose(quads[..., axis], at, atol=1e-12)
    low, high = quads.min(axis=1), quads.max(axis=1)
    points = np.random.default_rng(0).uniform(0, SIZE, (2000, 3))
    points[:, axis] = at
    inside = ((points[:, None] >= low - 1e-12) & (points[:, None] <= high + 1e-12)).all(axis=2)
    np.testing.assert_array_equal(inside.sum(axis=1), 1)


@pytest.mark.parametrize("rotation", [0.0, 30.0, -200.0])
@pytest.mark.parametrize("state", ["open", "shaded"])
def test_all_fronts_face_the_room(rotation, state):
    facades = dict.fromkeys(SIDES, FACADE)
    turned = case(
        room={"size": list(SIZE), "rotation": rotation}, facade=facades,
        shading={"material": "shade"},
    )  # fmt: skip
    middle = geometry.rotation(turned) @ (SIZE / 2)
    surfaces = surfaces_of(turned, state)
    for surface in surfaces:
        normals, _ = normals_and_areas(surface.quads)
        towards = middle - surface.quads.mean(axis=1)
        assert (np.einsum("qi,qi->q", normals, towards) > 0).all(), surface.name
    whole = 2 * (SIZE[0] * SIZE[1] + SIZE[0] * SIZE[2] + SIZE[1] * SIZE[2])
    assert area(surfaces, "") == pytest.approx(whole, rel=1e-12)


def test_rotation_turns_clockwise_seen_from_above():
    # A façade to the south (−y) of a room that is turned by a quarter faces west (−x).
    turned = case(room={"size": list(SIZE), "rotation": 90.0}, facade={"south": FACADE})
    panes = next(s for s in surfaces_of(turned) if s.name == "glass south")
    normals, _ = normals_and_areas(panes.quads)
    np.testing.assert_allclose(normals, np.tile([1.0, 0, 0], (3, 1)), atol=1e-12)
    points, up = sensor_points(turned)
    straight, _ = sensor_points(case())
    np.testing.assert_allclose(points, straight[:, [1, 0, 2]] * [1, -1, 1], atol=1e-12)
    np.testing.assert_array_equal(up, np.tile([0.0, 0, 1], (12, 1)))


def test_normals_of_furniture_point_outward():
    desk = {"corner": [1, 1, 0.7], "size": [1.2, 0.6, 0.04], "count": [2, 3], "step": [1.5, 1.0]}
    surfaces = surfaces_of(case(furniture=[desk | {"name": "desk"}]))
    quads = next(s for s in surfaces if s.name == "desk").quads
    assert len(quads) == 6 * 2 * 3
    normals, areas = normals_and_areas(quads)
    boxes = quads.reshape(6, 6, 4, 3)  # six boxes with six faces each
    middles = boxes.mean(axis=(1, 2), keepdims=True)
    outward = np.einsum("bfi,bfi->bf", normals.reshape(6, 6, 3), (boxes - middles).mean(axis=2))
    assert (outward > 0).all()
    assert areas.sum() == pytest.approx(6 * 2 * (1.2 * 0.6 + 1.2 * 0.04 + 0.6 * 0.04))
    corners = {tuple(np.round(box.min(axis=(0, 1)), 9)) for box in boxes}
    assert corners == {(x, y, 0.7) for x in (1.0, 2.5) for y in (1.0, 2.0, 3.0)}


def test_furniture_without_height_is_one_plate_that_looks_up():
    plate = {"name": "plate", "corner": [1, 1, 0.7], "size": [1.2, 0.6, 0]}
    quads = next(s for s in surfaces_of(case(furniture=[plate])) if s.name == "plate").quads
    normals, areas = normals_and_areas(quads)
    np.testing.assert_allclose(normals, [[0, 0, 1]])
    np.testing.assert_allclose(areas, [0.72])


def material(surfaces, name):
    return next(s.material for s in surfaces if s.name == name)


def test_the_shade_covers_the_clear_panes_only():
    shut = with_facade()
    is_open, shaded = surfaces_of(shut, "open"), surfaces_of(shut, "shaded")
    assert [s.name for s in is_open] == [s.name for s in shaded]
    assert isinstance(material(is_open, "glass south"), GlazingMaterial)
    assert material(shaded, "glass south") == shut.materials["shade"]
    assert material(shaded, "fabric south") == shut.materials["fabric"]
    for a, b in zip(is_open, shaded, strict=True):
        np.testing.assert_array_equal(a.quads, b.quads)
        assert a.name == "glass south" or a.material == b.material


def test_an_opening_has_no_surface_until_the_shade_closes():
    strips = [
        {"bottom": 1.0, "top": 2.0, "material": "open"},
        {"bottom": 2.0, "top": 2.5, "material": "wall"},
    ]
    hole = with_facade(strips=strips, frame=0.0)
    names = [s.name for s in surfaces_of(hole)]
    assert not any("open" in name for name in names)
    assert area(surfaces_of(hole), "south") == pytest.approx(4 * (3 - 1))
    assert isinstance(material(surfaces_of(hole, "shaded"), "open south"), DiffuserMaterial)


def test_without_a_shade_both_states_are_the_same():
    bare = case(facade={"south": FACADE})
    both = [
        [(s.name, s.material) for s in surfaces_of(bare, state)] for state in ("open", "shaded")
    ]
    assert both[0] == both[1] != []


def test_openings_of_the_enclosure_are_those_that_let_straight_light_in():
    backend.select()
    shut = with_facade()
    is_open = scene.load(shut).enclosure
    np.testing.assert_allclose(is_open.openings.min(axis=(0, 1)), [0, 0, 0.9])
    np.testing.assert_allclose(is_open.openings.max(axis=(0, 1)), [4, 0, 2.2])
    assert scene.load(shut, "shaded").enclosure.openings.shape == (0, 4, 3)
    loaded = scene.load(shut)
    np.testing.assert_allclose(loaded.bounds, [np.zeros(3), SIZE])
    assert [p.material.transmittance for p in loaded.scattering] == [0.3]
    panes = scene.load(shut, "shaded").scattering
    assert [p.material.transmittance for p in panes] == [0.1, 0.3]


def test_no_room_has_sensors_under_the_free_sky():
    free = Case.model_validate({"sensors": {"corner": [0, 0, 0], "count": [2, 2], "spacing": 1.0}})
    assert surfaces_of(free) == []
    points, _ = sensor_points(free)
    np.testing.assert_allclose(points, [[0.5, 0.5, 0], [1.5, 0.5, 0], [0.5, 1.5, 0], [1.5, 1.5, 0]])


DESK = {"name": "desk", "corner": [1.0, 1.0, 0.7], "size": [1.2, 0.6, 0.04]}


@pytest.mark.parametrize(
    ("corner", "furniture", "message"),
    [
        ([0.5, 0.5, 0.0], [], r"sensor 0 at \(1, 1, 0\) lies in, on or beyond a wall .*12 in all"),
        ([0.5, 0.5, 3.2], [], r"sensor 0 at \(1, 1, 3.2\) lies in, on or beyond a wall"),
        ([1.5, 0.5, 0.8], [], r"sensor 2 at \(4, 1, 0.8\) lies in, on or beyond a wall .*4 in all"),
        ([1.5, 0.5, 0.8], [DESK], r"sensor 2 at \(4, 1, 0.8\) lies in, on or beyond a wall"),
    ],
)
def test_a_sensor_that_would_see_nothing_is_refused_by_number(corner, furniture, message):
    grid = {"corner": corner, "count": [3, 4], "spacing": 1.0}
    with pytest.raises(InputError, match=message) as caught:
        sensor_points(case(sensors=grid, furniture=furniture))
    assert str(caught.value).startswith("case: sensors: ")
    assert str(caught.value).endswith("move it at least 1 mm off every surface")


@pytest.mark.parametrize(
    ("height", "furniture", "left"),
    [
        (0.72, [DESK], 10),
        (0.74, [DESK], 10),
        (0.7401, [DESK], 10),
        (0.7, [DESK | {"size": [0.6, 0.6, 0]}], 11),
    ],
)
def test_points_of_a_grid_in_furniture_are_left_out_with_a_note(height, furniture, left):
    """One point of 676 that touched a screen stopped the whole case."""
    grid = {"corner": [0.7, 0.7, height], "count": [3, 4], "spacing": 1.0}
    placed = placed_sensors(case(sensors=grid, furniture=furniture))
    assert len(placed.points) == left
    [note] = placed.notes
    assert note.startswith(f"sensors: {12 - left} of 12 points ")
    assert "in or on 'desk'" in note
    assert f"at (1.2, 1.2, {height:g})" in note


def test_points_that_a_user_listed_in_furniture_are_refused(tmp_path):
    file = tmp_path / "desk.pts"
    file.write_text("1.2 1.2 0.72 0 0 1\n")
    with pytest.raises(InputError, match=r"sensor 0 at \(1.2, 1.2, 0.72\) lies in or on 'desk'"):
        sensor_points(case(sensors={"points": str(file)}, furniture=[DESK]))


def test_points_stand_in_the_case_itself():
    """They were refused: "input is not a valid path"."""
    at = [[1, 1.5, 0.8], [2, 1.5, 1.2, 0, 2, 0]]
    points, normals = sensor_points(case(sensors={"points": at}))
    np.testing.assert_allclose(points, [[1, 1.5, 0.8], [2, 1.5, 1.2]])
    np.testing.assert_allclose(normals, [[0, 0, 1], [0, 1, 0]])
    with pytest.raises(InputError, match=r"sensor 1 at \(9, 1, 1\) lies in, on or beyond a wall"):
        sensor_points(case(sensors={"points": [[1, 1, 1], [9, 1, 1]]}))


def test_a_grid_that_lies_in_furniture_as_a_whole_is_refused():
    grid = {"corner": [1.0, 1.0, 0.72], "count": [1, 1], "spacing": 0.5}
    with pytest.raises(InputError, match="lies in or on 'desk'"):
        sensor_points(case(sensors=grid, furniture=[DESK]))


@pytest.mark.parametrize("height", [0.689, 0.742])
def test_a_sensor_under_or_above_a_desk_is_fine(height):
    grid = {"corner": [0.7, 0.7, height], "count": [3, 4], "spacing": 1.0}
    points, _ = sensor_points(case(sensors=grid, furniture=[DESK]))
    assert points.shape == (12, 3)
    assert points[1, 0] - points[0, 0] == pytest.approx(1.0)  # x runs fastest


@pytest.mark.parametrize(
    ("changes", "coloured"),
    [
        ({}, False),
        ({"room": {"size": list(SIZE), "floor": [0.4, 0.4, 0.4]}}, False),
        ({"room": {"size": list(SIZE), "floor": [0.4, 0.3, 0.2]}}, True),
        ({"furniture": [DESK | {"reflectance": [0.1, 0.1, 0.2]}]}, True),
        ({"facade": {"south": FACADE | {"frame_reflectance": [0.9, 0.1, 0.1]}}}, True),
    ],
)
def test_a_case_is_coloured_where_channels_differ(changes, coloured):
    assert scene.is_coloured(case(**changes)) is coloured


def test_a_surface_has_the_reflectance_of_its_case():
    coloured = case(room={"size": list(SIZE), "floor": [0.4, 0.3, 0.2], "walls": 0.6})
    surfaces = surfaces_of(coloured)
    assert material(surfaces, "floor") == Lambertian((0.4, 0.3, 0.2))
    assert material(surfaces, "wall north") == Lambertian(0.6)
    assert material(surfaces, "ceiling") == Lambertian(0.8)
