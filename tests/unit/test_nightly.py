"""The table of slow tests keeps what a run did not reach."""

from types import SimpleNamespace

import pytest

from tests.validation import nightly


def report(node, outcome="passed", when="call", duration=1.0):
    return SimpleNamespace(nodeid=node, outcome=outcome, when=when, duration=duration)


def test_a_row_is_a_test_with_all_of_its_cases(tmp_path):
    recorder = nightly.Recorder(deadline=float("inf"))
    for case, outcome in (("1", "passed"), ("2", "failed")):
        node = f"tests/unit/test_a.py::test_b[{case}]"
        recorder.pytest_runtest_logreport(report(node, when="setup"))
        recorder.pytest_runtest_logreport(report(node, outcome))
    row = recorder.row("unit/test_a.py::test_b", 2, "2026-11-27")
    assert row == ("1 failed, 1 passed", "4", "2026-11-27")
    assert recorder.row("unit/test_a.py::test_b", 3, "2026-11-27") is None
    rows = {"unit/test_a.py::test_b": row, "unit/test_a.py::test_c": nightly.NOT_RUN}
    page = tmp_path / "nightly.md"
    page.write_text(nightly.written(rows, "2026-11-27", "a machine"), encoding="utf-8")
    assert nightly.known(page) == rows
    assert nightly.known(tmp_path / "none.md") == {}


@pytest.mark.parametrize("workers", [None, SimpleNamespace(shouldstop=False)])
def test_the_run_ends_when_its_time_is_over(workers):
    """With workers (xdist) it is they who are told."""
    manager = SimpleNamespace(getplugin={"dsession": workers}.get)
    config = SimpleNamespace(pluginmanager=manager)
    session = SimpleNamespace(shouldstop=False, config=config)
    recorder = nightly.Recorder(deadline=0.0)
    recorder.pytest_sessionstart(session)
    recorder.pytest_runtest_logreport(report("tests/unit/test_a.py::test_b"))
    assert (workers or session).shouldstop == "the time is over"
