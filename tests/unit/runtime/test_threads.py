"""Work that threads share with the one that asks for it."""

import threading

import pytest

from drcmitsuba.runtime.threads import in_threads


def test_every_job_is_done_once():
    done = []
    in_threads(done.append, range(1000))
    assert sorted(done) == [*range(1000)]
    in_threads(done.append, [])
    assert len(done) == 1000


def test_work_of_many_threads_may_ask_for_threads():
    """With more work that waits than there are threads, none waits for ever."""
    done = []
    in_threads(lambda i: in_threads(lambda k: done.append((i, k)), range(20)), range(50))
    assert sorted(done) == [(i, k) for i in range(50) for k in range(20)]


@pytest.mark.parametrize("fails", ["here", "elsewhere"])
def test_errors_are_raised(fails):
    """An error ends the work, whichever thread it is in, and the threads work on."""
    caller, begun = threading.get_ident(), threading.Barrier(2, timeout=60)

    def work(job):
        if job < 2:
            begun.wait()  # both threads have a job
        if (threading.get_ident() == caller) == (fails == "here"):
            raise ValueError(f"job {job}")

    with pytest.raises(ValueError, match="job"):
        in_threads(work, range(100))
    done = []
    in_threads(done.append, range(10))
    assert sorted(done) == [*range(10)]
