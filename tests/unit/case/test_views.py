"""The tables `[views.NAME]`: what they give, and views that no eye can have."""

import pytest

from drcmitsuba import load_case
from drcmitsuba.model.model import View
from drcmitsuba.picture import view as picture_view
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.views import views

ROOM = """
[room]
size = [4, 5, 3]
[sensors]
corner = [1, 1, 0.8]
count = [2, 2]
[[furniture]]
name = "cupboard"
corner = [0.5, 0.5, 0]
size = [1, 0.5, 2]
"""


def case_of(folder, text, room=ROOM):
    (folder / "room.toml").write_text(room + text)
    return load_case(folder / "room.toml")


def desk(**keys):
    keys = {"position": [2, 3, 1.2], "direction": [0, -1, 0], **keys}
    return "[views.desk]\n" + "".join(f"{key} = {value!r}\n" for key, value in keys.items())


def test_a_view_looks_all_round_by_default(tmp_path):
    case = case_of(tmp_path, desk())
    (view,) = views(case)
    assert view == View("desk", "a", (2, 3, 1.2), (0, -1, 0), (0, 0, 1), (180, 180))
    assert picture_view.of_model(view).kind == "equidistant"


@pytest.mark.parametrize("kind", ["perspective", "hemispherical", "equidistant", "equisolid"])
def test_every_kind_is_a_kind_of_pictures(kind, tmp_path):
    (view,) = views(case_of(tmp_path, desk(kind=kind, angle=[60, 40])))
    shown = picture_view.of_model(view)
    assert (shown.kind, shown.angles) == (kind, (60, 40))


@pytest.mark.parametrize(
    ("keys", "complaint"),
    [
        ({"up": [0, 2, 0]}, "views.desk.up: [0.0, 2.0, 0.0] along the direction"),
        ({"up": [0, 0, 0]}, "views.desk.up: no length"),
        ({"direction": [0, 0, 0]}, "views.desk.direction: no length"),
        ({"kind": "hemispherical", "angle": 200}, "views.desk.angle: 200"),
        ({"kind": "perspective"}, "views.desk.angle: 180"),
        ({"kind": "round"}, "views.desk.kind"),
        ({"angle": 0}, "views.desk.angle"),
        ({"angles": 90}, "views.desk.angles"),
    ],
)
def test_an_unfit_view_is_refused_in_one_line(keys, complaint, tmp_path):
    with pytest.raises(InputError) as error:
        case_of(tmp_path, desk(**keys))
    assert complaint in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("position", "complaint"),
    [
        ([2, 5.0, 1.2], "view 'desk' at (2, 5, 1.2) lies in, on or beyond a wall"),
        ([2, 3, 3.5], "in, on or beyond a wall"),
        ([1, 0.75, 1.2], "in or on 'cupboard'"),
    ],
)
def test_a_view_in_a_wall_or_in_furniture_is_refused(position, complaint, tmp_path):
    case = case_of(tmp_path, desk(position=position))
    with pytest.raises(InputError) as error:
        views(case)
    assert complaint in str(error.value)


def test_views_of_a_model_stand_beside_those_of_the_case(tmp_path):
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")
    (tmp_path / "floor.rad").write_text(
        "void plastic floor 0 0 5 .3 .3 .3 0 0\nfloor polygon f 0 0 12 0 0 0 4 0 0 4 5 0 0 5 0\n"
    )
    (tmp_path / "door.vf").write_text("rvu -vth -vp 1 1 1.2 -vd 0 1 0 -vh 180 -vv 180\n")
    model = """
[model]
files = ["floor.rad", "door.vf"]
[sensors]
floors = ["floor"]
"""
    seen = views(case_of(tmp_path, desk(), model))
    assert [view.name for view in seen] == ["desk", "door"]
    with pytest.raises(InputError, match=r"view 'desk' at .* on a surface of the model"):
        views(case_of(tmp_path, desk(position=[2, 3, 0.0005]), model))
    with pytest.raises(InputError, match=r"views\.door: a view of the model, too"):
        views(case_of(tmp_path, desk().replace("desk", "door"), model))
