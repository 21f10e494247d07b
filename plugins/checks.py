"""Parameters of plugins, checked while a scene is loaded: an error names plugin and parameter."""

from __future__ import annotations

import drjit as dr
import numpy as np


def checked(plugin: str, name: str, value, low: float, high: float = np.inf):
    """Return `value` unchanged if all of it is finite and lies between `low` and `high`.

    Parameters
    ----------
    plugin, name : str
        Named in the error.
    value : float, array or tensor
    low, high : float
        Range, its ends included.

    Raises
    ------
    ValueError
        No number, NaN, infinite, or out of the range.
    """
    want = f"give numbers from {low:g}" + (f" to {high:g}" if np.isfinite(high) else "")
    try:
        v = np.asarray(dr.detach(value), float)
    except (TypeError, ValueError):
        raise ValueError(f"{plugin}: {name}: {value!r} is no number; {want}") from None
    bad = ~(np.isfinite(v) & (v >= low) & (v <= high))
    if bad.any():
        raise ValueError(f"{plugin}: {name}: {v[bad].flat[0]:g}; {want}")
    return value
