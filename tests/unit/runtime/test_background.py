"""Jobs beside the main thread end before it goes on, and their errors are its own."""

import threading

import pytest

from drcmitsuba.runtime.background import Behind, beside


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


def full_disk():
    raise OSError(28, "No space left on device")


def test_jobs_behind_are_done_at_once_unless_a_thread_is_open():
    behind, threads = Behind(), []
    behind.do(lambda: threads.append(threading.current_thread()))
    with behind.opened():
        behind.do(lambda: threads.append(threading.current_thread()))
    behind.do(lambda: threads.append(threading.current_thread()))
    main = threading.current_thread()
    assert [thread is main for thread in threads] == [True, False, True]


def test_a_job_behind_waits_for_the_one_before_and_others_for_what_it_is_about():
    behind, go, done = Behind(), threading.Event(), []
    with behind.opened():
        behind.do(lambda: (go.wait(60), done.append(1)), ("a", "c"))
        behind.wait("b")  # the job in hand is about something else
        assert done == []
        threading.Timer(0.1, go.set).start()
        behind.do(lambda: done.append(2), "b")
        assert done[0] == 1
        behind.wait("b")
        assert done == [1, 2]


def wait_for_another(behind):
    """Wait for something else until the job has failed."""
    while True:
        behind.wait("b")


@pytest.mark.parametrize(
    "ask", [lambda b: b.wait("a"), wait_for_another, lambda b: b.do(int), lambda b: None]
)
def test_the_error_of_a_job_behind_is_raised_once(ask):
    behind = Behind()
    with pytest.raises(OSError, match="No space"), behind.opened():  # noqa: PT012
        behind.do(full_disk, ("a",))
        ask(behind)
    behind.wait()


def test_a_job_behind_is_done_where_the_block_fails():
    behind, go, done = Behind(), threading.Event(), []
    with pytest.raises(KeyboardInterrupt), behind.opened():  # noqa: PT012
        behind.do(lambda: (go.wait(60), done.append(1)))
        threading.Timer(0.1, go.set).start()
        raise KeyboardInterrupt
    assert done == [1]
