"""Smooth comparisons and counts that the twins of the metrics share, for gradients.

Wherever a metric asks for value ≥ threshold, its twin takes

    s(value) = 1 / (1 + (value / threshold)⁻ᵏ)

the logistic function of k·ln(value / threshold): 0 at 0, exactly ½ at the threshold, with a slope
of k/4 there, relative to the threshold, and 1 far above. k is the sharpness; as a continuation
raises it [1]_, every twin tends to its metric, unless an illuminance lies exactly on its threshold.
The step is 0 at 0, not only small, so that the many hours without sun do not add up to exposure.

Counts, of hours or of sensors, have their threshold half a count below the whole count n that the
metric asks for: so n passes and n − 1 does not in the limit, and there are no ties of counts.

A twin is for an optimiser; the number to report is that of the metric. All functions take Dr.Jit
tensors of shape (time, sensor) and keep gradients; their sums are over the hours or the sensors of
one room, in double precision: in single precision, 8760 hours drift.

References
----------
.. [1] E. L. Allgower, K. Georg, "Numerical continuation methods", 1990.
"""

from __future__ import annotations

from collections.abc import Callable

import drjit as dr
import mitsuba as mi
import numpy as np

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
        0 or above; a value below 0 counts as 0.
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


def passed(E: mi.TensorXf, threshold: float, sharpness: float) -> mi.TensorXf:
    """Soft E ≥ threshold, shape (time, sensor); a threshold of 0 lx is always reached.

    No time stamp or sensor, a threshold or a sharpness out of range raise InputError.
    """
    if len(E.shape) != 2 or 0 in E.shape:
        raise InputError("smooth", "shape", f"{E.shape}", "give a tensor (time, sensor)")
    if not 0 <= threshold < np.inf:
        got = f"{threshold}"
        raise InputError("smooth", "threshold", got, "give a finite number, 0 or above")
    if not 1 <= sharpness < np.inf:
        raise InputError("smooth", "sharpness", f"{sharpness}", "give a number from 1 on")
    return dr.full(mi.TensorXf, 1.0, E.shape) if threshold == 0 else step(E, threshold, sharpness)


def total(values: mi.TensorXf, axis: int) -> mi.TensorXf:
    """Sum of values (time, sensor) along an axis in double precision."""
    every = mi.TensorXd(values)
    if axis:
        return mi.TensorXf(dr.sum(every, axis=axis))
    once = dr.ones(mi.TensorXd, (1, values.shape[0]))  # as a product, gradients take half the time
    return mi.TensorXf((once @ every).array)


def stamps_reached(E: mi.TensorXf, threshold: float, sharpness: float) -> mi.TensorXf:
    """Soft number of time stamps with E ≥ threshold, shape (sensor,)."""
    return total(passed(E, threshold, sharpness), axis=0)


def share(
    stamps: mi.TensorXf, required: int, sharpness: float, weights: np.ndarray | None = None
) -> mi.Float:
    """Soft share [%] of the sensors with at least `required` time stamps.

    `weights` (sensor,), of any sum, are what each sensor stands for; by default all are equal.
    """
    if required == 0:
        return mi.Float(100.0)
    passed = step(stamps, required - 0.5, sharpness).array
    if weights is None:
        return 100 * mi.Float(dr.mean(mi.Float64(passed)))
    return 100 * mi.Float(dr.sum(mi.Float64(passed) * mi.Float64(weights / np.sum(weights))))


def monthly_share(
    E: mi.TensorXf, months: np.ndarray, threshold: float,
    required: Callable[[int, int], int], sharpness: float,
) -> mi.TensorXf:  # fmt: skip
    """Soft share [%] of the sensors that reach the threshold at `required(t_m, t_y)` time stamps.

    E has the shape (time, sensor) [lx], `months` (time,), the result (present,): the months in
    `np.unique(months)`. A month has t_m of the t_y time stamps. Errors are those of `passed`, and
    InputError where there is not one month for each time stamp.
    """
    if np.shape(months) != E.shape[:1]:
        got = f"shape {np.shape(months)}"
        raise InputError("smooth", "months", got, f"give {E.shape[0]} months, one for each stamp")
    in_month = np.asarray(months) == np.unique(months)[:, None]  # (present, time)
    least = np.array([required(int(t_m), len(months)) for t_m in in_month.sum(axis=1)])
    weights = mi.TensorXd(in_month.astype(np.float32))
    stamps = mi.TensorXf(weights @ mi.TensorXd(passed(E, threshold, sharpness)))
    # Where no stamp is required, every sensor passes: a threshold far below any count.
    need = np.where(least > 0, least - 0.5, SMALLEST).astype(np.float32)[:, None]
    free = mi.TensorXf((least == 0).astype(np.float32)[:, None])
    reached = step(stamps + free, mi.TensorXf(need), sharpness)
    return 100 / E.shape[1] * total(reached, axis=1)
