"""Radiance's materials, in the numbers of its primitives, as materials of the engine."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from drcmitsuba_plugins.grazing import more_at_grazing

from drcmitsuba.model import glass as panes
from drcmitsuba.model.materials import (
    BsdfMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Lambertian,
    MirrorMaterial,
    PorousMaterial,
    Reflectance,
    SurfaceMaterial,
)
from drcmitsuba.model.translucent import NARROWEST
from drcmitsuba.model.translucent import pane as translucent_pane
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
HIGHLIGHTS = (
    f"Mirrored light counts as diffuse where it is at most {100 * SMALL:.0f} % of the light"
)
COSINES = np.linspace(0, 1, 513)
"""Cosines of the incidence at which what goes through panes is tabulated."""
SCATTERED = "Light that panes mirror counts as scattered"
REPLACED = "Mirrors reflect alike in every direction, without their alternate material"
BOTH_SIDES = "Mirrors reflect on both sides"
LOST = (0.12, 0.18, 0.24, 0.36, 0.6), (0, 0.001, 0.011, 0.060, 0.167)
"""Share of mirrored light that Beckmann's facets shadow at 45° [–], by roughness."""
LEAST_LOST = 0.5
"""Share from which this has a note [%]."""
LOBES = "Rough surfaces have Beckmann's lobes, next to Radiance's, but"
FRESNEL = 0.018
"""Least mirrored share from which Radiance's smooth surfaces mirror more at grazing incidence [–].

There it is m + (1 − m) F, F = exp(−5.85 cos θ) − exp(−5.85); the rest is diffuse.
"""
GRAZING = (
    f"Smooth surfaces that mirror at most {100 * SMALL:.0f} % do so where they are grey, alike on "
    "both sides, in six planes or fewer and in no group; elsewhere this light counts as diffuse, "
    "which lowers the illuminance in a room of them by 1 %"
)
GREYED = "Mirrors, panes and solids are grey: these have the luminance of their colour"


def luminance(channels: np.ndarray) -> np.ndarray:
    """Luminance of red, green and blue on the last axis; Radiance's own weights differ."""
    return np.asarray(channels @ np.array(list(LUMINANCE_WEIGHTS.values())))


def glass(transmissivity: Colour, index: float, note: Note) -> GlazingMaterial:
    """Pane of Radiance's `glass`: transmissivity t [–] of each channel, refractive index [–]."""
    channels = np.array(transmissivity)
    grey(channels, note)
    tau, _ = panes.pane(channels, index, np.ones(1))
    return GlazingMaterial(type="glazing", transmittance=float(luminance(tau[0])), ior=index)


def plastic(colour: Colour, specularity: float, roughness: float, note: Note) -> SurfaceMaterial:
    """Surface of reflectance C with a white highlight s: C (1 − s) diffuse and s mirrored [–]."""
    mirrored = np.full(3, specularity)
    return _opaque(np.array(colour) * (1 - specularity), mirrored, specularity, roughness, note)


def metal(colour: Colour, specularity: float, roughness: float, note: Note) -> SurfaceMaterial:
    """Surface of reflectance C with its own highlight: C (1 − s) diffuse and C s mirrored [–]."""
    diffuse, mirrored = np.array(colour) * (1 - specularity), np.array(colour) * specularity
    return _opaque(diffuse, mirrored, specularity, roughness, note)


def trans(
    colour: Colour, specularity: float, roughness: float, transmission: float, straight: float,
    note: Note,
) -> BsdfMaterial | DiffuserMaterial | PorousMaterial:  # fmt: skip
    """Diffusing sheet: transmits C (1 − s) t and reflects C (1 − s) (1 − t) + s [–].

    The share `straight` of what it transmits goes straight on, or with a roughness into a lobe
    around that direction. It is porous where all that it transmits goes straight. What it mirrors
    counts as scattered; a smooth one mirrors more, and transmits less, at grazing incidence, by
    `at_grazing`.
    """
    rest = np.array(colour) * (1 - specularity)
    through, back = rest * transmission, rest * (1 - transmission) + specularity
    unscattered = float(luminance(through)) * straight
    if unscattered > SMALL >= specularity and roughness == 0 and straight == 1:
        if specularity > 0:
            note(HIGHLIGHTS)
        gaps = grey(through, note)
        return PorousMaterial(
            type="porous", porosity=gaps, reflectance=reflectance(back / max(1 - gaps, GREY))
        )
    if specularity > SMALL:
        note(f"{SCATTERED}: {100 * specularity:.2g} % of the light")
    elif specularity > 0 or 0 < unscattered <= SMALL:
        note(HIGHLIGHTS)
    transmitted, reflected = grey(through, note), grey(back, note)
    if unscattered <= SMALL:
        return DiffuserMaterial(
            type="diffuser", transmittance=transmitted, reflectance=reflected,
            outer_reflectance=reflected,
        )  # fmt: skip
    if roughness > 0:
        if roughness < NARROWEST:
            note(f"Lobes of a roughness below {NARROWEST:g} rad are as wide as those of it")
        scattered, lobe = (1 - straight) * transmitted, straight * transmitted
        return translucent_pane(scattered, lobe, reflected, roughness)
    pane = DiffuserMaterial(
        type="diffuser", transmittance=(1 - straight) * transmitted, reflectance=reflected,
        outer_reflectance=reflected, straight=straight * transmitted,
    )  # fmt: skip
    return at_grazing(pane) if specularity >= FRESNEL else pane


def at_grazing(pane: DiffuserMaterial) -> DiffuserMaterial:
    """Pane with a smooth surface, from its shares at normal incidence: it mirrors F(θ) more.

    Of what is transmitted, straight or scattered, the share 1 − F(θ) is left. What is mirrored
    counts as scattered, by its mean. Radiance's own pane, with θ' the angle of the eye, scatters
    (1 − F(θ')) of the sky's light, and (1 − F(θ)) (1 − F(θ')) of a sun's.
    """
    more = more_at_grazing(COSINES)
    mean = mean_of(more)
    # Where no light is absorbed, the mean of F and the shares at normal incidence are above 1.
    reflected = min(pane.reflectance * (1 - mean) + mean, 1 - pane.most_through)
    through = {
        name: tuple((np.ravel(share) * (1 - more)).tolist())
        for name, share in (("transmittance", pane.transmittance), ("straight", pane.straight))
    }
    both = dict.fromkeys(("reflectance", "outer_reflectance"), reflected)
    return pane.model_copy(update={**both, **through})


def mean_of(share: np.ndarray) -> float:
    """Mean of a share over the hemisphere, from its values at `COSINES`."""
    return float((share * COSINES).sum() / COSINES.sum())


def mirror(colour: Colour, note: Note) -> MirrorMaterial:
    """Perfect mirror, which reflects on both sides here."""
    return MirrorMaterial(type="mirror", reflectance=grey(np.array(colour), note))


def _opaque(
    diffuse: np.ndarray, mirrored: np.ndarray, specularity: float, roughness: float, note: Note
) -> SurfaceMaterial:
    total = diffuse + mirrored
    polished = roughness == 0 and specularity >= FRESNEL
    if specularity <= SMALL:
        if specularity > 0:
            note(GRAZING if polished else HIGHLIGHTS)
        return Lambertian(reflectance(total), polish=float(luminance(mirrored)) * polished)
    rho = grey(total, note)
    share = float(luminance(mirrored)) / rho if rho > 0 else 1.0
    lobe: dict[str, Any] = {}
    if roughness > 0:
        # Ward's Gaussian of tan δ / α is Beckmann's distribution of facets.
        lobe = {"roughness": roughness, "distribution": "beckmann"}
        lost = 100 * np.interp(roughness, *LOST)
        if lost >= LEAST_LOST:
            note(f"{LOBES} about {lost:.0f} % of what is mirrored at 45° is lost by shadowing")
    return MirrorMaterial(
        type="mirror", reflectance=min(rho, 1.0), specular=min(share, 1.0), polished=polished,
        **lobe,
    )  # fmt: skip


def grey(channels: np.ndarray, note: Note) -> float:
    """Luminance of a colour, with a note where it is not grey."""
    if np.ptp(channels) <= GREY:
        return min(float(channels[1]), 1.0)
    note(greyed(channels))
    return min(float(luminance(channels)), 1.0)


def greyed(channels: np.ndarray) -> str:
    """Sentence on the grey that stands for channels (…, 3), with the largest difference from it."""
    apart = np.abs(channels - luminance(channels)[..., None]).max()
    return f"{GREYED}, up to {np.ceil(10 * apart - 1e-9) / 10:g} off that of a channel"


def reflectance(channels: np.ndarray) -> Reflectance:
    """One number for a grey, else three."""
    red, green, blue = np.minimum(channels, 1.0).tolist()
    return green if np.ptp(channels) <= GREY else (red, green, blue)
