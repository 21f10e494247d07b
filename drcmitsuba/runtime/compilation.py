"""Compilation of kernels, which Dr.Jit does once and keeps in a folder of the user's.

A kernel is compiled by the first run that launches it; later runs, of other cases too, load it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import drjit as dr

from drcmitsuba.runtime import kernel_folder
from drcmitsuba.runtime.progress import Progress, Stage

LEAST = 0.5
"""Time of compilation below which there is nothing to say [s]."""


@dataclass
class Compilation:
    """Kernels that a run compiled, in the order of its stages."""

    kernels: dict[str, int] = field(default_factory=dict)
    """Number of kernels by stage."""
    seconds: float = 0.0
    """Time that the compiler took [s]."""

    def add(self, stage: str) -> None:
        """Add the kernels that were compiled since the last call."""
        for launch in dr.kernel_history([dr.KernelType.JIT]):
            if not (launch["cache_hit"] or launch["cache_disk"]):
                self.kernels[stage] = self.kernels.get(stage, 0) + 1
                self.seconds += launch["backend_time"] / 1000

    def line(self) -> str:
        """Sentence for the user; empty where little was compiled."""
        if self.seconds < LEAST:
            return ""
        stages = ", ".join(f"{name} {count}" for name, count in self.kernels.items())
        later = "they are kept: later runs take less time"
        return (
            f"compiled {sum(self.kernels.values())} kernels in {self.seconds:.1f} s ({stages}); "
            f"{later if kernel_folder.are_kept() else 'they are not kept'}"
        )


@contextmanager
def recorded(stage: Stage) -> Iterator[tuple[Stage, Compilation]]:
    """Record what is compiled while the block runs; yields stages that do so, and the record."""
    compilation = Compilation()

    @contextmanager
    def opened(name: str) -> Iterator[Progress]:
        with stage(name) as done:
            yield done
        compilation.add(name)

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        try:
            yield opened, compilation
        finally:
            dr.kernel_history_clear()
