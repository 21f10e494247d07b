"""Flat arrays: rows and columns of their entries."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.runtime import backend
from drcmitsuba.runtime.flat_arrays import flat, marked, row_and_column, shared, vectors_of


@pytest.fixture(autouse=True)
def _variant():
    backend.select()


@pytest.mark.parametrize(
    "columns", [1, 2, 3, 7, 10, 146, 2159, 65_537, 999_983, (1 << 24) + 1, (1 << 32) - 1]
)
def test_rows_and_columns_are_quotient_and_remainder(columns):
    """Around every multiple, a reciprocal rounded the wrong way would show."""
    last = (1 << 32) - 1
    rows = np.unique(np.linspace(0, last // columns, 5000).astype(np.int64))
    entries = np.clip(np.add.outer(rows * columns, [-1, 0, 1]).ravel(), 0, last)
    row, column = row_and_column(mi.UInt32(entries.astype(np.uint32)), columns)
    np.testing.assert_array_equal(row.numpy(), entries // columns)
    np.testing.assert_array_equal(column.numpy(), entries % columns)


@pytest.mark.parametrize("count", [1, 5, 100_000])
def test_marked_entries_come_once_and_in_rising_order(count):
    rng = np.random.default_rng(2)
    entry, active = rng.integers(0, count, 3000), rng.random(3000) < 0.4
    found = marked(count, mi.UInt32(entry.astype(np.uint32)), mi.Bool(active)).numpy()
    np.testing.assert_array_equal(found, np.unique(entry[active]))
    assert dr.width(marked(count, mi.UInt32(entry.astype(np.uint32)), mi.Bool(False))) == 0


def test_vectors_are_read_one_by_one_and_numbers_of_the_device_stay_there():
    rows = np.arange(6.0).reshape(2, 3)
    assert [v.numpy().ravel().tolist() for v in vectors_of(rows)] == rows.tolist()
    values = dr.arange(mi.Float, 4)
    assert flat(values) is values


def test_an_array_without_columns_has_no_entries():
    row, column = row_and_column(mi.UInt32(), 0)
    assert dr.width(row) == dr.width(column) == 0


def test_numbers_of_the_device_are_shared_without_a_copy():
    memory = dr.arange(mi.Float, 15).numpy().reshape(3, 5)
    numbers = shared(memory)
    assert numbers.numpy().tolist() == [*range(15)]
    if backend.select().startswith("llvm"):
        assert np.shares_memory(numbers.numpy(), memory)


def test_other_numbers_are_copied():
    memory = np.arange(16, dtype=np.float32)[1:].reshape(3, 5)
    of_device = dr.arange(mi.Float, 64).numpy().reshape(4, 16)
    locked = dr.arange(mi.Float, 64).numpy()
    locked.flags.writeable = False
    for a in (memory, memory.T, memory.astype(float), of_device.T, locked):
        numbers = shared(a).numpy()
        assert numbers.tolist() == a.ravel().tolist()
        assert not np.shares_memory(numbers, a)
