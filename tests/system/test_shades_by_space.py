"""Shades that close space by space: two rooms whose windows have one glass and one direction."""

import json
import math

import numpy as np
import pytest

import drcmitsuba
from drcmitsuba import InputError
from drcmitsuba.annual.variants import evaluate_variants
from drcmitsuba.design.model_layout import ModelLayout
from drcmitsuba.plan import notes
from drcmitsuba.runtime import backend
from drcmitsuba.scene.prepared_case import prepared
from tests.system.every_room import GLASS, HONEYBEE, SHADING
from tests.unit.model import box_room as box

PANE = "generic_exterior_window_vis_0.64"
BY_SPACE = SHADING + 'groups = "spaces"\n'
GROUPS = "".join(
    f'[groups.blind_{k}]\npanes = ["generic_ext*"]\nspaces = ["Room_{k}"]\nstates = ["shade"]\n'
    for k in (1, 2)
)
DESIGN = '[design]\nfilm = "opal"\n'
NAMES = ("Room_1 south", "Room_2 south")


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


@pytest.fixture(scope="module")
def case_of(tmp_path_factory):
    """Function that makes a case of two rooms, of which the second has a window half as high."""
    folder = tmp_path_factory.mktemp("rooms")
    rooms = box.room("Room_1"), box.room("Room_2", shift=5.0)
    (aperture,) = rooms[1]["faces"][1]["apertures"]
    corners = aperture["geometry"]["boundary"]
    top = max(z for _, _, z in corners)
    aperture["geometry"]["boundary"] = [[x, y, z - 0.5 * (z == top)] for x, y, z in corners]
    box.written(folder, box.model(*rooms), "rooms.hbjson")

    def case(tables):
        text = HONEYBEE.replace("spacing = 1.4", "spacing = 0.7\nmargin = 0.5") + GLASS
        (folder / "case.toml").write_text(text + tables)
        return drcmitsuba.load_case(folder / "case.toml")

    return case


@pytest.fixture(scope="module")
def by_space(case_of):
    """E of both rooms, each with a shade of its own."""
    backend.select()
    return drcmitsuba.evaluate(case_of(BY_SPACE)).illuminance


def test_the_shade_of_a_space_closes_by_its_own_sensors(case_of, by_space):
    groups = prepared(case_of(BY_SPACE)).groups
    assert (groups.states.names, groups.spaces) == (NAMES, (("Room_1",), ("Room_2",)))
    E = by_space
    sunlit = E["direct_sun"] >= 1000
    closes = []
    for name in ("Room_1", "Room_2"):
        own = sunlit.values[:, E["space"].values == name]
        closes.append(own.sum(axis=1) >= math.ceil(0.02 * own.shape[1]))
    assert (closes[0] & ~closes[1]).any()
    np.testing.assert_array_equal(E["facade_state"].values.T, closes)
    alone = closes[0] & ~closes[1]  # the open room has the light of open windows alone
    second = {
        "time": np.flatnonzero(alone),
        "sensor": np.flatnonzero(E["space"].values == "Room_2"),
    }
    np.testing.assert_allclose(E["total"][second], E["total_open"][second], rtol=1e-5)
    both = drcmitsuba.evaluate(case_of(SHADING)).illuminance
    np.testing.assert_array_equal(both["shade_closed"].values, np.logical_or(*closes))


def test_groups_may_name_spaces(case_of, by_space):
    ours = drcmitsuba.evaluate(case_of(GROUPS)).illuminance
    assert json.loads(ours.attrs["groups"])["names"] == ["blind_1", "blind_2"]
    np.testing.assert_array_equal(ours["facade_state"].values, by_space["facade_state"].values)
    np.testing.assert_allclose(ours["total"].values, by_space["total"].values, rtol=1e-5)
    case = case_of(GROUPS.replace("Room_2", "Room_3"))
    with pytest.raises(InputError, match=r"groups\.blind_2\.panes: no pane is meant; .*Room_1"):
        prepared(case).check()


def test_spaces_are_openings_of_their_own(case_of):
    light = drcmitsuba.elements(case_of(BY_SPACE), fills=["opal"])
    assert light.openings == NAMES
    assert light.fills["Room_2 south"] == (PANE, "shade", "opal")
    clear, opal = (light.illuminance({NAMES[1]: fill}) for fill in (PANE, "opal"))
    differs = np.abs(opal["total"] / clear["total"] - 1).max("time")
    is_second = prepared(light.case).receivers.coordinates["space"].values == "Room_2"
    np.testing.assert_array_equal(differs.values > 1e-3, is_second)
    as_in_case = light.evaluate().metrics["groups"]
    assert [*as_in_case] == [*NAMES]


def test_variants_close_space_by_space(case_of, by_space):
    milky = f'[materials."{PANE}"]\ntype = "diffuser"\ntransmittance = 0.5\n'
    cases = [case_of(BY_SPACE), case_of(BY_SPACE + milky)]
    first, second = (result.illuminance for result in evaluate_variants(cases))
    assert first["group"].values.tolist() == [*NAMES]
    np.testing.assert_array_equal(first["facade_state"].values, by_space["facade_state"].values)
    assert "group" not in second.coords  # nothing that a shade covers


def test_a_search_may_mean_the_panes_of_a_group(case_of):
    layout = ModelLayout.of(case_of(GROUPS + DESIGN + 'groups = ["blind_2"]\n'))
    assert [str(panes) for panes in layout.openings.panes] == [f"{PANE} (south, Room_2)"]
    with pytest.raises(InputError, match=r"design\.groups: there is no group \"x\"; .*blind_1"):
        ModelLayout.of(case_of(GROUPS + DESIGN + 'groups = ["x"]\n'))


@pytest.mark.slow
def test_an_eye_sees_the_shade_of_its_own_space(case_of, by_space):
    closed = by_space["facade_state"].sel(group=NAMES[0]).values
    E = drcmitsuba.glare(case_of(BY_SPACE)).hours["illuminance"].isel(view=0)
    open_, shaded = (E.isel(state=state).values for state in (0, 1))
    expected = np.where(closed, shaded, open_)
    assert 0 < closed.mean() < 1
    np.testing.assert_allclose(E.sel(state="applied").values, expected, rtol=1e-4)


@pytest.mark.parametrize(("spaces", "left"), [("", ()), ('"Room_2"', NAMES[:1])])
def test_shades_of_spaces_that_are_left_out_stay_open_with_a_note(case_of, spaces, left):
    case = case_of(BY_SPACE + f"[output]\nspaces = [{spaces}]\n")
    some = [note for note in notes(case) if note.startswith("output.spaces")]
    assert len(some) == len(left)
    assert all(f'the shades of "{name}", since sensors of their' in some[0] for name in left)


@pytest.mark.parametrize("tables", ["", SHADING, GROUPS])
def test_other_shades_have_no_note_of_spaces_or_one_by_group(case_of, tables):
    case = case_of(tables + '[output]\nspaces = ["Room_2"]\n')
    some = [note for note in notes(case) if note.startswith("output.spaces")]
    assert len(some) == (tables == GROUPS)
    assert all('"blind_1"' in note for note in some)
