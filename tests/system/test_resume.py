"""A run that is killed, stopped, or finds the disk full is continued by the same command."""

import errno
import json
import os
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest
import xarray as xr

from drcmitsuba.annual.saved_result import SavedResult
from drcmitsuba.blocks import block_folder
from drcmitsuba.runtime.folder_lock import locked
from drcmitsuba.transport.interreflection import interior
from tests import ROOT, skips
from tests.system.small_room import changed, run

TINY = changed(
    ("months = [3, 6]", "months = [3]\nhours = [9, 13]"), ("count = [5, 5]", "count = [4, 4]"),
    ("[accuracy]\nreplicates = 4", '[effects]\npictures = "off"\n[accuracy]\nreplicates = 2'),
)  # fmt: skip
"""Sixteen sensors in the mornings of a month."""


@pytest.fixture
def case(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(TINY)
    return path


def numbers(folder):
    """All numbers of a result that do not tell how long it took."""
    metrics = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    for name in ("seconds", "peak_memory_bytes"):
        del metrics[name]
    metrics["settings"].pop("notes")
    with (
        xr.open_dataset(folder / "illuminance.nc") as E,
        xr.open_zarr(folder / "coefficients.zarr", chunks=None) as C,
    ):
        return metrics, E.load(), C.load()


def assert_identical(one, other):
    (m, E, C), (n, F, D) = numbers(one), numbers(other)
    assert m == n
    xr.testing.assert_identical(E, F)
    xr.testing.assert_equal(C, D)


@pytest.fixture
def computed(monkeypatch):
    """Blocks of four sensors, and a list of those that are computed and stored."""
    blocks, write_block = [], block_folder.write_block
    monkeypatch.setattr(interior, "SENSORS", 4)
    monkeypatch.setattr(
        block_folder, "write_block", lambda *a: write_block(*a) or blocks.append(a[1])
    )
    return blocks


def test_blocks_are_written_behind_the_main_thread(case, tmp_path, monkeypatch):
    write_block, threads = block_folder.write_block, []

    def write(*args):
        threads.append(threading.current_thread())
        write_block(*args)

    monkeypatch.setattr(block_folder, "write_block", write)
    run(monkeypatch, "evaluate", case, "-o", tmp_path / "r")
    assert threads
    assert threading.main_thread() not in threads


@skips.POSIX.mark
@skips.LLVM.mark
@pytest.mark.parametrize("kills", [3, pytest.param(100, marks=pytest.mark.slow)])
def test_kills_at_random_moments_change_no_number(case, tmp_path, kills):
    """By LLVM, since a GPU's driver cannot be used behind a fork."""
    command = [sys.executable, "-m", "tests.system.killed_runs", case, tmp_path, kills]
    done = subprocess.run(
        [*map(str, command)], capture_output=True, text=True, check=False, cwd=ROOT,
        env=os.environ | {"DRCMITSUBA_VARIANT": "llvm_ad_mono"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    report = json.loads(done.stdout)
    assert set(report["ends"]) <= {0, -signal.SIGKILL}, report
    assert report["ends"].count(-signal.SIGKILL) == kills
    assert report["unfinished"] > 0, report
    if report["blocks"]:  # else the last but one run had ended before its kill
        expected = report["computed"]["undisturbed"] - report["blocks"]
        assert report["computed"]["killed"] == expected, report
    assert_identical(tmp_path / "undisturbed", tmp_path / "killed")
    assert not (tmp_path / "killed" / "unfinished").exists()


def test_blocks_of_sensors_move_numbers_by_rounding_alone(case, tmp_path, monkeypatch):
    run(monkeypatch, "evaluate", case, "-o", tmp_path / "whole")
    monkeypatch.setattr(interior, "SENSORS", 5)
    run(monkeypatch, "evaluate", case, "-o", tmp_path / "cut")
    _, E, C = numbers(tmp_path / "whole")
    _, F, D = numbers(tmp_path / "cut")
    np.testing.assert_allclose(D["replicates"], C["replicates"], rtol=1e-5, atol=1e-9)
    np.testing.assert_array_equal(D["straight"], C["straight"])
    np.testing.assert_allclose(F["total"], E["total"], rtol=1e-5)


def test_a_full_disk_stops_the_run_with_a_line_and_the_next_goes_on(
    case, tmp_path, monkeypatch, capsys, computed
):
    run(monkeypatch, "evaluate", case, "-o", tmp_path / "whole")
    assert "going on" not in capsys.readouterr().err
    every = len(computed)
    folder, write_block = tmp_path / "results", block_folder.write_block
    computed.clear()

    def until_full(data, path):
        if len(computed) == 3:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        write_block(data, path)

    with monkeypatch.context() as full:
        full.setattr(block_folder, "write_block", until_full)
        with pytest.raises(SystemExit) as stop:
            run(monkeypatch, "evaluate", case, "-o", folder)
    assert stop.value.code == 2
    assert "No space left" in capsys.readouterr().err
    assert not (folder / "metrics.json").exists()
    computed.clear()
    run(monkeypatch, "evaluate", case, "-o", folder)
    assert len(computed) == every - 3
    told = [line for line in capsys.readouterr().err.splitlines() if "going on" in line]
    assert told == [
        f"small room, open: going on from 3 of 4 blocks stored in {folder / 'unfinished'}"
    ]
    assert_identical(tmp_path / "whole", folder)


def test_a_run_that_was_stopped_while_files_were_written_is_no_result(
    case, tmp_path, monkeypatch, capsys, computed
):
    folder = tmp_path / "results"
    run(monkeypatch, "evaluate", case, "-o", folder)
    with monkeypatch.context() as stopped:
        stopped.setattr(
            SavedResult,
            "_save_pictures",
            lambda *a: (_ for _ in ()).throw(KeyboardInterrupt),
        )
        with pytest.raises(SystemExit) as stop:
            run(monkeypatch, "evaluate", case, "-o", folder)
    assert stop.value.code == 130
    with pytest.raises(SystemExit) as refused:
        run(monkeypatch, "report", folder, "-o", tmp_path / "report.html")
    assert refused.value.code == 2
    capsys.readouterr()
    computed.clear()
    (folder / ".coefficients.zarr.0123abcd").mkdir()
    (folder / ".illuminance.nc.0123abcd").write_bytes(b"half")
    (folder / ".mine").write_text("mine")
    run(monkeypatch, "evaluate", case, "-o", folder)
    assert computed == []  # all blocks were whole
    assert (folder / "metrics.json").exists()
    assert {p.name for p in folder.glob(".*")} == {".mine"}


def test_a_damaged_block_is_made_again_with_a_line(case, tmp_path, monkeypatch, capsys, computed):
    folder, cache = tmp_path / "results", tmp_path / "cache"
    run(monkeypatch, "evaluate", case, "-o", folder, "--cache", cache)
    files = sorted(cache.glob("*/*.zip"))
    content = files[1].read_bytes()
    middle = slice(len(content) // 2, len(content) // 2 + 200)
    damaged = bytes(255 - byte for byte in content[middle])
    files[1].write_bytes(content[: middle.start] + damaged + content[middle.stop :])
    computed.clear()
    capsys.readouterr()
    run(monkeypatch, "evaluate", case, "-o", tmp_path / "again", "--cache", cache)
    out = " ".join(capsys.readouterr().out.split())
    assert f"block {files[1].name} of small room" in out
    assert "was damaged and is made again" in out
    assert len(computed) == 1
    assert_identical(folder, tmp_path / "again")


@pytest.mark.parametrize("verb", ["evaluate", "optimise", "glare", "season", "tradeoff"])
def test_two_runs_on_one_folder_do_not_meet(verb, case, tmp_path, monkeypatch, capsys):
    holder = (
        "import sys, time; from pathlib import Path; from drcmitsuba.runtime.folder_lock import "
        "locked\nwith locked(Path(sys.argv[1])): print('held', flush=True); time.sleep(60)"
    )
    command = [sys.executable, "-c", holder, str(tmp_path / "results")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline() == "held\n"
            with pytest.raises(SystemExit) as stop:
                run(monkeypatch, verb, case, "-o", tmp_path / "results")
        finally:
            process.kill()
    assert stop.value.code == 2
    assert "another run writes to it" in capsys.readouterr().err


def test_rounds_toward_a_target_are_continued(tmp_path, monkeypatch, computed):
    path = tmp_path / "case.toml"
    path.write_text(TINY + 'target = "3 %"\n')
    run(monkeypatch, "evaluate", path, "-o", tmp_path / "one", "--cache", tmp_path / "cache")
    rounds = json.loads((tmp_path / "one" / "metrics.json").read_text())["accuracy"]["rounds"]
    assert rounds > 1
    computed.clear()
    run(monkeypatch, "evaluate", path, "-o", tmp_path / "two", "--cache", tmp_path / "cache")
    assert computed == []
    assert_identical(tmp_path / "one", tmp_path / "two")


def test_the_lock_is_given_back(tmp_path):
    with locked(tmp_path), pytest.raises(ValueError, match="inside"), locked(tmp_path / "other"):
        raise ValueError("inside")
    with locked(tmp_path / "other"):
        pass
