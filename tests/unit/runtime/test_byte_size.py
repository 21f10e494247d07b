"""Sizes are read and written as users write them."""

import pytest

from drcmitsuba.runtime.byte_size import byte_size, in_words
from drcmitsuba.runtime.errors import InputError


@pytest.mark.parametrize(
    ("text", "size"), [("3 GiB", 3 << 30), ("500MB", 5e8), ("1.5 kB", 1500), (" 7 b ", 7)]
)
def test_a_size_is_read(text, size):
    assert byte_size(text, "--memory") == size


@pytest.mark.parametrize("text", ["", "3", "GiB", "-1 GiB", "3 apples", "1e9 GB", "nan GB"])
def test_other_texts_are_refused(text):
    with pytest.raises(InputError, match="--memory"):
        byte_size(text, "--memory")


@pytest.mark.parametrize(
    ("size", "words"), [(0, "0 B"), (1023, "1.02e+03 B"), (3 << 30, "3 GiB"), (1 << 19, "512 KiB")]
)
def test_a_size_is_written(size, words):
    assert in_words(size) == words
