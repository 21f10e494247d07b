"""Lobes of a BSDF component: the light from one direction, and the width of its peak.

Directions point away from the surface, +z into the room, +y up, +x to the right as seen from the
room. Outgoing directions are the centres of a grid over the square of Shirley and Chiu, each of
the same projected solid angle, so that sums over the grid are sums of light.

A file holds one value for each cell. Many directions of interest lie on a border of cells: the
plane normal to the façade in every tree, 15° and 45° from the normal in a Klems matrix. Values on a
border are means over the cells on both sides, so that no side is favoured.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from drcmitsuba_plugins import peak
from drcmitsuba_plugins.bsdf_file import Component, Swapped
from drcmitsuba_plugins.klems_basis import KlemsMatrix
from drcmitsuba_plugins.tensor import TensorTree, to_direction, to_square

GRID = 256
"""Number of directions of a lobe along either axis, as fine as the finest tree."""
ASIDE = 1e-6
"""Sine of the angle by which directions are moved off the borders of cells."""


def sun(elevation: float, azimuth: float = 0.0) -> np.ndarray:
    """Unit vector (3,) from the pane to the sun outside a vertical façade.

    `elevation` is the angle above the horizon [deg], `azimuth` that from the façade's normal,
    clockwise as seen from above [deg]: to the right as seen from the room.
    """
    e, a = np.radians(elevation), np.radians(azimuth)
    return np.array([np.cos(e) * np.sin(a), np.sin(e), -np.cos(e) * np.cos(a)])


def directions(theta: np.ndarray, phi: float | np.ndarray) -> np.ndarray:
    """Unit vectors (…, 3) at angles [deg] from +z and +x."""
    t, p = np.radians(theta), np.radians(phi)
    return np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)


def cone_width(solid_angle: float | np.ndarray) -> np.ndarray:
    """Full opening angle [deg] of the cone with a solid angle [sr]."""
    return np.degrees(2 * np.arccos(np.clip(1 - np.asarray(solid_angle) / (2 * np.pi), -1, 1)))


@dataclass(frozen=True)
class Lobe:
    """Transmitted or reflected light from one direction."""

    incident: np.ndarray
    """Direction to the source of the light, shape (3,)."""
    outgoing: np.ndarray
    """Directions in which the light leaves, shape (grid², 3)."""
    value: np.ndarray
    """f [1/sr], shape (grid²,)."""

    @cached_property
    def power(self) -> np.ndarray:
        """Share of the incident light that goes to every direction of the grid."""
        return self.value * np.pi / len(self.value)

    @cached_property
    def solid_angle(self) -> np.ndarray:
        """Solid angle [sr] of every direction of the grid: dω = dω⊥ / cos θ."""
        return np.pi / len(self.value) / np.abs(self.outgoing[:, 2])

    def share(self, where: np.ndarray) -> float:
        """Share of the outgoing light in the directions `where`; 0 without light."""
        total = self.power.sum()
        return float(self.power[where].sum() / total) if total > 0 else 0.0

    def upward(self) -> float:
        """Share of the outgoing light that goes up."""
        return self.share(self.outgoing[:, 1] > 0)

    @cached_property
    def _steep(self) -> np.ndarray:
        """BSDF without the last 5° before grazing, where measurements are mostly noise."""
        return np.where(np.abs(self.outgoing[:, 2]) > np.cos(np.radians(85)), self.value, 0)

    def brightest(self) -> np.ndarray:
        """Direction (3,) of the largest f; the middle of neighbouring directions with equal f."""
        best = self.outgoing[self._steep >= self._steep.max() * (1 - 1e-9)]
        middle = best[best @ best[0] > np.cos(np.radians(20))].mean(axis=0)
        return middle / np.linalg.norm(middle)

    def half_maximum(self) -> np.ndarray:
        """Whether each direction has at least half of the largest f, shape (grid²,)."""
        return self._steep >= max(self._steep.max() / 2, np.finfo(float).tiny)

    def width_at_half_maximum(self) -> float:
        """Full opening [deg] of a cone with the solid angle of f above half of its maximum."""
        return float(cone_width(self.solid_angle[self.half_maximum()].sum()))

    def width_of_half_the_light(self) -> float:
        """Full opening [deg] of a cone as large as the brightest directions with half the light.

        A Lambertian surface gives 90°.
        """
        intensity = self.value * np.abs(self.outgoing[:, 2])
        order = np.argsort(-intensity, kind="stable")
        running = np.cumsum(self.power[order])
        count = int(np.searchsorted(running, running[-1] / 2)) + 1
        return float(cone_width(self.solid_angle[order[:count]].sum()))


def around(directions: np.ndarray) -> np.ndarray:
    """Four directions beside each direction (…, 3), one in each cell that meets there, (…, 4, 3).

    Where no border is near, all four lie in one cell.
    """
    steps = ASIDE * np.array([[-1, -1, 0], [-1, 1, 0], [1, -1, 0], [1, 1, 0]])
    moved = directions[..., None, :] + steps
    return moved / np.linalg.norm(moved, axis=-1, keepdims=True)


def cells_at(component: Component, incident: np.ndarray) -> np.ndarray:
    """Directions (cell, 3), one for each incident cell that meets at a direction (3,).

    There is one direction within a cell, two or four on a border.
    """
    near = around(incident)
    if isinstance(component, KlemsMatrix):
        cells = component.incident.patch(-near[:, 0], -near[:, 1], near[:, 2])
    else:
        n = 1 << (component.tree if isinstance(component, Swapped) else component).depth
        s, t = (np.floor(n * c) for c in to_square(near[:, 0], near[:, 1]))
        cells = s * n + t
    return near[np.sort(np.unique(cells, return_index=True)[1])]


def lobe(
    component: Component, incident: np.ndarray, side: float, grid: int = GRID, *,
    one_cell: bool = False,
) -> Lobe:  # fmt: skip
    """Light from a direction (3,) that a component sends to the side +z or −z (1 or −1).

    The outgoing square has `grid` directions along either axis. At a border of cells f is the mean
    over those that meet there or, with `one_cell`, that of the first: a mean would widen the lobe.
    """
    u = (np.arange(grid) + 0.5) / grid
    outgoing = to_direction(*(a.ravel() for a in np.meshgrid(u, u, indexing="ij")), side=side)
    cells = cells_at(component, incident)[: 1 if one_cell else None]
    values = [component.values(np.broadcast_to(d, outgoing.shape), outgoing) for d in cells]
    return Lobe(cells[0] if one_cell else incident, outgoing, np.mean(values, axis=0))


def resolution(component: Component, incident: np.ndarray, outgoing: np.ndarray) -> float:
    """Full opening [deg] of a cone as large as the outgoing cell at a pair of directions."""
    if isinstance(component, Swapped):
        # The light leaves within the tree's incident cell.
        tree = component.tree
        level = tree.level[tree.at(outgoing, incident)]
        projected = np.pi / 4.0**level
    elif isinstance(component, TensorTree):
        projected = np.pi / 4.0 ** component.level[component.at(incident, outgoing)]
    else:
        basis = component.outgoing
        projected = basis.projected_solid_angle[basis.patch(*outgoing)]
    return float(cone_width(projected / max(abs(float(outgoing[2])), 0.05)))


@dataclass(frozen=True)
class StraightThrough:
    """View through a pane."""

    stands_out: bool
    """Whether the straight-through cells stand out enough to be simulated as a view through."""
    share: float
    """Share of the transmitted light that goes straight through, all incidences together."""
    normal: float
    """Transmittance of the undeviated ray at normal incidence."""
    ratio: float | None
    """Straight-through f over that of its neighbours at normal incidence; None if they are 0."""


def straight_through(component: Component) -> StraightThrough:
    """Measure the peak of undeviated light, as the plugins do."""
    if isinstance(component, Swapped):
        component = component.tree  # its peak is the same from the other side
    split = peak.split(component)
    incident = np.array([[0.0, 0.0, 1.0]])
    before, after = (c.values(incident, -incident)[0] for c in (component, split.rest))
    if isinstance(component, KlemsMatrix):
        cell = component.incident.patch(*-incident[0])
    else:
        cell = -1 if component.rank == 4 else len(split.through) // 2 - 1
        if component.rank == 4 and component.depth:
            # Four cells meet on the axis; this one has both coordinates from ½ on.
            cell = 3 << 2 * (component.depth - 1)
    return StraightThrough(
        stands_out=bool(split.stands_out),
        share=float(split.share),
        normal=float(split.through[cell]),
        ratio=float(before / after) if after > 0 else None,
    )
