"""What a designer wants to know of a BSDF file before he relies on it.

Directions are as in `drcmitsuba_plugins.bsdf_file`: away from the surface, +z into the room, +y up.
"""

from __future__ import annotations

import numpy as np
from drcmitsuba_plugins.bsdf_file import BsdfFile

from drcmitsuba.bsdf import advice, balance
from drcmitsuba.bsdf.balance import SIDES
from drcmitsuba.bsdf.check_report import CheckReport, Curve, Sunlight, Width
from drcmitsuba.bsdf.lobes import lobe, resolution, straight_through, sun

THETAS = tuple(range(0, 90, 5))
"""Incidences of the curves [deg]."""
PLANES = {"above": 90.0, "below": 270.0, "right": 0.0, "left": 180.0}
"""Azimuth [deg] of the light's origin; right and left as seen from the room."""
ELEVATIONS = tuple(range(10, 90, 10))
PEAK_ELEVATIONS = (15.0, 30.0, 45.0, 60.0)
REDIRECTED = tuple(range(25, 65, 5))
"""Elevations [deg] of the sun that a redirecting film is meant for."""


def check(file: BsdfFile) -> CheckReport:
    """Check a BSDF file and say what it is good for.

    Parameters
    ----------
    file : BsdfFile

    Returns
    -------
    CheckReport
        `curves`: T and R over θ = 0 … 85° from four azimuths, both sides. `energy`: diffuse T and
        R, largest T + R. `reciprocity`: ∫|f(i, o) − f(o, i)| over the mean of both integrals, for
        'transmission', 'rb', 'rf'; None where a direction is missing. `sunlight`, `widths`: where
        the sun's light goes. `mounting`: part of the light of suns 25–60° high that goes up, for
        the four ways to mount the film. `model`: 'klems', 'tensor_tree', 'any', 'geometry', 'none'.

    Notes
    -----
    Lobes are taken at 256² directions. Reciprocity is exact for trees of rank 4 and Klems, by
    16 × 64² pairs of directions for rank 3. A vertical façade is assumed. All is for luminance.
    """
    energy = tuple(balance.energy(file, side) for side in SIDES)
    sunlight = _sunlight(file)
    widths = _widths(file) if any(s.transmittance > 1e-3 for s in sunlight) else ()
    component = file.component("tb")
    straight = straight_through(component) if component is not None else None
    lambertian = {name: c.lambertian() for name, c in file.components.items()}
    mounting = _mounting(file)
    refused = any(e.verdict == "refused" for e in energy)
    model, reasons = advice.model(file.kind, widths, straight, lambertian, energy, refused)
    return CheckReport(
        source=file.source,
        name=file.name,
        manufacturer=file.manufacturer,
        kind=file.kind,
        leaves={n: c.value.size for n, c in file.components.items()},
        curves=_curves(file),
        energy=energy,
        reciprocity=balance.reciprocity(file),
        sunlight=sunlight,
        widths=widths,
        straight=straight,
        lambertian=lambertian,
        mounting=mounting,
        hint=advice.mounting(mounting),
        model=model,
        reasons=reasons,
        notes=(*file.notes, *advice.gaps(file)),
    )


def _from(theta: np.ndarray, phi: float | np.ndarray, side: float) -> np.ndarray:
    """Directions at angles [deg] from the normal of a side."""
    t, p = np.broadcast_arrays(np.radians(theta), np.radians(phi))
    return np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), side * np.cos(t)], axis=-1)


def _curves(file: BsdfFile) -> tuple[Curve, ...]:
    planes = {"any": 90.0} if file.kind == "TensorTree3" else PLANES
    found = []
    for side, (_, _, z) in SIDES.items():
        for plane, phi in planes.items():
            T, R = file.hemispherical(_from(np.array(THETAS, float), phi, z))
            found.append(Curve(side, plane, THETAS, tuple(T.tolist()), tuple(R.tolist())))
    return tuple(found)


def _sunlight(file: BsdfFile) -> tuple[Sunlight, ...]:
    component = file.component("tb")
    if component is None:
        return ()
    found = []
    for elevation in ELEVATIONS:
        incident = sun(elevation)
        T = float(component.hemispherical(incident[None])[0])
        found.append(Sunlight(float(elevation), T, lobe(component, incident, 1.0).upward()))
    return tuple(found)


def _widths(file: BsdfFile) -> tuple[Width, ...]:
    component = file.component("tb")
    assert component is not None
    found = []
    for elevation in PEAK_ELEVATIONS:
        incident = sun(elevation)
        light = lobe(component, incident, 1.0)
        if light.power.sum() == 0:
            continue
        toward = light.brightest()
        found.append(
            Width(
                elevation,
                float(np.degrees(np.arcsin(np.clip(toward[1], -1, 1)))),
                light.width_at_half_maximum(),
                light.width_of_half_the_light(),
                light.share(light.half_maximum()),
                resolution(component, incident, toward),
            )
        )
    return tuple(found)


def _mounting(file: BsdfFile) -> dict[str, float]:
    """Part of the light of high suns that goes up, for the four ways to mount the film."""
    found = {}
    for name, transmission, turned, swapped in (
        ("as the file says", "tb", 1, 1),
        ("upside down", "tb", -1, 1),
        ("front and back exchanged", "tf", 1, -1),
        ("both", "tf", -1, -1),
    ):
        component = file.component(transmission)
        if component is None:
            continue
        parts = []
        for elevation in REDIRECTED:
            incident = sun(elevation) * [1, turned, swapped]
            light = lobe(component, incident, float(swapped), grid=64)
            up = light.outgoing[:, 1] * turned > 0
            parts.append(float(light.power[up].sum()))
        found[name] = float(np.mean(parts))
    return found
