"""Colour of light as lighting states it: temperature, distance from the locus, rendition."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from drcmitsuba.colour.bands import GRID, TRISTIMULUS, Bands, d65, responses
from drcmitsuba.runtime import lazy

colour = lazy.module("colour")


def temperatures(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Correlated colour temperature [K] and Duv [–] of chromaticities, after Robertson (1968).

    Arrays have any one shape. It is within 2 K of Ohno's from 2000 to 7000 K, and far faster; the
    dark, x = y = 0, has neither (NaN).
    """
    dark = (x <= 0) | (y <= 0)
    xy = np.stack([np.where(dark, 0.3127, x), np.where(dark, 0.3290, y)], axis=-1)
    uv = colour.UCS_to_uv(colour.XYZ_to_UCS(colour.xy_to_XYZ(xy)))
    cct, duv = np.moveaxis(colour.temperature.uv_to_CCT_Robertson1968(uv), -1, 0)
    return np.where(dark, np.nan, cct), np.where(dark, np.nan, duv)


class Appearance(NamedTuple):
    """Colour of light and of things in it."""

    cct: float
    """Correlated colour temperature [K], after Ohno (2013)."""
    duv: float
    """Distance from the Planckian locus in CIE 1960 u, v [–]: above it, towards green, positive."""
    fidelity: float
    """Fidelity index R_f of ANSI/IES TM-30-18 [–]."""
    gamut: float
    """Gamut index R_g of ANSI/IES TM-30-18 [–]."""

    @classmethod
    def of(cls, spectrum: np.ndarray, bands: Bands) -> Appearance:
        """Appearance of light from its amount in every band, per that of D65, shape (band,)."""
        power = (spectrum @ bands.splines) * d65()
        xyz = np.array([responses()[name] @ power for name in TRISTIMULUS])
        cct, duv = colour.temperature.uv_to_CCT_Ohno2013(colour.UCS_to_uv(colour.XYZ_to_UCS(xyz)))
        light = colour.SpectralDistribution(dict(zip(GRID, np.maximum(power, 0), strict=True)))
        index = colour.colour_fidelity_index
        with colour.utilities.suppress_warnings(colour_runtime_warnings=True):  # tables are aligned
            made = index(light, additional_data=True, method="ANSI/IES TM-30-18")
        return cls(float(cct), float(duv), float(made.R_f), float(made.R_g))
