"""Meshes that cannot be read are refused by name; mutated files give a model or one line."""

import json
import struct

import numpy as np
import pytest

from drcmitsuba.model import mesh
from drcmitsuba.runtime.errors import InputError
from tests.unit.model import box_room as box
from tests.unit.model.test_mesh import KINDS, WALL, gltf_of, obj, ply_of


def refused(path, *words, unit=1.0, materials=WALL):
    with pytest.raises(InputError) as error:
        mesh.read(path, unit=unit, materials=materials)
    line = str(error.value)
    assert "\n" not in line
    for word in (path.name, *words):
        assert word in line, line


@pytest.mark.parametrize("kind", ["obj", "ply", "stl"])
def test_files_without_a_unit_ask_for_it(tmp_path, kind):
    path = KINDS[kind](tmp_path)
    refused(path, "unit", 'write unit = "m"', unit=None)
    refused(path, "unit", "-1", unit=-1.0)


def test_gltf_is_in_metres(tmp_path):
    model = mesh.read(gltf_of(tmp_path, "glb"), materials=WALL)
    assert model.layers[0].quads.max() == 6


@pytest.mark.parametrize("kind", ["ply", "stl", "glb"])
def test_a_signalling_nan_is_refused_without_a_warning(tmp_path, kind):
    """Fuzzing: NumPy warns where such a number becomes one of double precision."""
    if kind == "ply":
        head = "ply\nformat binary_little_endian 1.0\nelement vertex 3\n"
        head += "".join(f"property float {axis}\n" for axis in "xyz")
        head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        corners = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0]], "<f4").tobytes()
        path = tmp_path / "box.ply"
        path.write_bytes(head.encode() + corners + struct.pack("<B3i", 3, 0, 1, 2))
    else:
        path = KINDS[kind](tmp_path)
    four, signalling = np.float32(4).tobytes(), struct.pack("<I", 0x7FA00000)
    path.write_bytes(path.read_bytes().replace(four, signalling))
    refused(path)


def test_unknown_kinds_and_missing_files_are_refused(tmp_path):
    refused(tmp_path / "box.dae", ".obj, .ply, .stl")
    for kind in ("obj", "ply", "stl", "glb", "gltf"):
        refused(tmp_path / f"box.{kind}", "file")
        (tmp_path / f"box.{kind}").write_bytes(b"")
        refused(tmp_path / f"box.{kind}")


@pytest.mark.parametrize(
    ("library", "words"),
    [
        ("", ("a, b",)),
        ("newmtl a\nKd 1 1 1\n", ("b",)),
        ("newmtl a\nKd 1 1 1\nd 0.3\nnewmtl b\nKd 1 1 1\nTr 0.7", ("a, b",)),
        ("newmtl a\nKd 1 1 1\nmap_Kd wood.jpg\nnewmtl b\nKd 1 2 1", ("a, b",)),
        ("newmtl a\nKd 1 1 1\nnewmtl b\nKd spectral b.rfl", ("b",)),
    ],
)
def test_all_names_without_a_reflectance_are_named(tmp_path, library, words):
    path = obj(tmp_path, "mtllib box.mtl\nusemtl a\nf 1 2 3\nusemtl b\nf 1 2 3", library)
    refused(path, "without reflectance", *words)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("f 1 2 9", ("9", "4 vertices")),
        ("f 1 2 0", ("none of",)),
        ("f 1 2 -9", ("none of",)),
        ("f 1 2", ("2 corners",)),
        ("f 1 2 x", ("3 whole numbers",)),
        ("f 1 2 99999999999999999999", ("3 whole numbers",)),
        ("v 1 2", ("3 numbers",)),
        ("v 1 2 x", ("3 numbers",)),
        ("v 1 2 nan\nf 1 2 3", ("coordinate",)),
        ("v 1 2 1e300\nf 1 2 3", ("coordinate",)),
        ("v 2 2 9\nf 1 2 3 5 4", ("not planar", "triangulate")),
        ("", ("faces", "none")),
        ("f " + "1 " * 1001, ("1001 corners",)),
    ],
)
def test_faults_of_an_obj_are_named(tmp_path, text, words):
    words = [word for word in words if word != "9"]
    refused(obj(tmp_path, "usemtl wall\n" + text), *words, materials=box.MATERIALS)


def test_lines_without_end_and_parts_without_number_are_refused(tmp_path):
    refused(obj(tmp_path, "x" * (6 * 2**20)), "1 MiB")
    text = "".join(f"g {k}\nf 1 2 3\n" for k in range(50_001))
    refused(obj(tmp_path, text), "parts: more than 50000")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"ply", b"plx", ("header",)),
        (b"end_header", b"end", ("header", "end")),
        (b"format ascii", b"format utf8", ("header",)),
        (b"vertex 24", b"vertex 99999999999", ("vertices", "at most")),
        (b"face 6", b"face 3000000", ("polygons", "at most")),
        (b"vertex 24", b"vertex 240", ("vertex",)),
        (b"face 6", b"face 7", ("face", "fewer than 7")),
        (b"double x", b"double w", ("vertex", "without x")),
        (b"vertex_indices", b"corners", ("face", "vertex_indices")),
        (b"1 4 0 1", b"1 2 0 1", ("face", "2 corners")),
        (b"1 4 0 1", b"1 4 0 -1", ("faces",)),
        (b"1 4 0 1 2 3", b"1 4 0 1 2", ("face", "4 whole numbers")),
    ],
)
def test_faults_of_a_ply_are_named(tmp_path, old, new, words):
    path = ply_of(tmp_path)
    content = path.read_bytes()
    assert old in content
    path.write_bytes(content.replace(old, new, 1))
    refused(path, *words)


def test_a_binary_file_that_is_cut_short_is_refused(tmp_path):
    path = ply_of(tmp_path, "binary_little_endian")
    path.write_bytes(path.read_bytes()[:-3])
    refused(path, "face", "cut short")
    path = KINDS["stl"](tmp_path)
    path.write_bytes(path.read_bytes()[:-3])
    refused(path, "STL", "triangles")


def changed_gltf(folder, change):
    path = gltf_of(folder, "gltf")
    tree = json.loads(path.read_text())
    change(tree)
    path.write_text(json.dumps(tree))
    return path


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t["asset"].update(version="1.0"), ("version 2",)),
        (lambda t: t.update(extensionsRequired=["KHR_draco_mesh_compression"]), ("draco",)),
        (lambda t: t["buffers"][0].update(uri="http://example.com/a.bin"), ("uri", "beside it")),
        (lambda t: t["buffers"][0].update(uri="../a.bin"), ("uri", "beside it")),
        (lambda t: t["buffers"][0].update(uri="data:,%%%"), ("glTF",)),
        (lambda t: t["accessors"][0].update(count=10**15), ("at most",)),
        (lambda t: t["accessors"][0].update(count=10**6), ("beyond the end",)),
        (lambda t: t["accessors"][0].update(sparse={}), ("sparse",)),
        (lambda t: t["nodes"][0].update(children=[0]), ("twice",)),
        (lambda t: t["nodes"][0].update(scale=[1e300, 1, 1]), ("far away",)),
        (lambda t: t["nodes"][0].update(matrix=[1, 2]), ("schema",)),
        (lambda t: t.update(meshes=[]), ("meshes",)),
        (lambda t: t.update(nodes={"a": 1}), ("schema",)),
    ],
)
def test_faults_of_a_gltf_are_named(tmp_path, change, words):
    refused(changed_gltf(tmp_path, change), *words)


def test_a_buffer_that_is_missing_is_named(tmp_path):
    path = changed_gltf(tmp_path, lambda tree: tree["buffers"][0].update(uri="none.bin"))
    with pytest.raises(InputError, match=r"none\.bin: file"):
        mesh.read(path, materials=WALL)


def test_gltf_names_its_materials_and_their_colours(tmp_path):
    def change(tree):
        base = {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1]}}
        tree["materials"] = [{"name": "paint"} | base | more]
        tree["meshes"][0]["primitives"][0]["material"] = 0
        tree["meshes"][0]["name"] = "wall"

    more = {}
    model = mesh.read(changed_gltf(tmp_path, change), materials={})
    assert (model.layers[0].name, model.layers[0].material.reflectance) == ("paint", 0.5)
    model = mesh.read(changed_gltf(tmp_path, change), materials=box.MATERIALS)
    assert model.layers[0].name == "wall"
    more = {"alphaMode": "BLEND"}
    refused(changed_gltf(tmp_path, change), "paint", materials={})


def test_a_node_that_mirrors_keeps_the_fronts_outside(tmp_path):
    path = changed_gltf(tmp_path, lambda t: t["nodes"][0].update(scale=[-1, 1, 1]))
    (layer,) = mesh.read(path, materials=WALL).layers
    normals = np.cross(layer.quads[:, 1] - layer.quads[:, 0], layer.quads[:, 2] - layer.quads[:, 0])
    outward = layer.quads.mean(axis=1) - layer.quads.mean(axis=(0, 1))
    assert ((normals * outward).sum(axis=1) > 0).all()
    assert layer.quads[..., 0].min() == -4


def test_a_glb_of_another_version_is_refused(tmp_path):
    path = gltf_of(tmp_path, "glb")
    path.write_bytes(b"glTF" + struct.pack("<II", 1, 20) + path.read_bytes()[12:])
    refused(path, "version 1")


@pytest.mark.parametrize("kind", KINDS)
def test_mutated_bytes_give_a_model_or_one_line(tmp_path, kind):
    path = KINDS[kind](tmp_path)
    whole = path.read_bytes()
    rng = np.random.default_rng(list(KINDS).index(kind))
    lines = []
    for _ in range(60):
        content = bytearray(whole)
        for at in rng.integers(min(len(content), 800), size=rng.integers(1, 4)):
            content[at] = rng.choice([*b"0-9 \n/e", *rng.integers(256, size=4)])
        path.write_bytes(content[: rng.integers(len(content))] if rng.random() < 0.1 else content)
        try:
            mesh.read(path, unit=1.0, materials=WALL)
        except InputError as error:
            lines.append(str(error))
    assert not any("\n" in line for line in lines)
    assert len(lines) > 0
