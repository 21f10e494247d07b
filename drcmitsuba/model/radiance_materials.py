"""Radiance's materials, in the numbers of its primitives, as materials of the engine.

With r Fresnel's reflectance of a face and d = t^(1/cos θ') the light left after one pass, `glass`
has, for each polarisation, the transmittance τ = (1 − r)² d / (1 − r² d²) and the reflectance
ρ = r (1 + (1 − 2r) d²) / (1 − r² d²). The engine's pane has τ(θ) = τ₀ [1 − (1 − cos θ)ᵖ] and
Schlick's reflectance. τ₀ and ρ₀ are those at normal incidence; p is fitted.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drcmitsuba.model.materials import (
    DiffuserMaterial,
    GlazingMaterial,
    Lambertian,
    MirrorMaterial,
    Reflectance,
    SurfaceMaterial,
)
from drcmitsuba.schema import LUMINANCE_WEIGHTS

Colour = tuple[float, float, float]
Note = Callable[[str], None]
"""Takes in a sentence, without its stop, about what the engine's material simplifies."""
INDEX = 1.52
"""Refractive index of `glass` that states none [–]."""
SMALL = 0.05
"""Largest share of mirrored light that counts as diffuse [–]."""
GREY = 1e-6
"""Largest difference between the channels of a grey [–]."""
INCIDENCE = np.radians(np.arange(90.0))
"""Incidences at which transmittances are fitted [rad]."""
HIGHLIGHTS = (
    f"Mirrored light counts as diffuse where it is at most {100 * SMALL:.0f} % of the light"
)
GREYED = "Mirrors, panes and solids are grey: these have the luminance of their colour"
_EXPONENTS = np.geomspace(0.2, 100, 2001)


def transmissivity(transmittance: float) -> float:
    """Transmissivity [–] of glass of index 1.52 from its transmittance at normal incidence [–]."""
    root = np.sqrt(0.8402528435 + 0.0072522239 * transmittance**2)
    return float((root - 0.9166530661) / 0.0036261119 / transmittance)


def luminance(channels: np.ndarray) -> np.ndarray:
    """Luminance of red, green and blue on the last axis."""
    return np.asarray(channels @ np.array(list(LUMINANCE_WEIGHTS.values())))


def glass(transmissivity: Colour, index: float, note: Note) -> GlazingMaterial:
    """Pane of Radiance's `glass`: transmissivity t [–] of each channel, refractive index [–]."""
    tau, rho = _pane(np.array(transmissivity), index)
    _grey(np.array(transmissivity), note)
    return _fitted(luminance(tau), float(luminance(rho[0])))


def plastic(colour: Colour, specularity: float, roughness: float, note: Note) -> SurfaceMaterial:
    """Surface of reflectance C with a white highlight s: C (1 − s) diffuse and s mirrored [–]."""
    mirrored = np.full(3, specularity)
    return _opaque(np.array(colour) * (1 - specularity), mirrored, specularity, roughness, note)


def metal(colour: Colour, specularity: float, roughness: float, note: Note) -> SurfaceMaterial:
    """Surface of reflectance C with its own highlight: C (1 − s) diffuse and C s mirrored [–]."""
    diffuse, mirrored = np.array(colour) * (1 - specularity), np.array(colour) * specularity
    return _opaque(diffuse, mirrored, specularity, roughness, note)


def trans(
    colour: Colour, specularity: float, transmission: float, straight: float, note: Note
) -> DiffuserMaterial:
    """Diffusing sheet: transmits C (1 − s) t and reflects C (1 − s) (1 − t) + s [–].

    Raises
    ------
    ValueError
        The share `straight` of the transmitted light that is not scattered, or what is mirrored,
        is more than a twentieth of the light.
    """
    rest = np.array(colour) * (1 - specularity)
    through, back = rest * transmission, rest * (1 - transmission) + specularity
    unscattered = float(luminance(through)) * straight
    if max(unscattered, specularity) > SMALL:
        shares = f"{100 * unscattered:.1f} % transmitted and {100 * specularity:.1f} % reflected"
        raise ValueError(f"{shares} without scattering")
    if max(unscattered, specularity) > 0:
        note(HIGHLIGHTS)
    return DiffuserMaterial(
        type="diffuser", transmittance=_grey(through, note), reflectance=_grey(back, note)
    )


def mirror(colour: Colour, note: Note) -> MirrorMaterial:
    """Perfect mirror, which reflects on both sides here."""
    return MirrorMaterial(type="mirror", reflectance=_grey(np.array(colour), note))


def _opaque(
    diffuse: np.ndarray, mirrored: np.ndarray, specularity: float, roughness: float, note: Note
) -> SurfaceMaterial:
    total = diffuse + mirrored
    if specularity <= SMALL:
        if specularity > 0:
            note(HIGHLIGHTS)
        return Lambertian(_reflectance(total))
    rho = _grey(total, note)
    share = float(luminance(mirrored)) / rho if rho > 0 else 1.0
    return MirrorMaterial(
        type="mirror", reflectance=min(rho, 1.0), roughness=roughness, specular=min(share, 1.0)
    )


def _grey(channels: np.ndarray, note: Note) -> float:
    """Luminance of a colour, with a note where it is not grey."""
    if np.ptp(channels) <= GREY:
        return min(float(channels[1]), 1.0)
    note(GREYED)
    return min(float(luminance(channels)), 1.0)


def _reflectance(channels: np.ndarray) -> Reflectance:
    """One number for a grey, else three."""
    red, green, blue = np.minimum(channels, 1.0).tolist()
    return green if np.ptp(channels) <= GREY else (red, green, blue)


def _pane(transmissivity: np.ndarray, index: float) -> tuple[np.ndarray, np.ndarray]:
    """Transmittance and reflectance of `glass` at the incidences, shape (incidence, channel)."""
    c = np.cos(INCIDENCE)[:, None]
    inside = np.sqrt(1 - (1 - c**2) / index**2)
    d = transmissivity ** (1 / inside)
    faces = (
        ((c - index * inside) / (c + index * inside)) ** 2,
        ((inside - index * c) / (inside + index * c)) ** 2,
    )
    through = [(1 - r) ** 2 * d / (1 - (r * d) ** 2) for r in faces]
    back = [r * (1 + (1 - 2 * r) * d**2) / (1 - (r * d) ** 2) for r in faces]
    return (through[0] + through[1]) / 2, (back[0] + back[1]) / 2


def _fitted(transmittance: np.ndarray, reflectance: float) -> GlazingMaterial:
    """Pane whose exponent fits a transmittance best, of those that never send more than arrives."""
    at_normal = float(transmittance[0])
    x = 1 - np.cos(INCIDENCE)
    difference = at_normal * (1 - x ** _EXPONENTS[:, None]) - transmittance
    dense = np.linspace(0, 1, 201)
    mirrored = reflectance + (1 - reflectance) * dense**5 if reflectance > 0 else 0 * dense
    sums = at_normal * (1 - dense ** _EXPONENTS[:, None]) + mirrored
    error = (difference**2 * np.sin(2 * INCIDENCE)).sum(axis=1)
    error[sums.max(axis=1) > 1 + 1e-9] = np.inf
    return GlazingMaterial(
        type="glazing",
        transmittance=at_normal,
        exponent=float(_EXPONENTS[np.argmin(error)]),
        reflectance=reflectance,
    )
