"""Energy of measured BSDFs: values with T + R above 1 are scaled down or refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from drcmitsuba_plugins.bsdf_file import BsdfFile, Swapped

EXCESS = 0.05
"""Largest T + R − 1 that counts as measurement error; a file with more is refused."""


def scaled_to_conserve(file: BsdfFile) -> tuple[BsdfFile, float]:
    """Scale down the leaves of incidences where T + R exceeds 1, by at most 5 %.

    Returns
    -------
    BsdfFile
        The file with T + R ≤ 1 at every incidence.
    float
        Largest T + R of the given file.

    Raises
    ------
    ValueError
        T + R exceeds 1.05 somewhere.
    """
    components = dict(file.components)
    largest = 0.0
    for side in ("f", "b"):
        of_side = {n: file.component(n) for n in (f"t{side}", f"r{side}")}
        # A missing transmission is the reverse of the other one, and counts as well.
        of_side = {n: _listed(c) for n, c in of_side.items() if c is not None}
        if not of_side:
            continue
        total = sum_of_albedos(list(of_side.values()))
        largest = max(largest, float(total.max()))
        if total.max() > 1 + EXCESS:
            where = "the room" if side == "f" else "outside"
            raise ValueError(
                f"sends out {100 * total.max():.0f} % of the light from {where} at some incidence; "
                f"above {100 * (1 + EXCESS):.0f} % it is refused: correct the data"
            )
        if total.max() > 1:
            scale = 1 / np.maximum(total, 1)
            if any(isinstance(c, _Ring) for c in of_side.values()):
                # A reversed tree has no leaves to scale: the whole file takes the factor.
                of_side, scale = file.components, np.full(1, scale.min())
            components |= {n: _scaled(components.get(n, c), scale) for n, c in of_side.items()}
    return replace(file, components=components), largest


def _listed(component):
    """Component whose method `albedos` lists one value per incident cell."""
    if not isinstance(component, Swapped):
        return component
    if component.tree.rank == 4:
        return component.tree.reversed()
    return _Ring(component)


class _Ring:
    """Albedos of a reversed isotropic tree, one per ring of equal width of the incident radius."""

    def __init__(self, component: Swapped):
        self.component = component

    def albedos(self) -> np.ndarray:
        n = max(2, 1 << self.component.tree.depth)
        r = np.maximum(1 - 2 * (np.arange(n) + 0.5) / n, 0)
        along = np.stack([-r, 0 * r, np.sqrt(1 - r * r)], axis=-1)
        return np.where(r > 0, self.component.hemispherical(along), 0)


def sum_of_albedos(components: list) -> np.ndarray:
    """T + R of the components of one side, shape (finest incident cell,)."""
    albedos = [c.albedos() for c in components]
    size = max(map(len, albedos))
    return np.sum([np.repeat(a, size // len(a)) for a in albedos], axis=0)


def _scaled(component, scale: np.ndarray):
    """Component times one factor per incident cell; a leaf takes the least factor of its cells."""
    if len(scale) == 1 or not hasattr(component, "rank"):
        return replace(component, value=component.value * scale)
    axes = component.rank - 2
    fine = int(np.log2(len(scale))) // axes
    first = component.incident_cells() << axes * (fine - component.depth)
    span = 1 << axes * (fine - component.level)
    borders = np.stack([first, first + span], axis=-1).ravel()
    factor = np.minimum.reduceat(np.append(scale, 1.0), borders)[::2]
    return replace(component, value=component.value * factor)
