"""One line for a user's mistake: files near the current folder have short names."""

import pickle
from pathlib import Path

from drcmitsuba.runtime.errors import InputError


def test_a_file_in_the_current_folder_is_told_from_there(tmp_path, monkeypatch):
    file = tmp_path / "films" / "hot.xml"
    told = "energy: 120 %; give a film"
    monkeypatch.chdir(tmp_path)
    assert str(InputError(file, "energy", "120 %", "give a film")) == f"films/hot.xml: {told}"
    assert str(InputError(str(file), "energy", "120 %", "give a film")) == f"{file}: {told}"
    assert str(InputError(tmp_path, "energy", "120 %", "give a film")) == f"{tmp_path}: {told}"
    monkeypatch.chdir(Path.home())
    error = InputError(file, "energy", "120 %", "give a film")
    assert str(error) == str(pickle.loads(pickle.dumps(error))) == f"{file}: {told}"
