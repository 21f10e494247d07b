"""Daylight factor under a standard overcast sky, from coefficients C.

References
----------
.. [1] ISO 15469:2004 / CIE S 011, "Spatial distribution of daylight – CIE standard general sky":
   type 1, the standard overcast sky; type 16, the traditional one of Moon and Spencer.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.metrics.point_autonomy import by_sensor
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.schema import UnknownLabelsError, positions

OVERCAST = (1, 16)
"""Types of [1] that are the same in every direction of the compass."""
LARGEST = 6
"""Largest subdivision of the sky."""


def overcast_luminances(
    subdivision: int = 1, ground_reflectance: float = 0.2, kind: int = 1
) -> xr.DataArray:
    """Luminances of an overcast sky that gives 1 lx of horizontal illuminance.

    Parameters
    ----------
    subdivision : int
        Reinhart's subdivision of the sky, 1 to 6.
    ground_reflectance : float
        ρ of the ground, whose luminance is ρ/π · 1 lx [–].
    kind : int
        1, the standard overcast sky, or 16, the traditional one [1].

    Returns
    -------
    DataArray (bin,)
        L [cd/m²].

    Raises
    ------
    InputError
        Another kind, or a reflectance that is none.
    """
    from drcmitsuba.sky.cie import relative
    from drcmitsuba.sky.quadrature import gauss_nodes

    if kind not in OVERCAST:
        raise InputError("daylight factor", "kind", f"{kind}", "give 1 or 16")
    if not 0 <= ground_reflectance <= 1:
        got = f"{ground_reflectance}"
        raise InputError("daylight factor", "ground_reflectance", got, "give a number from 0 to 1")
    patches = Patches(subdivision)
    nodes, weights = gauss_nodes(patches, 8, 5)
    z = nodes[..., 2]
    of_patches = (relative(kind, z, np.zeros_like(z), np.zeros(1)) * weights).sum(axis=1)
    of_patches /= of_patches @ patches.projected_solid_angles[1:]
    L = np.concatenate([[ground_reflectance / np.pi], of_patches])
    labels = np.array(patches.labels, dtype=object)
    return xr.DataArray(L, {"bin": labels}, ("bin",), "L", {"units": "cd/m2"})


def daylight_factor(
    coefficients: xr.DataArray, ground_reflectance: float = 0.2, kind: int = 1
) -> xr.DataArray:
    """Daylight factor, illuminance over the unobstructed horizontal one under an overcast sky.

    DF_j = 100 · Σ_b C_jb L_b / E_h. It is linear in C: its own smooth twin.

    Parameters
    ----------
    coefficients : DataArray (sensor, bin)
        C by luminance, of one state of the façade [sr]; bins of suns do not count.
    ground_reflectance, kind
        As for `overcast_luminances`.

    Returns
    -------
    DataArray (sensor,)
        DF [%].

    Raises
    ------
    InputError
        Other dims, bins of no whole sky, values that are not finite.

    Examples
    --------
    >>> import drcmitsuba
    >>> result = drcmitsuba.evaluate("office.toml")
    >>> C = result.coefficients.sel(state="open")
    >>> factor = drcmitsuba.metrics.daylight_factor(C["direct"] + C["interreflected"])
    >>> bool((factor > 0).all())
    True
    """
    if not isinstance(coefficients, xr.DataArray):
        got = type(coefficients).__name__
        raise InputError("coefficients", "type", got, "give an xarray DataArray")
    if set(coefficients.dims) != {"sensor", "bin"}:
        got = ", ".join(map(str, coefficients.dims)) or "none"
        remedy = "give C of one state: direct + interreflected"
        raise InputError("coefficients", "dims", got, remedy)
    labels = [str(label) for label in coefficients["bin"].values]
    count = 1 + sum(label.startswith("sky_") for label in labels)
    fits = [mf for mf in range(1, LARGEST + 1) if len(Patches(mf)) == count]
    try:
        sky = overcast_luminances(fits[0], ground_reflectance, kind)
        at = positions(sky["bin"].values, labels)
    except (IndexError, UnknownLabelsError):
        got = f"{count - 1} patches of a sky"
        remedy = "give the ground and all patches of a Reinhart sky"
        raise InputError("coefficients", "bin", got, remedy) from None
    C = coefficients.transpose("sensor", "bin").values[:, at]
    if not np.isfinite(C).all():
        raise InputError("coefficients", "values", "NaN or infinite", "compute C of this state")
    return by_sensor(coefficients, 100.0 * (C @ sky.values), "DF", "daylight factor")
