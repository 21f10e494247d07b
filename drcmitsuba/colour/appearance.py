"""Colour of light as lighting states it: temperature, distance from the locus, rendition."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from drcmitsuba.colour.bands import GRID, TRISTIMULUS, Bands, d65, responses
from drcmitsuba.runtime import lazy

colour = lazy.module("colour")

U, V = np.linspace(0.12, 0.36, 481), np.linspace(0.24, 0.42, 361)
"""Coordinates of the table of temperatures [–]."""
FARTHEST, REDDEST, BLUEST = 0.05, 1000.0, 25_000.0
"""Largest Duv [–] and ends of the temperatures [K] of light that has one, and rendition beside
light of it."""


def temperatures(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Correlated colour temperature [K] and Duv [–] of chromaticities, after Robertson (1968).

    Arrays have any one shape. Values are interpolated in a table of CIE 1960 u, v; the dark,
    x = y = 0, and colours far from any white have neither (NaN).
    """
    from scipy.ndimage import map_coordinates

    dark = (x <= 0) | (y <= 0)
    d = np.where(dark, 1.0, -2 * x + 12 * y + 3)
    place = [(4 * x / d - U[0]) / (U[1] - U[0]), (6 * y / d - V[0]) / (V[1] - V[0])]
    mired, duv = (
        map_coordinates(table, place, order=1, cval=np.nan, output=np.float32) for table in _by_uv()
    )
    has = ~dark & has_temperature(1e6 / mired, duv)
    return np.where(has, 1e6 / mired, np.nan), np.where(has, duv, np.nan)


@lru_cache(maxsize=1)
def _by_uv() -> tuple[np.ndarray, np.ndarray]:
    """Reciprocal temperature [1/MK] and Duv [–] on a grid of CIE 1960 u, v."""
    uv = np.stack(np.meshgrid(U, V, indexing="ij"), axis=-1)
    cct, duv = np.moveaxis(colour.temperature.uv_to_CCT_Robertson1968(uv), -1, 0)
    return 1e6 / np.maximum(cct, 1.0), np.asarray(duv)


def has_temperature(cct: Any, duv: Any) -> Any:
    """Whether light of some numbers of both is near enough to a white, bool; NaN is not."""
    return (abs(duv) <= FARTHEST) & (cct >= REDDEST) & (cct <= BLUEST)


class Appearance(NamedTuple):
    """Colour of light and of things in it; None of what light far from any white has not."""

    cct: float | None
    """Correlated colour temperature [K], after Ohno (2013)."""
    duv: float | None
    """Distance from the Planckian locus in CIE 1960 u, v [–]: above it, towards green, positive."""
    fidelity: float | None
    """Fidelity index R_f of ANSI/IES TM-30-18 [–]."""
    gamut: float | None
    """Gamut index R_g of ANSI/IES TM-30-18 [–]."""

    @classmethod
    def of(cls, spectrum: np.ndarray, bands: Bands) -> Appearance:
        """Appearance of light from its amount in every band, per that of D65, shape (band,)."""
        power = (spectrum @ bands.splines) * d65()
        xyz = np.array([responses()[name] @ power for name in TRISTIMULUS])
        light = colour.SpectralDistribution(dict(zip(GRID, np.maximum(power, 0), strict=True)))
        index = colour.colour_fidelity_index
        uv = colour.UCS_to_uv(colour.XYZ_to_UCS(xyz))
        # Tables are aligned, and light may be far from any white.
        with colour.utilities.suppress_warnings(
            colour_runtime_warnings=True, colour_usage_warnings=True, python_warnings=True
        ):
            cct, duv = colour.temperature.uv_to_CCT_Ohno2013(uv)
            made = index(light, additional_data=True, method="ANSI/IES TM-30-18")
        near = has_temperature(cct, duv)
        every = (cct, duv, made.R_f, made.R_g)
        return cls(*(float(v) if near and np.isfinite(v) else None for v in every))
