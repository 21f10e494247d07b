"""Jobs beside the main thread end before it goes on, and their errors are its own."""

import threading

import pytest

from drcmitsuba.runtime.background import beside


def test_jobs_are_done_in_turn_while_the_block_runs():
    done, met = [], threading.Barrier(2, timeout=60)
    with beside(met.wait, lambda: done.append(1), lambda: done.append(2)):
        met.wait()
    assert done == [1, 2]


def test_an_error_of_a_job_is_raised_and_ends_the_jobs():
    done = []

    def fail():
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"), beside(fail, lambda: done.append(1)):
        done.append(0)
    assert done == [0]


def test_jobs_are_done_where_the_block_fails():
    done = []
    with pytest.raises(ValueError, match="picture"), beside(lambda: done.append(1)):
        raise ValueError("picture")
    assert done == [1]


def test_after_a_stop_only_the_job_that_has_begun_ends():
    done, begun, stopped = [], threading.Event(), threading.Event()

    def first():
        begun.set()
        stopped.wait(60)
        done.append(1)

    def stop():
        begun.wait(60)
        threading.Timer(0.2, stopped.set).start()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), beside(first, lambda: done.append(2)):
        stop()
    assert done == [1]
