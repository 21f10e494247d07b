"""Balances of a BSDF: energy for light from either side, and reciprocity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from drcmitsuba_plugins.bsdf_file import BsdfFile, Component, Swapped
from drcmitsuba_plugins.colour import refined
from drcmitsuba_plugins.energy import EXCESS
from drcmitsuba_plugins.klems_basis import KlemsMatrix
from drcmitsuba_plugins.tensor import TensorTree, to_direction, unpack

ROUNDING = 1e-3
"""Excess of T + R over 1 that the rounding of a file's digits explains."""
PAIRS = {"transmission": ("tb", "tf"), "rb": ("rb", "rb"), "rf": ("rf", "rf")}
"""Components that are each other's reverse, by name."""
SIDES = {"outside": ("tb", "rb", -1.0), "room": ("tf", "rf", 1.0)}


@dataclass(frozen=True)
class Energy:
    """Energy of the light from one side."""

    side: str
    """'outside' or 'room'."""
    transmittance: float
    reflectance: float
    """T and R of diffuse light."""
    largest: float
    """Largest T + R over all incidences of the file."""
    theta: float
    phi: float
    """Direction of the incidence with the largest T + R [deg]; θ from that side's normal, φ from
    the right, up at 90°."""

    @property
    def verdict(self) -> str:
        """'ok', 'scaled' (at most 5 % too large, the plugins scale it down) or 'refused'."""
        if self.largest <= 1 + ROUNDING:
            return "ok"
        return "scaled" if self.largest <= 1 + EXCESS else "refused"


def incidences(component: Component, side: float) -> tuple[np.ndarray, np.ndarray]:
    """Centres of a component's incident cells, and their weights in diffuse light.

    Centres are unit vectors (cell, 3) away from the surface, on the side ±1; weights (cell,) are
    shares of the light of a uniform hemisphere, their sum is 1.
    """
    if isinstance(component, KlemsMatrix):
        basis = component.incident
        directions = basis.centres * [-1, -1, side]
        return directions, basis.projected_solid_angle / np.pi
    tree = component.tree if isinstance(component, Swapped) else component
    n = 1 << tree.depth
    if tree.rank == 4:
        s, t = unpack(np.arange(n * n), 2, tree.depth)
        flat = to_direction((s + 0.5) / n, (t + 0.5) / n)
        return flat * [-1, -1, side], np.full(n * n, 1 / n**2)
    rings = max(n // 2, 1)
    r = 1 - (np.arange(rings) + 0.5) / rings  # s0 from ½ at the normal to 0 at grazing
    directions = np.stack([r * 0, r, side * np.sqrt(1 - r * r)], axis=-1)
    return directions, 2 * r / rings


def energy(file: BsdfFile, side: str) -> Energy:
    """Energy of the light from one side; a missing component counts as 0."""
    transmission, reflection, z = SIDES[side]
    present = [c for c in map(file.component, (transmission, reflection)) if c is not None]
    if not present:
        return Energy(side, 0.0, 0.0, 0.0, 0.0, 0.0)
    finest = max((incidences(c, z) for c in present), key=lambda pair: len(pair[0]))
    directions, weight = finest
    T, R = file.hemispherical(directions)
    worst = int((T + R).argmax())
    x, y, along = directions[worst]
    return Energy(
        side,
        float(weight @ T),
        float(weight @ R),
        float((T + R)[worst]),
        float(np.degrees(np.arccos(min(abs(along), 1.0)))),
        float(np.degrees(np.arctan2(y, x)) % 360),
    )


def reciprocity(file: BsdfFile) -> dict[str, float | None]:
    """Relative errors of reciprocity, of "transmission", "rb" and "rf"; None if one is missing."""
    c = file.components
    return {
        key: _asymmetry(c[a], c[b]) if a in c and b in c else None for key, (a, b) in PAIRS.items()
    }


def one_way(file: BsdfFile) -> dict[str, float]:
    """Relative errors of reciprocity beyond the noise of single cells, of what the file holds.

    Sums over the other direction average that noise: with T(i) what leaves for light from i, and
    T'(i) what leaves along i for even light,

    .. math:: ∫ |T - T'| / ½ ∫ (T + T').

    Returns
    -------
    dict of str to float
        By "transmission", "rb" and "rf" [–].
    """
    c = file.components
    return {key: _one_way(c[a], c[b]) for key, (a, b) in PAIRS.items() if a in c and b in c}


def _one_way(one: TensorTree | KlemsMatrix, other: TensorTree | KlemsMatrix) -> float:
    if isinstance(one, KlemsMatrix):
        solid_angle, weight = one.outgoing.projected_solid_angle, one.incident
        a, b = (solid_angle @ m.value for m in (one, other.reversed()))
        share = weight.projected_solid_angle
    elif one.rank == 4:
        # Cells in Morton order: those of a finer tree stand together.
        a, b = one.albedos(), other.reversed().albedos()
        count = min(len(a), len(b))
        a, b = (x.reshape(count, -1).mean(axis=1) for x in (a, b))
        share = np.ones(count)
    else:
        a, b = (x.mean(axis=1) for x in _sampled(one, other)[:2])
        share = np.ones(len(a))
    total = float(share @ (a + b)) / 2
    return float(share @ np.abs(a - b)) / total if total > 0 else 0.0


def _asymmetry(one: TensorTree | KlemsMatrix, other: TensorTree | KlemsMatrix) -> float:
    """∫|f − f'| / ½∫(f + f') with f' the other component at exchanged directions."""
    if isinstance(one, KlemsMatrix):
        a, b = one.value, other.reversed().value
        weight = np.outer(one.outgoing.projected_solid_angle, one.incident.projected_solid_angle)
    elif one.rank == 4:
        x, y = refined([one, other.reversed()])
        a, b, weight = x.value, y.value, 16.0**-x.level
    else:
        a, b, weight = _sampled(one, other)
    total = ((a + b) * weight).sum() / 2
    return float((np.abs(a - b) * weight).sum() / total) if total > 0 else 0.0


def _sampled(one: TensorTree, other: TensorTree) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values of two trees of rank 3 at pairs of directions of equal projected solid angle."""
    r = np.sqrt((np.arange(16) + 0.5) / 16)
    turn = np.arange(16) * 2.4  # azimuths are arbitrary for an isotropic material
    z = np.sqrt(1 - r * r)
    incident = np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=-1)[:, None]
    u = (np.arange(64) + 0.5) / 64
    outgoing = to_direction(*(g.ravel() for g in np.meshgrid(u, u)))[None]
    incident, outgoing = np.broadcast_arrays(incident, outgoing)
    # An isotropic material is its own mirror image. Files often put a peak on the border of two
    # cells into one of them, and only the mirror image of the reverse has it in the same cell.
    mirror = np.array([-1, 1, 1])
    a, b = one.values(incident, outgoing), other.values(outgoing * mirror, incident * mirror)
    return a, b, np.ones(a.shape)
