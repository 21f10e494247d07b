"""Sky and suns as light sources of Radiance.

`rcontrib` drops contributions whose ray coefficient falls below 1e-6, which a sun of unit radiance
seen by way of a dark floor does: it so loses a fifth of the interreflected light of a sun at 15°.
Contributions (`-V+`) of a bright sun stay above that; coefficients (`-V-`) do not, however bright
the sun is.
"""

from __future__ import annotations

from drcmitsuba.export.primitives import identifier
from drcmitsuba.sky.sun_models import Suns

SKY = "void glow skyglow 0 0 4 1 1 1 0\nskyglow source sky 0 0 4 0 0 1 360\n"
"""Sky and ground of unit radiance: one source, which `reinhart.cal` divides into bins."""
SUN_RADIANCE = 1e6
"""Radiance of every sun."""


def sun_modifiers(suns: Suns) -> list[str]:
    """Modifiers of suns: their labels in the characters of an identifier."""
    return [identifier(label) for label in suns.labels]


def sun_text(suns: Suns) -> str:
    """Suns of radiance SUN_RADIANCE, each with a modifier of its own."""
    rgb = " ".join(3 * [f"{SUN_RADIANCE:g}"])
    return "".join(
        f"void light {name} 0 0 3 {rgb}\n"
        f"{name} source {name}.disk 0 0 4 {x:.9g} {y:.9g} {z:.9g} {suns.diameter:.9g}\n"
        for name, (x, y, z) in zip(sun_modifiers(suns), suns.directions, strict=True)
    )
