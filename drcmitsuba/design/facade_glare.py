"""Hours of glare of a searched façade, smooth and hard, from what its eyes see.

The eyes belong to a room above this one: who calls a search passes them, as
`drcmitsuba.glare_year.EyesOfSearch.of`. DGP of the states of the façade is mixed as their
illuminance is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import drjit as dr
import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba.case.case import Case
from drcmitsuba.design.facade_groups import FacadeGroups, applied, smooth_applied
from drcmitsuba.metrics import smooth_step
from drcmitsuba.metrics.intervals.rules import Rules
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Stage
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.transport.elements.state_illuminances import Illuminances

Weights = tuple[Any, Any]
"""Shares and factors of elements, (element + 1,) each, as for `SmoothYear.illuminance`."""


class TracedEyes(Protocol):
    """Eyes of a case, and all that they see by element."""

    @property
    def limit(self) -> float:
        """DGP above which an hour is one of glare."""

    @property
    def counted(self) -> np.ndarray:
        """Time stamps that count, bool, shape (time,)."""

    def at(self, hours: np.ndarray) -> TracedEyes:
        """Eyes at some time stamps (hour,)."""

    def dgp(
        self, shares: mi.Float, factors: mi.Float, sharpness: float | None
    ) -> tuple[mi.TensorXf, ...]:
        """DGP (time, view) in every state; hard without a sharpness."""

    def in_facades(self, case: Case, panes: PaneGroups, shares: np.ndarray, stage: Stage) -> Any:
        """Glare by other light paths, with the shares (time, element) of openings of a case."""

    def of_case(self, case: Case, stage: Stage) -> Any:
        """Glare of a case that is drawn."""


class EyesOfCase(Protocol):
    """Eyes of a case, before their light is traced."""

    def traced(
        self, case: Case, panes: PaneGroups, light: Daylight, effects: EnabledEffects,
        is_open: np.ndarray, closings: Sequence[np.ndarray], stage: Stage,
    ) -> TracedEyes:  # fmt: skip
        """Trace what they see by every opening and fill."""


TraceEyes = Callable[[Case], EyesOfCase]
"""Finds the eyes of a case."""


@dataclass(frozen=True)
class LitOpenings:
    """Openings and fills by which the light of a search was traced."""

    case: Case
    panes: PaneGroups
    effects: EnabledEffects
    eyes: EyesOfCase


def eyes_of(case: Case, trace: TraceEyes | None) -> EyesOfCase | None:
    """Eyes of a case; None where `[design]` does not ask for hours of glare.

    Raises
    ------
    InputError
        There is no way to trace them, or the case has none.
    """
    if case.design is None or not case.design.asks_glare:
        return None
    if trace is None:
        remedy = "pass trace_eyes=drcmitsuba.glare_year.EyesOfSearch.of"
        raise InputError("design", "trace_eyes", "hours of glare without eyes", remedy)
    return trace(case)


def smooth_hours(
    eyes: TracedEyes, weights: Weights, E: Illuminances, rules: Rules,
    groups: FacadeGroups | None, sharpness: float,
) -> mi.TensorXf:  # fmt: skip
    """Soft share of the hours with glare at each view [%], shape (view,), with gradients.

    Parameters
    ----------
    E : Illuminances
        Illuminance of the sensors, whose direct sun closes the shade.
    rules, groups
        Rule of the shade, as for `facade_groups.smooth_applied`.
    """
    of_states = _states(eyes.dgp(*weights, sharpness), E)
    dgp = smooth_applied(of_states, rules, groups, sharpness)
    is_counted = mi.TensorXf(eyes.counted.astype(np.float32)[:, None])
    hours = smooth_step.total(smooth_step.passed(dgp, eyes.limit, sharpness) * is_counted, axis=0)
    return hours * (100 / max(1, int(eyes.counted.sum())))


def hard_hours(
    eyes: TracedEyes, weights: Weights, E: Illuminances, direct: xr.DataArray, rules: Rules,
    groups: FacadeGroups | None,
) -> np.ndarray:  # fmt: skip
    """Share of the hours with glare at each view [%], shape (view,).

    `direct` is `E.direct` with the coordinates of the sensors.
    """
    of_states = _states(eyes.dgp(*weights, None), E)
    dgp = applied(of_states, direct, rules, groups)[eyes.counted]
    return np.asarray(100 * (dgp > eyes.limit).sum(axis=0) / max(1, int(eyes.counted.sum())))


def states_of_hours(
    E: Illuminances, direct: xr.DataArray, rules: Rules, groups: FacadeGroups | None
) -> np.ndarray:
    """Number of the state that the façade takes in every hour, int, shape (time,)."""
    count = E.direct.shape[0]
    numbers = tuple(dr.full(mi.TensorXf, k, (count, 1)) for k in range(len(E.states)))
    return applied(_states(numbers, E), direct, rules, groups)[:, 0].astype(int)


def _states(values: tuple[mi.TensorXf, ...], E: Illuminances) -> Illuminances:
    """Values of all states in place of their illuminance."""
    return E._replace(open=values[0], shaded=values[1], others=tuple(values[2:]))
