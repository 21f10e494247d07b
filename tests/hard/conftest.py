"""What must hold in a hard case, and the margin that is left."""

from collections import Counter

import numpy as np
import pytest

from tests.hard.command_line import CommandLine

MARGINS = pytest.StashKey[list[tuple[str, str, str, float, float]]]()


def pytest_configure(config):
    config.stash[MARGINS] = []


@pytest.fixture
def holds(request):
    """Call `holds(invariant, measured, allowed)`: no NaN in what was measured, none above allowed.

    `measured` are the distances from what must hold: a number or an array, none of them negative.
    `pytest tests/hard --margins` prints the largest of each case beside what is allowed.
    """

    def holds(invariant, measured, allowed):
        worst = float(np.max(np.asarray(measured, float)))
        case = request.node.name.removeprefix("test_").replace("_", " ")
        subject = request.path.stem.removeprefix("test_").replace("_", " ")
        request.config.stash[MARGINS].append((subject, case, invariant, worst, allowed))
        assert 0 <= worst <= allowed, f"{invariant}: {worst:.3g}, allowed {allowed:.3g}"

    return holds


LEAST_VALID = 0.3
"""Share of the generated inputs that have to give a result."""


@pytest.fixture
def tally():
    """Count "result" and "refused"; afterwards enough of them must have had a result."""
    counts = Counter()
    yield counts
    assert counts["result"] >= LEAST_VALID * (counts["result"] + counts["refused"]), counts


@pytest.fixture(scope="module")
def command():
    """The command line, in a process that stays."""
    process = CommandLine()
    yield process
    process.close()


def pytest_terminal_summary(terminalreporter, config):
    if not config.getoption("--margins"):
        return
    terminalreporter.write_line("| subject | case | what must hold | measured | allowed |")
    terminalreporter.write_line("|---|---|---|---|---|")
    for subject, case, invariant, worst, allowed in config.stash[MARGINS]:
        line = f"| {subject} | {case} | {invariant} | {worst:.2g} | {allowed:.2g} |"
        terminalreporter.write_line(line)
