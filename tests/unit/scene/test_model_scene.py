"""Scenes of models: fronts of panes, sensors above floors, leaks, suns that can get in."""

from dataclasses import replace

import numpy as np
import pytest

from drcmitsuba import elements, evaluate
from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import (
    BsdfMaterial,
    DielectricMaterial,
    DiffuserMaterial,
    FacedBsdf,
    Lambertian,
)
from drcmitsuba.model.polygon import area_vector
from drcmitsuba.plan import panes
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.components import place
from drcmitsuba.scene.fills import openings_of
from drcmitsuba.scene.geometry import box, heading, near_bounds, quad, turn
from drcmitsuba.scene.leaks import refuse_leaks
from drcmitsuba.scene.meshes import paired_mesh, quad_mesh
from drcmitsuba.scene.panes_behind import doubled_notes, mirroring_before
from drcmitsuba.scene.panes_in_state import grouped_panes
from drcmitsuba.scene.panes_of_model import panes_of_model
from drcmitsuba.scene.scene import load
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.scene.sun_visibility import SunVisibility
from drcmitsuba.scene.surfaces import surfaces_of
from tests import ROOT
from tests.model_rooms import GLASS, case_of, l_room, layer, prism


@pytest.fixture(autouse=True, scope="module")
def _backend():
    backend.select()


FILM = ROOT / "scenes" / "films" / "prism.xml"
SOUTH = np.array([[1, 0, 1], [3, 0, 1], [3, 0, 2], [1, 0, 2]], float)


def box_room(*more, window=SOUTH, material=GLASS, **tables):
    floor, ceiling, walls = prism([(0, 0), (4, 0), (4, 5), (0, 5)], 3.0)
    return case_of(
        layer("floor", Lambertian(0.2), floor),
        layer("ceiling", Lambertian(0.8), ceiling),
        layer("walls", Lambertian(0.5), *walls, holes=[SOUTH]),
        layer("glass", material, window),
        *more,
        **{"sensors": {"floors": ["floor"]}, **tables},
    )


@pytest.mark.parametrize("window", [SOUTH, SOUTH[::-1]])
def test_fronts_of_glass_turn_to_the_room_whichever_way_they_were_drawn(window):
    windows = panes_of_model(box_room(window=window).building)
    np.testing.assert_allclose(windows.front, [[0, 1, 0]], atol=1e-9)
    assert windows.outside.tolist() == [True]
    assert windows.width == pytest.approx([1.0])
    assert area_vector(windows.frame[0]) == pytest.approx([0, 2, 0])


@pytest.mark.parametrize("window", [SOUTH, SOUTH[::-1]])
def test_films_turn_to_the_room_and_those_of_a_model_are_flipped_where_their_corners_say(window):
    film = {"type": "bsdf", "file": FILM}
    away = area_vector(window)[1] < 0
    for material, flips in ((BsdfMaterial(**film), False), (FacedBsdf(**film), away)):
        case = box_room(window=window, material=material)
        windows = panes_of_model(case.building)
        np.testing.assert_allclose(windows.front, [[0, 1, 0]], atol=1e-9)
        assert windows.facing == ("south",)
        assert windows.turned[int(windows.layer[0])].tolist() == [away]
        (drawn,) = (surface for surface in surfaces_of(case) if surface.name == "glass")
        (grouped,) = grouped_panes(case, groups=openings_of(case))
        for quads, made in (
            (drawn.quads, drawn.material), (grouped.quads, grouped.materials[0])
        ):  # fmt: skip
            np.testing.assert_allclose(area_vector(quads[0]), [0, 2, 0], atol=1e-9)
            assert made.flip == flips


def test_sums_over_openings_hold_the_sun_of_a_film_that_was_drawn_from_outside(tmp_path):
    """A film of the model's own with corners from outside is one of the case that is flipped."""
    times = tmp_path / "times.csv"
    times.write_text("time\n2015-03-21T10:30\n2015-03-21T14:30\n")
    film = {"type": "bsdf", "file": FILM, "straight_through": "off"}
    tables = {
        "sensors": {"corner": [1, 1, 0.8], "count": [2, 2], "spacing": 1.5},
        "period": {"timestamps": times}, "accuracy": {"replicates": 4, "paths": 64},
    }  # fmt: skip
    E = []
    for window, material in (
        (SOUTH, FacedBsdf(**film)), (SOUTH[::-1], BsdfMaterial(**film, flip=True))
    ):  # fmt: skip
        case = box_room(window=window, material=material, **tables)
        E.append(elements(case).illuminance()["total"].values)
    np.testing.assert_allclose(*E, rtol=1e-3)
    whole = evaluate(case).illuminance["total"].values
    np.testing.assert_allclose(E[0].mean(), whole.mean(), rtol=0.1)


def test_a_model_without_spaces_says_what_to_do():
    with pytest.raises(InputError, match=r"the model has none: outline rooms in \[spaces.NAME\]"):
        sensor_points(box_room(sensors={"spaces": ["office"]}))


def test_panes_of_a_room_of_any_shape():
    case = l_room()
    windows = panes_of_model(case.building)
    assert windows.outside.tolist() == [True] * 6 + [False]
    slope = np.hypot(0.8, 0.75)
    assert windows.front[2] == pytest.approx([0, 0.8 / slope, -0.75 / slope])
    sides = panes.used(case)["glass"]
    assert sides == ("south", "east", "north", "west", "between rooms")


def test_north_of_a_model_turns_the_world():
    case = box_room(north=90.0)  # true north is the model's x axis: the window faces the east
    assert panes.used(case) == {"glass": ("east",)}
    glass = next(s for s in surfaces_of(case) if s.name == "glass").quads
    np.testing.assert_allclose(area_vector(glass[0]), [-2, 0, 0], atol=1e-9)
    points, normals = sensor_points(case)
    assert (normals == [0, 0, 1]).all()
    assert ((points[:, 0] > -5) & (points[:, 0] < 0)).all()
    assert ((points[:, 1] > 0) & (points[:, 1] < 4)).all()


def test_grids_above_floors_keep_the_margin_of_walls_and_columns():
    case = l_room(sensors={"floors": ["flo*"], "spacing": 0.25, "margin": 0.5, "height": 0.85})
    points, _ = sensor_points(case)
    assert points[:, 2] == pytest.approx(0.85)
    x, y = points[:, 0], points[:, 1]
    assert (x > 0.5 - 1e-9).all()
    assert (y > 0.5 - 1e-9).all()
    assert ((x < 2.5 + 1e-9) | (y < 2.5 + 1e-9)).all()
    assert (np.abs(y - 3.5)[x < 3] > 0.5 - 1e-6).all()
    column = np.maximum(np.abs(x - 4.15), np.abs(y - 1.65)) - 0.15
    assert column.min() > 0.3  # 16 level directions see a corner a little late
    apart = np.diff(np.unique(np.round(x, 6)))
    assert apart.max() <= 0.25 + 1e-6


@pytest.mark.parametrize(
    ("sensors", "complaint"),
    [
        ({"floors": ["flor"]}, 'sensors.floors: no surface has the material "flor"; did you mean'),
        ({"floors": ["walls"]}, "walls has no level polygon"),
        ({"floors": ["floor"], "margin": 3.0}, "leaves no floor; take a smaller margin"),
        ({"floors": ["floor"], "spacing": 0.001}, "points above the floors"),
        ({"grids": ["desk"]}, 'sensors.grids: the model has no grid "desk"'),
    ],
)
def test_unfit_sensors_of_a_model_are_refused(sensors, complaint):
    with pytest.raises(InputError, match=complaint):
        sensor_points(box_room(sensors=sensors))


def test_sensors_on_a_surface_are_refused():
    grid = {"corner": [0.0, 0.0, 0.0], "count": [2, 2], "spacing": 1.0}
    with pytest.raises(InputError, match="lies on a surface of the model"):
        sensor_points(box_room(sensors=grid))


def test_floors_and_grids_need_a_model():
    with pytest.raises(ValueError, match="there is no"):
        Case.model_validate({"sensors": {"floors": ["floor"]}})


def test_a_closed_room_has_no_leak_and_a_hole_is_named_with_its_place():
    case = l_room()
    refuse_leaks(case)
    layers = list(case.building.layers)
    walls = layers[4]
    kept = walls.polygon != 0  # the wall at y = 3, from x = 3 to 6
    layers[4] = replace(walls, quads=walls.quads[kept], polygon=walls.polygon[kept])
    case._building = replace(case.building, layers=tuple(layers))
    with pytest.raises(InputError, match="rays in its rooms leave it near") as caught:
        refuse_leaks(case)
    place = np.array([float(v) for v in caught.value.got.rpartition("(")[2][:-1].split(",")])
    assert 2.5 < place[0] < 6.5
    assert abs(place[1] - 3) < 1


def test_leaks_may_be_allowed():
    case = box_room(model={"leaks": "allow"})
    case._building = replace(case.building, layers=case.building.layers[:2])
    refuse_leaks(case)
    assert load(case).enclosure is None


TOWER = layer(
    "tower", Lambertian(0.4), *prism([(-9, -9), (13, -9), (13, -8), (-9, -8)], 60.0)[2],
    role="context",
)  # fmt: skip


def towards(altitude, azimuth):
    a, z = np.radians([altitude, azimuth])
    return [np.sin(z) * np.cos(a), np.cos(z) * np.cos(a), np.sin(a)]


def test_suns_before_a_pane_get_in_and_a_tower_hides_the_low_ones():
    suns = np.array([towards(30, 180), towards(30, 0), towards(89, 180)])
    alone = SunVisibility.of(box_room(), place(box_room()))
    assert alone.visible(suns, 0.5).mask.tolist() == [True, False, True]
    black = replace(TOWER, material=Lambertian(0.0))
    hidden = SunVisibility.of(box_room(black), ())
    assert hidden.visible(suns, 0.5).mask.tolist() == [False, False, True]
    # A bright tower passes the northern sun on.
    assert SunVisibility.of(box_room(TOWER), ()).visible(suns, 0.5).mask[1]


@pytest.mark.parametrize(
    ("faces", "complaint"),
    [
        (np.array(box(np.array([1, 1, 1.0]), np.ones(3))), ""),
        (np.array(box(np.array([1, 1, 1.0]), np.ones(3)))[:, ::-1], "faces look inward; turn"),
        (SOUTH[None], '"prism": a flat sheet of a clear solid; close its surface'),
    ],
)
def test_clear_solids_are_closed_and_face_outward(faces, complaint):
    solid = DielectricMaterial(type="dielectric", ior=1.5)
    case = box_room(layer("prism", solid, *faces))
    if not complaint:
        assert [placed.name for placed in place(case)] == ["prism"]
        return
    with pytest.raises(InputError, match=complaint):
        place(case)


@pytest.mark.parametrize(("gap", "told"), [(0.02, True), (0.0001, False), (0.3, False)])
def test_glass_that_is_drawn_as_a_body_is_noted(gap, told):
    case = box_room(layer("double", GLASS, SOUTH + [0, 0.5, 0], SOUTH + [0, 0.5 + gap, 0]))
    notes = doubled_notes(case)
    assert len(notes) == told
    assert not told or notes[0].endswith("draw glass as one sheet: double (20 mm)")


@pytest.mark.parametrize(
    ("material", "gap", "names"),
    [
        ({"transmittance": 0.4, "outer_reflectance": 0.3}, 0.2, ["glass"]),
        ({"transmittance": 0.4, "reflectance": 0.3}, -0.2, ["glass"]),
        ({"transmittance": 0.4}, 0.2, []),
        ({"transmittance": 0.4, "reflectance": 0.3}, 4.0, []),
    ],
)
def test_panes_that_scatter_before_glass_that_mirrors_are_known(material, gap, names):
    opal = DiffuserMaterial(type="diffuser", **material)
    case = box_room(layer("opal", opal, SOUTH + [0, gap, 0]))
    assert mirroring_before(case) == names


def test_a_shade_that_scatters_behind_glass_that_mirrors_is_known():
    opal = {"type": "diffuser", "transmittance": 0.1, "reflectance": 0.5}
    outer = layer("outer", GLASS, SOUTH - [0, 0.2, 0])
    groups = {"blinds": {"panes": ["glass"], "states": ["opal"]}}
    closing = box_room(outer, materials={"opal": opal}, groups=groups)
    assert "outer" in mirroring_before(closing)
    assert mirroring_before(box_room(outer)) == []


@pytest.mark.parametrize("off", [0.2, 20])
def test_cells_lie_along_the_heaviest_of_walls_that_are_nearly_parallel(off):
    """Walls of which some are drawn inexactly, and a screen that is askew to the others."""
    turned = turn(off).T
    wall = np.array([[1, 1, 0], [1, 4, 0], [1, 4, 3], [1, 1, 3]]) @ turned
    walls = [layer(f"askew {i}", Lambertian(0.5), wall + [0.1 * i, 0, 0]) for i in range(2)]
    assert heading(box_room(*walls)) == pytest.approx(0.0, abs=1e-6)
    walls = [layer(f"askew {i}", Lambertian(0.5), wall + [0.1 * i, 0, 0]) for i in range(9)]
    assert heading(box_room(*walls)) == pytest.approx(off, abs=1e-3)


def test_context_is_no_part_of_the_room():
    case = box_room(TOWER)
    assert {s.name for s in surfaces_of(case)} == {"floor", "ceiling", "walls", "glass", "tower"}
    assert load(case).enclosure.size == pytest.approx([4, 5, 3])


def test_a_room_and_a_model_exclude_each_other():
    tables = {"room": {"size": [3.0, 3.0, 3.0]}, "model": {"files": ["a.rad"]}}
    with pytest.raises(ValueError, match="beside a room of boxes"):
        Case.model_validate({**tables, "sensors": {"floors": ["floor"]}})


def test_a_triangle_is_one_face_of_a_mesh():
    quads = np.array([quad([0, 0, 0], [1, 0, 0], [0, 1, 0]), quad([2, 0, 0], [1, 0, 0], [0, 1, 0])])
    quads[0, 3] = quads[0, 2]
    assert quad_mesh("some", quads).face_count() == 3
    assert paired_mesh("some", quads).face_count() == 4


def test_bounds_of_a_turned_model_leave_out_its_context():
    building = replace(box_room(TOWER).building, north=90.0)
    np.testing.assert_allclose(near_bounds(building), [[0, 0, 0], [4, 5, 3]], atol=1e-12)
    np.testing.assert_allclose(near_bounds(building, -90.0), [[-5, 0, 0], [0, 4, 3]], atol=1e-12)
