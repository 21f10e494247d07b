"""Meshes in another unit, or with another axis up, are asked about; floors stand where they lie."""

import numpy as np
import pytest

from drcmitsuba.case.reading import load_case
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.floors_of_model import rooms_of
from tests.unit.model import box_room as box


def case_file(folder, text, keys=""):
    (folder / "box.obj").write_text(text)
    (folder / "case.toml").write_text(
        f'[model]\nfiles = ["box.obj"]\n{keys}\n[sensors]\nfloors = ["floor"]\n'
        "[materials.pane]\ntype = 'glazing'\ntransmittance = 0.6\n"
        "[model.reflectances]\nwall = 0.5\nfloor = 0.2\nceiling = 0.8\n"
    )
    return folder / "case.toml"


def upright(text):
    """The same box with y up: z becomes y, and y becomes −z."""
    lines = []
    for line in text.splitlines():
        if line.startswith("v "):
            x, y, z = line.split()[1:4]
            line = f"v {x} {z} {-float(y)}"
        lines.append(line)
    return "\n".join(lines) + "\n"


def extent(case):
    every = np.concatenate([layer.quads for layer in case.building.layers]).reshape(-1, 3)
    return np.ptp(every, axis=0)


def test_a_mesh_with_y_up_is_turned(tmp_path):
    """Its floors had no level polygon, and nothing said how to turn them."""
    backend.select()
    text = upright(box.obj_text())
    lying = load_case(case_file(tmp_path, text, 'unit = "m"'))
    with pytest.raises(InputError, match=r'no level polygon; .* or give up = "y" in \[model\]'):
        rooms_of(lying.building, ("floor",), 0.8, "case")
    standing = load_case(case_file(tmp_path, text, 'unit = "m"\nup = "y"'))
    assert extent(standing) == pytest.approx([4, 6, 3])
    [room] = rooms_of(standing.building, ("floor",), 0.8, "case")
    assert (room.height, room.outline.area) == pytest.approx((0, 24))
    same = load_case(case_file(tmp_path, box.obj_text(), 'unit = "m"'))
    for one, other in zip(standing.building.layers, same.building.layers, strict=True):
        np.testing.assert_allclose(one.quads, other.quads, atol=1e-9)


@pytest.mark.parametrize("factor", [1000.0, 0.01])
def test_rooms_of_no_size_are_asked_for_their_unit(tmp_path, factor):
    """A glTF file in millimetres asked for a larger spacing of 79,964,004 points."""
    scene = "".join(
        f"{name} polygon p{k} 0 0 12 " + " ".join(f"{factor * v:g}" for v in ring.ravel()) + "\n"
        for k, (name, ring) in enumerate(
            ("wall", box.CORNERS[index]) for _, index in box.FACES.values()
        )
    )
    (tmp_path / "box.rad").write_text(f"void plastic wall 0 0 5 .5 .5 .5 0 0\n{scene}")
    file = tmp_path / "case.toml"
    text = '[model]\nfiles = ["box.rad"]\n{}\n[sensors]\nfloors = ["wall"]\n'
    file.write_text(text.format(""))
    with pytest.raises(InputError, match=r"model\.unit: the model without.* m; give the unit"):
        load_case(file)
    file.write_text(text.format('unit = "mm"'))
    assert extent(load_case(file)) == pytest.approx(np.array([4, 6, 3]) * factor / 1000)
