"""Tables of a share of light over the cosine of the incidence."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.checks import checked
from drcmitsuba_plugins.sampling import clamped_index


def cosine_table(plugin: str, name: str, values) -> mi.TensorXf:
    """Table of a parameter whose values stand at equal steps of cos θ from 0 to 1.

    Parameters
    ----------
    plugin, name : str
        Named in errors.
    values : tensor or array, shape (n,)
        Shares from 0 to 1 [–], n > 1; a tensor keeps its gradients.

    Raises
    ------
    ValueError
        Another shape, or a value out of the range.
    """
    checked(plugin, name, values, 0, 1)
    table = mi.TensorXf(values if dr.is_tensor_v(values) else np.asarray(values, np.float32))
    if table.ndim != 1 or table.shape[0] < 2:
        raise ValueError(f"{plugin}: {name}: shape {table.shape}; give (n,) with n > 1")
    return table


def at_cosine(table: mi.TensorXf, cosine: mi.Float, active: mi.Bool) -> mi.Float:
    """Value of a table at a cosine, linear between its steps; below 0 that at 0."""
    n = table.shape[0]
    x = dr.clip(cosine, 0, 1) * (n - 1)
    i = clamped_index(x, n - 1)
    low = dr.gather(mi.Float, table.array, i, active)
    high = dr.gather(mi.Float, table.array, i + 1, active)
    return dr.lerp(low, high, x - mi.Float(i))
