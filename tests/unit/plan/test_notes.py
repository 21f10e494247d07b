"""Notes that a result carries beside its numbers."""

import re

import pytest

from drcmitsuba.case.case import Case
from drcmitsuba.plan.notes import notes
from drcmitsuba.runtime import backend
from tests import ROOT
from tests.unit.plugins.measured_files import write

OPEN = {"strips": [{"bottom": 1.0, "top": 2.0, "material": "open"}]}
OPAL = {"strips": [{"bottom": 1.0, "top": 2.0, "material": "opal"}]}
CASE = {
    "room": {"size": [3.0, 4.0, 2.8]},
    "sensors": {"corner": [0.3, 0.3, 0.7], "count": [2, 2], "spacing": 1.0},
    "materials": {"opal": {"type": "diffuser", "transmittance": 0.2, "reflectance": 0.4}},
    "shading": {"material": "opal"},
}


@pytest.mark.parametrize(
    ("facade", "facades"),
    [
        ({"south": OPEN, "west": OPEN}, "south and west"),
        ({"south": OPEN, "east": OPEN, "west": OPEN}, "south, east and west"),
        ({"south": OPEN, "west": OPAL}, None),  # the shade covers no diffusing pane
        ({"south": OPEN}, None),
    ],
)
def test_clear_panes_in_several_planes_close_one_by_one(facade, facades):
    note = f"shading: {facades} close and open each on its own, as in LM-83"
    assert notes(Case.model_validate({**CASE, "facade": facade})) == [note] * (facades is not None)


def test_without_a_shade_there_is_no_note_of_it():
    facade = {"south": OPEN, "west": OPEN}
    assert notes(Case.model_validate({**CASE, "facade": facade, "shading": None})) == []


def of_film(file):
    """Notes of a case with a film."""
    film = {"type": "bsdf", "file": str(file)}
    facade = {"south": {"strips": [{"bottom": 1.0, "top": 2.0, "material": "film"}]}}
    tables = {"facade": facade, "materials": {"film": film}, "shading": None}
    return notes(Case.model_validate({**CASE, **tables}))


def test_a_film_that_is_not_reciprocal_has_one_note_with_its_size(tmp_path):
    """Random matrices are not; the shipped films are, within the noise of their rays."""
    backend.select()
    told = [n for n in of_film(write(tmp_path, "LBNL/Klems Quarter", albedo=0.2)) if "recip" in n]
    assert len(told) == 1
    assert re.search(r"is not reciprocal, by \d+ % of its transmission, \d+ % of its refl", told[0])
    for film in (ROOT / "scenes" / "films").glob("*.xml"):
        assert not [note for note in of_film(film) if "recip" in note]


@pytest.mark.parametrize(
    ("missing", "lacking"),
    [
        ((), None),
        (("tb",), None),  # it follows by reciprocity
        (("rf",), "lacks the reflection into the room: taken as 0"),
        (
            ("rb", "rf"),
            "lacks the reflection to the outside and the reflection into the room: taken",
        ),
    ],
)
def test_a_film_whose_file_lacks_a_side_has_a_note(tmp_path, missing, lacking):
    """A Klems file without reflection into the room lost 5 % of E without a word."""
    backend.select()
    file = write(tmp_path, "LBNL/Klems Quarter", missing, albedo=0.2)
    told = [note for note in of_film(file) if "lacks" in note]
    assert len(told) == (lacking is not None)
    assert all(note.startswith("materials.film: ") and lacking in note for note in told)


@pytest.mark.parametrize(("size", "count"), [(0.1, 0), (0.45, 1)])
def test_cells_that_are_large_beside_the_room_are_noted(size, count):
    """A model in wrong units, for instance: light of its walls is a mean over half of the room."""
    case = Case.model_validate(
        {
            "room": {"size": [0.6, 0.8, 0.5]},
            "sensors": {"corner": [0.2, 0.2, 0.1], "count": [2, 2], "spacing": 0.2},
            "accuracy": {"cell_size": size},
        }
    )
    some = [note for note in notes(case) if "cell_size" in note]
    assert len(some) == count
    assert all("cells of 0.45 m in rooms of 0.5 m" in note for note in some)
    assert all(note.endswith("write 0.1 or less") for note in some)
