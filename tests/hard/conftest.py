"""Hard cases state what must hold; the margin that is left is printed."""

from collections import Counter

import numpy as np
import pytest

from tests.hard.command_line import CommandLine

MARGINS = pytest.StashKey[dict[tuple[str, str, str], tuple[float, float]]]()


def pytest_configure(config):
    config.stash[MARGINS] = {}


@pytest.fixture
def holds(request):
    """Call `holds(invariant, measured, allowed)`: no NaN in what was measured, none above allowed.

    `measured` are the distances from what must hold: a number or an array, none of them negative.
    `pytest tests/hard --margins -n 0` prints the largest beside what is allowed, of all calls of a
    test, whatever its parameters.
    """

    def holds(invariant, measured, allowed):
        worst = float(np.max(np.asarray(measured, float)))
        case = request.node.originalname.removeprefix("test_").replace("_", " ")
        subject = request.path.stem.removeprefix("test_").replace("_", " ")
        margins, key = request.config.stash[MARGINS], (subject, case, invariant)
        # Of several calls the one that is nearest to its limit; NaN is nearer than any number.
        near = worst / allowed if allowed else worst
        known = margins.get(key, (0.0, 1.0))
        if key not in margins or not near <= (known[0] / known[1] if known[1] else known[0]):
            margins[key] = worst, allowed
        assert 0 <= worst <= allowed, f"{invariant}: {worst:.3g}, allowed {allowed:.3g}"

    return holds


LEAST_VALID = 0.3
"""Share of the generated inputs that have to give a result."""


@pytest.fixture
def tally():
    """Count "result" and "refused"; afterwards enough of them must have had a result.

    A few draws may have two standard deviations less, but one at least.
    """
    counts = Counter()
    yield counts
    drawn = counts["result"] + counts["refused"]
    spread = 2 * np.sqrt(drawn * LEAST_VALID * (1 - LEAST_VALID))
    assert counts["result"] >= max(1, LEAST_VALID * drawn - spread), counts


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
    for (subject, case, invariant), (worst, allowed) in config.stash[MARGINS].items():
        line = f"| {subject} | {case} | {invariant} | {worst:.2g} | {allowed:.2g} |"
        terminalreporter.write_line(line)
