"""Run the slow tests, and write a dated table of them: `python -m tests.validation.nightly`.

A row is a test with all of its cases, written when the last one has ended. What a run does not
reach in its minutes keeps the row of the last run that did; what none has reached is "not run".
"""

from __future__ import annotations

import argparse
import datetime
import re
import time
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import pytest

from drcmitsuba import __version__
from drcmitsuba.runtime import backend
from tests import ROOT

PAGE = ROOT / "docs" / "validation" / "nightly.md"
HEAD = "| test | result | seconds | run |"
ROW = re.compile(r"^\| `([^`]+)` \| ([^|]+) \| ([^|]+) \| ([^|]+) \|$")
NOT_RUN = ("not run", "–", "–")
"""Result, seconds and run of a test that no run has reached."""


def name_of(node: str) -> str:
    """Test without its case: `tests/unit/test_a.py::test_b[3]` is `unit/test_a.py::test_b`."""
    return node.partition("[")[0].removeprefix("tests/")


@dataclass
class Recorder:
    """Plugin of pytest that keeps the page, and ends the run when its time is over."""

    deadline: float
    """Time by `time.monotonic` [s] after which no further test begins."""
    cases: Mapping[str, int]
    """Number of cases by test, of all slow tests."""
    ends: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))
    """How the cases of a test ended: passed, failed, skipped."""
    seconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    session: pytest.Session | None = None

    def pytest_sessionstart(self, session: pytest.Session) -> None:
        """Keep the session, which is told to stop."""
        self.session = session

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add a phase of a case."""
        test = name_of(report.nodeid)
        self.seconds[test] += report.duration
        if report.when == "call" or report.outcome != "passed":
            self.ends[test].append(report.outcome)
        if report.when == "teardown" and len(self.ends[test]) >= self.cases[test]:
            self.write()
        if time.monotonic() > self.deadline and self.session is not None:
            workers = self.session.config.pluginmanager.getplugin("dsession")
            (workers or self.session).shouldstop = "the time is over"

    def write(self) -> None:
        """Write the page with the rows of this run, and those of earlier ones for the rest."""
        run, before = datetime.date.today().isoformat(), known(PAGE)
        rows = {
            test: self.row(test, run) or before.get(test, NOT_RUN) for test in sorted(self.cases)
        }
        PAGE.write_text(written(rows, run, machine()), encoding="utf-8")

    def row(self, test: str, run: str) -> tuple[str, str, str] | None:
        """Result, seconds and run of a test; None where not all of its cases were run."""
        ends = self.ends.get(test, [])
        if len(ends) < self.cases[test]:
            return None
        told = [f"{ends.count(end)} {end}" for end in dict.fromkeys(sorted(ends))]
        return ", ".join(told), f"{self.seconds[test]:.0f}", run


class Collected:
    """Plugin of pytest that counts the cases of each test."""

    def __init__(self) -> None:
        self.cases: dict[str, int] = defaultdict(int)

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        """Count what is selected."""
        for item in session.items:
            self.cases[name_of(item.nodeid)] += 1


def known(page: Path) -> dict[str, tuple[str, str, str]]:
    """Rows of a page by their test."""
    lines = page.read_text(encoding="utf-8").splitlines() if page.is_file() else []
    rows = (match for line in lines if (match := ROW.match(line)))
    return {row[1]: (row[2], row[3], row[4]) for row in rows}


@cache
def machine() -> str:
    """What a run's figures depend on."""
    told = backend.report()
    names = ("LLVM", "GPU (CUDA)", "threads", "mitsuba", "drjit", "numpy")
    return ", ".join([told["system"], *(f"{name} {told[name]}" for name in names)])


def written(rows: dict[str, tuple[str, str, str]], run: str, about: str) -> str:
    """Page with all rows."""
    reached = sum(row != NOT_RUN for row in rows.values())
    text = f"""\
# Slow tests

Suites of minutes: statistics, fuzzing, and checks at a larger scale, of which the tests for every
commit hold one each. `python -m tests.validation.nightly` runs them and writes this page; {reached}
of {len(rows)} tests have been run. Seconds are those of all cases of a test. The newest run, {run}:
drcmitsuba {__version__},
{about}.

{HEAD}
{"|---" * 4}|
"""
    return text + "".join(f"| `{test}` | {' | '.join(row)} |\n" for test, row in rows.items())


def main() -> None:
    """Run the slow tests for some minutes and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("paths", nargs="*", help="tests; all by default")
    parser.add_argument("--minutes", type=float, default=600.0, help="after which no test begins")
    asked = parser.parse_args()
    quiet, slow = ["-q", "-p", "no:cacheprovider"], ["-m", "slow"]
    every = Collected()
    pytest.main([*quiet, "-qq", *slow, "-n", "0", "--collect-only", str(ROOT / "tests")], [every])
    recorder = Recorder(time.monotonic() + 60 * asked.minutes, every.cases)
    few_ahead = ["--dist", "load", "--maxschedchunk", "1"]  # workers end what they were given
    code = pytest.main([*quiet, *slow, *few_ahead, *asked.paths], [recorder])
    recorder.write()
    raise SystemExit(0 if code == pytest.ExitCode.INTERRUPTED else code)


if __name__ == "__main__":
    main()
