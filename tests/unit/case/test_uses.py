"""Uses of spaces: the program's table, words that tell a use, and what a case overrules."""

import re
from collections import Counter

import pytest
import shapely

from drcmitsuba.case.case import Case
from drcmitsuba.case.uses import (
    UseTable,
    clock_hours,
    known_uses,
    recognised,
    shipped_uses,
    with_uses,
)
from drcmitsuba.model.space import Space, SpaceFloor
from drcmitsuba.plan.notes import notes
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import checked
from drcmitsuba.scene.spaces import box_and_note
from tests import ROOT
from tests.unit.scene.test_spaces_of_case import WEST, two_rooms

USES = known_uses({}, "case")
GRID = {"spaces": ["*"], "spacing": 1.0}


def space(name, use="", **more):
    return Space(name, (SpaceFloor(0.0, shapely.box(0, 0, 2, 2)),), use=use, **more)


def test_every_use_says_where_its_numbers_are_from():
    for use in shipped_uses().values():
        assert use.source.startswith("EN 12464-1:2011, 5.")
        assert "DIN V 18599-10" in use.source
        assert use.hours[0] < use.hours[1]
        assert use.words
    words = Counter(word for use in shipped_uses().values() for word in use.words)
    assert max(words.values()) == 1


def test_the_table_of_the_docs_is_the_program_s():
    text = (ROOT / "docs" / "howto" / "buildings.md").read_text(encoding="utf-8")
    cells = re.findall(r"\| ([a-z, ]+) \| (\d+) \| (\d+)–(\d+) (?=\|)", text)
    told = {
        name: (float(lx), (int(first), int(last)))
        for names, lx, first, last in cells for name in names.split(", ")
    }  # fmt: skip
    assert told == {name: (use.target, use.hours) for name, use in shipped_uses().items()}


@pytest.mark.parametrize(
    ("words", "use"),
    [
        ("office", "office"), ("Generic Office Program", "office"), ("ClosedOffice", "office"),
        ("OfficeOpenPlan", "office"), ("CorridorOrTransition", "circulation"),
        ("ConferenceMeetingOrMultipurpose", "meeting room"), ("Elec/MechRoom", "plant room"),
        ("ClassroomOrLectureOrTraining", "classroom"), ("A105 Stair", "stairs"),
        ("PatientRoomHospitalOrHealthcare", "ward"), ("ReadingAreaLibrary", "library"),
        ("Book Shelves", "book shelves"), ("A204 Bathroom 2", "toilets"),
        ("20 Ladies Room", "toilets"), ("Men's Room", "toilets"), ("Mensa", "canteen"),
        ("Living Room", ""), ("Backoffices", ""), ("大厅", ""), ("", ""), ("-", ""),
    ],
)  # fmt: skip
def test_words_tell_a_use(words, use):
    assert recognised(words, USES) == use


def test_a_case_overrules_keys_of_a_use_and_adds_others_in_front():
    uses = known_uses(
        {"office": UseTable(target=300), "大厅": UseTable(target=150, words=("hall",))}, "case"
    )
    office = uses["office"]
    assert (office.target, office.hours) == (300, (7, 18))
    assert office.words == shipped_uses()["office"].words
    assert recognised("entrance hall of the office", uses) == "office"  # the case's come first
    assert recognised("large hall", uses) == recognised("大厅", uses) == "大厅"


def test_spaces_take_what_they_do_not_state():
    some = (
        space("a", "Open Office"), space("b", "office", target=200.0),
        space("Meeting 2", hours=(9, 12)), space("attic"),
    )  # fmt: skip
    told, note = with_uses(some, {"office": UseTable(power=6.0)}, "case")
    assert [(s.target, s.hours, s.power) for s in told] == [
        (500, (7, 18), 6.0), (200, (7, 18), 6.0), (500, (9, 12), None), (None, None, None),
    ]  # fmt: skip
    assert "office 500 lx, 7 to 18 h (1 space); meeting room 500 lx (1 space); those" in note
    assert 'those of "attic" tell none' in note
    assert with_uses([space("attic")], {}, "case")[1] == ""


def test_tables_of_a_case_reach_its_spaces(tmp_path):
    table = {**WEST, "use": "ward 3", "threshold": 120, "hours": [10, 16], "power": 5}
    case = two_rooms(tmp_path, GRID, west=table)
    (west,) = case.building.spaces
    assert (west.use, west.target, west.hours, west.power) == ("ward 3", 120, (10, 16), 5)
    (west,) = two_rooms(tmp_path, GRID, west=WEST).building.spaces
    assert (west.target, west.hours) == (500, (7, 18))


@pytest.mark.parametrize(
    ("more", "field", "got"),
    [
        ({"hours": [18, 8]}, "spaces.a.hours", "of which the period has none"),
        ({"hours": [9, 9]}, "spaces.a.hours", "9 to 9 h, which is none"),
        ({"hours": [18, 22]}, "spaces.a.hours", "of which the period has none"),
        ({"hours": [9]}, "spaces.a.hours.1", "nothing"),
        ({"threshold": 0}, "spaces.a.threshold", "0"),
        ({"power": -1}, "spaces.a.power", "-1"),
    ],
)
def test_unfit_tasks_are_named(tmp_path, more, field, got):
    with pytest.raises(InputError) as error:
        two_rooms(tmp_path, GRID, a={**WEST, **more})
    assert error.value.field == field
    assert got in error.value.got


def test_hours_may_pass_midnight():
    assert clock_hours((22, 6)) == {22, 23, 0, 1, 2, 3, 4, 5}
    assert clock_hours((0, 24)) == set(range(24))
    assert clock_hours((9, 9)) == clock_hours((24, 0)) == set()
    night = {"ward": UseTable(hours=(20, 9))}
    _, note = with_uses([space("ward 3")], night, "case", (8, 18))
    assert "ward 100 lx, 20 to 9 h (1 space); of these hours the period's, 8 to 18 h" in note


BOX = {
    "name": "study", "room": {"size": [4, 5, 3]},
    "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 4], "spacing": 1.0},
    "facade": {"south": {"strips": [{"bottom": 0.9, "top": 2.7, "material": "glass"}]}},
    "materials": {"glass": {"type": "glazing", "transmittance": 0.7}},
}  # fmt: skip


def test_a_box_has_a_use():
    """Its name is that of the case, which tells no use unless the case asks about uses."""
    table = {"study": {"use": "office", "power": 6, "hours": [9, 17]}}
    case = Case.model_validate({**BOX, "spaces": table})
    (box,), note = box_and_note(case)
    assert (box.name, box.use, box.target, box.hours, box.power) == (
        "study", "office", 500, (9, 17), 6,
    )  # fmt: skip
    assert note.startswith("spaces: targets and hours by use are office 500 lx")
    assert note in notes(case)
    (plain,), nothing = box_and_note(Case.model_validate({**BOX, "name": "office"}))
    assert (plain.target, nothing) == (None, "")
    named = Case.model_validate({**BOX, "name": "office 7", "uses": {"office": {"target": 300}}})
    assert box_and_note(named)[0][0].target == 300


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"spaces": {"studio": {"use": "office"}}}, "spaces.studio: a box is one space"),
        ({"spaces": {"study": {"outline": [[0, 0], [1, 0], [1, 1]]}}}, "leave it out"),
    ],
)
def test_other_spaces_of_a_box_are_refused(table, said):
    with pytest.raises(InputError, match=said):
        checked(Case, {**BOX, **table}, "case.toml")


def test_a_use_that_nobody_knows_needs_a_target():
    with pytest.raises(InputError) as error:
        known_uses({"offices": UseTable(power=3)}, "case.toml")
    assert str(error.value) == (
        "case.toml: uses.offices.target: none, and the program has no such use; "
        'did you mean "office"?'
    )


def test_a_use_of_the_case_that_no_space_can_have_is_refused():
    """A mistyped name would leave the program's own numbers in place, without a word."""
    spaces = [Space("west", (), use="office")]
    with pytest.raises(InputError, match=r"uses\.offce: no space has this use.*office"):
        with_uses(spaces, {"offce": UseTable(target=300)}, "case.toml")
    with_uses(spaces, {"offce": UseTable(target=300, words=("desk",))}, "case.toml")
    with_uses([Space("west", (), use="offce")], {"offce": UseTable(target=300)}, "case.toml")


def test_a_use_that_is_nearly_a_known_one_is_told():
    _, note = with_uses([space("west", "offce"), space("hall", "lobby")], {}, "case.toml")
    assert 'those of "west" (did you mean "office"?) tell none' in note
    assert 'did you mean "office"?' in with_uses([space("west", "offce")], {}, "case.toml")[1]


def test_hours_that_the_period_cuts_off_are_told():
    spaces = [Space("west", (), use="office")]
    _, cut = with_uses(spaces, {}, "case.toml", (8, 18))
    assert "the period's, 8 to 18 h, count alone" in cut
    _, whole = with_uses(spaces, {}, "case.toml", (6, 20))
    assert "count alone" not in whole
