"""Views of `.vf` files and sensors of `.pts` files."""

from dataclasses import replace

import numpy as np
import pytest

from drcmitsuba.model.model import Model, View, joined
from drcmitsuba.model.radiance import read_points, read_views, views
from drcmitsuba.runtime.errors import InputError


def test_views_have_their_options_and_radiances_defaults(tmp_path):
    file = tmp_path / "south.vf"
    file.write_text(
        "# RCSid -- views\n"
        "rvu -vtv -vp 1 2 1.2 -vd 0 -1 .1 -vu 0 .1 1 -vh 60 -vv 40 -vo 0 -va 0 -vs 0 -vl 0\n"
        "VIEW= -vta -vp 0 0 1\n"
    )
    assert read_views(file) == (
        View("south 1", "v", (1, 2, 1.2), (0, -1, 0.1), (0, 0.1, 1), (60, 40)),
        View("south 2", "a", (0, 0, 1), (0, 1, 0), (0, 0, 1), (45, 45)),
    )


def test_other_words_and_options_are_passed_over(tmp_path):
    assert _view(tmp_path, "\trpict -t 60 -vth -vp 1 1 1 -vh 180 -vv 180 -x 512 a.oct").kind == "h"


def _view(folder, text):
    (folder / "v.vf").write_text(text)
    (view,) = read_views(folder / "v.vf")
    return view


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "0 lines with views"),
        ("-vtx -vp 0 0 1", "-vtx"),
        ("-vp 0 0", "-vp 0 0"),
        ("-vp 0 0 nan", "-vp 0 0 nan"),
        ("-vp 0 0 1e99", "-vp 0 0 1e99"),
        ("-vd 0 0 1", "-vd along -vu"),
        ("-vd 0 0 0", "-vd along -vu"),
        ("-vh 0", "-vh 0"),
        ("-vq 1", "'-vq' in a view"),
        ("-vp 0 0 1 -vs .5", "-vs 0.5, which shifts or cuts the picture"),
        ("-vp 0 0 1 -vl -1 -vo 0", "-vl -1, which"),
        ("-vp 0 0 1 -va 5", "-va 5, which"),
        ("-vp '0 0 1", "No closing quotation"),
        ("-vp 0 0 1\n" * 1001, "1001 lines"),
    ],
)
def test_an_unfit_view_is_refused_in_one_line(text, complaint, tmp_path):
    with pytest.raises(InputError) as error:
        _view(tmp_path, text)
    assert complaint in str(error.value)
    assert "\n" not in str(error.value)


def test_sensors_have_unit_normals(tmp_path):
    (tmp_path / "desk.pts").write_text("# x y z\n0.3 0.3 .75 0 0 2\n\n1 2 3 3 0 4\r\n")
    grid = read_points(tmp_path / "desk.pts")
    assert grid.name == "desk"
    np.testing.assert_allclose(grid.points, [[0.3, 0.3, 0.75], [1, 2, 3]])
    np.testing.assert_allclose(grid.normals, [[0, 0, 1], [0.6, 0, 0.8]])


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "sensors: none"),
        ("0 0 0 0 0 1\n1 2 3 0 0\n", "line 2: sensor: 1 2 3 0 0"),
        ("0 0 0 0 0 0\n", "line 1: sensor: 0 0 0 0 0 0"),
        ("0 0 0 0 0 1\n\n0 0 inf 0 0 1\n", "line 3: sensor: 0 0 inf"),
        ("0 0 0 1e300 0 0\n", "1e+300"),
        ("0 0 0 0 0 x\n", "line 1"),
        ("0 0 0 0 0 1\0\n", "byte 0x00"),
        ("0 0 0 0 0 1\n" * 4, "more than 3"),
    ],
)
def test_unfit_sensors_are_refused_in_one_line(text, complaint, tmp_path, monkeypatch):
    monkeypatch.setattr(views, "MOST_POINTS", 3)
    (tmp_path / "a.pts").write_text(text)
    with pytest.raises(InputError) as error:
        read_points(tmp_path / "a.pts")
    assert complaint in str(error.value)
    with pytest.raises(InputError, match="no such file"):
        read_points(tmp_path / "gone.pts")


def test_views_are_scaled_with_the_model_and_angles_are_not():
    eye = View("eye", "v", (1.0, 2.0, 3.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (60.0, 40.0))
    plan = replace(eye, kind="l")
    scaled = Model(views=(eye, plan)).scaled(0.5).views
    assert [view.position for view in scaled] == [(0.5, 1.0, 1.5)] * 2
    assert [view.angles for view in scaled] == [(60.0, 40.0), (30.0, 20.0)]
    assert scaled[0].direction == eye.direction


def test_views_of_one_name_in_several_models_are_numbered():
    eye = View("eye", "v", (0, 0, 1.2), (0, 1, 0), (0, 0, 1), (60, 60))
    other = replace(eye, position=(1, 0, 1.2))
    made = joined([Model(views=(eye,)), Model(views=(other, eye))]).views
    assert [(view.name, view.position[0]) for view in made] == [("eye", 0), ("eye 2", 1)]
