"""The table [groups], and schedules."""

import pytest

from drcmitsuba.case.reading import load_case
from drcmitsuba.case.schedule import HOURS, read_schedule
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.pane_groups import PaneGroups

ROOM = """
[room]
size = [5.0, 4.0, 3.0]
[facade.south]
strips = [{ bottom = 1, top = 2, material = "glass" }]
[facade.east]
strips = [{ bottom = 1, top = 2, material = "glass" }, { bottom = 2, top = 2.8, material = "milk" }]
[materials.glass]
type = "glazing"
transmittance = 0.7
[materials.milk]
type = "diffuser"
transmittance = 0.3
[materials.fabric]
type = "diffuser"
transmittance = 0.1
[sensors]
corner = [1, 1, 0.8]
count = [3, 3]
spacing = 0.5
"""
SHADE = '[shading]\nmaterial = "fabric"\n'


@pytest.fixture(autouse=True)
def variant():
    backend.select()


def case(tmp_path, more=""):
    file = tmp_path / "room.toml"
    file.write_text(ROOM + more)
    return load_case(file)


def test_a_shade_closes_façade_by_façade(tmp_path):
    groups = PaneGroups.of(case(tmp_path, SHADE))
    assert groups.states.names == ("south", "east", "(others)")  # milk glass needs no shade
    assert groups.states.states == (("open", "shaded"), ("open", "shaded"), ("open",))
    assert groups.strip("glass", "east") == 1
    assert groups.strip("milk", "east") == 2
    together = PaneGroups.of(case(tmp_path, SHADE + 'groups = "together"\n'))
    assert together.states.names == ("shade",)
    assert len(PaneGroups.of(case(tmp_path))) == 0


def test_groups_are_named_by_material_and_side(tmp_path):
    text = '[groups.low]\npanes = ["gl*"]\nstates = ["milk", "fabric"]\n'
    text += '[groups.high]\npanes = ["milk"]\nfacing = "east"\nstates = ["fabric"]\n'
    groups = PaneGroups.of(case(tmp_path, text))
    assert groups.states.states == (("open", "milk", "fabric"), ("open", "fabric"))
    assert groups.facings == (("south", "east"), ("east",))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[groups.a]\npanes = ["glas"]\nstates = ["fabric"]\n', "groups.a.panes: no pane is meant"),
        ('[groups.a]\npanes = ["glass"]\nstates = ["fabrc"]\n', 'did you mean "?fabric'),
        ('[groups.a]\npanes = ["glass"]\n', "groups.a.states: no other state than open"),
        ('[groups.a]\nstates = ["fabric"]\n', 'a.panes: no group "a" of panes to the outside'),
        (
            '[groups.a]\npanes = ["glass"]\nstates = ["fabric"]\n'
            '[groups.b]\npanes = ["*"]\nfacing = "south"\nstates = ["fabric"]\n',
            r"groups.b.panes: glass \(south\) belongs to a, too",
        ),
        ('[groups.a]\npanes = ["glass"]\nfacing = "up"\nstates = ["fabric"]\n', "groups.a.facing"),
        (
            '[groups.a]\npanes = ["glass"]\nstates = ["fabric"]\nschedule = "no.csv"\n',
            "groups.a.schedule: no.csv: no such file",
        ),
    ],
)
def test_unfit_groups_are_one_line(tmp_path, text, message):
    with pytest.raises(InputError, match=message) as caught:
        PaneGroups.of(case(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_a_schedule_names_states_or_their_numbers(tmp_path):
    file = tmp_path / "s.csv"
    rows = ["open", "fabric", "1", " 0"] * (HOURS // 4)
    file.write_text("south, east\n" + "".join(f"x,{row}\n" for row in rows), encoding="utf-8-sig")
    states = read_schedule(file, "east", ("open", "fabric"))
    assert states[:4].tolist() == [0, 1, 1, 0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", 'head: no column "east"'),
        ("esat\n" + "open\n" * HOURS, "did you mean"),
        ("east\n" + "open\n" * 24, "lines: 24 below the head; give 8760"),
        ("east\n" + "open\n" * (HOURS - 1) + "opn\n", 'line 8761, east: "opn"; did you mean'),
        ("south,east\n" + "open\n" * HOURS, 'line 2, east: ""'),
        ("east\n\n" + "opn\n" * HOURS, 'line 3, east: "opn"'),
        ("east,east\n" + "open,fabric\n" * HOURS, 'head: 2 columns "east"; give each group one'),
        ("east\n" + "\0\n" * HOURS, "s.csv"),
    ],
)
def test_unfit_schedules_are_one_line(tmp_path, text, message):
    file = tmp_path / "s.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_schedule(file, "east", ("open", "fabric"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("table", "mirrors"),
    [("", True), ("[groups.window]\npanes = ['pane']\nstates = ['shade']\n", False),
     ("[sun]\nmodel = 'adaptive'\n", False)],
)  # fmt: skip
def test_smooth_plastic_is_no_mirror_beside_groups_of_panes(table, mirrors, tmp_path):
    """Sums over groups count no light by way of mirrors: such a floor opened before, and does."""
    (tmp_path / "room.rad").write_text(
        "void plastic floor 0 0 5 .2 .2 .2 .03 0\nvoid glass pane 0 0 3 .9 .9 .9\n"
        "floor polygon f 0 0 12 0 0 0 4 0 0 4 5 0 0 5 0\n"
        "pane polygon p 0 0 12 0 0 1 0 0 2 4 0 2 4 0 1\n"
    )
    (tmp_path / "case.toml").write_text(
        "[model]\nfiles = ['room.rad']\n[sensors]\nfloors = ['floor']\n"
        f"[materials.shade]\ntype = 'diffuser'\ntransmittance = 0.1\n{table}"
    )
    case = load_case(tmp_path / "case.toml")
    assert [layer.name for layer in case.building.layers if layer.deviates] == ["floor"] * mirrors
    assert any(
        "lowers the illuminance" in n and "mesh of suns" in n for n in case.building.notes
    ) == (not mirrors)
    dull = case.without_polish()
    assert not dull.standing
    assert any("lowers the illuminance" in n for n in dull.building.notes)
    floor = next(layer for layer in case.building.layers if layer.name == "floor")
    assert floor.material.reflectance == pytest.approx(0.2 * 0.97 + 0.03)
