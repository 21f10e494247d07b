"""Panes of several files: those of one name and another material have names of their own."""

from drcmitsuba.case.reading import case_of_settings, load_case, with_files
from drcmitsuba.runtime import backend
from tests.unit.model import box_room as box


def panes(case):
    layers = [layer for layer in case.building.layers if layer.role == "pane"]
    taus = [round(case.materials[layer.name].transmittance, 2) for layer in layers]
    assert taus == [round(layer.material.transmittance, 2) for layer in layers]
    return [layer.name for layer in layers], taus


def panes_of(folder, more=""):
    for k, (name, t) in enumerate({"a": 0.9, "b": 0.3, "c": 0.9}.items()):
        room = box.room(name, shift=20.0 * k)
        window = room["faces"][1]["apertures"][0]
        window["properties"]["radiance"] = {"modifier": "pane"}
        glass = {"type": "Glass", "identifier": "pane"}
        glass |= {f"{c}_transmissivity": t for c in "rgb"}
        whole = box.model(room, radiance={"modifiers": [glass]})
        box.written(folder, whole, f"{name}.hbjson")
    (folder / "case.toml").write_text(
        '[model]\nfiles = ["a.hbjson", "b.hbjson", "c.hbjson"]\n[sensors]\nspaces = ["*"]\n' + more
    )
    case = load_case(folder / "case.toml")
    return case, *panes(case)


def test_panes_of_one_name_keep_their_materials(tmp_path):
    """An office had a quarter of its light: a file beside its own had dark panes of one name."""
    backend.select()
    case, names, taus = panes_of(tmp_path)
    assert names == ["pane", "pane (2)", "pane"]
    clear, dark, same = taus
    assert (clear, clear > dark + 0.4) == (same, True)
    assert "Panes of another material than others of their name: pane (2)." in case.building.notes
    stored = case_of_settings(case.model_dump(mode="json"), tmp_path / "case.toml")
    assert panes(with_files(stored)) == (names, taus)


def test_a_case_replaces_all_panes_of_a_name_or_some(tmp_path):
    backend.select()
    table = '[materials.{}]\ntype = "glazing"\ntransmittance = 0.5\n'
    case, names, taus = panes_of(tmp_path, table.format("pane"))
    assert (set(names), taus) == ({"pane"}, [0.5] * 3)
    assert not any("pane (2)" in note for note in case.building.notes)
    case, names, taus = panes_of(tmp_path, table.format('"pane (2)"'))
    assert (names[1], taus[1]) == ("pane (2)", 0.5)
    assert taus[0] == taus[2] > 0.7
