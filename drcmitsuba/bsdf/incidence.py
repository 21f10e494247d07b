"""Interpolation from the measured incidences to those of a tree's cells."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from drcmitsuba_plugins.tensor import to_disk
from matplotlib.tri import Triangulation

from drcmitsuba.bsdf.displacement import passage
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress

SYMMETRIES = ("auto", "none", "bilateral", "quadrilateral")
NORMAL = np.sin(np.radians(1.0))
"""Incidences nearer to the normal than this have no azimuth."""
REACH = 1.5
"""Largest shift of a lobe over that of the incidence; a mirror or a window has the ratio 1."""

Light = tuple[np.ndarray, np.ndarray]
"""Direction cosines of an incidence, shape (2,), and its light in pixels, shape (m, m)."""
Cells = Callable[[np.ndarray], np.ndarray]


def triangles(xy: np.ndarray, source: str) -> np.ndarray:
    """Corner indices (triangle, 3) of Delaunay triangles of points (n, 2), without flat ones."""
    try:
        corners = Triangulation(*xy.T).triangles
    except (RuntimeError, ValueError):  # qhull finds no triangle in points on a line
        corners = np.zeros((0, 3), int)
    corners = corners[areas(xy[corners]) > 1e-9]
    if not len(corners):
        remedy = "measure directions all over the hemisphere"
        raise InputError(source, "directions", "all of them lie in one plane", remedy)
    return corners


def areas(corners: np.ndarray) -> np.ndarray:
    """Areas of triangles (n, 3, 2)."""
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2


def at_one_azimuth(incident: list[np.ndarray]) -> bool:
    """Whether all directions of incidence lie at one azimuth, as for isotropic materials."""
    slanted = np.array([i[:2] for i in incident if np.hypot(*i[:2]) >= NORMAL]).reshape(-1, 2)
    if not len(slanted):
        return True
    phi = np.arctan2(*slanted.T[::-1])
    apart = np.degrees(np.angle(np.exp(1j * (phi - phi[0]))))
    return bool(np.abs(apart).max() <= 0.5)


def mirrored(lights: list[Light], symmetry: str) -> tuple[list[Light], tuple[str, ...]]:
    """Add the mirror images of measured incidences that a symmetry implies, with notes on it."""
    p = np.array([key for key, _ in lights])
    whole = [(p[:, a].max() > NORMAL) and (p[:, a].min() < -NORMAL) for a in (0, 1)]
    words = ("left and right", "top and bottom")
    if symmetry == "none":
        return lights, ()
    if symmetry == "auto" or symmetry == "quadrilateral":
        axes = [a for a in (0, 1) if not whole[a] or symmetry == "quadrilateral"]
    else:
        axes = [0 if not whole[0] else 1]
    for axis in axes:
        sign = np.where(np.arange(2) == axis, -1.0, 1.0)
        lights = lights + [
            (key * sign, np.flip(light, axis))
            for key, light in lights
            if abs(key[axis]) > NORMAL / 4
        ]
    keys: dict[tuple[float, ...], Light] = {}
    for key, light in lights:
        keys.setdefault(tuple(np.round(key, 4).tolist()), (key, light))
    return list(keys.values()), tuple(f"taken as symmetric, {words[a]}" for a in axes)


def isotropic(
    lights: list[Light], cover: np.ndarray, depth: int, cells: Cells, progress: Progress
) -> np.ndarray:
    """BSDF of a tree of rank 3, shape (n, n, n), from measurements at one azimuth.

    Light comes from −x, as in the tree. The material is its own mirror image.
    """
    own: dict[float, np.ndarray] = {}
    for key, light in lights:
        turned = _turned(light, np.pi - np.arctan2(key[1], key[0])) if np.hypot(*key) else light
        own[float(np.hypot(*key))] = (turned + np.flip(turned, 1)) / 2
    if len(own) < 2:
        got = f"{len(own)} incidence"
        raise InputError("measurement", "incidences", got, "measure at least two")
    nearest = min(own)
    if nearest > NORMAL:  # the normal lies between an incidence and the opposite one
        own[-nearest] = np.flip(own[nearest], 0)
    r = sorted(own)
    between = cache(
        lambda i: passage(own[r[i]], own[r[i + 1]], cover, _reach(r[i + 1] - r[i], cover))
    )
    n = 1 << depth
    grid = np.zeros((n, n, n))
    for k in range(n // 2):
        wanted = 1 - (k + 0.5) / (n // 2)
        i = int(np.clip(np.searchsorted(r, wanted) - 1, 0, len(r) - 2))
        t = float(np.clip((wanted - r[i]) / (r[i + 1] - r[i]), 0, 1))
        grid[k] = cells(between(i).at(t))
        progress((k + 1) / (n // 2))
    return grid


def anisotropic(
    lights: list[Light], cover: np.ndarray, depth: int, cells: Cells, progress: Progress
) -> np.ndarray:
    """BSDF of a tree of rank 4, shape (n, n, n, n)."""
    p = np.array([key for key, _ in lights])
    if len(p) < 3:
        got = f"{len(p)} incidences"
        raise InputError("measurement", "incidences", got, "measure at least three")
    corners = triangles(p, "incidences")

    @cache
    def between(i: int, j: int):  # type: ignore[no-untyped-def]
        reach = _reach(float(np.linalg.norm(p[j] - p[i])), cover)
        return passage(lights[i][1], lights[j][1], cover, reach)

    n = 1 << depth
    grid = np.zeros((n, n, n, n))
    at = (np.arange(n) + 0.5) / n
    for cell, (s, t) in enumerate(np.ndindex(n, n)):
        wanted = -np.stack(to_disk(at[s], at[t]))  # the tree's square holds −incident
        which, weight = _weights(p, corners, wanted)
        order = np.argsort(-weight)
        (a, b, c), (u, v, w) = which[order].tolist(), weight[order].tolist()
        light = between(*sorted((a, b))).at(v / (u + v) if a < b else u / (u + v))
        if w > 0.02:
            here = (u * p[a] + v * p[b]) / (u + v)
            reach = _reach(float(np.linalg.norm(p[c] - here)), cover)
            light = passage(light, lights[c][1], cover, reach).at(w)
        grid[s, t] = cells(light)
        progress((cell + 1) / n**2)
    return grid


def _reach(distance: float, cover: np.ndarray) -> float:
    """Longest shift [pixel] of lobes between incidences a distance (direction cosines) apart."""
    return REACH * distance * len(cover) / 2 + 2


def _weights(
    p: np.ndarray, corners: np.ndarray, wanted: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Corner indices of the triangle around a point and its barycentric weights, (3,) each.

    A point outside all triangles is moved toward the normal until it meets one.
    """
    a, b, c = (p[corners[:, i]] for i in range(3))
    det = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    for scale in (*np.linspace(1, 0, 101), None):
        q = (wanted * scale if scale is not None else p[corners].mean(axis=(0, 1))) - a
        v = (q[:, 0] * (c - a)[:, 1] - q[:, 1] * (c - a)[:, 0]) / det
        w = ((b - a)[:, 0] * q[:, 1] - (b - a)[:, 1] * q[:, 0]) / det
        least = np.minimum(np.minimum(v, w), 1 - v - w)
        best = int(least.argmax())
        if least[best] > -1e-6:
            break
    weight = np.maximum([1 - v[best] - w[best], v[best], w[best]], 0)
    return corners[best], weight / weight.sum()


def _turned(light: np.ndarray, angle: float) -> np.ndarray:
    """Light (m, m) turned counter-clockwise by an angle [rad]; quarter turns are exact."""
    quarters = angle / (np.pi / 2)
    if abs(quarters - round(quarters)) < 1e-6:
        return np.rot90(light, round(quarters), axes=(0, 1))
    m = len(light)
    u = (np.arange(4 * m) + 0.5) / (4 * m) * 2 - 1
    x, y = np.meshgrid(u, u, indexing="ij")
    c, s = np.cos(angle), np.sin(angle)
    i, j = (
        np.floor((q + 1) / 2 * m).astype(int).clip(0, m - 1) for q in (c * x - s * y, s * x + c * y)
    )
    out = np.zeros_like(light)
    np.add.at(out, (i, j), np.repeat(np.repeat(light, 4, 0), 4, 1) / 16)
    return out
