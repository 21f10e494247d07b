"""Keys of stored numbers: inputs and program are told apart."""

import pytest

from drcmitsuba.runtime import provenance
from drcmitsuba.runtime.provenance import Provenance, StoredKeys


def test_a_key_follows_inputs_program_and_release(monkeypatch):
    one = Provenance.of("room", 1)
    assert Provenance.of("room", 1) == one
    assert Provenance.of("room", 2).key != one.key
    released = Provenance.of("room", 1, release="2.0")
    monkeypatch.setattr(provenance, "METHOD", -1)
    older = Provenance.of("room", 1)
    assert older.inputs == released.inputs == one.inputs
    assert len({one.key, older.key, released.key}) == 3


@pytest.mark.parametrize("ending", ["", ".json"])
def test_what_another_program_made_of_the_same_inputs_is_known(tmp_path, monkeypatch, ending):
    one = Provenance.of("room")

    def is_other(folder):
        return StoredKeys.of(folder).are_of_another_program(one)

    assert not is_other(tmp_path / "not yet")
    (tmp_path / f"{Provenance.of('other room').key}{ending}").touch()
    assert not is_other(tmp_path)
    (tmp_path / f"{one.inputs}-00000000{ending}").touch()
    assert is_other(tmp_path)
    (tmp_path / f"{one.key}{ending}").touch()
    assert not is_other(tmp_path)
