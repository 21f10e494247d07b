"""Sizes of memory and files as users write them: "3 GiB", "500 MB"."""

from __future__ import annotations

import re
from pathlib import Path

from drcmitsuba.runtime.errors import InputError

UNITS = {
    "b": 1, "kb": 10**3, "mb": 10**6, "gb": 10**9, "tb": 10**12,
    "kib": 1 << 10, "mib": 1 << 20, "gib": 1 << 30, "tib": 1 << 40,
}  # fmt: skip
"""Bytes of a unit."""


def byte_size(text: str, field: str) -> int:
    """Number of bytes that a text states; InputError for the `field` where it states none."""
    match = re.fullmatch(r"\s*(\d{1,9}(?:\.\d{1,9})?)\s*([a-zA-Z]{1,3})\s*", text, re.ASCII)
    if match is None or match[2].lower() not in UNITS:
        raise InputError("command line", field, repr(text), 'write a size such as "3 GiB"')
    return round(float(match[1]) * UNITS[match[2].lower()])


def size_on_disk(path: Path) -> int:
    """Number of bytes of a file, or of all files of a folder."""
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())


def in_words(size: int) -> str:
    """Size with three digits, in the largest unit of which it holds one."""
    units = [(name, bytes_) for name, bytes_ in UNITS.items() if name.endswith("b") and "i" in name]
    name, unit = next((u for u in reversed(units) if size >= u[1]), ("b", 1))
    return f"{size / unit:.3g} {name.capitalize().replace('ib', 'iB') if unit > 1 else 'B'}"
