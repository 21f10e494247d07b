"""Panes of glass by Fresnel's formulas.

With r Fresnel's reflectance of a face for one polarisation and d the light left after one pass,
d = t^(1/cos θ'), a pane of transmissivity t has the transmittance τ = (1 − r)² d / (1 − r² d²) and
the reflectance ρ = r (1 + (1 − 2r) d²) / (1 − r² d²), averaged over both polarisations. Radiance's
`glass` is the same pane.
"""

from __future__ import annotations

import numpy as np


def transmissivity(transmittance: float, ior: float) -> float:
    """Share t of light left after one pass at normal incidence [–], from the transmittance [–]."""
    r = ((ior - 1) / (ior + 1)) ** 2
    root = np.sqrt((1 - r) ** 4 + 4 * (r * transmittance) ** 2)
    return float(2 * transmittance / (root + (1 - r) ** 2))  # no difference of nearly equal numbers


def most(ior: float) -> float:
    """Transmittance at normal incidence of a pane that absorbs nothing [–]."""
    r = ((ior - 1) / (ior + 1)) ** 2
    return float((1 - r) ** 2 / (1 - r**2))


def pane(
    transmissivity: np.ndarray, ior: float, cosine: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Transmittance and reflectance of a pane, mean of both polarisations.

    Parameters
    ----------
    transmissivity : np.ndarray, shape (channel,)
        Share of light left after one pass at normal incidence [–].
    ior : float
        Refractive index [–].
    cosine : np.ndarray, shape (angle,)
        Cosine of the incidence, from 0.

    Returns
    -------
    transmittance, reflectance : np.ndarray, shape (angle, channel)
    """
    c = np.maximum(np.asarray(cosine, float), 1e-9)[:, None]
    inside = np.sqrt(1 - (1 - c**2) / ior**2)
    d = np.asarray(transmissivity, float) ** (1 / inside)
    faces = (
        ((c - ior * inside) / (c + ior * inside)) ** 2,
        ((inside - ior * c) / (inside + ior * c)) ** 2,
    )
    through = [(1 - r) ** 2 * d / (1 - (r * d) ** 2) for r in faces]
    back = [r * (1 + (1 - 2 * r) * d**2) / (1 - (r * d) ** 2) for r in faces]
    return (through[0] + through[1]) / 2, (back[0] + back[1]) / 2
