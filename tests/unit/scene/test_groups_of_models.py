"""Dynamic groups of a Honeybee model: their panes, and what else changes with them."""

from dataclasses import replace

import numpy as np
import pytest

from drcmitsuba.case.model_case import notes_on_groups
from drcmitsuba.case.reading import load_case
from drcmitsuba.case.schedule import HOURS
from drcmitsuba.model.group_states import in_states
from drcmitsuba.model.materials import Lambertian
from drcmitsuba.plan.panes import most_reflecting
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.components import place
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.panes_in_state import PanesInState, groups_with_surfaces
from drcmitsuba.scene.sun_visibility import SunVisibility
from drcmitsuba.scene.surfaces import surfaces_of
from tests.model_rooms import layer
from tests.unit.model import box_room as box

SUN = np.array([[0, -0.9, np.sqrt(1 - 0.81)]])


@pytest.fixture(autouse=True)
def variant():
    backend.select()


def states(group, *modifiers):
    taken = [{"modifier": name} for name in modifiers]
    return {"dynamic_group_identifier": group, "states": taken}


def case(tmp_path, tables, tree=("summer", "winter"), shelf=("dull", "bright"), states_of="",
         panes=("clear", "dark")):  # fmt: skip
    """Room with a pane and a shelf of the group south; a tree of its own group hides the sun."""
    room = box.room()
    window = room["faces"][1]["apertures"][0]
    window["properties"]["radiance"] = states("south", *panes)
    corners = [[1, 0.1, 1.5], [3, 0.1, 1.5], [3, 0.6, 1.5], [1, 0.6, 1.5]]
    window["indoor_shades"] = [
        box.element("Shade", "shelf", corners, radiance=states("south", *shelf))
    ]
    crown = [[-9, -2, -9], [13, -2, -9], [13, -2, 9], [-9, -2, 9]]
    trees = [box.element("Shade", "oak", crown, radiance=states("tree", *tree))]
    glass = [
        {"type": "Glass", "identifier": name} | {f"{c}_transmissivity": t for c in "rgb"}
        for name, t in (("clear", 0.9), ("dark", 0.1))
    ]
    matt = {"dull": 0.2, "bright": 0.95, "summer": 0.3, "black": 0.0, "soot": 0.0}
    modifiers = [*glass, *(box.plastic(name, r, r, r) for name, r in matt.items())]
    # Bare branches let 0.6 of the light straight through.
    modifiers.append(
        box.plastic("winter", 0.7, 0.7, 0.7, type="Trans", transmitted_diff=0.6 / 0.7)
        | {"transmitted_spec": 1.0}
    )
    modifiers.append({"type": "Mirror", "identifier": "mirror"} | dict.fromkeys(
        ("r_reflectance", "g_reflectance", "b_reflectance"), 0.9
    ))  # fmt: skip
    model = box.model(room, orphaned_shades=trees, radiance={"modifiers": modifiers})
    box.written(tmp_path, model)
    file = tmp_path / "case.toml"
    sensors = "[sensors]\ncorner = [1, 1, 0.8]\ncount = [2, 2]\nspacing = 1.0\n"
    file.write_text(f'[model]\nfiles = ["box.hbjson"]\n{states_of}{sensors}{tables}')
    by_half = "0\n" * (HOURS // 2) + f"{tree[-1]}\n" * (HOURS // 2)
    (tmp_path / "tree.csv").write_text(f"tree\n{by_half}")
    return load_case(file)


TREE = '[groups.tree]\nschedule = "tree.csv"\n'


def made_of(case, state):
    return {surface.name: surface.material for surface in surfaces_of(case, state)}


def test_a_shelf_changes_with_the_panes_of_its_group(tmp_path):
    one = case(tmp_path, "[groups.south]\n")
    assert PaneGroups.of(one).states.states == (("open", "dark"),)
    is_open, shut = made_of(one, "open"), made_of(one, "shaded")
    assert is_open["dull"] == Lambertian(0.2)
    assert shut["dull"] == Lambertian(0.95)
    assert shut["clear"].transmittance < 0.1 < is_open["clear"].transmittance
    assert shut["summer"] == is_open["summer"] == Lambertian(0.3)
    assert groups_with_surfaces(one) == ["south"]  # no sum knows the shelf
    assert most_reflecting(one, (), beyond=True) == (0.95, "dull")


def test_a_tree_follows_its_schedule(tmp_path):
    one = case(tmp_path, f"[groups.south]\n{TREE}")
    groups = PaneGroups.of(one).states
    assert groups.names == ("south", "tree")
    assert groups.states[1] == ("open", "winter")
    bare = made_of(one, "open/winter")
    assert bare["summer"].porosity == pytest.approx(0.6)
    assert bare["dull"] == Lambertian(0.2)


def test_a_sun_behind_a_tree_with_bare_states_lights_the_room(tmp_path):
    masks = []
    for tree in (("black", "winter"), ("black", "soot")):
        one = case(tmp_path, TREE, tree)
        masks.append(SunVisibility.of(one, place(one)).visible(SUN, 0.5).mask.item())
    assert masks == [True, False]


def test_groups_that_stay_in_their_first_state_are_told(tmp_path):
    one = case(tmp_path, TREE)
    (note,) = notes_on_groups(one.building, one.groups)
    assert note.endswith("a state of theirs in [model.states]: south (2 states)")
    assert "tree (2 states)" in notes_on_groups(one.building, ())[0]


@pytest.mark.parametrize(
    ("tables", "shelf", "message"),
    [
        ("[groups.tree]\n", ("dull", "bright"), "groups.tree: no pane to the outside"),
        (f'{TREE}states = ["fabric"]\n', ("dull", "bright"), "groups.tree.states"),
        ("[groups.tre]\n", ("dull", "bright"), 'tre.panes: .*; groups of the model: "south'),
        ("[groups.south]\n", ("dull", "mirror"), '"dull" is a mirror or a clear solid'),
    ],
)
def test_unfit_groups_of_a_model_are_one_line(tmp_path, tables, shelf, message):
    with pytest.raises(InputError, match=message) as caught:
        PaneGroups.of(case(tmp_path, tables, shelf=shelf))
    assert "\n" not in str(caught.value)


def test_a_model_stays_in_the_states_that_the_case_names(tmp_path):
    grouped = case(tmp_path, f"[groups.south]\n{TREE}")
    still = case(tmp_path, "", states_of='states = { south = "dark", tree = "winter" }\n')
    assert not len(PaneGroups.of(still))
    of_groups = {(s.name, s.material): s.quads for s in surfaces_of(grouped, "dark/winter")}
    own = {s.material: s.quads for s in surfaces_of(still)}
    assert {s.name for s in surfaces_of(still)} >= {"dark", "bright", "winter"}
    assert own.keys() == {material for _, material in of_groups}
    for (_, material), quads in of_groups.items():
        np.testing.assert_array_equal(own[material], quads)
    assert notes_on_groups(still.building, ()) == []
    for south in ("open", "clear", "0"):
        names = f'states = {{ south = "{south}", tree = "summer" }}\n'
        first = case(tmp_path, "", states_of=names)
        assert made_of(first, "open") == made_of(grouped, "open")
    both = 'states = { south = "1", tree = "1" }\nreflectances = { summer = 0.1, bright = 0.5 }\n'
    assert made_of(case(tmp_path, "", states_of=both), "open")["bright"] == Lambertian(0.5)


def test_states_of_one_name_or_without_a_pane_are_named_otherwise(tmp_path):
    folder = tmp_path / "alike"
    folder.mkdir()
    with pytest.raises(InputError, match="two states have this name: give a number, 0 to 1"):
        case(folder, "", panes=("clear", "clear"), states_of='states = { south = "clear" }\n')
    with pytest.raises(InputError, match="leaves an opening in place of a pane; simulate this"):
        case(folder, "", panes=("clear", "void"), states_of='states = { south = "void" }\n')


@pytest.mark.parametrize(
    ("states_of", "message"),
    [
        ('{ sowth = "dark" }', 'model.states."sowth": the model has no such group of states; did'),
        ('{ south = "darc" }', 'model.states.south: "darc"; did you mean "dark"'),
        ("{ south = 1 }", "model.states.south"),
        ('{ south = "dark" }', "groups.south: model.states keeps it in one state; give one"),
    ],
)
def test_states_that_a_model_cannot_take_are_refused(tmp_path, states_of, message):
    tables = "[groups.south]\n" if "groups" in message else ""
    with pytest.raises(InputError, match=message) as caught:
        case(tmp_path, tables, states_of=f"states = {states_of}\n")
    assert "\n" not in str(caught.value)


def test_a_state_may_leave_surfaces_out(tmp_path):
    one = case(tmp_path, "")
    layers = tuple(
        replace(layer, states=(layer.states[0], replace(layer.states[1], material=None)))
        if layer.group == "tree" else layer
        for layer in one.building.layers
    )  # fmt: skip
    model = replace(one.building, layers=layers)
    assert "summer" in [layer.name for layer in in_states(model, {"tree": 0}).layers]
    assert len(in_states(model, {"tree": 1}).layers) == len(layers) - 1


def test_surfaces_may_stand_in_another_state_than_the_panes(tmp_path):
    one = case(tmp_path, f"[groups.south]\n{TREE}")
    groups = replace(PaneGroups.of(one), standing=(1, 0))
    front = PanesInState.of(one, "(blocked)/winter", ALL_EFFECTS, groups)
    layers = {layer.name: layer for layer in one.building.layers}
    assert front.rest(layers["dull"]) == Lambertian(0.95)
    assert front.rest(layers["summer"]) == Lambertian(0.3)
    assert front.layer(layers["clear"], 0) == Lambertian(0.0)


def test_shades_of_the_first_state_come_and_go_with_materials_of_the_case(tmp_path):
    one = case(tmp_path, '[groups.south]\nstates = ["blind"]\n'
               '[materials.blind]\ntype = "diffuser"\ntransmittance = 0.1\n')  # fmt: skip
    assert groups_with_surfaces(one) == []
    shade = layer("blade", Lambertian(0.5), [[1, 0.2, 1], [3, 0.2, 1], [3, 0.2, 2], [1, 0.2, 2]])
    layers = (*one.building.layers, replace(shade, stands_in="south"))
    with_shade = one.with_building(replace(one.building, layers=layers))
    assert groups_with_surfaces(with_shade) == ["south"]
    made = {
        state: "blade" in made_of(with_shade, state) for state in ("open", "(blocked)", "blind")
    }
    assert made == {"open": True, "(blocked)": True, "blind": False}
