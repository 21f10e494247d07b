"""Folders of blocks: what is stored, found again, refused, listed and removed."""

import json
import os
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from drcmitsuba.blocks import block_folder
from drcmitsuba.blocks.block_folder import FORMAT, HEADER, NOTHING_KEPT, BlockFolder
from drcmitsuba.runtime.errors import InputError
from tests import skips


def dataset(sensors, value=1.0):
    return xr.Dataset({"C": (("sensor", "bin"), np.full((sensors, 3), value))})


@pytest.fixture
def cache(tmp_path):
    return BlockFolder.cache(tmp_path / "cache")


def test_blocks_cover_the_sensors_only_without_gaps(cache):
    series = cache.series("case, open", 1)
    assert series.cover(9) == []
    series.put(slice(0, 4), dataset(4))
    series.put(slice(8, 9), dataset(1))
    assert series.cover(9) == []
    series.put(slice(4, 8), dataset(4, 2.0))
    assert series.cover(9) == [slice(0, 4), slice(4, 8), slice(8, 9)]
    assert series.cover(10) == []
    xr.testing.assert_identical(series.get(slice(4, 8)), dataset(4, 2.0))
    assert cache.series("other words", 1).get(slice(0, 4)) is not None
    assert cache.series("case, open", 2).get(slice(0, 4)) is None


def test_a_damaged_block_is_noted_and_removed(cache):
    series = cache.series("case, open", 1)
    series.put(slice(0, 4), dataset(4))
    (file,) = series.folder.glob("*.zip")
    file.write_bytes(file.read_bytes()[:-9])
    assert series.get(slice(0, 4)) is None
    assert cache.notes == [f"block {file.name} of case, open was damaged and is made again"]
    assert not file.exists()
    made = series.kept(4, lambda: dataset(4, 3.0))
    xr.testing.assert_identical(made, series.get(slice(0, 4)))


def test_blocks_that_a_thread_writes_are_found_as_others(cache, monkeypatch):
    series, go, write = cache.series("case, open", 1), threading.Event(), block_folder.write_block
    monkeypatch.setattr(block_folder, "write_block", lambda *args: (go.wait(60), write(*args)))
    with cache.writing.opened():
        series.put(slice(0, 4), dataset(4))
        assert cache.series("case, shaded", 2).cover(4) == []  # does not wait
        assert series.get(slice(4, 8)) is None
        assert not series.folder.exists()
        go.set()
        assert series.cover(4) == [slice(0, 4)]
        series.put(slice(4, 8), dataset(4, 2.0))
        xr.testing.assert_identical(series.get(slice(4, 8)), dataset(4, 2.0))
        series.put(slice(8, 9), dataset(1))
    assert series.cover(9) == [slice(0, 4), slice(4, 8), slice(8, 9)]


def test_a_block_that_a_thread_cannot_write_ends_the_run(cache, monkeypatch):
    def full_disk(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(block_folder, "write_block", full_disk)
    with pytest.raises(OSError, match="No space"), cache.writing.opened():
        cache.series("case, open", 1).put(slice(0, 4), dataset(4))


def test_a_series_without_a_folder_keeps_nothing():
    NOTHING_KEPT.put(slice(0, 4), dataset(4))
    assert NOTHING_KEPT.get(slice(0, 4)) is None
    assert NOTHING_KEPT.cover(4) == []


def test_a_temporary_file_is_no_block(cache):
    series = cache.series("case", 1)
    series.folder.mkdir()
    (series.folder / ".00000000-00000004.zip.0123abcd").write_bytes(b"half")
    assert series.cover(4) == []
    assert cache.entries() == []
    old = time.time() - 7200
    os.utime(series.folder / ".00000000-00000004.zip.0123abcd", (old, old))
    cache.prune()
    assert list(series.folder.iterdir()) == []


def test_pruning_removes_what_was_not_used_for_longest(cache):
    for i in range(4):
        series = cache.series(f"case {i}", i)
        series.put(slice(0, 4), dataset(4))
        (file,) = series.folder.glob("*.zip")
        os.utime(file, (1000 + i, 1000 + i))
    cache.series("case 0", 0).get(slice(0, 4))  # used now
    size = cache.entries()[0].size
    assert [e.about for e in cache.entries()] == ["case 0", "case 3", "case 2", "case 1"]
    assert cache.prune(2 * size) == 2 * size
    assert [e.about for e in cache.entries()] == ["case 0", "case 3"]
    cache.set_limit(size)
    assert BlockFolder.cache(cache.path).limit == size
    cache.finish()
    assert [e.about for e in cache.entries()] == ["case 0"]


def test_pruning_passes_over_what_another_run_removes(cache, monkeypatch):
    stat = Path.stat

    def vanished(file, **options):
        if file.suffix in (".zip", ".part"):
            raise FileNotFoundError(file)
        return stat(file, **options)

    folder = cache.path / "key"
    folder.mkdir()
    for name in ("0.zip", ".1.part"):
        (folder / name).write_bytes(b"")
    monkeypatch.setattr(Path, "stat", vanished)
    assert cache.prune() == 0


def test_own_blocks_go_when_the_run_has_ended(tmp_path):
    blocks = BlockFolder.of_results(tmp_path / "results")
    blocks.series("case", 1).put(slice(0, 4), dataset(4))
    blocks.finish()
    assert list((tmp_path / "results").iterdir()) == []
    BlockFolder.of_results(tmp_path / "nowhere").finish()
    assert not (tmp_path / "nowhere").exists()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"format": FORMAT + 1}, "format"),
        ({"byte_order": "big" if sys.byteorder == "little" else "little"}, "byte order"),
        (None, "format"),
    ],
)
def test_a_cache_of_another_version_or_machine_is_refused_by_name(tmp_path, changes, words):
    cache = BlockFolder.cache(tmp_path)
    header = json.loads((cache.path / HEADER).read_text())
    text = "[]" if changes is None else json.dumps(header | changes)
    (cache.path / HEADER).write_text(text)
    with pytest.raises(InputError, match=words):
        BlockFolder.cache(tmp_path)


def test_folders_that_are_no_cache_are_refused(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="other files"):
        BlockFolder.cache(tmp_path)
    with pytest.raises(InputError, match="a file"):
        BlockFolder.cache(tmp_path / "mine.txt")


@skips.POSIX.mark
@skips.ORDINARY_USER.mark
def test_a_cache_without_permission_is_refused(tmp_path):
    BlockFolder.cache(tmp_path)
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="may not be written"):
        BlockFolder.cache(tmp_path)


def test_a_cache_that_the_system_says_is_not_writable_is_refused(tmp_path, monkeypatch):
    BlockFolder.cache(tmp_path)
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(InputError, match="may not be written"):
        BlockFolder.cache(tmp_path)
