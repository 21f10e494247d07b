"""Fixtures for the command line."""

import pytest

from drcmitsuba.cli import main


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
        told = capsys.readouterr()
        return code, told.out, told.err

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
