"""IFC buildings: elements, glass as sheets, spaces; areas are exact."""

from collections import Counter

import numpy as np
import pytest

from drcmitsuba.model.model import areas
from drcmitsuba.runtime.errors import InputError
from tests import SHARED, skips

SAMPLE = SHARED / "data" / "ifc" / "duplex_21_spaces_ifc2x3.ifc"
ifcopenshell = skips.module("ifcopenshell")
from drcmitsuba.model import ifc  # noqa: E402
from drcmitsuba.model.ifc import reader, shapes  # noqa: E402
from tests.unit.model import ifc_building as building  # noqa: E402


@pytest.mark.parametrize("schema", ["IFC2X3", "IFC4"])
@pytest.mark.parametrize("millimetres", [False, True])
def test_a_house_has_its_areas(tmp_path, schema, millimetres):
    model = ifc.read(building.house(schema=schema, millimetres=millimetres).written(tmp_path))
    total = Counter()
    for layer in model.layers:
        total[layer.name, layer.role] += float(areas(layer.quads).sum())
    glass = 1.8 * 0.8
    slab = 8.6 * 5.4
    assert total["glass", "pane"] == pytest.approx(glass, rel=1e-3)
    assert total["floor", "surface"] == pytest.approx(2 * slab)
    assert total["ceiling", "surface"] == pytest.approx(2 * slab)
    assert total["furniture", "surface"] == pytest.approx(2 + 4 * 0.05)
    assert set(total) == {
        ("glass", "pane"), ("floor", "surface"), ("ceiling", "surface"), ("wall", "surface"),
        ("frame", "surface"), ("furniture", "surface"),
    }  # fmt: skip
    assert [s.floor_area for s in model.spaces] == pytest.approx([20, 20], rel=1e-3)
    assert [s.volume for s in model.spaces] == pytest.approx([60, 60])


def test_bodies_that_a_mapping_mirrors_face_outward():
    corners, faces = building.box((1, 2, 3), (5, 4, 6))
    quads = np.array(corners, float)[np.array(faces)]
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    one = shapes.outward(triangles)
    two = shapes.outward(triangles * [-1, 1, 1])
    for body in (one, two):
        normal = np.cross(body[:, 1] - body[:, 0], body[:, 2] - body[:, 0])
        out = body.mean(axis=1) - body.mean(axis=(0, 1))
        assert ((normal * out).sum(axis=1) > 0).all()
    sheet = triangles[:1]
    assert shapes.outward(sheet) is sheet


def test_spaces_have_names_uses_and_storeys(tmp_path):
    spaces = ifc.read(building.house().written(tmp_path)).spaces
    told = [(space.name, space.use, space.storey) for space in spaces]
    assert told == [("1 Office", "Office", "Ground"), ("2 Store", "storage", "First")]


def test_two_panes_of_a_window_are_one_sheet(tmp_path):
    model = ifc.read(building.house().written(tmp_path))
    [glass] = [layer for layer in model.layers if layer.role == "pane"]
    np.testing.assert_allclose(glass.quads[..., 1], -0.108, atol=1e-6)
    assert glass.material.transmittance == 0.6
    assert "Windows without a visible transmittance have 0.6: glass." in model.notes


def test_panes_of_one_element_in_two_walls_are_two_sheets(tmp_path):
    """A curtain wall around a room has glass to the south and to the north."""
    made = building.house()
    panes = building.joined(
        building.box((5, -0.11, 1), (7, -0.09, 2)), building.box((5, 5.09, 1), (7, 5.11, 2))
    )
    made.add("IfcCurtainWall", "all round", building.box((5, -0.15, 0), (7, -0.05, 0.1)), panes)
    model = ifc.read(made.written(tmp_path))
    quads = np.concatenate([layer.quads for layer in model.layers if layer.role == "pane"])
    middle, size = quads[..., 1].mean(axis=1), areas(quads)
    for place, area in ((-0.1, 2.0), (5.1, 2.0), (-0.108, 1.8 * 0.8)):
        assert size[abs(middle - place) < 1e-4].sum() == pytest.approx(area, rel=1e-3)
    assert size.sum() == pytest.approx(4 + 1.8 * 0.8, rel=1e-3)


@pytest.mark.parametrize("thickness", [0.1, 0.4])
def test_a_window_that_is_one_body_is_one_sheet_however_thick(tmp_path, thickness):
    made = building.house()
    made.add("IfcWindow", "plain", building.box((5, -thickness, 1), (6, 0, 2)))
    model = ifc.read(made.written(tmp_path))
    quads = np.concatenate([layer.quads for layer in model.layers if layer.role == "pane"])
    mine = quads[(quads[..., 0] > 4.9).all(axis=1)]
    assert areas(mine).sum() == pytest.approx(1, rel=1e-3)
    np.testing.assert_allclose(mine[..., 1], -thickness / 2, atol=1e-6)


def test_a_window_without_glass_is_glass_as_a_whole(tmp_path):
    made = building.house()
    made.add("IfcWindow", "plain", building.box((5, -0.15, 1), (6, -0.05, 2)))
    model = ifc.read(made.written(tmp_path))
    [glass] = [layer for layer in model.layers if layer.role == "pane"]
    assert areas(glass.quads).sum() == pytest.approx(1.8 * 0.8 + 1, rel=1e-3)
    assert any(note.startswith("Windows without a transparent part") for note in model.notes)


@pytest.mark.parametrize("gap", [0.001, 0.0])
def test_a_curb_that_is_glass_as_a_whole_stands_on_all_of_its_sides(tmp_path, gap):
    """Opposite sides of a skylight's curb were one sheet in the middle of the hole."""
    made, low, high = building.house(), np.array([5, 1, 3.2]), np.array([6.2, 2.2, 3.4])
    plate = building.box((5, 1, 3.4 + gap), (6.2, 2.2, 3.43 + gap))
    made.add("IfcWindow", "skylight", building.joined(building.ring(low, high, 0.06), plate))
    model = ifc.read(made.written(tmp_path))
    [glass] = [layer for layer in model.layers if layer.role == "pane"]
    mine = glass.quads[glass.polygon == glass.polygon.max()]
    assert areas(mine[np.ptp(mine[..., 2], axis=1) < 1e-6]).sum() == pytest.approx(1.44, rel=0.01)
    height = 0.2 if gap else 0.23  # a plate of the same body has edges
    for axis, (first, last) in enumerate(((5.03, 6.17), (1.03, 2.17))):
        level = mine[np.ptp(mine[..., axis], axis=1) < 1e-6]
        for place in (first, last):
            at = np.abs(level[:, 0, axis] - place) < 0.01
            assert areas(level[at]).sum() == pytest.approx(1.2 * height, rel=0.02)
        assert areas(level).sum() == pytest.approx(2 * 1.2 * height, rel=0.02)


def test_opaque_plates_are_told(tmp_path):
    """A curtain wall whose styles state no transparency left a room dark without a word."""
    made = building.house()
    made.add("IfcPlate", "panel", building.box((5, -0.15, 1), (6, -0.05, 2)))
    notes = ifc.read(made.written(tmp_path)).notes
    [told] = [note for note in notes if note.startswith("Plates and curtain walls without")]
    assert "IfcPlate" in told
    assert not any("Plates" in note for note in ifc.read(building.house().written(tmp_path)).notes)


def test_place_and_north_are_read(tmp_path):
    made = building.house()
    made.site.RefLatitude, made.site.RefLongitude = (57, 30, 0, 0), (-11, -15, 0, 0)
    made.whole.TrueNorth = made.model.createIfcDirection((0.5, 3**0.5 / 2))
    model = ifc.read(made.written(tmp_path))
    assert (model.location.latitude, model.location.longitude) == (57.5, -11.25)
    assert model.north == pytest.approx(30)


@pytest.mark.parametrize(
    ("stated", "turned", "north", "told"),
    [(None, 90, 90, ""), (92, 90, 92, ""), (0, 90, 90, "that of the map"), (40, 0, 40, "turned")],
)
def test_the_axes_of_a_map_take_precedence(tmp_path, stated, turned, north, told):
    """True north within a map's convergence is more exact, and axes may be left as they are."""
    made = building.house()
    if stated is not None:
        up = np.sin(np.radians(stated)), np.cos(np.radians(stated))
        made.whole.TrueNorth = made.model.createIfcDirection([*map(float, up)])
    grid = made.model.createIfcProjectedCRS("EPSG:2056")
    place = 2.6e6, 1.2e6, 0.0
    axis = [float(np.round(f(np.radians(turned)), 9)) for f in (np.cos, np.sin)]
    made.model.createIfcMapConversion(made.whole, grid, *place, *axis, 1.0)
    model = ifc.read(made.written(tmp_path))
    assert model.north == pytest.approx(north)
    notes = [note for note in model.notes if "orth is" in note]
    assert len(notes) == bool(told)
    assert all(told in note for note in notes)


def test_a_file_without_spaces_says_so(tmp_path):
    made = building.IfcBuilding()
    made.add("IfcSlab", "floor", building.box((0, 0, 0), (1, 1, 0.1)))
    model = ifc.read(made.written(tmp_path))
    assert model.spaces == ()
    assert any(note.startswith("The file has no IfcSpace") for note in model.notes)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (lambda t: t.replace("FILE_SCHEMA(('IFC4'))", "FILE_SCHEMA(('IFC1X5'))"), None),
        (lambda t: t[:200], None),
        (lambda t: "", None),
        (lambda t: "solid\nfacet normal 0 0 1\n", None),
    ],
)
def test_what_is_no_ifc_is_named(tmp_path, change, field):
    file = building.house().written(tmp_path)
    file.write_text(change(file.read_text()))
    with pytest.raises(InputError) as error:
        ifc.read(file)
    assert "house.ifc" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_without_shapes_is_named(tmp_path):
    with pytest.raises(InputError, match="no element with a shape"):
        ifc.read(building.IfcBuilding().written(tmp_path))


@skips.needs(SAMPLE)
def test_a_duplex_has_its_rooms_and_windows():
    model, source = ifc.read(SAMPLE), ifcopenshell.open(str(SAMPLE))
    assert len(model.spaces) == len(source.by_type("IfcSpace")) == 21
    [glass] = [layer for layer in model.layers if layer.role == "pane"]
    windows = {f"IfcWindow {each.GlobalId}" for each in source.by_type("IfcWindow")}
    assert windows <= set(glass.places)
    assert {space.storey for space in model.spaces} == {"Level 1", "Level 2", "Roof"}


def test_a_file_that_brings_down_the_library_is_one_line(tmp_path, monkeypatch):
    """A damaged file ends ifcopenshell by SIGSEGV: it is read by a process of its own."""
    file = building.house().written(tmp_path)
    monkeypatch.setattr(reader, "_read", building.ended)
    with pytest.raises(InputError, match=r"cannot read it \(SIGSEGV\); check the file"):
        ifc.read(file)
