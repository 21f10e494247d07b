"""Energy of measured BSDFs: what sends out more light than it gets is scaled down or refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from drcmitsuba_plugins.bsdf_file import BsdfFile, Swapped

EXCESS = 0.05
"""Energy above 1 that is put down to measurement: more is refused."""


def scaled_to_conserve(file: BsdfFile) -> tuple[BsdfFile, float]:
    """Scale down what sends out more light than it gets, by at most 5 %.

    Returns
    -------
    BsdfFile
        Where T + R of an incidence exceeds 1, all of its leaves scaled to reach just 1.
    float
        Largest T + R that came.

    Raises
    ------
    ValueError
        T + R exceeds 1.05 somewhere.
    """
    components = dict(file.components)
    largest = 0.0
    for side in ("f", "b"):
        names = [f"t{side}", f"r{side}"]
        found = [c for c in map(_listed, map(file.component, names)) if c is not None]
        if not found:
            continue
        total = sum_of_albedos(found)
        largest = max(largest, float(total.max()))
        if total.max() > 1 + EXCESS:
            where = "the room" if side == "f" else "outside"
            raise ValueError(
                f"sends out {100 * total.max():.0f} % of the light from {where} at some incidence; "
                f"above {100 * (1 + EXCESS):.0f} % it is refused: correct the data"
            )
        if total.max() > 1:
            scale = 1 / np.maximum(total, 1)
            components |= {n: _scaled(components[n], scale) for n in names if n in components}
    return replace(file, components=components), largest


def _listed(component):
    """A component whose albedos can be listed.

    A transmission that the file lacks is the other one reversed: it counts as well, though only
    what the file holds can be scaled. An isotropic tree has no list of its reverse's albedos.
    """
    if isinstance(component, Swapped):
        return component.tree.reversed() if component.tree.rank == 4 else None
    return component


def sum_of_albedos(components: list) -> np.ndarray:
    """T + R for every finest incident cell of components of one kind."""
    albedos = [c.albedos() for c in components]
    size = max(map(len, albedos))
    return sum(np.repeat(a, size // len(a)) for a in albedos)


def _scaled(component, scale: np.ndarray):
    """Scale a component by factors for incident cells; a leaf takes the least of its cells."""
    if not hasattr(component, "rank"):
        return replace(component, value=component.value * scale)
    axes = component.rank - 2
    fine = int(np.log2(len(scale))) // axes
    first = component.incident_cells() << axes * (fine - component.depth)
    span = 1 << axes * (fine - component.level)
    factor = np.array(
        [scale[a : a + n].min() for a, n in zip(first.tolist(), span.tolist(), strict=True)]
    )
    return replace(component, value=component.value * factor)
