"""The bench: a table that can be pasted, with Radiance and without, of a room that is soon done."""

import numpy as np
import pytest

from drcmitsuba.annual.bench import run as module
from drcmitsuba.annual.bench.reference import CoefficientErrors, known
from drcmitsuba.annual.bench.run import HEAD, Bench, Scope, Timed, bench
from drcmitsuba.export.programs import RadiancePrograms
from drcmitsuba.runtime.errors import InputError
from tests import skips

TINY = Scope(every=8, picked=2, rounds=2)
ERRORS = CoefficientErrors(total=0.2, direct=0.1, dark=0.3, mean=1.0)


@pytest.fixture(autouse=True)
def _short(monkeypatch):
    monkeypatch.setattr(module, "STEPS", (1.0, 16.0))
    monkeypatch.setattr(module, "TIMES", 1)


def test_a_table_has_as_many_cells_in_every_row():
    rows = (Timed("theirs", 4.0, ERRORS), Timed("ours", 0.02, ERRORS, rays=170_000, ratio=200.0))
    text = Bench({"sky": (rows, "Reference.")}, ("A note.",)).markdown()
    table = [line for line in text.splitlines() if line.startswith("|")]
    assert {line.count("|") for line in table} == {HEAD.count("|")}
    assert table[3] == "| ours | 0.02 | 0.17 M | 0.200 | 0.100 | 0.300 | **200 ×** |"
    assert text.endswith("A note.\n")


def test_errors_that_are_not_reached_have_no_seconds():
    assert Timed("ours", float("nan"), ERRORS).row().startswith("| ours | – | – | 0.200 |")


def test_halves_tell_the_reference_and_its_own_error():
    direct = np.array([[1.0, 0.0]])
    halves = np.array([[[[1.0, 0.0]], [[1.0, 2.0]]], [[[1.0, 0.0]], [[3.0, 2.0]]]])
    found = known(direct, halves)
    np.testing.assert_array_equal(found.total, [[3.0, 2.0]])
    assert found.own_error == pytest.approx(np.sqrt(0.5) / 2.5)  # half the difference of the halves
    assert found.errors(found.total, direct) == CoefficientErrors(0.0, 0.0, 0.0, 1.0)


def test_without_radiance_ours_is_measured_and_the_remedy_told(monkeypatch):
    monkeypatch.setattr(RadiancePrograms, "found", lambda: None)
    measured = bench(TINY)
    assert [len(rows) for rows, _ in measured.parts.values()] == [1, 1]
    for rows, _ in measured.parts.values():
        assert rows[0].seconds > 0
        assert rows[0].rays > 0
        assert 0 < rows[0].errors.total < 1
        assert rows[0].errors.mean == pytest.approx(1, abs=0.1)
    assert "pip install pyradiance" in measured.markdown()


def test_beside_radiance(monkeypatch):
    skips.RADIANCE.skip_if_so()
    monkeypatch.setattr(module, "SKY_OPTIONS", "-ab 4 -ad 64 -lw 1e-3")
    monkeypatch.setattr(module, "SUN_OPTIONS", "-ab 3 -ad 128 -lw 1e-4 -dt 0 -dc 1")
    stages = []
    measured = bench(TINY, stage=lambda name: stages.append(name) or module.silent(name))
    assert stages == [
        f"{s}: {w}" for s in ("sky", "suns") for w in ("reference", "Radiance", "ours")
    ]
    for theirs, *ours in (rows for rows, _ in measured.parts.values()):
        assert theirs.errors.mean == pytest.approx(1, abs=0.15)  # the same room and the same bins
        for row in ours:
            assert row.errors.total <= theirs.errors.total
            assert row.ratio == pytest.approx(theirs.seconds / row.seconds)


def test_a_program_that_fails_is_told_in_one_line(tmp_path):
    skips.RADIANCE.skip_if_so()
    with pytest.raises(InputError, match=r"oconv nothing\.rad: Radiance: .*nothing\.rad"):
        RadiancePrograms.found().run(["oconv", "nothing.rad"], tmp_path)
