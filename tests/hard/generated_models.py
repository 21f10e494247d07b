"""Files of models that the readers take: valid ones, and damage to them."""

from __future__ import annotations

import base64
import functools
import json
import struct
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from tests.hard.generated_files import wholes
from tests.hard.mutations import damaged, mutated
from tests.unit.model import box_room as box
from tests.unit.model import gbxml_building, ifc_building

MATERIALS = """void plastic wall 0 0 5 .5 .5 .5 0 0
void glass pane 0 0 3 .96 .96 .96
void trans opal 0 0 7 .8 .8 .8 0 0 .5 0
void metal steel 0 0 5 .6 .6 .6 .9 .1
void mirror silver 0 0 3 .9 .9 .9
void colorfunc stripes 4 r g b . 0 0
void texfunc dents 4 x y z . 0 0
void mixfunc both 4 wall steel .5 . 0 0
void alias again wall
void BRTDfunc coated 10 .1 .1 .1 .8 .8 .8 0 0 0 . 0 9 .1 .1 .1 .1 .1 .1 0 0 0
void aBSDF film 5 even.xml 0 0 1 . 0 0
"""
RADIANCE = (
    "wall polygon floor 0 0 12 0 0 0 4 0 0 4 6 0 0 6 0\n",
    "wall polygon l 0 0 18 0 0 1 3 0 1 3 1 1 1 1 1 1 2 1 0 2 1\n",
    "wall polygon seam 0 0 30 0 0 0 3 0 0 3 3 0 0 3 0 0 0 0 1 1 0 1 2 0 2 2 0 2 1 0 1 1 0\n",
    "pane polygon window 0 0 12 1 0 1 3 0 1 3 0 2 1 0 2\n",
    "film polygon fabric 0 0 12 1 9 1 3 9 1 3 9 2 1 9 2\n",
    "steel cylinder leg 0 0 7 1 1 0 1 1 .7 .02\n",
    "again cone shade 0 0 8 2 2 2 2 2 1.8 .1 .3\n",
    "wall sphere ball 0 0 4 2 3 1 .2\n",
    "opal ring lid 0 0 8 2 2 2 0 0 1 .1 .4\n",
    "!genbox wall desk 1.6 .8 .04 | xform -t 1 1 .7 -a 2 -t 0 2 0\n",
    "!genbox wall soft 1 1 1 -r .1\n",
    "!genprism wall bar 3 0 0 1 0 0 1 -l 0 0 2\n",
    "!genrev wall vase 't' '.1+.05*sin(6*t)' 6\n",
    "!gensurf wall hill 's' 't' 's*t' 3 4\n",
    "!genworm wall worm 0 t 't*t' .1 3\n",
    "!xform -rz 30 -s 2 -mx part.rad\n",
    "!cat part.rad\n",
    "# a comment\nvoid alias other wall\nother polygon t 0 0 9 0 0 2 1 0 2 0 1 2\n",
    "wall instance copy 1 part.oct 0 0\n",
    "void light lamp 0 0 3 9 9 9\nlamp source sun 0 0 4 0 0 1 .5\n",
)
PART = "void plastic part 0 0 5 .3 .3 .3 0 0\npart polygon p 0 0 9 0 0 0 1 0 0 0 1 0\n"
OTHERS = {"part.rad": PART, "box.mtl": "newmtl wall\nKd .5 .5 .5\nnewmtl pane\nKd 1 1 1\nd .3\n"}
"""Files that the generated ones name."""


def furnish(folder: Path) -> None:
    """Write the files that models name."""
    for name, text in OTHERS.items():
        (folder / name).write_text(text, encoding="utf-8")


@st.composite
def scenes(draw):
    """Radiance scenes."""
    whole = draw(wholes)
    lines = draw(st.lists(st.sampled_from(RADIANCE[:-2] if whole else RADIANCE), min_size=1))
    names = MATERIALS.splitlines(keepends=True)
    text = "".join([*names[:5], *names[8:9], *names[10:]] if whole else names) + "".join(lines)
    return ".rad", text.encode() if whole else draw(damaged(text))


def _honeybee():
    """Tree of a Honeybee model with states, shades, a mesh, a grid and a view."""
    corners = [[0, 0, 5], [2, 0, 5], [2, 1, 5], [0, 1, 5]]
    mesh = {
        "type": "ShadeMesh", "identifier": "terrain", "properties": {},
        "geometry": {"type": "Mesh3D", "vertices": corners, "faces": [[0, 1, 2, 3], [0, 1, 2]]},
    }  # fmt: skip
    tint = {f"{c}_transmissivity": 0.6 for c in "rgb"} | {"type": "Glass", "identifier": "tint"}
    grid = {"identifier": "g", "sensors": [{"pos": [1, 2, 1], "dir": [0, 0, 1]}]}
    view = {
        "identifier": "v",
        "position": [1, 1, 1],
        "direction": [0, 1, 0],
        "up_vector": [0, 0, 1],
    }
    radiance = {
        "modifiers": [box.plastic("grey", 0.5, 0.5, 0.5), tint],
        "sensor_grids": [grid], "views": [view],
    }  # fmt: skip
    room = box.room()
    window = room["faces"][1]["apertures"][0]["properties"]["radiance"]
    window |= {
        "dynamic_group_identifier": "south",
        "states": [{"identifier": "clear", "modifier": "tint"}, {"identifier": "dark"}],
    }
    shade = box.element("Shade", "awning", corners, "grey")
    return box.model(room, radiance=radiance, shade_meshes=[mesh], orphaned_shades=[shade])


HONEYBEE = _honeybee()


@st.composite
def honeybees(draw):
    """Honeybee models."""
    whole = draw(wholes)
    if whole:
        return ".hbjson", json.dumps(HONEYBEE | {"display_name": f"{draw(numbers)}"}).encode()
    if draw(st.booleans()):
        return ".hbjson", json.dumps(draw(mutated(HONEYBEE)), default=str).encode()
    return ".hbjson", draw(damaged(json.dumps(HONEYBEE, indent=1)))


def _obj(number):
    return f"mtllib box.mtl\no room\n# {number}\n" + box.obj_text()


def _stl_text(number):
    rows = ["solid wall"]
    for _, index in box.OBJ:
        rows += [f"facet normal 0 0 {number}", "outer loop"]
        rows += ["vertex {} {} {}".format(*box.VERTICES[k]) for k in index[:3]]
        rows += ["endloop", "endfacet"]
    return "\n".join([*rows, "endsolid"]) + "\n"


TRIANGLES = np.array([box.VERTICES[index[:3]] for _, index in box.OBJ], np.float32)


def _stl(number):
    facets = np.zeros(len(TRIANGLES), [("n", "<f4", 3), ("v", "<f4", (3, 3)), ("more", "<u2")])
    facets["v"] = TRIANGLES
    return f"{number:80}".encode() + struct.pack("<I", len(facets)) + facets.tobytes()


def _ply(order, number):
    byte = ">" if "big" in order else "<"
    head = f"ply\nformat {order} 1.0\ncomment {number}\nelement vertex 12\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz")
    head += "element face 10\nproperty list uchar int vertex_indices\nend_header\n"
    if order == "ascii":
        rows = ["{} {} {}".format(*corner) for corner in box.VERTICES]
        rows += ["4 " + " ".join(map(str, index)) for _, index in box.OBJ]
        return head + "\n".join(rows) + "\n"
    faces = np.zeros(10, [("n", "u1"), ("index", f"{byte}i4", 4)])
    faces["n"], faces["index"] = 4, [index for _, index in box.OBJ]
    return head.encode() + box.VERTICES.astype(f"{byte}f4").tobytes() + faces.tobytes()


def _gltf(packed, number):
    index = np.arange(3 * len(TRIANGLES), dtype="<u2").tobytes()
    corners = TRIANGLES.tobytes()
    buffer = {"byteLength": len(corners) + len(index)}
    if not packed:
        buffer["uri"] = "data:application/octet-stream;base64,"
        buffer["uri"] += base64.b64encode(corners + index).decode()
    views = [
        {"buffer": 0, "byteOffset": 0, "byteLength": len(corners)},
        {"buffer": 0, "byteOffset": len(corners), "byteLength": len(index)},
    ]
    count = 3 * len(TRIANGLES)
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5123, "count": count, "type": "SCALAR"},
    ]
    primitive = {"attributes": {"POSITION": 0}, "indices": 1, "material": 0, "mode": 4}
    colour = {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1]}, "name": "wall"}
    nodes = [
        {"mesh": 0, "translation": [1, 0, 0], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]},
        {"children": [0], "matrix": np.eye(4).ravel().tolist()},
    ]
    tree = {
        "asset": {"version": "2.0", "generator": f"{number}"},
        "scene": 0, "scenes": [{"nodes": [1]}], "nodes": nodes,
        "meshes": [{"primitives": [primitive], "name": "box"}], "materials": [colour],
        "accessors": accessors, "bufferViews": views, "buffers": [buffer],
    }  # fmt: skip
    return tree, corners + index


def _glb(tree, binary):
    text = json.dumps(tree, default=str).encode("utf-8", "replace")
    text, binary = text + b" " * (-len(text) % 4), binary + b"\0" * (-len(binary) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    body += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


@st.composite
def spoilt(draw, raw: bytes):
    """Bytes with up to three pieces replaced."""
    for _ in range(draw(st.integers(1, 3))):
        at, drop = draw(st.integers(0, len(raw))), draw(st.integers(0, 9))
        raw = raw[:at] + draw(st.binary(max_size=9)) + raw[at + drop :]
    return raw


numbers = st.integers(0, 1 << 20)
"""Numbers that tell whole files apart: what was drawn before is not tried again."""


@st.composite
def mesh_files(draw, suffix, *makers):
    """A mesh, whole or damaged, from a function of a number."""
    whole, raw = draw(wholes), draw(st.sampled_from(makers))(draw(numbers))
    if isinstance(raw, str):
        return suffix, raw.encode() if whole else draw(damaged(raw))
    return suffix, raw if whole else draw(spoilt(raw))


@st.composite
def gltfs(draw, suffix):
    """A scene of glTF: its tree changed, or its bytes."""
    whole, (tree, binary) = draw(wholes), _gltf(suffix == ".glb", draw(numbers))
    tree = tree if whole or draw(st.integers(0, 3)) == 0 else draw(mutated(tree))
    raw = _glb(tree, binary) if suffix == ".glb" else json.dumps(tree, default=str).encode()
    return suffix, raw if whole or draw(st.booleans()) else draw(spoilt(raw))


@st.composite
def sensor_lists(draw):
    """Sensors of `.pts` files."""
    whole = draw(wholes)
    rows = draw(st.lists(st.tuples(*[st.floats(-99, 99)] * 3), min_size=1, max_size=9))
    text = "# sensors\n" + "".join(f"{x:g} {y:g} {z:g} 0 0 1\n" for x, y, z in rows)
    return ".pts", text.encode() if whole else draw(damaged(text))


@st.composite
def view_lists(draw):
    """Views of `.vf` files."""
    whole = draw(wholes)
    kind = draw(st.sampled_from("vhaslc"))
    text = f"# {draw(numbers)}\nrvu -vt{kind} -vp 1 2 1.2 -vd 0 -1 .1 -vu 0 .1 1"
    text += " -vh 60 -vv 40 -vo 0 -va 0\nVIEW= -vta -vp 0 0 1\n"
    return ".vf", text.encode() if whole else draw(damaged(text))


@st.composite
def gbxmls(draw):
    """A building in gbXML, whole, damaged or without some of its surfaces."""
    whole, number = draw(wholes), draw(numbers)
    surfaces = gbxml_building.surfaces(draw(st.sampled_from([1.0, 1 / gbxml_building.FOOT])))
    if draw(st.booleans()):
        surfaces = {name: part for name, part in surfaces.items() if draw(st.integers(0, 9))}
    unit = draw(st.sampled_from(["Meters", "Feet", "Millimeters"]))
    text = gbxml_building.text(surfaces.values(), unit=unit, head=f"<!-- {number} -->")
    return ".xml", text.encode() if whole else draw(damaged(text))


@functools.cache
def ifc_text() -> str:
    """A building in IFC."""
    with tempfile.TemporaryDirectory() as folder:
        return ifc_building.house().written(Path(folder)).read_text()


@st.composite
def ifcs(draw):
    """A building in IFC, whole or damaged."""
    whole, text = draw(wholes), f"{ifc_text()}/* {draw(numbers)} */\n"
    return ".ifc", text.encode() if whole else draw(damaged(text))


ORDERS = ("ascii", "binary_little_endian", "binary_big_endian")
MODELS = {
    "model_rad": scenes(),
    "model_hbjson": honeybees(),
    "model_obj": mesh_files(".obj", _obj),
    "model_ply": mesh_files(".ply", *(partial(_ply, order) for order in ORDERS)),
    "model_stl": mesh_files(".stl", _stl_text, _stl),
    "model_gltf": gltfs(".gltf"),
    "model_glb": gltfs(".glb"),
    "model_xml": gbxmls(),
    "model_ifc": ifcs(),
    "points": sensor_lists(),
    "views": view_lists(),
}
"""Strategy of each reader of `readers.READERS`."""
