"""Slow modules are imported while kernels run."""

import os
import subprocess
import sys
import threading

import pytest

from drcmitsuba.cli import startup
from drcmitsuba.runtime.progress import silent

UNUSED = "this"  # a module that nothing imports


def test_modules_are_imported_from_the_first_kernels_on(capsys):
    sys.modules.pop(UNUSED, None)
    stage = startup.importing(silent, UNUSED)
    with stage("sky"):
        assert UNUSED not in sys.modules
    with stage(startup.WHILE) as done:
        done(0.5)
        for thread in threading.enumerate():
            if thread.name == "imports":
                thread.join(60)
    assert UNUSED in sys.modules


def test_a_module_that_is_missing_fails_where_it_is_used(monkeypatch):
    """The thread ends without a word."""
    complaints = []
    monkeypatch.setattr(threading, "excepthook", complaints.append)
    before = set(threading.enumerate())
    with startup.importing(silent, "no_such_module")(startup.WHILE):
        for thread in set(threading.enumerate()) - before:
            thread.join(60)
    assert complaints == []


@pytest.mark.parametrize("bits", [32, 64])
def test_a_python_that_cannot_import_mitsuba_is_told_in_one_line(bits):
    """Mitsuba's extension is for one kind of Python: here there is none, as for 32 bit."""
    code = f"import sys; sys.modules['drjit'] = None; sys.maxsize = 2**{bits - 1} - 1; "
    code += "sys.argv = ['drcmitsuba', 'doctor']; from drcmitsuba.cli import main; main.main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    line = done.stderr.removesuffix("\n")
    assert (done.returncode, done.stdout, line.count("\n")) == (1, "", 0)
    assert f"({bits} bit, " in line
    assert "cannot import Mitsuba: " in line
    assert "install drcmitsuba in CPython 3.10 to 3.14 of 64 bit" in line


def test_messages_of_compiled_code_are_kept_and_not_shown(capfd):
    lines = []
    with startup._native_code_heard(lines):
        os.write(2, b"one\ntwo\n")
        os.write(2, bytes(1 << 10))
    os.write(2, b"shown\n")
    assert lines[:2] == ["one", "two"]
    assert capfd.readouterr().err == "shown\n"


def test_more_than_a_pipe_holds_does_not_stop_the_program():
    code = "import os; from drcmitsuba.cli import startup\\nwith startup._native_code_heard([]):\\n"
    code = (
        code.replace("\\n", "\n") + "  for _ in range(1000):\n    try: os.write(2, bytes(1 << 12))"
    )
    code += "\n    except BlockingIOError: pass"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=30)
