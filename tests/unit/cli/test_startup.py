"""Slow modules are imported while kernels run."""

import sys
import threading

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
