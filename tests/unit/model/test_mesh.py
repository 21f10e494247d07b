"""Meshes of every kind: the same box has the same quads, names decide on materials."""

import base64
import json

import numpy as np
import pytest
import trimesh

from drcmitsuba.model import honeybee, mesh
from drcmitsuba.model.facets import facet_quads, join, polygon_quads
from drcmitsuba.model.materials import Lambertian, MirrorMaterial
from drcmitsuba.model.mesh.part import beside
from drcmitsuba.model.polygon import area_vector
from tests.unit.model import box_room as box

WALL = {"box": Lambertian(0.5)}
RINGS = np.array([box.CORNERS[index] for _, index in box.FACES.values()])
"""Faces of the box, shape (face, 4, 3)."""


def triangles():
    """Box as the triangles that exporters make of it: two in turn for each face."""
    faces = [
        [k + each for each in pair] for k in range(0, 24, 4) for pair in ([0, 1, 2], [0, 2, 3])
    ]
    return trimesh.Trimesh(RINGS.reshape(-1, 3), faces, process=False)


def obj_of(folder):
    path = folder / "box.obj"
    lines = ["v {} {} {}".format(*corner) for corner in RINGS.reshape(-1, 3).tolist()]
    lines += ["usemtl box"]
    lines += [f"f {k}//1 {k + 1}/2 {k + 2}/3/4 {k + 3}" for k in range(1, 24, 4)]
    path.write_text("\n".join(lines))
    return path


def ply_of(folder, order="ascii"):
    """PLY with quads; trimesh writes triangles only."""
    path = folder / "box.ply"
    header = f"""ply\nformat {order} 1.0\ncomment a box\nelement vertex 24\nproperty double x
property double y\nproperty double z\nproperty uchar red\nelement face 6\nproperty uchar flag
property list uchar int vertex_indices\nend_header\n""".encode()
    corners = RINGS.reshape(-1, 3)
    if order == "ascii":
        rows = ["{} {} {} 7".format(*corner) for corner in corners.tolist()]
        rows += [f"1 4 {k} {k + 1} {k + 2} {k + 3}" for k in range(0, 24, 4)]
        path.write_bytes(header + "\n".join(rows).encode() + b"\n")
        return path
    byte = "<" if "little" in order else ">"
    vertex = np.zeros(24, [("at", f"{byte}f8", 3), ("red", "u1")])
    vertex["at"] = corners
    face = np.zeros(6, [("flag", "u1"), ("n", "u1"), ("index", f"{byte}i4", 4)])
    face["n"], face["index"] = 4, np.arange(24).reshape(6, 4)
    path.write_bytes(header + vertex.tobytes() + face.tobytes())
    return path


def stl_of(folder, kind):
    path = folder / "box.stl"
    triangles().export(path, file_type=kind)
    if kind == "stl_ascii":
        lines = path.read_text().splitlines()
        path.write_text("\n".join(["solid box", *lines[1:]]))
    return path


def gltf_of(folder, kind):
    """GlTF, whose y axis is up."""
    turned = triangles()
    turned.vertices = turned.vertices[:, [0, 2, 1]] * [1, 1, -1]
    scene = trimesh.Scene({"box": turned})
    if kind == "glb":
        path = folder / "box.glb"
        scene.export(path)
        return path
    for name, content in scene.export(file_type="gltf").items():
        (folder / name).write_bytes(content)
    return folder / "model.gltf"


KINDS = {
    "obj": obj_of,
    "ply": ply_of,
    "ply, little": lambda folder: ply_of(folder, "binary_little_endian"),
    "ply, big": lambda folder: ply_of(folder, "binary_big_endian"),
    "stl": lambda folder: stl_of(folder, "stl"),
    "stl, text": lambda folder: stl_of(folder, "stl_ascii"),
    "glb": lambda folder: gltf_of(folder, "glb"),
    "gltf": lambda folder: gltf_of(folder, "gltf"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_box_has_the_same_quads_in_every_kind_of_file(tmp_path, kind):
    model = mesh.read(KINDS[kind](tmp_path), unit=1.0, materials=WALL)
    (layer,) = model.layers
    assert (layer.name, layer.role) == ("box", "surface")
    assert layer.quads == pytest.approx(RINGS)
    assert layer.place(3).endswith(": box")


@pytest.mark.parametrize("kind", ["ply", "stl", "glb"])
def test_a_sphere_has_the_triangles_that_trimesh_wrote(tmp_path, kind):
    sphere = trimesh.creation.icosphere(subdivisions=3)
    path = tmp_path / f"box.{kind}"
    trimesh.Scene({"box": sphere}).export(path) if kind == "glb" else sphere.export(path)
    (layer,) = mesh.read(path, unit=1.0, materials=WALL).layers
    area = sum(np.linalg.norm(area_vector(quad)) for quad in layer.quads)
    assert area == pytest.approx(sphere.area, rel=1e-6)
    assert all(area_vector(quad) @ quad.mean(axis=0) > 0 for quad in layer.quads)


def test_a_box_as_honeybee_and_as_mesh_has_the_same_surfaces(tmp_path):
    reflectances = {"wall": (0.5, "Wall"), "floor": (0.2, "Floor"), "ceiling": (0.8, "RoofCeiling")}
    room = box.room()
    for face in room["faces"]:
        names = [name for name, (_, kind) in reflectances.items() if kind == face["face_type"]]
        face["properties"]["radiance"]["modifier"] = names[0]
    glass = {"type": "Glass", "identifier": "pane"} | {f"{c}_transmissivity": 0.6 for c in "rgb"}
    room["faces"][1]["apertures"][0]["properties"]["radiance"]["modifier"] = "pane"
    modifiers = [box.plastic(name, r, r, r) for name, (r, _) in reflectances.items()] + [glass]
    one = honeybee.read(box.written(tmp_path, box.model(room, radiance={"modifiers": modifiers})))
    path = tmp_path / "box.obj"
    path.write_text(box.obj_text(unit=0.001))
    other = mesh.read(path, unit=0.001, materials=box.MATERIALS)
    assert box.area_of(one.layers) == pytest.approx(box.area_of(other.layers))
    for layer in one.layers:
        twin = box.layer_of(other, layer.name)
        vectors = [sum(area_vector(quad) for quad in each.quads) for each in (layer, twin)]
        assert vectors[0] == pytest.approx(vectors[1], abs=1e-9)
        if layer.role == "surface":
            assert layer.material == twin.material


def obj(folder, text, library=""):
    (folder / "box.obj").write_text(f"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n{text}\n")
    (folder / "box.mtl").write_text(library)
    return folder / "box.obj"


def test_names_of_materials_come_before_those_of_groups_and_objects(tmp_path):
    text = "o house\nf 1 2 3\ng roof\nf 1 2 3\nusemtl tin\nf 1 2 3\nusemtl red clay\nf 1 2 3"
    table = {name: Lambertian(k / 10) for k, name in enumerate(("house", "roof", "red clay"))}
    model = mesh.read(obj(tmp_path, text), unit=1, materials=table)
    assert {layer.name: len(layer.quads) for layer in model.layers} == {
        "house": 1,
        "roof": 2,
        "red clay": 1,
    }
    table |= {"tin": MirrorMaterial(type="mirror", reflectance=0.9)}
    assert len(mesh.read(obj(tmp_path, text), unit=1, materials=table).layers) == 4


def test_a_name_that_the_table_lacks_has_the_diffuse_reflectance_of_its_library(tmp_path):
    library = "newmtl a\nKd 0.5 0.4 0.3\nd 1\nnewmtl b\nKd 0.2 0.2 0.2\nTr 0\n"
    path = obj(tmp_path, "mtllib box.mtl\nusemtl a\nf 1 2 3\nusemtl b\nf 1 2 3 4", library)
    model = mesh.read(path, unit=1, materials={})
    assert box.layer_of(model, "a").material == Lambertian((0.5, 0.4, 0.3))
    assert box.layer_of(model, "b").material == Lambertian(0.2)
    assert model.notes == ("The file's own colour is the diffuse reflectance: a, b.",)
    assert box.layer_of(mesh.read(path, unit=1, materials=box.MATERIALS), "a").role == "surface"


def test_relative_indices_lines_in_parts_and_comments_are_read(tmp_path):
    text = "f -4 -3 \\\n -2 # a triangle\nv 9 9 9\nvn 0 0 1\nl 1 2\nf 1 2 3 4\r\nf -5 -4 -3"
    path = obj(tmp_path, "usemtl wall\n" + text)
    quads = mesh.read(path, unit=2, materials=box.MATERIALS).layers[0].quads
    assert quads.shape == (3, 4, 3)
    assert quads.max() == 2


def test_panes_are_what_lets_light_through(tmp_path):
    path = tmp_path / "box.obj"
    path.write_text(box.obj_text())
    model = mesh.read(path, unit=1, materials=box.MATERIALS)
    assert [layer.name for layer in model.layers if layer.role == "pane"] == ["pane"]


def test_quads_that_are_not_planar_are_two_triangles_and_concave_ones_keep_their_area():
    bent = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0.5], [0, 1, 0]]], float)
    assert facet_quads(bent)[0].shape == (2, 4, 3)
    for turn in range(4):
        arrow = np.array([[0, 0, 0], [2, -1, 0], [0.5, 0, 0], [2, 1, 0]], float)[::1]
        quads, polygon = facet_quads(np.roll(arrow, turn, axis=0)[None])
        areas = [area_vector(quad)[2] for quad in quads]
        assert sum(areas) == pytest.approx(area_vector(arrow)[2])
        assert min(areas) * max(areas) > 0
        assert polygon.tolist() == [0, 0]


def test_polygons_of_many_corners_keep_their_area():
    def refuse(k, wrong):
        return ValueError(f"{k}: {wrong}")

    angle = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    star = ring * np.where(np.arange(8) % 2, 0.3, 1)[:, None]
    quads, _ = polygon_quads(np.stack([ring, star, np.roll(star, 1, axis=0)]), refuse)
    wanted = sum(area_vector(each)[2] for each in (ring, star, star))
    assert sum(area_vector(quad)[2] for quad in quads) == pytest.approx(wanted)
    with pytest.raises(ValueError, match="1: not planar"):
        polygon_quads(np.stack([ring, ring + [[0, 0, 1]] * (np.arange(8) == 2)[:, None]]), refuse)


def test_triangles_in_a_row_join_in_pairs_only_where_they_make_parallelograms():
    one, other, third = [0, 0, 0], [1, 0, 0], [1, 1, 0]
    fourth, fifth, sixth = [0, 1, 0], [2, 1, 0], [2, 2, 0]
    rows = [[one, other, third], [one, third, fourth], [third, fourth, one], [other, fifth, sixth]]
    quads = facet_quads(np.array(rows, float))[0]
    assert join(quads)[0].tolist() == [
        [one, other, third, fourth],
        [third, fourth, one, one],
        [other, fifth, sixth, sixth],
    ]
    assert len(join(quads[:2], np.array([0, 1]))[0]) == 2
    assert join(quads, np.array([0, 0, 1, 1]))[1].tolist() == [0, 1, 1]
    rng = np.random.default_rng(5)
    for _ in range(20):
        corners = rng.standard_normal((1, 3, 3))
        ring = np.concatenate([corners, corners[:, :1] + corners[:, 2:] - corners[:, 1:2]], axis=1)
        i, j = rng.integers(3, size=2)
        pair = [np.roll(ring[0, [0, 1, 2]], i, axis=0), np.roll(ring[0, [0, 2, 3]], j, axis=0)]
        joined = join(facet_quads(np.array(pair))[0])[0]
        assert len(joined) == 1
        assert area_vector(joined[0]) == pytest.approx(area_vector(ring[0]))
        assert joined[0, 0] == pytest.approx(pair[0][0])


def test_no_file_outside_the_folder_is_read(tmp_path):
    file = tmp_path / "box.obj"
    (tmp_path / "link.mtl").symlink_to("/etc/hostname")
    for name in (
        "../a",
        "/etc/passwd",
        "a/b",
        "..",
        "",
        "c:x",
        "a\\b",
        "link.mtl",
        "http://x/y",
        "a\0",
    ):
        assert beside(file, name) is None
    assert beside(file, "box.mtl") == (tmp_path / "box.mtl").resolve()
    path = obj(tmp_path, "mtllib ../box.mtl other.mtl\nusemtl wall\nf 1 2 3")
    notes = mesh.read(path, unit=1, materials=box.MATERIALS).notes
    assert notes[0].endswith("are left out: ../box.mtl, other.mtl.")


@pytest.mark.parametrize("name", ["loop.mtl", "x" * 300])
def test_links_in_a_circle_and_endless_names_are_no_file(tmp_path, name):
    """Both are errors of the system, of two kinds."""
    (tmp_path / "loop.mtl").symlink_to(tmp_path / "loop.mtl")
    path = obj(tmp_path, f"mtllib {name}\nusemtl wall\nf 1 2 3")
    notes = mesh.read(path, unit=1, materials=box.MATERIALS).notes
    assert "beside the file are left out" in notes[0]


def square(folder, mode, index, **more):
    """GlTF of a square of 1 m, whose corners are normalized whole numbers."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.int16) * 32767
    content = corners.tobytes() + np.array(index, "<u2").tobytes()
    accessors = [
        {"bufferView": 0, "componentType": 5122, "normalized": True, "count": 4, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5123, "count": len(index), "type": "SCALAR"},
    ]
    primitive = {"attributes": {"POSITION": 0}, "indices": 1, "mode": mode}
    uri = "data:application/octet-stream;base64," + base64.b64encode(content).decode()
    scene = {
        "asset": {"version": "2.0"},
        "extensionsRequired": ["KHR_mesh_quantization"],
        "nodes": [{"mesh": 0, "name": "box"}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": [
            {"buffer": 0, "byteLength": 24},
            {"buffer": 0, "byteOffset": 24, "byteLength": 2 * len(index)},
        ],
        "buffers": [{"byteLength": len(content), "uri": uri}],
    }
    path = folder / "square.gltf"
    path.write_text(json.dumps(scene | more))
    return path


@pytest.mark.parametrize(
    ("mode", "index"),
    [(4, [0, 1, 2, 0, 2, 3]), (5, [0, 1, 3, 2]), (6, [0, 1, 2, 3])],
    ids=["triangles", "strip", "fan"],
)
@pytest.mark.parametrize("more", [{}, {"scenes": [{"nodes": [0]}]}], ids=["nodes", "scene"])
def test_a_quantized_square_of_gltf_is_one_quad(tmp_path, mode, index, more):
    (layer,) = mesh.read(square(tmp_path, mode, index, **more), materials=WALL).layers
    (quad,) = layer.quads
    np.testing.assert_allclose(area_vector(quad), [0, -1, 0], atol=1e-12)


def test_materials_of_gltf_with_one_name_are_told_apart(tmp_path):
    """Both had the reflectance of the first."""
    path = square(tmp_path, 4, [0, 1, 2, 0, 2, 3], nodes=[{"mesh": 0}, {"mesh": 1}])
    scene = json.loads(path.read_text())
    [primitive] = scene["meshes"][0]["primitives"]
    scene["meshes"] = [{"primitives": [primitive | {"material": k}]} for k in range(2)]
    colours = [{"baseColorFactor": [r, r, r, 1]} for r in (0.8, 0.1)]
    scene["materials"] = [{"name": "paint", "pbrMetallicRoughness": each} for each in colours]
    path.write_text(json.dumps(scene))
    layers = mesh.read(path, materials={}).layers
    assert {layer.material.reflectance for layer in layers} == {0.8, 0.1}
    assert {layer.name for layer in layers} == {"paint", "paint (2)"}
    [both] = mesh.read(path, materials={"paint": Lambertian(0.5)}).layers
    assert len(both.quads) == 2


@pytest.mark.parametrize("kind", ["obj", "ply"])
def test_a_concave_pentagon_of_a_file_keeps_its_area(tmp_path, kind):
    """A fan about its first corner has an area of 14 m²."""
    corners = ["0 0 0", "4 0 0", "4 4 0", "2 1 0", "0 4 0"]
    path = tmp_path / f"box.{kind}"
    if kind == "obj":
        path.write_text("".join(f"v {c}\n" for c in corners) + "usemtl box\nf 1 2 3 4 5\n")
    else:
        axes = "".join(f"property float {axis}\n" for axis in "xyz")
        head = f"ply\nformat ascii 1.0\nelement vertex 5\n{axes}element face 1\n"
        head += "property list uchar int vertex_indices\nend_header\n"
        path.write_text(head + "\n".join(corners) + "\n5 0 1 2 3 4\n")
    (layer,) = mesh.read(path, unit=1.0, materials=WALL).layers
    areas = [area_vector(quad)[2] for quad in layer.quads]
    assert min(areas) > 0
    assert sum(areas) == pytest.approx(10)
