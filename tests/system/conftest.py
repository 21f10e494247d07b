"""Fixtures for the command line and for evaluations of small rooms."""

import pytest

import drcmitsuba
from drcmitsuba import load_case
from drcmitsuba.cli import main
from tests.system.small_room import DAYS


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
