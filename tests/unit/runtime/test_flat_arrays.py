"""Flat arrays: rows and columns of their entries."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.runtime import backend
from drcmitsuba.runtime.flat_arrays import row_and_column, shared


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
