"""Kernels that cannot be kept are told in one line, and the run goes on."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from drcmitsuba.runtime import kernel_folder
from drcmitsuba.runtime.compilation import Compilation


@pytest.fixture(autouse=True)
def _anew(monkeypatch):
    """Nothing is known of this process' own folder; the environment is restored."""
    monkeypatch.delenv(kernel_folder.VARIABLE, raising=False)
    kernel_folder.check.cache_clear()
    yield
    kernel_folder.check.cache_clear()


@pytest.fixture
def home(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("HOME", str(tmp_path))
    return tmp_path


def test_kernels_lie_where_dr_jit_keeps_them(home, monkeypatch):
    assert kernel_folder.kernel_folder() == home / ".drjit"
    assert kernel_folder.check() == ""
    assert kernel_folder.are_kept()
    monkeypatch.setenv(kernel_folder.VARIABLE, "elsewhere")
    assert kernel_folder.kernel_folder() == Path("elsewhere")


def test_windows_keeps_them_among_temporary_files(monkeypatch):
    monkeypatch.setattr(sys, "platform", "win32")
    assert kernel_folder.kernel_folder().name == "drjit"


def _no_home(home, monkeypatch):
    monkeypatch.delenv("HOME")
    return "HOME is not set"


def _home_is_no_folder(home, monkeypatch):
    (home / "file").touch()
    monkeypatch.setenv("HOME", str(home / "file"))
    return f"{home}/file/.drjit: Not a directory"


def _read_only(home, monkeypatch):
    monkeypatch.setattr(os, "access", lambda *_: False)
    return f"{home}/.drjit: may not be written"


def _full(home, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=3 << 20))
    return f"{home}/.drjit: 3.0 MiB are free, and 16 MiB are needed"


@pytest.mark.parametrize("spoil", [_no_home, _home_is_no_folder, _read_only, _full])
def test_a_folder_that_is_of_no_use_is_told_with_the_remedy(spoil, home, monkeypatch):
    monkeypatch.setenv(kernel_folder.VARIABLE, "")  # restored afterwards
    why = spoil(home, monkeypatch)
    line = kernel_folder.check()
    assert f"they cannot be kept: {why}; free space, or set DRJIT_CACHE_DIR" in line
    assert kernel_folder.check() == line  # though the variable now names another place
    assert not kernel_folder.are_kept()
    assert Compilation({"rays": 2}, 3.0).line().endswith("(rays 2); they are not kept")


def test_a_command_says_it_in_one_line_and_goes_on(tmp_path):
    (tmp_path / "file").touch()
    place = tmp_path / "file" / "kernels"
    done = subprocess.run(
        [sys.executable, "-W", "error", "-m", "drcmitsuba.cli", "doctor"],
        env=os.environ | {"DRJIT_CACHE_DIR": str(place)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0
    assert "ready: " in done.stdout
    assert done.stderr.startswith("note: kernels are compiled in each run, since they cannot be ")
    assert f"{place}: Not a directory" in done.stderr
    assert done.stderr.count("\n") == 1
