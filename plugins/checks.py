"""Parameters of plugins, checked while a scene is loaded: an error names plugin and parameter."""

from __future__ import annotations

import drjit as dr
import numpy as np


def required(plugin: str, props, name: str, wanted: str):
    """Value of a parameter that has no default.

    Raises
    ------
    ValueError
        The parameter is missing.
    """
    if name not in props:
        raise ValueError(f"{plugin}: {name}: missing; give {wanted}")
    return props[name]


def checked_whole(plugin: str, name: str, value, low: int, high: float = np.inf) -> int:
    """Return `value` as an int if it is a whole number from `low` to `high`; see `checked`."""
    if checked(plugin, name, value, low, high) != int(value):
        raise ValueError(f"{plugin}: {name}: {value:g}; give a whole number")
    return int(value)


def checked(plugin: str, name: str, value, low: float, high: float = np.inf):
    """Check that all numbers of a value are finite and between `low` and `high`.

    Parameters
    ----------
    plugin, name : str
        Named in the error.
    value : float, array or tensor
    low, high : float
        Range, its ends included.

    Returns
    -------
    float, array or tensor
        The value, unchanged.

    Raises
    ------
    ValueError
        The value holds no number, or one that is NaN, infinite or out of the range.
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
