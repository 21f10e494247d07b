"""One setting, evaluated as a user would: its illuminance, seconds and memory."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import numpy as np

from drcmitsuba.annual.result import Result, evaluate
from drcmitsuba.case.case import Case
from drcmitsuba.schema import luminance


@dataclass(frozen=True)
class Evaluated:
    """What an evaluation says about some of its time stamps, and what it cost.

    Parameters
    ----------
    total, total_open, direct_sun : np.ndarray, shape (time, sensor)
        [lx]; luminance where the case is coloured.
    closed : np.ndarray of bool, shape (time,)
        Whether the shade is closed.
    seconds : float
        All of the period, without start-up and writing.
    memory : int
        Largest that the process held [bytes].
    """

    total: np.ndarray
    total_open: np.ndarray
    direct_sun: np.ndarray
    closed: np.ndarray
    seconds: float
    memory: int


@dataclass(frozen=True)
class Evaluation:
    """The job: evaluate a case, and keep the time stamps that are named.

    Parameters
    ----------
    case : Case
    times : np.ndarray of datetime64, shape (time,)
    """

    case: Case
    times: np.ndarray

    def __call__(self) -> Evaluated:
        """Evaluate, and once more where kernels had to be compiled: users do that only once."""
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            result = evaluate(self.case)
            kernels = dr.kernel_history([dr.KernelType.JIT])
        if any(not k["cache_hit"] and not k["cache_disk"] for k in kernels):
            del result, kernels
            dr.flush_malloc_cache()
            result = evaluate(self.case)
        return self._kept(result)

    def _kept(self, result: Result) -> Evaluated:
        E = result.illuminance.sel(time=self.times)
        total, total_open, direct = (
            luminance(E[name]).transpose("time", "sensor").values
            for name in ("total", "total_open", "direct_sun")
        )
        return Evaluated(
            total, total_open, direct, E["shade_closed"].values.astype(bool),
            sum(result.metrics["seconds"].values()), int(result.metrics["peak_memory_bytes"]),
        )  # fmt: skip
