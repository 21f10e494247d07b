"""The table of slow tests keeps what a run did not reach."""

from types import SimpleNamespace

import pytest

from tests.validation import nightly


def report(node, outcome="passed", when="call", duration=1.0):
    return SimpleNamespace(nodeid=node, outcome=outcome, when=when, duration=duration)


def test_a_row_is_a_test_with_all_of_its_cases(tmp_path, monkeypatch):
    """It is on the page, beside the rows of earlier runs, when the last of them has ended."""
    page = tmp_path / "nightly.md"
    monkeypatch.setattr(nightly, "PAGE", page)
    b, c, d = (f"unit/test_a.py::test_{name}" for name in "bcd")
    earlier = {b: nightly.NOT_RUN, c: ("1 passed", "9", "2026-11-01"), d: nightly.NOT_RUN}
    page.write_text(nightly.written(earlier, "2026-11-01", "a machine"), encoding="utf-8")
    recorder = nightly.Recorder(float("inf"), {b: 2, c: 1, d: 1})
    for case, outcome in (("1", "passed"), ("2", "failed")):
        assert nightly.known(page) == earlier
        assert recorder.row(b, "2026-11-27") is None
        for when, ended in (("setup", "passed"), ("call", outcome), ("teardown", "passed")):
            recorder.pytest_runtest_logreport(report(f"tests/{b}[{case}]", ended, when))
    assert recorder.row(b, "2026-11-27") == ("1 failed, 1 passed", "6", "2026-11-27")
    rows = nightly.known(page)
    assert rows[b][:2] == ("1 failed, 1 passed", "6")
    assert {name: rows[name] for name in (c, d)} == {name: earlier[name] for name in (c, d)}
    assert nightly.known(tmp_path / "none.md") == {}


@pytest.mark.parametrize("workers", [None, SimpleNamespace(shouldstop=False)])
def test_the_run_ends_when_its_time_is_over(workers):
    """With workers (xdist) it is they who are told."""
    manager = SimpleNamespace(getplugin={"dsession": workers}.get)
    config = SimpleNamespace(pluginmanager=manager)
    session = SimpleNamespace(shouldstop=False, config=config)
    recorder = nightly.Recorder(0.0, {"unit/test_a.py::test_b": 2})
    recorder.pytest_sessionstart(session)
    recorder.pytest_runtest_logreport(report("tests/unit/test_a.py::test_b"))
    assert (workers or session).shouldstop == "the time is over"
