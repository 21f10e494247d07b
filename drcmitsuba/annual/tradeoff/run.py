"""From a case to its trade-off: every setting is evaluated in a process of its own."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import drjit as dr
import numpy as np

from drcmitsuba.annual.result import evaluate
from drcmitsuba.annual.tradeoff.errors import Row, SettingResult, Yardstick
from drcmitsuba.annual.tradeoff.finer_samples import is_called_for, sample_reference
from drcmitsuba.annual.tradeoff.path_tracing import trace_reference
from drcmitsuba.annual.tradeoff.reference import illuminances, number_of_states, some_hours
from drcmitsuba.annual.tradeoff.settings import Setting, default, design
from drcmitsuba.annual.tradeoff.table import Tradeoff
from drcmitsuba.case.case import Case
from drcmitsuba.plan import plan
from drcmitsuba.plan.forecast import forecast
from drcmitsuba.runtime import backend, process
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Stage, silent
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.sky.daylight import daylight

SHARE_OF_REFERENCE = 0.5
"""Largest share of the time for the reference."""
START_UP = 5.0
"""Approximate seconds of a process beside its evaluation: imports, kernels from the cache."""


def evaluate_setting(case: Case, times: np.ndarray) -> SettingResult:
    """Evaluate a case as a user would, and keep the results at `times` (time,).

    The case is evaluated again if kernels had to be compiled: users compile them once.
    """
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        result = evaluate(case)
        kernels = dr.kernel_history([dr.KernelType.JIT])
    if any(not k["cache_hit"] and not k["cache_disk"] for k in kernels):
        del result, kernels
        dr.flush_malloc_cache()
        result = evaluate(case)
    E = result.illuminance.sel(time=times)
    return SettingResult(
        *illuminances(E), number_of_states(case, E),
        sum(result.metrics["seconds"].values()), int(result.metrics["peak_memory_bytes"]),
    )  # fmt: skip


def announcement(count: int, seconds: float, minutes: float) -> str:
    """Say how many of `count` settings fit into the time [min].

    The forecast [s] of the default setting is taken as the mean of all settings.
    """
    each = seconds + START_UP
    fitting = int(60 * minutes * (1 - SHARE_OF_REFERENCE) / each)
    text = f"about {min(fitting, count)} of {count} settings fit into {minutes:g} min"
    if fitting >= count:
        return text
    enough = math.ceil(count * each / (1 - SHARE_OF_REFERENCE) / 60)
    return f"{text}; all of them need about --minutes {enough}"


def tradeoff(
    case: Case,
    minutes: float = 10.0,
    stage: Stage = silent,
    seen: Callable[[Tradeoff], None] = lambda so_far: None,
    announce: Callable[[str], None] = lambda text: None,
) -> Tradeoff:
    """Measure what accuracy costs in time, for one case.

    The case is evaluated with one setting at a time changed from the default, and with a few
    together; every result is compared with a reference on some of the hours.

    Parameters
    ----------
    case : Case
        Case from `load_case`.
    minutes : float
        Time limit [min], at most half of it for the reference; further settings are "not run".
    stage : callable, optional
        Shows the stages of the work.
    seen : callable, optional
        Called with the `Tradeoff` so far, after the reference and each setting.
    announce : callable, optional
        Called first, with a sentence on how many settings fit into the time.

    Returns
    -------
    Tradeoff
        Errors [%, points] and seconds of all settings.

    Raises
    ------
    InputError
        The case is unfit, or the time is too short for the reference.
    BackendError
        No fit LLVM or GPU.

    Notes
    -----
    sDA and ASE count the reference's hours, by the rules of a year. Every setting runs in a process
    of its own, which measures its memory; seconds leave out start-up and compilation.
    """
    if not 0 < minutes < 1e6:
        raise InputError("tradeoff", "minutes", f"{minutes:g}", "give minutes above 0")
    case = case.without_polish()
    case.refuse_overruled("the reference of tradeoff")
    start = time.monotonic()
    until, deadline = (start + 60 * minutes * share for share in (SHARE_OF_REFERENCE, 1))
    backend.select()
    prepared(case).check()
    light = daylight(case)
    year = light.sky["time"].values
    times = year[some_hours(year)]
    planned = plan(default(case), light)
    seconds = forecast(planned).seconds
    with tempfile.TemporaryDirectory(prefix="drcmitsuba-") as folder:
        settings = design(case, Path(folder), solved_cells=planned.scope.solved_cells)
        announce(announcement(len(settings), seconds, minutes))
        with stage("reference") as progress:
            made = sample_reference if is_called_for(case) else trace_reference
            job = partial(made, case, times, until)
            share = (deadline - time.monotonic()) / max(until - time.monotonic(), 1e-3)
            try:
                reference = process.run(job, deadline, lambda t: progress(min(t * share, 1.0)))
            except TimeoutError:
                got, remedy = f"{minutes:g}: no reference", "give more --minutes"
                raise InputError("tradeoff", "minutes", got, remedy) from None
        if not reference.is_open.any():
            got = f"no light at the {len(times)} that are compared"
            raise InputError(case.source, "period, time stamps", got, "take some with daylight")
        yardstick = Yardstick(reference, case.metrics, len(times) / len(year), light.step_hours)
        rows = tuple(Row(setting.name, setting.varied) for setting in settings)
        so_far = Tradeoff(case.name, rows, yardstick, len(year), light.notes)
        seen(so_far)
        with stage("settings") as progress:
            for i, setting in enumerate(settings):
                row = _row(case, setting, times, yardstick, deadline)
                rows = (*rows[:i], row, *rows[i + 1 :])
                so_far = replace(so_far, rows=rows)
                seen(so_far)
                progress((i + 1) / len(settings))
                if time.monotonic() >= deadline:
                    break
    return so_far


def _row(
    case: Case, setting: Setting, times: np.ndarray, yardstick: Yardstick, deadline: float
) -> Row:
    """Evaluate one setting and compare it with the reference; a failure only marks its row.

    So does a setting that the case cannot have, such as an adaptive sun beside a component.
    """
    try:
        result = process.run(partial(evaluate_setting, setting.case, times), deadline)
    except TimeoutError:
        return Row(setting.name, setting.varied)
    except process.JobError as failure:
        return Row(setting.name, setting.varied, status=f"failed: {failure}")
    except InputError as error:
        return Row(setting.name, setting.varied, status=f"not for this case: {error.got}")
    errors = yardstick.errors(result, same_sensors=setting.case.sensors == case.sensors)
    return Row(setting.name, setting.varied, "done", errors, result.seconds, result.memory)
