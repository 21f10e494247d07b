"""Check of a BSDF file: energy, reciprocity, lobes of the sun's light, and a fit model.

Directions are as in `drcmitsuba_plugins.bsdf_file`: away from the surface, +z into the room, +y up.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from drcmitsuba_plugins.bsdf_file import BsdfFile
from drcmitsuba_plugins.klems_basis import KlemsMatrix

from drcmitsuba.bsdf import advice, balance, lobes
from drcmitsuba.bsdf.balance import SIDES
from drcmitsuba.bsdf.check_report import CheckReport, Curve, Sunlight, Width
from drcmitsuba.bsdf.reader import read

THETAS = tuple(map(float, range(0, 90, 5)))
"""Incidences of the curves [deg]; a Klems matrix has the centres of its rings instead."""
PLANES = {"above": 90.0, "below": 270.0, "right": 0.0, "left": 180.0}
"""Azimuth [deg] of the light's origin; right and left as seen from the room."""
ELEVATIONS = tuple(range(10, 90, 10))
"""Elevations [deg] of the suns in `CheckReport.sunlight`."""
PEAK_ELEVATIONS: tuple[float, ...] = (15.0, 30.0, 45.0, 60.0)
"""Elevations [deg] of the suns in `CheckReport.widths`; for Klems those of the nearest rings."""
REDIRECTED = tuple(range(25, 65, 5))
"""Elevations [deg] of the suns whose light a redirecting film is to send up."""


def check(file: BsdfFile | str | Path) -> CheckReport:
    """Check a BSDF file and choose a model for it.

    Parameters
    ----------
    file : BsdfFile, str or Path
        Content from `bsdf.read`, or the file's path.

    Returns
    -------
    CheckReport
        `curves`: T and R over θ = 0 … 85° (Klems: the centres of the rings) from four azimuths,
        both sides. `energy`: diffuse T and R, largest T + R. `reciprocity`: ∫|f(i, o) − f(o, i)|
        over the mean of both integrals, for 'transmission', 'rb', 'rf'; None where a direction is
        missing. `sunlight`, `widths`: where the sun's light goes. `mounting`: share of the light of
        suns 25–60° high that goes up, for the four ways to mount the film. `model`: 'klems',
        'tensor_tree', 'any', 'geometry', 'none'.

    Raises
    ------
    InputError
        The path leads to no BSDF file, or its numbers are wrong.

    Notes
    -----
    Lobes have 256² directions. On a border of the file's cells `widths` are those of one cell, all
    other numbers are means over the cells that meet there. Reciprocity is exact for trees of rank 4
    and for Klems; rank 3 is sampled at 16 × 64² pairs of directions. The façade is vertical. All
    values are for luminance.

    Examples
    --------
    >>> import drcmitsuba
    >>> report = drcmitsuba.bsdf.check.check("film.xml")
    >>> type(report).__name__
    'CheckReport'
    """
    if not isinstance(file, BsdfFile):
        file = read(file)
    energy = tuple(balance.energy(file, side) for side in SIDES)
    sunlight = _sunlight(file)
    widths = _widths(file) if any(s.transmittance > 1e-3 for s in sunlight) else ()
    component = file.component("tb")
    straight = lobes.straight_through(component) if component is not None else None
    lambertian = {name: c.lambertian() for name, c in file.components.items()}
    mounting = _mounting(file)
    model, reasons = advice.model(file.kind, widths, straight, lambertian, energy)
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


def _rings(file: BsdfFile) -> np.ndarray:
    """Angles from the normal [deg] of Klems rings' centres, (ring,); empty for other files."""
    matrices = [c for c in file.components.values() if isinstance(c, KlemsMatrix)]
    if not matrices:
        return np.zeros(0)
    basis = matrices[0].incident
    return np.round(np.degrees(np.arccos(basis.centres[basis.first, 2])), 6)


def _curves(file: BsdfFile) -> tuple[Curve, ...]:
    """T and R over incidence, for light from both sides."""
    planes = {"any": 90.0} if file.kind == "TensorTree3" else PLANES
    thetas = tuple(_rings(file).tolist()) or THETAS
    curves = []
    for side, (_, _, z) in SIDES.items():
        for plane, phi in planes.items():
            near = lobes.around(lobes.directions(np.array(thetas), phi) * [1, 1, z]).reshape(-1, 3)
            T, R = (v.reshape(-1, 4).mean(axis=1).tolist() for v in file.hemispherical(near))
            curves.append(Curve(side, plane, thetas, tuple(T), tuple(R)))
    return tuple(curves)


def _sunlight(file: BsdfFile) -> tuple[Sunlight, ...]:
    """Transmittance and upward share of the light of suns at `ELEVATIONS`."""
    component = file.component("tb")
    if component is None:
        return ()
    sunlight = []
    for elevation in ELEVATIONS:
        incident = lobes.sun(elevation)
        T = float(component.hemispherical(lobes.cells_at(component, incident)).mean())
        upward = lobes.lobe(component, incident, 1.0).upward()
        sunlight.append(Sunlight(float(elevation), T, upward))
    return tuple(sunlight)


def _widths(file: BsdfFile) -> tuple[Width, ...]:
    """Main peaks of the transmitted light, each for one incident cell."""
    component = file.component("tb")
    assert component is not None
    widths, elevations = [], PEAK_ELEVATIONS
    if len(rings := _rings(file)):  # inside cells and not on borders
        nearest = (float(rings[abs(rings - e).argmin()]) for e in PEAK_ELEVATIONS)
        elevations = tuple(dict.fromkeys(nearest))
    for elevation in elevations:
        light = lobes.lobe(component, lobes.sun(elevation), 1.0, one_cell=True)
        if light.power.sum() == 0:
            continue
        toward = light.brightest()
        widths.append(
            Width(
                elevation,
                float(np.degrees(np.arcsin(np.clip(toward[1], -1, 1)))),
                light.width_at_half_maximum(),
                light.width_of_half_the_light(),
                light.share(light.half_maximum()),
                lobes.resolution(component, light.incident, toward),
            )
        )
    return tuple(widths)


def _mounting(file: BsdfFile) -> dict[str, float]:
    """Share of the light of `REDIRECTED` suns that goes up, for four ways to mount the film."""
    upward = {}
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
            incident = lobes.sun(elevation) * [1, turned, swapped]
            light = lobes.lobe(component, incident, float(swapped), grid=64)
            up = light.outgoing[:, 1] * turned > 0
            parts.append(float(light.power[up].sum()))
        upward[name] = float(np.mean(parts))
    return upward
