"""Notes on what building models do not state leave out what the case states."""

from drcmitsuba.model.notes import Notes
from drcmitsuba.model.unstated import glass, note_reflectances, without_stated


def test_notes_leave_out_what_the_case_states():
    notes = Notes()
    note_reflectances(["floor", "wall", "ceiling"], notes)
    glass(None, "glass", notes)
    glass(None, "wall glass", notes)
    notes.add("Curved walls are facets", "wall")
    told = notes.sentences()
    assert without_stated(told, ()) == told
    assert without_stated(told, {"floor", "wall", "glass"}) == (
        "Reflectances that the file does not state are those of LM-83: ceiling 0.7.",
        "Windows without a visible transmittance have 0.6: glass, wall glass.",
        "Curved walls are facets: wall.",
    )
    assert without_stated(told, {"floor", "wall", "ceiling"}) == told[1:]
