"""Fixtures for the command line and for evaluations of small rooms."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from matplotlib.figure import Figure

import drcmitsuba
from drcmitsuba import load_case
from drcmitsuba.cli import main
from drcmitsuba.report import plots
from tests import skips
from tests.system.small_room import DAYS


@pytest.fixture(autouse=True)
def blank_pictures(request, monkeypatch):
    """Leave the plans and months of evaluations blank: drawing them takes half of a small run.

    A test that looks at them, or that wants them drawn, asks for the fixture `drawn`.
    """
    if "drawn" not in request.fixturenames:
        for name in ("plan", "monthly"):
            monkeypatch.setattr(plots, name, lambda *values, **settings: Figure((1, 1)))


@pytest.fixture
def drawn():
    """Pictures of evaluations as users see them."""


@pytest.fixture
def run(monkeypatch, capsys):
    """Run the command line in this process: exit code, stdout, stderr."""

    def run(*arguments):
        monkeypatch.setattr("sys.argv", ["drcmitsuba", *map(str, arguments)])
        code = 0
        try:
            main.main()
        except SystemExit as stop:
            code = stop.code
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    return run


@pytest.fixture
def refused(run):
    """Run what must end with exit code 2: the one line that says why."""

    def refused(*arguments):
        code, _, err = run(*arguments)
        assert code == 2
        assert err.endswith("\n")
        assert err.count("\n") == 1
        assert err.rstrip("\n").isprintable()
        assert err.startswith("drcmitsuba: ")
        return err.removeprefix("drcmitsuba: ").rstrip("\n")

    return refused


@pytest.fixture
def evaluate(tmp_path):
    """Evaluate the text of a case."""

    def evaluate(text):
        file = tmp_path / "case.toml"
        file.write_text(text, encoding="utf-8")
        return drcmitsuba.evaluate(load_case(file))

    return evaluate


@pytest.fixture
def stamps(tmp_path):
    """Period of own time stamps in the place of months: a few hours are quicker than two months."""

    def stamps(*times):
        (tmp_path / "times.csv").write_text("\n".join(["time", *times]) + "\n")
        return DAYS, 'timestamps = "times.csv"'

    return stamps


def wait_for(process, sign):
    """Wait until a process shows a sign, however busy the machine is."""
    deadline = time.monotonic() + 120
    while not sign(Path(f"/proc/{process.pid}")):
        assert process.poll() is None, "it ended before"
        assert time.monotonic() < deadline
        time.sleep(0.001)


def is_ready(proc):
    """Whether a process handles SIGTERM."""
    status = (proc / "status").read_text()
    caught = int(status.split("SigCgt:")[1].split()[0], 16)
    return bool(caught >> (signal.SIGTERM - 1) & 1)


def imports_mitsuba(proc):
    """Whether a process has begun to load Dr.Jit and Mitsuba."""
    return "drjit" in (proc / "maps").read_text()


def has_child(proc):
    """Whether a process has started another one."""
    return bool((proc / "task" / proc.name / "children").read_text())


@pytest.fixture
def stopped(tmp_path):
    """Stop `drcmitsuba ARGUMENTS` by a signal at a sign: exit code and stderr."""
    skips.PROC.skip_if_so()

    def stopped(number, sign, *arguments):
        command = [sys.executable, "-m", "drcmitsuba.cli", *map(str, arguments)]
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )  # fmt: skip
        wait_for(process, sign)
        os.kill(process.pid, number)
        _, err = process.communicate(timeout=120)
        return process.returncode, err

    return stopped
