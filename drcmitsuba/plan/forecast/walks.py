"""Paths and photons as a scout follows them: how far they go."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from drcmitsuba.case.materials import GlazingMaterial, MirrorMaterial
from drcmitsuba.plan.forecast.scout import Hit, Scout, cosine
from drcmitsuba.scene.materials import Lambertian, is_diffuse
from drcmitsuba.transport.gather import MOST_SURVIVAL, ROULETTE_DEPTH

PATHS = 1024
"""Paths of the gather that are tried."""
OFFSET = 1e-4
"""Of rays from a surface, for each metre of coordinates [m]."""
MOST_STEPS = 512
"""Surfaces that a path is followed over at most."""


class Walked(NamedTuple):
    """Paths of the gather.

    Parameters
    ----------
    flights, vertices : float
        Of a path in the mean: flights from surface to surface, and diffuse vertices.
    p, n : np.ndarray, shape (vertex, 3)
        Vertices of all paths, and normals that face where they came from.
    """

    flights: float
    vertices: float
    p: np.ndarray
    n: np.ndarray


def gathered(
    scout: Scout, points: np.ndarray, normals: np.ndarray, *,
    depth: int | None, beyond: bool, rng: np.random.Generator,
) -> Walked:  # fmt: skip
    """Follow paths of the gather as `transport.gather` does.

    Parameters
    ----------
    scout : Scout
    points, normals : np.ndarray, shape (sensor, 3)
    depth : int or None
        Surfaces at most.
    beyond : bool
        What leaves through a pane may come back.
    rng : np.random.Generator

    Notes
    -----
    Of paths that are longer than `MOST_STEPS` the rest is told by how many ended of late.
    """
    if depth == 0 or not len(points):
        return Walked(0.0, 0.0, np.zeros((0, 3)), np.zeros((0, 3)))
    at = rng.integers(len(points), size=PATHS)
    p, d = points[at], cosine(normals[at], rng)
    beta, flights, found, left = np.ones(len(p)), 0, [(p[:0], p[:0])], [len(p)]
    can_hold = np.array([isinstance(m, Lambertian | MirrorMaterial) and is_diffuse(m)
                         for m in scout.materials], bool)  # fmt: skip
    for step in range(1, MOST_STEPS):
        flights += len(p)
        hit = scout.meet(p, d)
        met = hit.surface >= 0
        hit, d, beta = Hit(*(a[met] for a in hit)), d[met], beta[met]
        sent = scout.scatter(hit, d, rng)
        beta = beta * sent.weight
        alive = beta > 0
        kept = can_hold[hit.surface] & alive
        side = np.sign((d * hit.n).sum(axis=1, keepdims=True))
        found.append((hit.p[kept], -(side * hit.n)[kept]))
        alive &= beyond | ~sent.through
        if depth is not None and step >= depth:
            break
        if step >= ROULETTE_DEPTH:
            survival = np.clip(np.sqrt(beta), 0.05, MOST_SURVIVAL)
            alive &= rng.random(len(beta)) < survival
            beta = beta / survival
        p, d, beta = _off(hit.p, sent.d)[alive], sent.d[alive], beta[alive]
        left.append(len(p))
        if not len(p):
            break
    more = _rest(left) if depth is None or depth > MOST_STEPS else 0.0
    p, n = (np.concatenate(column) for column in zip(*found, strict=True))
    return Walked((flights + more) / PATHS, (len(p) + more) / PATHS, p, n)


def _rest(left: list[int]) -> float:
    """Flights still to come of paths of which so many are `left` after each surface."""
    if left[-1] == 0:
        return 0.0
    kept = (left[-1] / left[len(left) // 2]) ** (2 / len(left))
    return left[-1] / max(1 - kept, 1 / (10 * len(left)))


def _off(p: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Origins of rays that leave surfaces."""
    return p + OFFSET * (1 + abs(p).max(axis=1, keepdims=True)) * d


def straight_through(scout: Scout, p: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Whether rays get out by clear glass and holes only."""
    free, active = np.zeros(len(p), bool), np.arange(len(p))
    clear = np.array([isinstance(m, GlazingMaterial) for m in scout.materials] or [False])
    for _ in range(16):
        hit = scout.meet(p[active], d[active])
        free[active[hit.surface < 0]] = True
        passes = (hit.surface >= 0) & clear[hit.surface]
        p = p.copy()
        p[active[passes]] = _off(hit.p, d[active])[passes]
        active = active[passes]
        if not len(active):
            break
    return free


def photon_flights(
    scout: Scout, p: np.ndarray, d: np.ndarray, *, name: str, weak: float, limit: int,
    rng: np.random.Generator,
) -> float:  # fmt: skip
    """Mean flights of photons of the component `name`, as `transport.photons` follows them.

    Parameters
    ----------
    scout : Scout
    p, d : np.ndarray, shape (photon, 3)
        Their starts.
    name : str
    weak : float
        Share of its flux below which a photon goes on by chance.
    limit : int
        Surfaces at most.
    rng : np.random.Generator
    """
    if not len(p):
        return 0.0
    count, flights = len(p), 0
    flux, by_straight = np.ones(len(p)), np.ones(len(p), bool)
    takes = np.array([is_diffuse(m) for m in scout.materials] or [False])
    foreign = np.array([component != name for component in scout.components] or [False])
    for _ in range(min(limit, MOST_STEPS)):
        flights += len(p)
        hit = scout.meet(p, d)
        met = hit.surface >= 0
        hit = Hit(*(a[met] for a in hit))
        d, flux, by_straight = d[met], flux[met], by_straight[met]
        sent = scout.scatter(hit, d, rng)
        flux = flux * sent.weight
        alive = (flux > 0) & ~takes[hit.surface]
        alive &= sent.straight | ~by_straight | ~foreign[hit.surface]
        by_straight &= sent.straight
        faint = flux < weak
        alive &= ~faint | (rng.random(len(flux)) * weak < flux)
        flux = np.where(faint, weak, flux)
        p, d, flux = _off(hit.p, sent.d)[alive], sent.d[alive], flux[alive]
        by_straight = by_straight[alive]
        if not len(p):
            break
    return flights / count
