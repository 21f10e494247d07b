"""Modules that are imported at their first use, by any thread."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from drcmitsuba.runtime import lazy


def test_a_thread_waits_for_a_module_that_another_still_imports(tmp_path, monkeypatch):
    """Python lists a module before its names exist; two files written at once need the same."""
    (tmp_path / "slow_to_import.py").write_text("import time\ntime.sleep(0.3)\nanswer = 42\n")
    monkeypatch.syspath_prepend(tmp_path)
    slow = lazy.module("slow_to_import")
    with ThreadPoolExecutor(4) as threads:
        answers = [threads.submit(lambda: slow.answer) for _ in range(4)]
    assert [answer.result() for answer in answers] == [42] * 4


def test_a_module_that_changes_how_arrays_are_printed_leaves_them_alone(tmp_path, monkeypatch):
    changing = "import numpy\nnumpy.set_printoptions(legacy='1.13')\nanswer = 42\n"
    (tmp_path / "changes_printing.py").write_text(changing)
    monkeypatch.syspath_prepend(tmp_path)
    before = np.get_printoptions()
    assert lazy.module("changes_printing").answer == 42
    assert np.get_printoptions() == before
