"""From goniophotometer measurements to a tensor tree.

1. Triangles over direction cosines join the scattered directions of one incidence; f is linear in
   each triangle. Its light is summed into square pixels of direction cosines, half as wide as the
   tree's cells, so that a peak narrower than a pixel keeps its light. Beyond the measured
   directions f is that of the nearest pixel.
2. Between the three incidences of a triangle lobes move (`drcmitsuba.bsdf.displacement`): from the
   first to the second, then to the third. Beyond the measured incidences the nearest ones hold.
3. Pixels are averaged into the cells of the square of Shirley and Chiu. The hemispherical total of
   every incidence stays as in step 2.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from drcmitsuba_plugins.bsdf_file import BsdfFile
from drcmitsuba_plugins.tensor import MAX_DEPTH, TensorTree, to_square

from drcmitsuba.bsdf import incidence, pab_opto
from drcmitsuba.bsdf.merge import merge
from drcmitsuba.bsdf.pab_opto import Measurement
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress, part

FEWEST = 16
"""Least number of scattered directions of one incidence."""


@dataclass(frozen=True)
class CosinePixels:
    """Square pixels of direction cosines, and how they lie in the cells of a tree."""

    depth: int
    """Number of levels of the tree."""

    @property
    def m(self) -> int:
        """Number of pixels along either axis."""
        return 2 << self.depth

    @cached_property
    def _parts(self) -> tuple[np.ndarray, np.ndarray]:
        """Pixel and cell index of 4 × 4 points in each pixel; points outside the disk left out."""
        fine = 4 * self.m
        u = (np.arange(fine) + 0.5) / fine * 2 - 1
        x, y = (g.ravel() for g in np.meshgrid(u, u, indexing="ij"))
        x, y = x[inside := np.hypot(x, y) < 1], y[inside]
        n = 1 << self.depth
        s, t = (np.minimum((c * n).astype(int), n - 1) for c in to_square(x, y))
        return self.index(x, y), s * n + t

    def index(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Pixel index of direction cosines x and y."""
        i, j = (np.clip(((c + 1) / 2 * self.m).astype(int), 0, self.m - 1) for c in (x, y))
        return i * self.m + j

    @cached_property
    def cover(self) -> np.ndarray:
        """Fraction of every pixel that lies in the unit disk, shape (m, m)."""
        return np.bincount(self._parts[0], minlength=self.m**2).reshape(self.m, self.m) / 16

    @property
    def area(self) -> float:
        """Projected solid angle of a whole pixel [sr]; the disk's pixels sum to π."""
        return np.pi / float(self.cover.sum())

    def cells(self, light: np.ndarray) -> np.ndarray:
        """BSDF [1/sr] in the cells of the tree, shape (n, n), from the light in pixels."""
        pixel, cell = self._parts
        n = 1 << self.depth
        f = np.divide(light, self.cover, out=np.zeros_like(light), where=self.cover > 0).ravel()
        total = np.bincount(cell, f[pixel], minlength=n * n)
        f = total / np.maximum(np.bincount(cell, minlength=n * n), 1)
        have = f.sum() * np.pi / n**2
        return (f * (light.sum() / have if have > 0 else 0)).reshape(n, n)


def gathered(xy: np.ndarray, value: np.ndarray, pixels: CosinePixels, source: str) -> np.ndarray:
    """Share (m, m) of the incident light that leaves through each pixel.

    It is summed from f at scattered directions: direction cosines `xy` (point, 2), `value` (point,)
    [1/sr]. `source` is the name of the file for errors.
    """
    if len(xy) < FEWEST:
        raise InputError(source, "data", f"{len(xy)} points for an incidence", f"give {FEWEST}")
    triangles = incidence.triangles(xy, source)
    corners, f = xy[triangles], value[triangles]
    light, area = np.zeros(pixels.m**2), np.zeros(pixels.m**2)
    side = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    whole = incidence.areas(corners)
    pieces = np.clip(np.ceil(side * pixels.m), 1, 2 * pixels.m).astype(int)  # half a pixel long
    for k in np.unique(pieces):
        mine, inner = pieces == k, _inner(int(k))
        at = np.einsum("pc,tcx->tpx", inner, corners[mine])
        index = pixels.index(at[..., 0].ravel(), at[..., 1].ravel())
        each = np.repeat(whole[mine] / k**2, len(inner))
        area += np.bincount(index, each, minlength=len(area))
        light += np.bincount(index, each * (f[mine] @ inner.T).ravel(), minlength=len(light))
    known = area > 0.1 * (2 / pixels.m) ** 2
    mean = np.divide(light, area, out=np.zeros_like(light), where=known)
    mean = _filled(mean.reshape(pixels.m, -1), known.reshape(pixels.m, -1))
    return mean * pixels.cover * pixels.area


def _inner(k: int) -> np.ndarray:
    """Barycentric coordinates (k², 3) of the centres of k² equal parts of a triangle."""
    i, j = (g.ravel() for g in np.indices((k, k)))
    upright, turned = i + j < k, i + j < k - 1
    a = np.concatenate([i[upright] + 1 / 3, i[turned] + 2 / 3]) / k
    b = np.concatenate([j[upright] + 1 / 3, j[turned] + 2 / 3]) / k
    return np.stack([a, b, 1 - a - b], axis=-1)


def _filled(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Values (m, m), each unknown one replaced by the nearest known one."""
    have, lack = np.argwhere(known), np.argwhere(~known)
    out = values.copy()
    for block in np.array_split(lack, max(1, len(lack) // 256)):
        distance = ((block[:, None] - have) ** 2).sum(axis=2)
        out[tuple(block.T)] = values[tuple(have[distance.argmin(axis=1)].T)]
    return out


def from_measurements(
    paths: Iterable[str | Path],
    *,
    depth: int = 5,
    symmetry: str = "auto",
    front: str = "room",
    tolerance: float = 0.02,
    progress: Progress = lambda share: None,
) -> BsdfFile:
    """Make a BSDF from goniophotometer measurements.

    Parameters
    ----------
    paths : iterable of path
        Text files by pab-opto, each with one or several incidences (`drcmitsuba.bsdf.pab_opto`).
    depth : int
        Levels of the tree: 5 has cells of 3.6° at the normal, 6 of 1.8°.
    symmetry : str
        'none'; 'bilateral' (left and right, or up and down, whichever half is measured);
        'quadrilateral'; 'auto' mirrors along each axis with incidences on one side only.
    front : str
        Where the sample's front (theta 0) faces when mounted: 'room' or 'outside'.
    tolerance : float
        Cells that differ by at most this fraction of their mean are merged.
    progress : callable
        Called with the share of the work that is done, 0 to 1.

    Returns
    -------
    BsdfFile
        Rank 3 if all incidences lie at one azimuth (isotropic), else rank 4.

    Raises
    ------
    InputError
        A file cannot be read, points or incidences are too few, or all incidences lie in a plane.

    Notes
    -----
    Limits: luminance only; no deconvolution of the lamp and detector; scattered directions within
    2° of grazing are left out; beyond the largest measured incidence lobes stay where they were;
    an isotropic material is taken to be its own mirror image; a lobe that only one of two
    neighbouring incidences shows fades, so each lobe has to be measured at several incidences.
    """
    if not 1 <= depth <= min(6, MAX_DEPTH):
        raise InputError("measurement", "depth", str(depth), "give 1 to 6")
    choices = {"symmetry": (symmetry, incidence.SYMMETRIES), "front": (front, ("room", "outside"))}
    for key, (got, known) in choices.items():
        if got not in known:
            raise InputError("measurement", key, repr(got), f"give {' or '.join(known)}")
    all_of_them = pab_opto.read(paths)
    if not all_of_them:
        raise InputError("measurement", "files", "none", "name measurement files")
    turned = np.array([1, 1, 1] if front == "room" else [-1, 1, -1])
    isotropic = incidence.at_one_azimuth([m.incident for m in all_of_them])
    parts = _components(all_of_them, turned)
    pixels = CosinePixels(depth)
    components, notes = {}, []
    for i, (name, measured) in enumerate(parts.items()):
        report = part(progress, i / len(parts), (i + 1) / len(parts))
        lights = [
            (key, gathered(xy, value, pixels, all_of_them[0].source)) for key, xy, value in measured
        ]
        if isotropic:
            grid = incidence.isotropic(lights, pixels.cover, depth, pixels.cells, report)
        else:
            lights, mirrors = incidence.mirrored(lights, symmetry)
            notes += [f"{name}: {text}" for text in mirrors]
            grid = incidence.anisotropic(lights, pixels.cover, depth, pixels.cells, report)
        components[name] = merge(TensorTree.of_grid(grid), percent=0, tolerance=tolerance)
        notes.append(f"{name}: from {len(measured)} incidences")
    names = [m.name for m in all_of_them if m.name]
    files = list(dict.fromkeys(m.source for m in all_of_them))
    return BsdfFile(
        source=files[0] + (f" and {len(files) - 1} more" if len(files) > 1 else ""),
        name=names[-1] if names else "",
        manufacturer="",
        kind=f"TensorTree{3 if isotropic else 4}",
        components=components,
        notes=tuple(dict.fromkeys(notes)),
    )


def _components(
    measurements: list[Measurement], turned: np.ndarray
) -> dict[str, list[tuple[np.ndarray, np.ndarray, np.ndarray]]]:
    """Incidence (2,), direction cosines (n, 2) and f (n,) of each component, scans joined."""
    points: dict[str, dict[tuple[float, float], list[tuple[np.ndarray, np.ndarray]]]] = {}
    for m in measurements:
        incident, outgoing = m.incident * turned, m.outgoing * turned
        key = tuple(np.round(incident[:2], 4).tolist())
        for sign in (1, -1):
            mine = outgoing[:, 2] * sign > 0
            if mine.any():
                kind = "r" if sign * incident[2] > 0 else "t"
                name = kind + ("f" if incident[2] > 0 else "b")
                place = points.setdefault(name, {}).setdefault(key, [])
                place.append((outgoing[mine, :2], m.value[mine]))
    joined: dict[str, list[tuple[np.ndarray, np.ndarray, np.ndarray]]] = {}
    for name, of_name in sorted(points.items()):
        for key, scans in sorted(of_name.items()):
            xy, value = (np.concatenate(column) for column in zip(*scans, strict=True))
            joined.setdefault(name, []).append((np.array(key), xy, value))
    return joined
