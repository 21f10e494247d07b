"""Blocks made by other processes: numbers are those of one process, whoever dies meanwhile."""

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager

import pytest
import xarray as xr

from drcmitsuba import load_case
from drcmitsuba.annual import workers as module
from drcmitsuba.annual.block_parts import StatePart, make_part
from drcmitsuba.annual.workers import Workers, opened, versions
from drcmitsuba.blocks import block_folder
from drcmitsuba.blocks.block_file import read_block
from drcmitsuba.blocks.block_folder import BlockFolder
from drcmitsuba.blocks.part import EVERY_BLOCK, BlockPart
from drcmitsuba.case.groups import OPEN
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.transport.interreflection import interior
from tests import ROOT, skips
from tests.system.small_room import changed, run
from tests.system.test_resume import TINY, assert_identical

distributed = skips.module("distributed")
# Sockets of a cluster inside this process may be closed by the garbage collector alone.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")

ROUGH = changed(
    ("months = [3, 6]", "months = [3]\nhours = [9, 10]"), ("count = [5, 5]", "count = [48, 44]"),
    ("spacing = 0.6", "spacing = 0.05"), ("replicates = 4", "replicates = 2"),
    ("[accuracy]", '[effects]\npictures = "off"\n[accuracy]'), ("paths = 32", "paths = 8"),
    ("sensor_sky_rays = 64", "sensor_sky_rays = 16"),
)  # fmt: skip
"""Three blocks of sensors, of which the last is small, with few rays."""


@pytest.fixture
def rough(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(ROUGH)
    return path


def stored(folder):
    """Content of all blocks by path."""
    return {path.relative_to(folder): read_block(path, {}) for path in folder.rglob("*.zip")}


def killed_after_the_first_block(client, folder):
    """Kill a worker at work with signal 9 once a block stands in the folder."""
    pids = client.run(os.getpid)

    def kill():
        while not [*folder.rglob("*.zip")]:
            time.sleep(0.01)
        busy = [address for address, jobs in client.processing().items() if jobs]
        os.kill(pids[busy[0]], signal.SIGKILL)

    thread = threading.Thread(target=kill, daemon=True)
    thread.start()
    return thread


def test_two_workers_of_which_one_is_killed_make_the_blocks_of_one_process(rough, tmp_path):
    case = load_case(rough)
    suns, seed = daylight(case).suns, case.accuracy.seed
    alone, together = (BlockFolder(tmp_path / name) for name in ("alone", "together"))
    alone.path.mkdir()
    StatePart(case, OPEN, suns, seed, alone, EVERY_BLOCK).make(lambda share: None)
    shares = []
    with opened(2) as workers:
        assert workers.count == 2
        killing = killed_after_the_first_block(workers.client, together.path)
        workers.elsewhere(case, together, seed)(OPEN, suns, shares.append)
        killing.join()
    expected, made = stored(alone.path), stored(together.path)
    assert len(expected) == 3
    assert made.keys() == expected.keys()
    for path, block in expected.items():
        xr.testing.assert_identical(made[path], block)
    assert shares[-1] == 1.0


def empties(group, seconds=30):
    """Whether nobody is left of a group of processes after a while."""
    for _ in range(10 * seconds):  # the system may collect the last ones a moment later
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.1)
    return False


@skips.POSIX.mark
@pytest.mark.slow
def test_ctrl_c_of_a_terminal_leaves_one_line_whole_blocks_and_no_worker(rough, tmp_path):
    folder = tmp_path / "out"
    command = [sys.executable, "-m", "drcmitsuba.cli", "evaluate", str(rough), "-o", str(folder)]
    process = subprocess.Popen(
        [*command, "--workers", "2"], cwd=ROOT, stderr=subprocess.PIPE, text=True,
        stdout=subprocess.DEVNULL, start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    while not [*folder.rglob("*.zip")]:
        assert process.poll() is None
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers, too
    error = process.communicate(timeout=60)[1]
    assert (process.returncode, error) == (130, "drcmitsuba: stopped\n")
    assert empties(process.pid)
    assert {path.name for path in folder.iterdir()} == {"unfinished"}
    assert stored(folder)


@pytest.fixture
def computed(monkeypatch):
    """Blocks of four sensors, and a list of those that are computed and stored."""
    blocks, write_block = [], block_folder.write_block
    monkeypatch.setattr(interior, "SENSORS", 4)
    monkeypatch.setattr(
        block_folder, "write_block", lambda *a: write_block(*a) or blocks.append(a[1])
    )
    return blocks


def test_parts_of_a_job_array_are_made_once_and_the_last_run_only_reads(
    tmp_path, monkeypatch, capsys, computed
):
    case, cache = tmp_path / "case.toml", tmp_path / "cache"
    case.write_text(TINY)
    for part in ("1/2", "2/2", "1/2"):
        run(monkeypatch, "evaluate", case, "--cache", cache, "--block", part)
    assert len(computed) == len(set(computed)) == 2 * 4  # open and shaded, 16 sensors
    assert "part 2/2 of the blocks is in" in capsys.readouterr().out
    make_part(load_case(case), BlockFolder.cache(tmp_path / "one"), EVERY_BLOCK)
    of_parts, of_one = stored(cache), stored(tmp_path / "one")
    assert of_parts.keys() == of_one.keys()
    for path, block in of_one.items():
        xr.testing.assert_identical(of_parts[path], block)
    computed.clear()
    run(monkeypatch, "evaluate", case, "--cache", cache, "-o", tmp_path / "out")
    assert computed == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--block", "7/4", "--cache", "c"], "--block: '7/4'; give i/n with i from 1 to n"),
        (["--block", "0/4", "--cache", "c"], "--block: '0/4'"),
        (["--block", "one", "--cache", "c"], "--block: 'one'"),
        (["--block", "1/2"], "--block: no --cache"),
        (["--workers", "2", "--scheduler", "tcp://127.0.0.1:1"], "--workers: beside --scheduler"),
        (["--workers", "0"], "--workers: 0; give a number"),
        (["--scheduler", "tcp://127.0.0.1:1"], "tcp://127.0.0.1:1: no scheduler answers"),
        (["--scheduler", "nonsense://1"], "--scheduler: nonsense://1: unknown"),
    ],
)
def test_unfit_arguments_are_told_in_a_line(arguments, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(module, "ANSWER", 0.5)
    (tmp_path / "case.toml").write_text(TINY)
    with pytest.raises(SystemExit) as stop:
        run(monkeypatch, "evaluate", "case.toml", "-o", "out", *arguments)
    assert stop.value.code == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["case.toml"]


@pytest.mark.parametrize(
    "further", [["--memory", "1 GiB"], ["--workers", "2"], ["--coefficients", "c.zarr"]]
)
def test_a_part_takes_the_options_that_it_follows(further, tmp_path, monkeypatch, capsys):
    (tmp_path / "case.toml").write_text(TINY)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stop:
        run(monkeypatch, "evaluate", "case.toml", "--cache", "c", "--block", "1/2", *further)
    assert stop.value.code == 2
    assert f"command line: {further[0]}: beside --block; give one" in capsys.readouterr().err


def test_a_part_is_of_the_chosen_spaces(tmp_path, monkeypatch):
    (tmp_path / "case.toml").write_text(TINY)
    made = []
    name = "drcmitsuba.annual.block_parts.make_part"
    monkeypatch.setattr(name, lambda case, *_: made.append(case))
    arguments = ("--cache", tmp_path / "c", "--block", "1/2", "--spaces", "A,B*")
    run(monkeypatch, "evaluate", tmp_path / "case.toml", *arguments)
    assert made[0].output.spaces == ("A", "B*")


def test_a_part_beside_groups_or_an_adaptive_sun_is_refused(tmp_path, monkeypatch, capsys):
    case = tmp_path / "case.toml"
    case.write_text(TINY.replace("[accuracy]", "[sun]\nmodel = 'adaptive'\n[accuracy]"))
    with pytest.raises(SystemExit):
        run(monkeypatch, "evaluate", case, "--cache", tmp_path / "c", "--block", "1/2")
    assert "--block: beside an adaptive sun" in capsys.readouterr().err


def test_a_worker_with_another_version_is_refused_by_name(tmp_path):
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0"
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        (address,) = client.nthreads()
        Workers(client, versions()).refuse_others()
        older = Workers(client, versions() | {"mitsuba": "3.5.0"})
        with pytest.raises(InputError, match=rf"worker {address}: version: mitsuba 3\.\d+\.\d+, "):
            older.refuse_others()
        case = load_case("classroom/reference/existing")
        unseen = StatePart(
            case, OPEN, daylight(case).suns, 1, BlockFolder(tmp_path / "unseen"), BlockPart(1, 2)
        )
        with pytest.raises(InputError, match="a worker does not see it"):
            [*older.__class__(client, versions()).each([unseen])]


@contextmanager
def cluster_of_processes(count):
    """A scheduler and workers without nannies, each a process of its own: address, processes."""
    python = [sys.executable, "-m"]
    options = {"stderr": subprocess.PIPE, "text": True, "cwd": ROOT}
    scheduler = subprocess.Popen(
        [*python, "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0",
         "--no-dashboard"], **options,
    )  # fmt: skip
    workers = []
    try:
        address = next(line.split()[-1] for line in scheduler.stderr if "Scheduler at:" in line)
        workers += [
            subprocess.Popen(
                [*python, "distributed.cli.dask_worker", address, "--nthreads", "1",
                 "--no-nanny", "--no-dashboard", "--death-timeout", "20"],
                stderr=subprocess.DEVNULL, cwd=ROOT,
            )
            for _ in range(count)
        ]  # fmt: skip
        yield address, scheduler, workers
    finally:
        for process in (*workers, scheduler):
            process.kill()
            process.wait()
        scheduler.stderr.close()


def started(case, folder, address):
    """The command with a scheduler's workers; it is returned when the first block is stored."""
    command = ["-m", "drcmitsuba.cli", "evaluate", case, "-o", folder, "--scheduler", address]
    process = subprocess.Popen(
        [sys.executable, *map(str, command)], cwd=ROOT, text=True, stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
    )  # fmt: skip
    while not [*folder.rglob("*.zip")] and process.poll() is None:
        time.sleep(0.02)
    return process


@pytest.mark.slow
def test_a_worker_of_a_scheduler_is_killed_and_the_scheduler_goes_away(rough, tmp_path):
    alone, folder, again = (tmp_path / name for name in ("alone", "killed", "gone"))
    command = [sys.executable, "-m", "drcmitsuba.cli", "evaluate", rough, "-o"]
    subprocess.run([*map(str, command), str(alone)], cwd=ROOT, check=True, capture_output=True)
    with cluster_of_processes(2) as (address, scheduler, workers):
        process = started(rough, folder, address)
        workers[0].kill()
        _, error = process.communicate(timeout=300)
        assert process.returncode == 0, error
        assert_identical(alone, folder)

        process = started(rough, again, address)
        scheduler.kill()
        _, error = process.communicate(timeout=60)
        assert process.returncode == 2
        assert "it has gone; start it and its workers" in error
        assert error.count("\n") == 1, error
        assert [*again.rglob("*.zip")]
    subprocess.run([*map(str, command), str(again)], cwd=ROOT, check=True, capture_output=True)
    assert_identical(alone, again)
