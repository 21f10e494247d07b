"""Memory that arrays may take of the machine, and that this process has taken."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

SHARE = 0.75
"""Share of the machine's memory that arrays may take."""
LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")
"""Files with the limit of a container's memory [bytes]; a word where there is none."""
STATUS = Path("/proc/self/status")
"""File in which Linux tells of a process."""


def of_machine() -> float:
    """Memory that arrays may take [bytes]."""
    try:
        physical = float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # not POSIX
        return float("inf")
    return SHARE * min([physical, *_limits()])


def _limits() -> Iterator[float]:
    """Yield limits of a container's memory [bytes]."""
    for file in LIMITS:
        with suppress(OSError):
            text = Path(file).read_text("utf-8").strip()
            if text.isdigit():
                yield float(text)


def peak_memory() -> int:
    """Largest memory that the process has held [bytes].

    On Linux `getrusage` also counts the memory of the parent at the start of the process, so the
    process' own status is read there.
    """
    if STATUS.is_file():
        status = STATUS.read_text(encoding="utf-8", errors="replace")
        line = re.search(r"^VmHWM:\s*(\d+) kB$", status, re.MULTILINE)
        if line is not None:
            return 1024 * int(line[1])
    if sys.platform == "win32":
        return _peak_of_windows()
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def _peak_of_windows() -> int:
    """Largest working set [bytes], from `PROCESS_MEMORY_COUNTERS`; 0 where Windows refuses."""
    import ctypes
    from ctypes import wintypes

    names = ("peak_working_set", "working_set", "peak_paged", "paged", "peak_nonpaged", "nonpaged",
             "pagefile", "peak_pagefile")  # fmt: skip

    class Counters(ctypes.Structure):
        _fields_ = (
            ("size", wintypes.DWORD), ("faults", wintypes.DWORD),
            *((name, ctypes.c_size_t) for name in names),
        )  # fmt: skip

    kernel = ctypes.WinDLL("kernel32")  # type: ignore[attr-defined, unused-ignore]
    kernel.GetCurrentProcess.restype = wintypes.HANDLE
    read = kernel.K32GetProcessMemoryInfo
    read.argtypes = (wintypes.HANDLE, ctypes.c_void_p, wintypes.DWORD)
    counters = Counters(size=ctypes.sizeof(Counters))
    read(kernel.GetCurrentProcess(), ctypes.byref(counters), ctypes.sizeof(Counters))
    return int(counters.peak_working_set)
