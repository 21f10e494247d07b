"""`drcmitsuba tradeoff` on a tiny room, with a short time and with mistakes."""

import signal

import pandas as pd
import pytest

from drcmitsuba.annual.tradeoff import settings
from drcmitsuba.runtime import process
from tests.fast import slowly
from tests.system.conftest import has_child

CASE = """
name = "tiny room"
[period]
months = [3]
[room]
size = [3.0, 4.0, 3.0]
[facade.south]
strips = [{ bottom = 0.9, top = 2.7, material = "glass" }]
[materials.glass]
type = "glazing"
transmittance = 0.65
[sensors]
corner = [0.5, 0.5, 0.8]
count = [3, 3]
spacing = 0.6
"""


@pytest.fixture
def case(tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(CASE)
    return file


@pytest.fixture
def few_settings(monkeypatch):
    """The default and two settings of a room that the reference is soon accurate for."""
    from drcmitsuba.annual.tradeoff import run as module

    def short(case, folder, solved_cells):
        names = ("default, yours", "samples × 1/8", "spacing × 2")
        return [
            s for s in settings.design(case, folder, solved_cells=solved_cells) if s.name in names
        ]

    monkeypatch.setattr(module, "design", short)


@pytest.fixture
def no_processes(monkeypatch):
    """Do in this process what users' settings do in their own, however slow the machine starts."""
    monkeypatch.setattr(process, "run", lambda job, deadline, progress=None: job())


def test_a_table_and_a_picture(run, case, tmp_path, few_settings, no_processes):
    """A busy machine may not reach every setting; the table says which."""
    code, out, err = run("tradeoff", case, "-o", tmp_path / "t", "--minutes", 0.2)
    assert code == 0, err
    assert {f.name for f in (tmp_path / "t").iterdir()} == {"tradeoff.csv", "tradeoff.png"}
    table = pd.read_csv(tmp_path / "t" / "tradeoff.csv").set_index("setting")
    assert set(table.index) == {"reference", "default, yours", "samples × 1/8", "spacing × 2"}
    assert table.status["reference"] == "done"
    assert table.loc["reference", "E_rms_percent"] > 0
    assert "220 of 220 time stamps" in out


@pytest.mark.slow
def test_errors_of_few_settings(run, case, tmp_path, few_settings):
    code, _, _ = run("tradeoff", case, "-o", tmp_path / "t", "--minutes", 1)
    assert code == 0
    table = pd.read_csv(tmp_path / "t" / "tradeoff.csv").set_index("setting")
    assert list(table.status) == ["done"] * 4
    assert table.loc["reference", "E_rms_percent"] < 1
    fine, coarse = table.loc["default, yours"], table.loc["samples × 1/8"]
    assert 0.1 < fine.E_rms_percent < 4
    assert 1.5 * fine.E_rms_percent < coarse.E_rms_percent < 12
    for row in (fine, coarse):
        assert row.E_mean_percent == pytest.approx(0, abs=1.5)
        assert abs(row.sDA_points) < 25
        assert row.direct_sun_wrong_percent < 1
        assert 0 < row.seconds < 30
        assert 50 < row.memory_MiB < 2000
    assert table.loc["spacing × 2"].isna()["E_rms_percent"]


@pytest.mark.parametrize("minutes", ["0", "-1", "nan"])
def test_no_time_is_refused(refused, case, tmp_path, minutes):
    line = refused("tradeoff", case, "-o", tmp_path / "t", "--minutes", minutes)
    assert line == f"command line: --minutes: {minutes}; give minutes above 0 and below 1e6"
    assert not (tmp_path / "t").exists()


def test_too_little_time_for_the_reference_is_refused(refused, case, tmp_path):
    line = refused("tradeoff", case, "-o", tmp_path / "t", "--minutes", "0.001")
    assert line == "tradeoff: minutes: 0.001: no reference; give more --minutes"
    assert not (tmp_path / "t").exists()


def test_a_folder_that_is_a_file_is_refused(refused, case):
    line = refused("tradeoff", case, "-o", case)
    assert line == f"{case}: -o: {case} is a file; name a folder"


def test_a_wrong_case_is_refused_at_once(refused, case, tmp_path):
    case.write_text(CASE.replace("count = [3, 3]", "count = [9, 3]"))
    assert "lies in, on or beyond a wall" in refused("tradeoff", case, "-o", tmp_path / "t")


@pytest.mark.parametrize("number", slowly([signal.SIGINT, signal.SIGTERM], signal.SIGTERM))
def test_a_stop_leaves_nothing_half_written(stopped, case, tmp_path, number):
    answer = stopped(number, has_child, "tradeoff", case, "-o", tmp_path / "t")
    assert answer == (130, "drcmitsuba: stopped\n")
    folder = tmp_path / "t"
    left = {f.name for f in folder.iterdir()} if folder.is_dir() else set()
    assert left <= {"tradeoff.csv"}
