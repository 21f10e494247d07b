"""One process at a time writes to a folder; one that was killed does not block it."""

import errno
import signal
import subprocess
import sys
import threading

import pytest

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.folder_lock import locked

HOLD = """
import sys, time
from pathlib import Path
from drcmitsuba.runtime.folder_lock import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_second_process_is_refused_by_name_until_the_first_is_killed(tmp_path):
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline() == "held\n"
            with pytest.raises(InputError, match=f"process {process.pid}"), locked(tmp_path):
                pytest.fail("two processes hold the lock")
        finally:
            process.send_signal(signal.SIGKILL)
    with locked(tmp_path):
        pass
    with locked(tmp_path):  # and again
        pass


def test_a_process_may_ask_for_its_folder_again(tmp_path):
    with locked(tmp_path):
        with locked(tmp_path / "." / ".." / tmp_path.name):
            pass
        command = [sys.executable, "-c", HOLD, str(tmp_path)]
        other = subprocess.run(command, capture_output=True, text=True, check=False)
        assert "another run writes to it" in other.stderr


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file: folder: it is a file"), locked(tmp_path / "file"):
        pytest.fail("a file is locked")


def test_another_thread_is_refused(tmp_path):
    told = []

    def ask():
        try:
            with locked(tmp_path):
                told.append("held twice")
        except InputError as error:
            told.append(str(error))

    with locked(tmp_path):
        thread = threading.Thread(target=ask)
        thread.start()
        thread.join()
    assert "another run writes to it" in told[0]


def test_file_systems_without_locks_are_written_to(tmp_path, monkeypatch):
    def flock(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    fcntl = pytest.importorskip("fcntl")
    monkeypatch.setattr(fcntl, "flock", flock)
    with locked(tmp_path / "new"):
        (tmp_path / "new" / "file").write_text("kept")


def test_work_that_leaves_nothing_leaves_no_folder(tmp_path):
    for _ in range(2):
        with pytest.raises(ValueError, match="refused"), locked(tmp_path / "new"):
            raise ValueError("refused")
        assert not (tmp_path / "new").exists()
    with locked(tmp_path / "new"):
        (tmp_path / "new" / "file").write_text("kept")
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["file"]
