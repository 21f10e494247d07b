"""Mitsuba scenes, in XML and as dictionaries: shapes against Mitsuba's own, materials, refusals."""

from contextlib import suppress

import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.model.materials import (
    DielectricMaterial,
    GlazingMaterial,
    Lambertian,
    MirrorMaterial,
)
from drcmitsuba.model.mitsuba import from_dict, read
from drcmitsuba.model.model import areas
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.geometry import normals

ROOM = """<scene version="3.0.0">
  <default name="rho" value="0.6"/>
  <integrator type="path"><integer name="max_depth" value="8"/></integrator>
  <sensor type="perspective"><transform name="to_world">
    <lookat origin="0,0,1" target="1,0,1" up="0,0,1"/></transform></sensor>
  <bsdf type="twosided" id="wall"><bsdf type="diffuse">
    <spectrum name="reflectance" value="$rho"/></bsdf></bsdf>
  <bsdf type="thindielectric" id="pane"><float name="int_ior" value="1.5"/></bsdf>
  <include filename="more.xml"/>
  <shape type="rectangle" id="floor">
    <transform name="to_world"><scale x="2" y="3"/><translate value="1 2 3"/></transform>
    <ref id="wall"/></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.5"/>
    <rotate x="1" y="1" angle="30"/><translate z="-1"/></transform>
    <bsdf type="diffuse" id="box"><rgb name="reflectance" value="0.1, 0.2, 0.3"/></bsdf></shape>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/></transform>
    <ref id="pane"/></shape>
  <emitter type="constant"/>
</scene>"""
MORE = """<scene version="3.0.0"><bsdf type="conductor" id="mirror">
  <string name="material" value="none"/><float name="specular_reflectance" value="0.9"/></bsdf>
  <shape type="disk" id="round"><ref id="mirror" name="bsdf"/></shape></scene>"""


def written(folder, text, name="room.xml"):
    (folder / name).write_text(text)
    return folder / name


def scene_with(shape, bsdf='<bsdf type="diffuse" id="b"/>'):
    return f'<scene version="3.0.0">{shape.format(bsdf)}</scene>'


def test_a_room_in_two_files(tmp_path):
    written(tmp_path, MORE, "more.xml")
    model = read(written(tmp_path, ROOM), unit=0.1, materials={})
    by_name = {layer.name: layer for layer in model.layers}
    assert {name: layer.material for name, layer in by_name.items()} == {
        "mirror": MirrorMaterial(type="mirror", reflectance=0.9),
        "wall": Lambertian(0.6),
        "box": Lambertian((0.1, 0.2, 0.3)),
        "pane": GlazingMaterial(type="glazing", transmittance=12 / 13, ior=1.5),
    }
    assert by_name["pane"].role == "pane"
    assert areas(by_name["wall"].quads).sum() == pytest.approx(0.24)
    assert by_name["wall"].place(0) == "room.xml: floor"
    assert any(note.startswith("Lamps, suns and skies") for note in model.notes)


def test_materials_of_the_case_replace_those_of_the_file(tmp_path):
    shape = '<shape type="cube"><bsdf type="hair" id="fur"/></shape>'
    path = written(tmp_path, scene_with(shape))
    (layer,) = read(path, unit=1, materials={"fur": Lambertian(0.2)}).layers
    assert layer.material == Lambertian(0.2)


def moved(*steps):
    return f'<transform name="to_world">{"".join(f"<{step}/>" for step in steps)}</transform>'


MIRROR = 'scale x="-1" y="2" z="2"'
LOOK = 'lookat origin="1,2,3" target="4,0,1" up="0,0,1"'
ENDS = '<point name="p0" x="1" y="1" z="1"/><point name="p1" x="1" y="2" z="3"/>'
CENTRE = '<point name="center" x="1" y="0" z="0"/>'
SHAPES = {
    "mirrored rectangle": ("rectangle", moved(MIRROR)),
    "inverted cube": ("cube", '<boolean name="flip_normals" value="true"/>'),
    "matrix": ("cube", moved('matrix value="1 0 0 2 0 0 -1 1 0 1 0 3 0 0 0 1"', MIRROR)),
    "lookat": ("rectangle", moved(LOOK)),
    "sphere": (
        "sphere",
        '<point name="center" x="1" y="0" z="0"/><float name="radius" value="2"/>',
    ),
    "inverted sphere": ("sphere", '<boolean name="flip_normals" value="true"/>'),
    "disk": ("disk", moved('rotate y="1" angle="40"')),
    "mirrored disk": ("disk", moved('scale x="-2" y="2" z="2"', 'rotate x="1" angle="10"')),
    "cylinder": ("cylinder", f'{ENDS}<float name="radius" value="0.5"/>'),
    "mirrored cylinder": ("cylinder", ENDS + moved('scale x="-2" y="2" z="2"')),
    "obj": ("obj", '<string name="filename" value="a.obj"/>' + moved('rotate z="1" angle="20"')),
}


@pytest.mark.parametrize("case", SHAPES)
def test_fronts_and_places_are_those_of_mitsuba(case, tmp_path):
    backend.select()
    kind, inner = SHAPES[case]
    shape = f'<shape type="{kind}">{{}}{inner}</shape>'
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\nf 1 2 3 4\n")
    path = written(tmp_path, scene_with(shape))
    (layer,) = read(path, unit=1, materials={}).layers
    scene = mi.load_file(str(path))
    (theirs,) = scene.shapes()
    assert areas(layer.quads).sum() == pytest.approx(theirs.surface_area()[0], rel=5e-3)
    middles, n = layer.quads[:, :3].mean(axis=1), normals(layer.quads)
    rays = mi.Ray3f(mi.Point3f((middles + 0.1 * n).T), mi.Vector3f(-n.T))
    si = scene.ray_intersect(rays)
    assert np.abs(si.t.numpy() - 0.1).max() < 0.01
    assert (np.einsum("iq,qi->q", si.n.numpy(), n) > 0.99).all()


def test_a_dictionary_is_read_as_mitsuba_reads_it():
    transform = mi.ScalarTransform4f
    scene = {
        "type": "scene",
        "light": {"type": "constant"},
        "glass": {"type": "dielectric", "int_ior": 1.5},
        "block": {
            "type": "cube",
            "to_world": transform().translate([1, 2, 3]).scale(0.5),
            "bsdf": {"type": "ref", "id": "glass"},
        },
        "floor": {
            "type": "rectangle",
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.1, 0.2, 0.2]}},
        },
    }
    block, floor = from_dict(scene).layers
    assert block.material == DielectricMaterial(type="dielectric", ior=1.5)
    np.testing.assert_allclose(block.quads.min(axis=(0, 1)), [0.5, 1.5, 2.5])
    assert (floor.name, floor.material) == ("floor", Lambertian((0.1, 0.2, 0.2)))


DIFFUSE = '<bsdf type="diffuse"/>'
CUBE = '<shape type="cube">{}</shape>'
BAD = {
    "no XML": ("hello", "XML"),
    "an entity": ('<!DOCTYPE s [<!ENTITY a "b">]><scene>&a;</scene>', "XML"),
    "another root": ("<WindowElement/>", "no <scene>"),
    "no shape": ("<scene/>", "no shape"),
    "include outside": ('<scene><include filename="../x.xml"/></scene>', "beside the file"),
    "include itself": ('<scene><include filename="room.xml"/></scene>', "too many files"),
    "no default": ('<scene><shape type="$x"/></scene>', "$x without"),
    "element": ("<scene><script/></scene>", "<script>"),
    "plugin": (scene_with('<shape type="serialized">{}</shape>'), "export it as one of"),
    "curve": (scene_with('<shape type="bsplinecurve">{}</shape>'), "bsplinecurve"),
    "bsdf": (scene_with(CUBE, '<bsdf type="hair" id="h"/>'), "hair"),
    "texture": (
        scene_with(CUBE, '<bsdf type="diffuse"><texture name="reflectance" type="bitmap"/></bsdf>'),
        "a texture",
    ),
    "metal": (scene_with(CUBE, '<bsdf type="conductor" id="c"/>'), "[materials]"),
    "bright": (
        scene_with(CUBE, '<bsdf type="diffuse"><rgb name="reflectance" value="2"/></bsdf>'),
        "0 to 1",
    ),
    "wavelengths": (
        scene_with(
            CUBE, '<bsdf type="diffuse"><spectrum name="reflectance" value="4:1,7:2"/></bsdf>'
        ),
        "wavelength",
    ),
    "reference": (scene_with(CUBE, '<ref id="gone"/>'), "nothing has it"),
    "number": (scene_with('<shape type="sphere"><float name="radius" value="x"/></shape>'), "'x'"),
    "nan": (scene_with('<shape type="sphere"><float name="radius" value="nan"/></shape>'), "nan"),
    "flat": (
        scene_with('<shape type="cube"><transform name="to_world"><scale value="0"/></transform>'
                   "</shape>"),
        "no area",
    ),
    "far": (
        scene_with('<shape type="cube"><transform name="to_world"><scale value="1e30"/></transform>'
                   "</shape>"),
        "no affine",
    ),
    "mesh": (
        scene_with('<shape type="obj"><string name="filename" value="/etc/passwd"/></shape>'),
        "beside",
    ),
    "two sides": (
        scene_with(CUBE, f'<bsdf type="twosided">{2 * DIFFUSE}</bsdf>'),
        "one for each side",
    ),
    "nested": (scene_with(CUBE, '<bsdf type="twosided">' * 40 + "</bsdf>" * 40), "in one another"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_scenes_are_refused_in_one_line(case, tmp_path):
    text, complaint = BAD[case]
    with pytest.raises(InputError) as error:
        read(written(tmp_path, text), unit=1, materials={})
    message = str(error.value)
    assert complaint in message
    assert "room.xml" in message
    assert "\n" not in message


def test_a_scene_without_a_unit_asks_for_it(tmp_path):
    with pytest.raises(InputError, match="unit"):
        read(written(tmp_path, scene_with(CUBE)), materials={})


def test_mutated_scenes_give_a_model_or_are_refused(tmp_path):
    rng = np.random.default_rng(0)
    written(tmp_path, MORE, "more.xml")
    for _ in range(300):
        raw = bytearray(ROOM.encode())
        for at in rng.integers(len(raw), size=rng.integers(1, 4)):
            raw[at] = rng.integers(256)
        (tmp_path / "room.xml").write_bytes(raw)
        with suppress(InputError):
            read(tmp_path / "room.xml", unit=1, materials={})
