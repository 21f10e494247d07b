"""Panes of several files: those of one name and another material have names of their own."""

from drcmitsuba.case.reading import load_case
from drcmitsuba.runtime import backend
from tests.unit.model import box_room as box


def panes_of(folder, more=""):
    (folder / "case.toml").write_text(
        '[model]\nfiles = ["a.hbjson", "b.hbjson", "c.hbjson"]\n[sensors]\nspaces = ["*"]\n' + more
    )
    case = load_case(folder / "case.toml")
    layers = [layer for layer in case.building.layers if layer.role == "pane"]
    taus = [round(case.materials[layer.name].transmittance, 2) for layer in layers]
    return case.building.notes, [layer.name for layer in layers], taus


def test_panes_of_one_name_keep_their_materials(tmp_path):
    """An office had a quarter of its light: a file beside its own had dark panes of one name."""
    backend.select()
    for k, (name, t) in enumerate({"a": 0.9, "b": 0.3, "c": 0.9}.items()):
        room = box.room(name, shift=20.0 * k)
        window = room["faces"][1]["apertures"][0]
        window["properties"]["radiance"] = {"modifier": "pane"}
        glass = {"type": "Glass", "identifier": "pane"}
        glass |= {f"{c}_transmissivity": t for c in "rgb"}
        whole = box.model(room, radiance={"modifiers": [glass]})
        box.written(tmp_path, whole, f"{name}.hbjson")
    notes, names, taus = panes_of(tmp_path)
    assert names == ["pane", "pane (2)", "pane"]
    clear, dark, same = taus
    assert (clear, clear > dark + 0.4) == (same, True)
    assert "Panes of another material than others of their name: pane (2)." in notes
    table = '[materials.pane]\ntype = "glazing"\ntransmittance = 0.5\n'
    notes, names, taus = panes_of(tmp_path, table)
    assert (set(names), taus) == ({"pane"}, [0.5] * 3)
    assert not any("pane (2)" in note for note in notes)
