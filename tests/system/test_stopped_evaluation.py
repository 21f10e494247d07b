"""Ctrl-C ends an evaluation in one line, and leaves whole files."""

import signal
import subprocess
import sys
from contextlib import suppress

import pytest

from drcmitsuba.blocks.block_file import read_block
from drcmitsuba.metrics import stored_arrays
from drcmitsuba.runtime import interruption
from tests import skips
from tests.system.small_room import CASE, RESULTS, changed


@pytest.fixture
def case(tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(CASE)
    return file


@pytest.mark.parametrize("inside_a_loop", [False, True])
def test_a_stop_is_exit_code_130(run, case, tmp_path, monkeypatch, inside_a_loop):
    def stopped(case):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as stop:
            if not inside_a_loop:
                raise
            raise RuntimeError("dr.while_loop(): encountered an exception") from stop

    monkeypatch.setattr("drcmitsuba.annual.result.daylight_and_year", stopped)
    code, _, err = run("evaluate", case, "-o", tmp_path / "r")
    assert (code, err) == (130, "drcmitsuba: stopped\n")
    assert not (tmp_path / "r").exists()


def test_an_error_that_a_stop_became_is_exit_code_130(run, case, tmp_path, monkeypatch):
    def stopped(case):
        with suppress(KeyboardInterrupt):
            interruption._raise(signal.SIGINT, None)
        raise ValueError("Invalid bounding box")  # as Matplotlib's compiled code does

    monkeypatch.setattr(interruption, "came", False)
    monkeypatch.setattr("drcmitsuba.annual.result.daylight_and_year", stopped)
    code, _, err = run("evaluate", case, "-o", tmp_path / "r")
    assert (code, err) == (130, "drcmitsuba: stopped\n")


def test_a_full_disk_after_a_stop_is_told(run, case, tmp_path, monkeypatch):
    """A search that was stopped writes its best design, and may fail then."""

    def full(case):
        raise OSError(28, "No space left on device", "r")

    monkeypatch.setattr(interruption, "came", True)
    monkeypatch.setattr("drcmitsuba.annual.result.daylight_and_year", full)
    code, _, err = run("evaluate", case, "-o", tmp_path / "r")
    assert code == 2
    assert "No space left on device" in err


SWALLOWED = """
import os, signal, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background
from drcmitsuba.runtime import interruption

class Finalised:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(1)

interruption.exit_at_once()
with interruption.raised():
    try:
        Finalised()
        time.sleep(30)
    except KeyboardInterrupt:
        print("heard")
"""


@skips.POSIX.mark
def test_a_stop_that_a_finaliser_swallows_comes_again():
    command = [sys.executable, "-c", SWALLOWED]
    done = subprocess.run(command, capture_output=True, text=True, timeout=50, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "heard\n", "")


SLOW = changed(
    ("count = [5, 5]", "count = [30, 30]"), ("spacing = 0.6", "spacing = 0.1"),
    ("paths = 32", "paths = 8000"), ("sensor_sky_rays = 64", "sensor_sky_rays = 20000"),
)  # fmt: skip
STOPPED_WITHIN = """
import os, signal, sys, threading
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background
from importlib import import_module

from drcmitsuba.cli.__main__ import main

module = import_module("drcmitsuba.{module}")

def stopped_within(*args, **options):
    module.{name} = function  # one signal: a second one would end the process at once
    threading.Timer({delay}, os.kill, (os.getpid(), signal.SIGINT)).start()
    return function(*args, **options)

function, module.{name} = module.{name}, stopped_within
sys.argv = ["drcmitsuba", "evaluate", {case!r}, "-o", {folder!r}]
main()
"""


@skips.POSIX.mark
@pytest.mark.parametrize(
    ("module", "name", "delay", "written"),
    [
        ("annual.simulation", "compute", 0.3, set()),
        pytest.param("blocks.block_folder", "write_block", 0.0, set(), marks=pytest.mark.slow),
        ("runtime.storage", "save_zarr", 0.0, {"illuminance.nc"}),
    ],
)
def test_ctrl_c_leaves_one_line_and_whole_files(tmp_path, case, module, name, delay, written):
    case.write_text(SLOW if delay else CASE)
    folder = tmp_path / "r"
    code = STOPPED_WITHIN.format(
        module=module, name=name, delay=delay, case=str(case), folder=str(folder)
    )
    # A signal between `open` and its `with` leaves Python's own warning of an unclosed file.
    warnings = ["-W", "error", "-W", "ignore::ResourceWarning"]
    done = subprocess.run(
        [sys.executable, *warnings, "-c", code],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (130, "drcmitsuba: stopped\n")
    blocks = [*folder.glob("unfinished/*/*")]
    assert len(blocks) >= (name == "write_block")  # the one in hand is written
    assert all(read_block(block, {}) is not None for block in blocks)
    left = {p.name for p in folder.iterdir()} if folder.exists() else set()
    left -= {"unfinished"}
    assert not any(file.startswith(".") for file in left)
    assert written <= left < RESULTS
    for file in left:
        if file.endswith(".png"):
            assert (folder / file).read_bytes().endswith(b"IEND\xaeB`\x82")
        else:
            stored_arrays.open_dataset(folder / file).load()
