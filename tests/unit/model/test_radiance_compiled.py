"""Octrees and compiled meshes are read by the files that they were made from."""

import numpy as np
import pytest

from drcmitsuba.model.radiance import read
from drcmitsuba.runtime.errors import InputError
from tests import radiance, skips

M = "void plastic m 0 0 5 .5 .5 .5 0 0\n"
N = "void plastic n 0 0 5 .2 .2 .2 0 0\n"
SQUARE = "m polygon s 0 0 12 0 0 0 1 0 0 1 1 0 0 1 0\n"
MOVE = "-rz 30 -t 1 2 3"
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl m\nf 1 2 3\nusemtl n\nf 1 2 4\n"


def octree(*names, head=b"oconv\nFORMAT=Radiance_octree\n\n\x01\x1f"):
    texts = ["-1", "-1", "-1", "3", *names, ""]
    return b"#?RADIANCE\n" + head + b"".join(t.encode() + b"\0" for t in texts) + b"\0\0\1\2"


def written(folder, **files):
    for name, content in files.items():
        content = content if isinstance(content, bytes) else content.encode()
        (folder / name.replace("_", ".")).write_bytes(content)
    return folder / "x.rad"


def refusal(path):
    with pytest.raises(InputError) as error:
        read([path])
    assert "\n" not in str(error.value)
    return str(error.value)


def test_an_instance_is_its_octrees_files_moved(tmp_path):
    command = "!genbox m b 1 2 3 | xform -t 5 0 0"
    files = {"a_rad": M + SQUARE, "a_oct": octree("a.rad", command)}
    path = written(tmp_path, x_rad=f"void instance i {1 + len(MOVE.split())} a.oct {MOVE} 0 0\n",
                   y_rad=f"!xform {MOVE} a.rad\n!genbox m b 1 2 3 | xform -t 5 0 0 {MOVE}\n",
                   **files)  # fmt: skip
    (ours,), (same,) = (read([file]).layers for file in (path, tmp_path / "y.rad"))
    assert len(ours.quads) == 7
    rows = [np.sort(np.round(layer.quads.reshape(-1, 12), 9), axis=0) for layer in (ours, same)]
    np.testing.assert_allclose(*rows, atol=1e-8)


def test_an_instances_modifier_stands_for_all_and_its_own_names_stay_inside(tmp_path):
    text = N + "n instance i 1 a.oct 0 0\n" + SQUARE
    path = written(tmp_path, x_rad=text, a_rad=M + SQUARE, a_oct=octree("a.rad"))
    assert "'m' is not defined" in refusal(path)
    (layer,) = read([written(tmp_path, x_rad=text.replace(SQUARE, ""))]).layers
    assert (layer.name, layer.material.reflectance) == ("n", 0.2)


def test_moved_films_and_solids_of_an_instance_keep_their_numbers(tmp_path):
    """An octree moves with the definitions in it, and not with those that come later."""
    solid = "void dielectric d 0 0 5 .5 .5 .5 1.5 0\nd polygon s 0 0 9 0 0 0 1 0 0 0 1 0\n"
    text = "!xform -s 2 in.rad\n" + solid.replace("dielectric d", "dielectric e").replace(
        "\nd", "\ne"
    )
    path = written(
        tmp_path, x_rad=text, in_rad="void instance i 3 a.oct -s 3 0 0\n", a_rad=solid,
        a_oct=octree("a.rad"),
    )  # fmt: skip
    inner, outer = read([path]).layers
    assert inner.material.absorption == pytest.approx(np.log(2) / 6)
    assert outer.material.absorption == pytest.approx(np.log(2))


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (octree(), "frozen"),
        (b"hello", "no octree"),
        (b"", "no octree"),
        (octree("a.rad", head=b"FORMAT=ascii\n\n\x01\x1f"), "no octree"),
        (octree("a.rad")[:45], "no octree"),
        (octree("x.rad"), "a circle"),
        (octree("gone.rad"), "no file 'gone.rad'"),
        (octree("!rm x"), "'rm' in"),
        (octree("!"), "'' in"),
    ],
)
def test_other_octrees_are_refused(content, complaint, tmp_path):
    message = refusal(written(tmp_path, x_rad="void instance i 1 a.oct 0 0\n", a_oct=content))
    assert complaint in message
    assert "x.rad: line 1" in message


@skips.RADIANCE.mark
def test_octrees_of_oconv_are_read(tmp_path):
    path = written(tmp_path, x_rad="void instance i 1 a.oct 0 0\n", a_rad=M + SQUARE)
    (tmp_path / "a.oct").write_bytes(
        radiance.run(["oconv", "a.rad", "!genbox m b 1 1 1"], tmp_path)
    )
    assert len(read([path]).layers[0].quads) == 7
    (tmp_path / "a.oct").write_bytes(radiance.run(["oconv", "-f", "a.rad"], tmp_path))
    assert "frozen" in refusal(path)


def test_a_compiled_mesh_is_the_obj_file_beside_it(tmp_path):
    text = M + N + "void mesh h 5 body.rtm -t 0 0 5 0 0\n"
    model = read([written(tmp_path, x_rad=text, body_obj=OBJ)])
    assert [layer.name for layer in model.layers] == ["m", "n"]
    assert model.layers[0].quads[:, :, 2].tolist() == [[5, 5, 5, 5]]
    assert model.notes == ("Compiled meshes are read from the OBJ files beside them: body.obj.",)
    (layer,) = read([written(tmp_path, x_rad=text.replace("void mesh", "n mesh"))]).layers
    assert (layer.name, len(layer.quads)) == ("n", 2)
    assert "'m' is not defined" in refusal(written(tmp_path, x_rad=text.removeprefix(M)))


@pytest.mark.parametrize("name", ["gone.rtm", "..", "", "/", "x" * 300, "'a\tb'"])
def test_a_compiled_mesh_without_its_obj_file_is_refused(name, tmp_path):
    message = refusal(written(tmp_path, x_rad=f"void mesh h 1 {name or chr(39) * 2} 0 0\n"))
    assert "give the OBJ file" in message
