"""Smooth twins of the metrics, for gradients: the steps of `metrics` become logistic curves.

Wherever a metric asks for value ≥ threshold, its twin takes

    s(value) = 1 / (1 + (value / threshold)⁻ᵏ)

the logistic function of k·ln(value / threshold): 0 at 0, exactly ½ at the threshold, with a slope
of k/4 there, relative to the threshold, and 1 far above. k is the sharpness; as a continuation
raises it, every twin tends to its metric, unless an illuminance lies exactly on its threshold. The
step is 0 at 0, not only small, so that the many hours without sun do not add up to exposure.

Counts, of hours or of sensors, have their threshold half a count below the whole count n that the
metric asks for: so n passes and n − 1 does not in the limit, and there are no ties of counts.

These are not the metrics of LM-83: a twin is for an optimiser, the number to report is that of
`metrics`. All functions take Dr.Jit tensors of shape (time, sensor) and keep gradients; their sums
are over the hours or the sensors of one room, in double precision: in single, 8760 hours drift.

References
----------
.. [1] IES LM-83-12, 2012; the metrics themselves are in `metrics`.
.. [2] E. L. Allgower, K. Georg, "Numerical continuation methods", 1990: why sharpness is raised in
   steps.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.metrics import autonomous, closing_sensors, exposed
from drcmitsuba.runtime.errors import InputError

SMALLEST = 1e-30
"""Ratios below this have no logarithm in single precision; their step is 0."""
STEEPEST = 80.0
"""Exponents beyond ± this are cut, before they overflow."""


def step(value: mi.TensorXf, threshold: float | mi.TensorXf, sharpness: float) -> mi.TensorXf:
    """Soft comparison value ≥ threshold, s = 1 / (1 + (value/threshold)⁻ᵏ).

    Parameters
    ----------
    value : mi.TensorXf
        0 or above; what is below counts as 0.
    threshold : float or mi.TensorXf
        Above 0, in the unit of `value`; a tensor is broadcast.
    sharpness : float
        k, above 0. From 1 on the gradient is finite everywhere, and 0 at 0.

    Returns
    -------
    mi.TensorXf
        0 to 1; finite with a finite gradient for any value, infinity included.
    """
    k = dr.opaque(mi.Float, sharpness)
    # Infinite values are cut too: their logarithm's gradient would be 0·∞.
    ratio = dr.clip(value / threshold, SMALLEST, 1 / SMALLEST)
    exponent = dr.clip(-k * dr.log(ratio), -STEEPEST, STEEPEST)
    return 1 / (1 + dr.exp(exponent))


def sda(
    illuminance: mi.TensorXf, threshold: float = 300.0, fraction: float = 0.5, *, sharpness: float
) -> mi.Float:
    """Twin of `metrics.sda`: 100 · mean_j s(Σ_t s(E_tj; threshold); n − ½).

    Parameters
    ----------
    illuminance : mi.TensorXf (time, sensor)
        With the shade applied, see `applied` [lx].
    threshold, fraction : float
        As for `metrics.sda`; n is the count of hours by `metrics.autonomous`.
    sharpness : float
        k of both steps.

    Returns
    -------
    mi.Float
        Smooth sDA [%].

    Raises
    ------
    InputError
        No time stamp or sensor, a threshold or a sharpness out of range.
    """
    hours = _hours(illuminance, threshold, sharpness)
    return _share(hours, autonomous(fraction, illuminance.shape[0]), sharpness)


def ase(
    direct: mi.TensorXf,
    threshold: float = 1000.0,
    hours: float = 250.0,
    step_hours: float = 1.0,
    *,
    sharpness: float,
) -> mi.Float:
    """Twin of `metrics.ase`; arguments as there, the rest as `sda`.

    Returns
    -------
    mi.Float
        Smooth ASE [%].

    Raises
    ------
    InputError
        As `sda`.
    """
    return _share(_hours(direct, threshold, sharpness), exposed(hours, step_hours), sharpness)


def msda(
    illuminance: mi.TensorXf,
    months: np.ndarray,
    threshold: float = 300.0,
    fraction: float = 0.5,
    *,
    sharpness: float,
) -> mi.TensorXf:
    """Twin of `metrics.msda`, of the months that have time stamps.

    Parameters
    ----------
    illuminance : mi.TensorXf (time, sensor)
        As for `sda` [lx].
    months : np.ndarray, shape (time,)
        Month of each time stamp, 1 to 12, in any order.
    threshold, fraction, sharpness : float
        As for `sda`.

    Returns
    -------
    mi.TensorXf (present,)
        Smooth msDA [%] of the months in `np.unique(months)`: none is without hours, so nothing is
        NaN.

    Raises
    ------
    InputError
        As `sda`; not one month for each time stamp.
    """
    stamps = _stamps(illuminance, months)
    least = np.array([autonomous(fraction, int(n)) for n in stamps.sum(axis=1)])
    return _monthly(illuminance, stamps, least, threshold, sharpness)


def mse(
    direct: mi.TensorXf,
    months: np.ndarray,
    threshold: float = 1000.0,
    hours: float = 250.0,
    step_hours: float = 1.0,
    *,
    sharpness: float,
) -> mi.TensorXf:
    """Twin of `metrics.mse`, of the months that have time stamps; see `msda`.

    Returns
    -------
    mi.TensorXf (present,)
        Smooth MSE [%].

    Raises
    ------
    InputError
        As `msda`.
    """
    stamps = _stamps(direct, months)
    count = stamps.sum(axis=1)
    least = np.array([exposed(hours, step_hours, int(n), len(months)) for n in count])
    return _monthly(direct, stamps, least, threshold, sharpness)


def shade_closed(
    direct: mi.TensorXf, threshold: float = 1000.0, area: float = 0.02, *, sharpness: float
) -> mi.TensorXf:
    """Twin of `metrics.shade_closed`: s(Σ_j s(E_tj; threshold); n − ½).

    Parameters
    ----------
    direct : mi.TensorXf (time, sensor)
        Direct sun with the shade open [lx].
    threshold, area : float
        As for `metrics.shade_closed`; n is the count of sensors by `metrics.closing_sensors`.
    sharpness : float
        k of both steps.

    Returns
    -------
    mi.TensorXf (time,)
        How far the shade is closed, 0 to 1.

    Raises
    ------
    InputError
        As `sda`.
    """
    _check(direct, threshold, sharpness)
    least = closing_sensors(area, direct.shape[1])
    if least == 0:
        return dr.full(mi.TensorXf, 1.0, (direct.shape[0],))
    return step(_sum(_passed(direct, threshold, sharpness), axis=1), least - 0.5, sharpness)


def applied(open: mi.TensorXf, shaded: mi.TensorXf, closed: mi.TensorXf) -> mi.TensorXf:
    """Blend the illuminances of both states: E = (1 − closed)·open + closed·shaded.

    Parameters
    ----------
    open, shaded : mi.TensorXf (time, sensor)
        Illuminance with the shade open and closed [lx].
    closed : mi.TensorXf (time,)
        From `shade_closed`.

    Returns
    -------
    mi.TensorXf (time, sensor)
        [lx].
    """
    part = dr.reshape(mi.TensorXf, closed, (closed.shape[0], 1))
    return open + (shaded - open) * part


def _check(E: mi.TensorXf, threshold: float, sharpness: float) -> None:
    if len(E.shape) != 2 or 0 in E.shape:
        raise InputError("smooth", "shape", f"{E.shape}", "give a tensor (time, sensor)")
    if not 0 <= threshold < np.inf:
        got = f"{threshold}"
        raise InputError("smooth", "threshold", got, "give a finite number, 0 or above")
    if not 1 <= sharpness < np.inf:
        raise InputError("smooth", "sharpness", f"{sharpness}", "give a number from 1 on")


def _passed(E: mi.TensorXf, threshold: float, sharpness: float) -> mi.TensorXf:
    """Soft E ≥ threshold, shaped as E; 0 lx are always reached."""
    return dr.full(mi.TensorXf, 1.0, E.shape) if threshold == 0 else step(E, threshold, sharpness)


def _hours(E: mi.TensorXf, threshold: float, sharpness: float) -> mi.TensorXf:
    """Soft count (sensor,) of the time stamps with E ≥ threshold."""
    _check(E, threshold, sharpness)
    return _sum(_passed(E, threshold, sharpness), axis=0)


def _sum(values: mi.TensorXf, axis: int) -> mi.TensorXf:
    return mi.TensorXf(dr.sum(mi.TensorXd(values), axis=axis))


def _share(hours: mi.TensorXf, least: int, sharpness: float) -> mi.Float:
    """Soft share [%] of the sensors with at least so many time stamps."""
    if least == 0:
        return mi.Float(100.0)
    return 100 * dr.mean(step(hours, least - 0.5, sharpness).array)


def _stamps(E: mi.TensorXf, months: np.ndarray) -> np.ndarray:
    """Whether a time stamp lies in a month, shape (present, time), 0 or 1."""
    if np.shape(months) != E.shape[:1]:
        got = f"shape {np.shape(months)}"
        raise InputError("smooth", "months", got, f"give {E.shape[0]} months, one for each stamp")
    present = np.unique(months)
    return (np.asarray(months) == present[:, None]).astype(np.float32)


def _monthly(
    E: mi.TensorXf, stamps: np.ndarray, least: np.ndarray, threshold: float, sharpness: float
) -> mi.TensorXf:
    """Soft share [%] of the sensors that reach `least` (present,) time stamps of each month."""
    _check(E, threshold, sharpness)
    hours = mi.TensorXf(mi.TensorXd(stamps) @ mi.TensorXd(_passed(E, threshold, sharpness)))
    # Where no stamp is asked for, every sensor passes: a threshold far below any count.
    need = np.where(least > 0, least - 0.5, SMALLEST)
    asked = mi.TensorXf(need.astype(np.float32)[:, None])
    passed = step(hours + mi.TensorXf((least == 0).astype(np.float32)[:, None]), asked, sharpness)
    return 100 * dr.mean(passed, axis=1)
