"""From a case to the table of what accuracy costs."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from drcmitsuba.annual.tradeoff import process
from drcmitsuba.annual.tradeoff.deviation import Yardstick
from drcmitsuba.annual.tradeoff.evaluation import Evaluation
from drcmitsuba.annual.tradeoff.reference import Referencing, some_hours
from drcmitsuba.annual.tradeoff.row import Row
from drcmitsuba.annual.tradeoff.settings import Setting, design
from drcmitsuba.annual.tradeoff.table import Tradeoff
from drcmitsuba.case.case import Case
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Stage, silent
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.daylight import daylight

SHARE_OF_REFERENCE = 0.5
"""Part of the time that the reference may take."""


def tradeoff(
    case: Case,
    minutes: float = 10.0,
    stage: Stage = silent,
    seen: Callable[[Tradeoff], None] = lambda so_far: None,
) -> Tradeoff:
    """Measure what accuracy costs in time, for one case.

    The case is evaluated with one setting at a time changed from the default, and with a few
    together; every result is compared with an unbiased reference on some of the hours.

    Parameters
    ----------
    case : Case
        From `load_case`.
    minutes : float
        After which it stops; settings that are not reached are listed as such. At most half of it
        goes into the reference.
    stage : callable, optional
        Shows the stages of the work, as the command line does.
    seen : callable, optional
        Called with what is known so far, after the reference and after every setting.

    Returns
    -------
    Tradeoff
        Shows itself in Jupyter.

    Raises
    ------
    InputError
        Something in the case is unfit, or the time does not suffice for the reference.
    BackendError
        No fit LLVM or GPU.

    Notes
    -----
    sDA and ASE are those of the reference's hours, by the rules of a year. Every setting runs in a
    process of its own, so its memory is its own; seconds leave out start-up and compilation.
    """
    if not 0 < minutes < 1e6:
        raise InputError("tradeoff", "minutes", f"{minutes:g}", "give minutes above 0")
    case.refuse_components("the reference of tradeoff")
    start = time.monotonic()
    deadline = start + 60 * minutes
    backend.select()
    sensor_points(case)  # what is wrong is told before the work begins
    light = daylight(case)
    year = light.sky["time"].values
    times = year[some_hours(year)]
    with stage("reference") as progress:
        until = start + 60 * minutes * SHARE_OF_REFERENCE
        job = Referencing(case, times, until)
        share = (deadline - time.monotonic()) / max(until - time.monotonic(), 1e-3)
        try:
            found = process.run(job, deadline, lambda done: progress(min(done * share, 1.0)))
        except TimeoutError:
            remedy = "give more --minutes"
            raise InputError("tradeoff", "minutes", f"{minutes:g}: no reference", remedy) from None
    if not found.is_open.any():
        got = f"no light at the {len(times)} that are compared"
        raise InputError(case.source, "period, time stamps", got, "take some with daylight")
    yardstick = Yardstick(found, case.metrics, len(times) / len(year), light.step_hours)
    with tempfile.TemporaryDirectory(prefix="drcmitsuba-") as folder:
        settings = design(case, Path(folder))
        rows = tuple(Row(setting.name, setting.varied) for setting in settings)
        so_far = Tradeoff.of(case, yardstick, len(year), rows)
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
    """Evaluate a setting and measure it; a setting that fails leaves the others alone."""
    try:
        found = process.run(Evaluation(setting.case, times), deadline)
    except TimeoutError:
        return Row(setting.name, setting.varied)
    except process.JobError as failure:
        return Row(setting.name, setting.varied, status=f"failed: {failure}")
    errors = yardstick.errors(found, same_sensors=setting.same_sensors(case))
    return Row(setting.name, setting.varied, "done", errors, found.seconds, found.memory)
