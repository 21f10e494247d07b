"""gbXML buildings: spaces, surfaces with both sides, openings; areas and counts are exact."""

import re
from collections import Counter

import numpy as np
import pytest

from drcmitsuba.model import gbxml
from drcmitsuba.model.gbxml.entries import read_entry
from drcmitsuba.model.gbxml.reader import METRES
from drcmitsuba.model.gbxml.spaces import entries_of
from drcmitsuba.model.model import areas
from drcmitsuba.runtime.errors import InputError
from tests import SHARED, skips
from tests.unit.model import gbxml_building as house

SAMPLES = SHARED / "data" / "gbxml"


def read(folder, parts=None, **fields):
    parts = house.surfaces().values() if parts is None else parts
    return gbxml.read(house.written(folder, house.text(parts, **fields)))


def areas_of(model):
    total = Counter()
    for layer in model.layers:
        total[layer.names, layer.role] += float(areas(layer.quads).sum())
    return dict(total)


EXPECTED = {
    (("outside", "floor"), "surface"): 40.0,
    (("floor", "ceiling"), "surface"): 40.0,
    (("outside", "ceiling"), "surface"): 40.0,
    (("outside", "wall"), "surface"): 4 * 12 + 2 * 15 - 2 + 2 * 24 + 2 * 15,
    (("wall",), "surface"): 15.0,
    (("shade",), "context"): 25.0,
    (("Double",), "pane"): 2.0,
}


@pytest.mark.parametrize("unit", ["Meters", "Feet", "Millimeters"])
def test_a_building_has_its_areas_in_any_unit(tmp_path, unit):
    scale = 1 / METRES[unit]
    model = read(tmp_path, house.surfaces(scale).values(), unit=unit)
    assert areas_of(model) == pytest.approx(EXPECTED)
    assert [space.floor_area for space in model.spaces] == pytest.approx([20, 20, 40])
    assert [space.volume for space in model.spaces] == pytest.approx([60, 60, 120])
    assert [space.height for space in model.spaces] == pytest.approx([3, 3, 3])


def test_a_building_whose_surfaces_face_inward_is_the_same(tmp_path):
    """All of them: a space then has its floor for a ceiling, and the outside's reflectance."""

    def turned(text):
        points = re.findall("<CartesianPoint>.*?</CartesianPoint>", text)
        return re.sub(
            "<PolyLoop>.*?</PolyLoop>", f"<PolyLoop>{''.join(points[::-1])}</PolyLoop>", text
        )

    parts = [
        re.sub("<PlanarGeometry>.*?</PlanarGeometry>", lambda each: turned(each[0]), part)
        for part in house.surfaces().values()
    ]
    (tmp_path / "other").mkdir()
    model, same = read(tmp_path, parts), read(tmp_path / "other")
    assert areas_of(model) == pytest.approx(areas_of(same))
    assert [space.floor_area for space in model.spaces] == pytest.approx([20, 20, 40])
    assert sum("face inward" in note for note in model.notes) == 1


def test_spaces_have_names_uses_and_storeys(tmp_path):
    spaces = read(tmp_path).spaces
    told = [(space.name, space.use, space.storey) for space in spaces]
    assert told == [
        ("Office (Level 1, 1)", "OfficeOpenPlan", "Level 1"),
        ("Office (Level 1, 2)", "OfficeOpenPlan", "Level 1"),
        ("大厅", "Lobby", "Level 2"),
    ]


def test_sides_lie_as_the_space_sees_them(tmp_path):
    """The slab is a ceiling below and a floor above, whatever its polygon's turn."""
    model = read(tmp_path)
    [slab] = [layer for layer in model.layers if layer.names == ("floor", "ceiling")]
    up = np.cross(slab.quads[:, 1] - slab.quads[:, 0], slab.quads[:, 3] - slab.quads[:, 0])
    assert (up[:, 2] > 0).all()
    assert [side.reflectance for side in slab.sides] == [0.2, 0.7]
    [wall] = [layer for layer in model.layers if layer.names == ("outside", "wall")]
    assert [side.reflectance for side in wall.sides] == [0.3, 0.5]


def test_glass_has_the_visible_transmittance_of_its_type(tmp_path):
    [glass] = [layer for layer in read(tmp_path).layers if layer.role == "pane"]
    assert glass.material.transmittance == 0.7
    bare = '<WindowType id="g"><Name>Bare</Name></WindowType>'
    model = read(tmp_path, types=bare)
    [glass] = [layer for layer in model.layers if layer.role == "pane"]
    assert glass.material.transmittance == 0.6
    assert "Windows without a visible transmittance have 0.6: Bare." in model.notes
    assert "those of LM-83: floor 0.2, wall 0.5, ceiling 0.7, outside 0.3" in " ".join(model.notes)


def test_window_types_of_one_name_are_told_apart(tmp_path):
    """Every opening had the transmittance of the first one of its type's name."""

    def kind(key, name, tau, angle="0.0"):
        normal = f'type="Visible" solarIncidentAngle="{angle}"'
        told = f"<Name>{name}</Name><Transmittance {normal}>{tau}</Transmittance>"
        return f'<WindowType id="{key}">{told}</WindowType>'

    for name in ("Double", "glass"):
        types = kind("g", name, 0.7) + kind("dark", name, 0.3)
        parts = house.with_window_above()
        parts["south c"] = parts["south c"].replace('windowTypeIdRef="g"', 'windowTypeIdRef="dark"')
        panes = {x.material.transmittance: x for x in read(tmp_path, parts.values(), types=types)
                 .layers if x.role == "pane"}  # fmt: skip
        assert set(panes) == {0.7, 0.3}
        assert {layer.name for layer in panes.values()} == {name}
    tilted = read(tmp_path, types=kind("g", "Double", 0.7, "60"))
    [glass] = [layer for layer in tilted.layers if layer.role == "pane"]
    assert glass.material.transmittance == 0.6


def test_doors_are_wall_and_air_is_open(tmp_path):
    parts = house.surfaces()
    corners = house.WINDOW[::-1]
    ring = house.rect(1, 0, (0, 0), (3, 4))[::-1]
    for kind, wall, panes in (("NonSlidingDoor", 12, 0), ("Air", 10, 0), ("FixedWindow", 10, 2)):
        hole = house.opening("o", corners, kind, glass="")
        parts["south a"] = house.surface("south a", "ExteriorWall", ring, ["a"], hole)
        found = areas_of(read(tmp_path, parts.values()))
        assert found[("outside", "wall"), "surface"] == pytest.approx(144 + wall)
        assert found.get((("glass",), "pane"), 0) == pytest.approx(panes)


def test_the_place_and_north_are_read(tmp_path):
    place = (
        "<Location><Latitude>57.7</Latitude><Longitude>11.99</Longitude>"
        "<CADModelAzimuth>30</CADModelAzimuth><Name>Göteborg</Name></Location>"
    )
    model = read(tmp_path, place=place)
    assert model.location is not None
    assert (model.location.latitude, model.location.name) == (57.7, "Göteborg")
    assert model.north == 330
    assert any("CADModelAzimuth: 30" in note for note in model.notes)


def test_a_missing_surface_is_closed_and_told(tmp_path):
    model = read(tmp_path, house.surfaces(without=["north a"]).values())
    [note] = [note for note in model.notes if note.startswith("Gaps")]
    assert "Office (12." in note
    found = areas_of(model)
    assert found[("wall",), "surface"] == pytest.approx(15 + 12, rel=0.03)


@pytest.mark.parametrize(
    ("change", "field", "got"),
    [
        (lambda t: t.replace('lengthUnit="Meters"', ""), "lengthUnit", "missing"),
        (lambda t: t.replace('lengthUnit="Meters"', 'lengthUnit="Ells"'), "lengthUnit", "Ells"),
        (lambda t: t.replace('spaceIdRef="c"', 'spaceIdRef="z"'), "AdjacentSpaceId", "'z'"),
        (lambda t: t.replace('windowTypeIdRef="g"', 'windowTypeIdRef="k"'), "windowType", "'k'"),
        (lambda t: t.replace("<Space ", "<Room ").replace("</Space>", "</Room>"), "Space", "none"),
        (lambda t: t.replace("<Surface ", "<F ").replace("</Surface>", "</F>"), "Surface", "none"),
        (lambda t: t.replace('<Space id="b"', '<Space id="a"'), "id", "twice"),
        (lambda t: t.replace("4.000000000", "nan", 1), "Coordinate", "nan"),
        (lambda t: t.replace("4.000000000", "1e400", 1), "Coordinate", "1e400"),
        (lambda t: t.replace("0.7<", "1.7<"), "Transmittance", "1.7"),
        (lambda t: t.replace("gbXML", "gbXNL"), "XML", "gbXNL"),
        (lambda t: t[: len(t) // 2], "XML", ""),
    ],
)  # fmt: skip
def test_what_is_unfit_is_named(tmp_path, change, field, got):
    file = house.written(tmp_path, change(house.text(house.surfaces().values())))
    with pytest.raises(InputError) as error:
        gbxml.read(file)
    assert field in error.value.field
    assert got in error.value.got
    assert "\n" not in str(error.value)


def test_a_window_off_its_wall_is_named(tmp_path):
    parts = house.surfaces()
    ring = house.rect(1, 0, (0, 0), (3, 4))[::-1]
    for shift, got in (([0, 0.4, 0], "0.40 m off"), ([20, 0, 0], "beside Surface south a")):
        hole = house.opening("w9", house.WINDOW + shift)
        parts["south a"] = house.surface("south a", "ExteriorWall", ring, ["a"], hole)
        with pytest.raises(InputError, match=got) as error:
            read(tmp_path, parts.values())
        assert error.value.field.startswith("Opening w9")


def test_entities_are_refused(tmp_path):
    bomb = '<!DOCTYPE b [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>'
    file = house.written(tmp_path, house.text(house.surfaces().values(), head=bomb))
    with pytest.raises(InputError, match="XML"):
        gbxml.read(file)


def test_kinds_of_xml_are_told_apart(tmp_path):
    assert gbxml.is_gbxml(house.written(tmp_path, house.text([])))
    scene = tmp_path / "scene.xml"
    scene.write_text('<scene version="3.0.0"/>')
    assert not gbxml.is_gbxml(scene)
    wide = tmp_path / "wide.xml"
    wide.write_text(house.text(house.surfaces().values()).replace("UTF-8", "UTF-16"), "utf-16")
    assert gbxml.is_gbxml(wide)
    assert len(gbxml.read(wide).spaces) == 3


@skips.needs(SAMPLES)
@pytest.mark.parametrize("file", sorted(SAMPLES.glob("*.xml")), ids=lambda file: file.stem)
def test_areas_and_numbers_are_those_that_files_state(file):
    """Areas of all spaces within 0.2 %, where a file has several floors one above another."""
    model, root = gbxml.read(file), read_entry(file)
    square = METRES[root.attribute("lengthUnit")] ** 2
    entries = entries_of(root)
    stated = [entry.number("Area") * square for entry in entries]
    assert [space.floor_area for space in model.spaces] == pytest.approx(stated, rel=2e-3)
    opened = [
        opening.attribute("id")
        for campus in root.children("Campus")
        for surface in campus.children("Surface")
        for opening in surface.children("Opening")
        if opening.attribute("windowTypeIdRef")
    ]
    panes = {place for layer in model.layers if layer.role == "pane" for place in layer.places}
    assert panes == {f"Opening {name}" for name in opened}


def test_surfaces_in_one_place_are_one_with_a_side_for_each_space(tmp_path):
    """A slab that a file states twice, once for each storey, is the slab that it states once."""
    stated = house.surfaces()
    twice = {name: part for name, part in stated.items() if not name.startswith("slab")}
    for room, x in (("a", 0.0), ("b", 4.0)):
        ring = house.rect(2, 3, (x, 0), (x + 4, 5))
        twice[f"ceiling {room}"] = house.surface(f"ceiling {room}", "Ceiling", ring, [room])
    ring = house.rect(2, 3, (0, 0), (8, 5))[::-1]
    twice["floor c"] = house.surface("floor c", "RaisedFloor", ring, ["c"])
    one, two = (
        gbxml.read(house.written(tmp_path, house.text(parts.values()))) for parts in (stated, twice)
    )

    def by_sides(model):
        """Area of the sides of opaque layers [m²], by their names."""
        out = {}
        for layer in model.layers:
            out[layer.names] = out.get(layer.names, 0) + areas(layer.quads).sum()
        slab = out.pop(("ceiling", "floor"), 0) + out.pop(("floor", "ceiling"), 0)
        return out | {"slab": slab}

    assert by_sides(one) == pytest.approx(by_sides(two))
    assert by_sides(one)["slab"] == pytest.approx(40.0)
    assert any("in one place" in note for note in two.notes)
    assert not any("in one place" in note for note in one.notes)


def test_windows_of_two_spaces_in_one_place_are_one(tmp_path):
    """Walls between a and b that the file states twice, each with the window."""
    parts = house.surfaces(without=("between",))
    hole = house.rect(0, 4, (1, 1), (3, 2))
    for room, ring, corners in (
        ("a", house.rect(0, 4, (0, 0), (5, 3)), hole),
        ("b", house.rect(0, 4, (0, 0), (5, 3))[::-1], hole[::-1]),
    ):
        glass = house.opening(f"window {room}", corners)
        parts[f"wall {room}"] = house.surface(f"wall {room}", "ExteriorWall", ring, [room], glass)
    model = gbxml.read(house.written(tmp_path, house.text(parts.values())))
    panes = next(layer for layer in model.layers if layer.role == "pane")
    assert areas(panes.quads).sum() == pytest.approx(2 + 2)
    assert "Opening window b" not in {panes.place(k) for k in range(len(panes.quads))}
    assert any("Opening window b" in note for note in model.notes)


def test_a_space_whose_floor_is_missing_has_the_one_that_closes_it(tmp_path):
    parts = house.surfaces(without=("floor a",)).values()
    model = gbxml.read(house.written(tmp_path, house.text(parts)))
    # Gaps are closed over the seam of 0.05 m within which edges count as one.
    assert [space.floor_area for space in model.spaces] == pytest.approx([20, 20, 40], rel=0.04)
    assert any("closed" in note for note in model.notes)
