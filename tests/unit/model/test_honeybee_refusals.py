"""HBJSON models that cannot be read are refused by name; BSDF files that they hold; mutations."""

import base64
import gzip
import json
import lzma
import zlib
from copy import deepcopy

import numpy as np
import pytest

from drcmitsuba.model import honeybee
from drcmitsuba.model.materials import FacedBsdf
from drcmitsuba.runtime.errors import InputError
from tests.unit.model import box_room as box

XML = b"<?xml version='1.0'?><WindowElement/>"


def bsdf(**fields):
    packed = base64.b64encode(gzip.compress(XML)).decode()
    return {"type": "BSDF", "identifier": "film", "bsdf_data": packed} | fields


def refused(folder, value, *words):
    path = box.written(folder, value)
    with pytest.raises(InputError) as error:
        honeybee.read(path)
    line = str(error.value)
    assert "\n" not in line
    for word in ("box.hbjson", *words):
        assert word in line, line


def changed(path, value):
    """Model of the box with another value at a path of keys."""
    tree = box.model(box.room(), orphaned_shades=[box.element("Shade", "S", box.WINDOW - 1)])
    inner = tree
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return tree


FACE = ("rooms", 0, "faces", 1)


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("type",), "Room", ("type", "Room")),
        (("version",), "2.0.1", ("version", "2.0.1")),
        (("version",), "new", ("version", "new")),
        (("units",), "Yards", ("units", "Yards")),
        ((*FACE, "face_type"), "Window", ("Face Room_South", "face_type", "Window")),
        ((*FACE, "identifier"), "Room_East", ("Face Room_East", "twice")),
        ((*FACE, "identifier"), None, ("identifier", "missing")),
        ((*FACE, "geometry", "boundary", 0), [0, "x", 0], ("Room_South", "boundary")),
        ((*FACE, "geometry", "boundary", 0), [0, 1e400, 0], ("Room_South", "boundary")),
        ((*FACE, "geometry", "boundary", 0), [0, 0.5, 0], ("Room_South", "not planar")),
        ((*FACE, "geometry"), None, ("Face Room_South", "geometry", "missing")),
        ((*FACE, "apertures", 0, "geometry", "boundary", 0), [-9, 0, 1], ("Room_South", "crosses")),
        ((*FACE, "properties", "radiance", "modifier"), "brick", ("Room_South", "brick")),
        (("rooms", 0, "properties", "radiance"), {"modifier_set": "x"}, ("Room Room", "_set")),
        (("properties", "radiance"), {"global_modifier_set": "x"}, ("global_modifier_set", "x")),
        (("orphaned_shades", 0, "identifier"), "", ("identifier", "missing")),
        (("rooms",), {"a": 1}, ("rooms", "a dict")),
        (("rooms", 0), [], ("rooms[0]", "a list")),
    ],
)  # fmt: skip
def test_what_the_schema_does_not_have_is_refused_by_name(tmp_path, path, value, words):
    refused(tmp_path, changed(path, value), *words)


def test_a_hole_that_reaches_beyond_its_pane_is_refused(tmp_path):
    hole = [[1.2, 0, 1.2], [9.0, 0, 1.2], [9.0, 0, 1.6], [1.2, 0, 1.6]]
    pane = box.geometry(box.WINDOW, [hole])
    refused(tmp_path, changed((*FACE, "apertures", 0, "geometry"), pane), "geometry", "hole")


@pytest.mark.parametrize(
    ("other", "words"),
    [
        ("Nowhere", ("Face Room_South", "Nowhere", "lacks")),
        ("Room_East", ("Face Room_South", "Room_East", "in turn")),
        ("Room_South", ("Face Room_South", "in turn")),
    ],
)
def test_an_object_that_touches_nothing_is_refused(tmp_path, other, words):
    condition = {"type": "Surface", "boundary_condition_objects": [other, "Room"]}
    refused(tmp_path, changed((*FACE, "boundary_condition"), condition), *words)


@pytest.mark.parametrize(
    ("modifier", "words"),
    [
        (box.plastic("m", 1.5, 0.5, 0.5), ("Plastic m", "r_reflectance", "1.5")),
        (box.plastic("m", 0.5, 0.5, 0.5, type="Marble"), ("Marble m", "type")),
        (box.plastic("m", 0.5, 0.5, 0.5, modifier=box.plastic("p", 1, 1, 1)), ("m", "pattern")),
        ({"type": "Glass", "identifier": "m", "refraction_index": 0.5}, ("Glass m", "0.5")),
        (bsdf(identifier="m", bsdf_data="%%%"), ("BSDF m", "bsdf_data", "no XML")),
    ],
)  # fmt: skip
def test_modifiers_without_a_counterpart_are_refused_where_they_are_used(tmp_path, modifier, words):
    tree = changed(("properties", "radiance"), {"modifiers": [modifier]})
    honeybee.read(box.written(tmp_path, tree))
    tree["orphaned_shades"][0]["properties"]["radiance"] = {"modifier": "m"}
    refused(tmp_path, tree, *words)


def test_repeated_modifiers_grids_and_groups_that_disagree_are_refused(tmp_path):
    twice = [box.plastic("m", 1, 1, 1), box.plastic("m", 1, 1, 0.9)]
    refused(
        tmp_path, changed(("properties", "radiance"), {"modifiers": twice}), "Plastic m", "twice"
    )
    grids = [{"type": "SensorGrid", "identifier": "g", "sensors": [{"pos": [0, 0, 0]}]}]
    tree = changed(("properties", "radiance"), {"sensor_grids": grids})
    refused(tmp_path, tree, "SensorGrid g", "dir")
    shades = [box.element("Shade", f"S{k}", box.WINDOW - k) for k in range(2)]
    for k, each in enumerate(shades):
        each["properties"]["radiance"] = {"dynamic_group_identifier": "g", "states": [{}] * (k + 1)}
    refused(tmp_path, box.model(orphaned_shades=shades), "group g", "1 and 2 states")


def test_a_file_that_holds_a_bsdf_gives_its_content_and_takes_its_path(tmp_path):
    for k, packed in enumerate(
        [
            XML,
            *map(
                base64.b64encode, (XML, gzip.compress(XML), zlib.compress(XML), lzma.compress(XML))
            ),
        ]
    ):
        pane = box.element("Aperture", "P", box.WINDOW, "film")
        modifier = bsdf(bsdf_data=packed.decode(), up_orientation=[0.01, 0.01, 1 - 2 * (k % 2)])
        tree = box.model(orphaned_apertures=[pane], radiance={"modifiers": [modifier]})
        path = box.written(tmp_path, tree)
        assert honeybee.bsdf_xml(path) == {"film": XML}
        model = honeybee.read(path, bsdf={"film": tmp_path / "film.xml"})
        file = tmp_path / "film.xml"
        assert model.layers[0].material == FacedBsdf(type="bsdf", file=file, turn=k % 2 == 1)
        assert list(tmp_path.iterdir()) == [path]
        own = honeybee.read(path).layers[0].material.file  # no case could name a file of its own
        assert own.read_bytes() == XML
        assert own.name == "film.xml"
        assert tmp_path not in own.parents


@pytest.mark.parametrize("data", ["", "%%%", base64.b64encode(b"\x1f\x8b broken").decode(), "é"])
def test_a_bsdf_that_is_no_xml_is_refused(tmp_path, data):
    path = box.written(tmp_path, box.model(radiance={"modifiers": [bsdf(bsdf_data=data)]}))
    with pytest.raises(InputError, match="BSDF film: bsdf_data: no XML"):
        honeybee.bsdf_xml(path)


def test_a_bsdf_that_unpacks_without_end_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(honeybee.bsdf_files, "LARGEST_BSDF", 10**6)
    packed = base64.b64encode(gzip.compress(b"<" + b" " * 10**7)).decode()
    path = box.written(tmp_path, box.model(radiance={"modifiers": [bsdf(bsdf_data=packed)]}))
    with pytest.raises(InputError, match="larger than"):
        honeybee.bsdf_xml(path)
    tree = json.loads(path.read_text())
    tree["orphaned_apertures"] = [box.element("Aperture", "P", box.WINDOW, "film")]
    refused(tmp_path, tree, "BSDF film", "larger than")


def test_all_bsdfs_of_a_model_share_one_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(honeybee.bsdf_files, "LARGEST_BSDF", 3 * len(XML) // 2)
    modifiers = [bsdf(identifier=f"film{k}", bsdf_data=XML.decode()) for k in range(2)]
    panes = [box.element("Aperture", f"P{k}", box.WINDOW + k, f"film{k}") for k in range(2)]
    tree = box.model(orphaned_apertures=panes, radiance={"modifiers": modifiers})
    refused(tmp_path, tree, "BSDF film1", "larger than")


@pytest.mark.parametrize(
    "content",
    [b"", b"[]", b"[" * 10**6, b'{"a":' * 10**5, b"\xff\xfe{", b'{"type": 1' + b"0" * 5000],
)
def test_what_is_no_model_is_refused(tmp_path, content):
    path = tmp_path / "box.hbjson"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"box\.hbjson"):
        honeybee.read(path)


def test_missing_large_and_crowded_files_are_refused_before_they_are_parsed(tmp_path, monkeypatch):
    monkeypatch.setattr(json, "loads", lambda text: pytest.fail("parsed"))
    for path in (tmp_path, tmp_path / "none.hbjson", tmp_path / "a\0b"):
        with pytest.raises(InputError):
            honeybee.read(path)
    path = tmp_path / "large.hbjson"
    with path.open("wb") as stream:
        stream.truncate(2 * 10**9 + 1)
    with pytest.raises(InputError, match="2 GB"):
        honeybee.read(path)
    path.write_bytes(b"[" + b"{}," * (6 * 10**6))
    with pytest.raises(InputError, match="1 GiB"):
        honeybee.read(path)


def places_of(tree, path=()):
    """Paths of every value in a tree of JSON."""
    yield path
    items = (
        tree.items()
        if isinstance(tree, dict)
        else enumerate(tree)
        if isinstance(tree, list)
        else ()
    )
    for key, inner in items:
        yield from places_of(inner, (*path, key))


def tree_with_everything():
    states = [{"modifier": "m", "shades": [box.element("Shade", "T", box.WINDOW - 2)]}, {}]
    dynamic = {"dynamic_group_identifier": "g", "states": states}
    shade = box.element("Shade", "S", box.WINDOW - 1, radiance=dynamic)
    mesh = {"type": "ShadeMesh", "identifier": "M", "properties": {}}
    mesh["geometry"] = {"vertices": box.WINDOW.tolist(), "faces": [[0, 1, 2], [0, 1, 2, 3]]}
    view = {
        "identifier": "v",
        "position": [0, 0, 1],
        "direction": [0, 1, 0],
        "up_vector": [0, 0, 1],
    }
    grid = {"identifier": "g", "sensors": [{"pos": [1, 2, 3], "dir": [0, 0, 2]}]}
    radiance = {
        "modifiers": [box.plastic("m", 0.5, 0.5, 0.5)],
        "views": [view],
        "sensor_grids": [grid],
    }
    more = {"orphaned_shades": [shade], "shade_meshes": [mesh], "tolerance": 0.01}
    return box.model(box.room(), radiance=radiance, **more)


def test_mutated_values_and_bytes_give_a_model_or_one_line(tmp_path):
    rng = np.random.default_rng(7)
    tree = tree_with_everything()
    whole = json.dumps(tree).encode()
    paths = [path for path in places_of(tree) if path]
    odd = [
        None,
        True,
        -1,
        10**400,
        1e308,
        -1e-320,
        float("nan"),
        "",
        "Surface",
        [],
        {},
        [[]],
        [{}],
        [0] * 3,
    ]
    path = tmp_path / "box.hbjson"
    lines = []
    for k in range(160):
        if k % 5:
            value = deepcopy(tree)
            inner = value
            keys = paths[rng.integers(len(paths))]
            for key in keys[:-1]:
                inner = inner[key]
            inner[keys[-1]] = odd[rng.integers(len(odd))]
            path.write_text(json.dumps(value))
        else:
            content = bytearray(whole)
            for at in rng.integers(len(content), size=3):
                content[at] = rng.integers(256)
            path.write_bytes(content)
        try:
            honeybee.read(path)
        except InputError as error:
            lines.append(str(error))
    assert not any("\n" in line for line in lines)
    assert 30 < len(lines) < 155
