"""Adaptive suns: straight light at every time stamp, all other light between suns of a mesh.

Straight sun jumps at the edges of shadows, so it is traced for every time stamp. What films scatter
and what the room interreflects changes slowly with the sun, mostly: there coefficients of a mesh of
suns are interpolated. A triangle of the mesh is tested with suns half way along its edges; where
the interpolation misses them by more than the tolerance, its children are tested in turn. The mesh
covers all suns that the place can have and knows nothing of weather or time stamps.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from drcmitsuba.accuracy import Accuracy
from drcmitsuba.coefficients import compute, straight_suns
from drcmitsuba.progress import Progress, part
from drcmitsuba.scene import Scene
from drcmitsuba.schema import describe
from drcmitsuba.suns import Suns, mesh

HELD_OUT = 48
"""Suns that the interpolation is checked with and that never serve it."""


class _Nodes:
    """Coefficients of the nodes known so far, by node."""

    def __init__(self, found: xr.Dataset):
        self.found = found
        names = map(str, found["bin"].values)
        self.at = {name: i for i, name in enumerate(names)}

    def missing(self, nodes: np.ndarray) -> np.ndarray:
        """Nodes of an array (…, 2) that are not known yet, each once."""
        each = np.unique(nodes.reshape(-1, 2), axis=0)
        return each[[mesh.label(node) not in self.at for node in each]]

    def replicates(self, nodes: np.ndarray) -> np.ndarray:
        """Replicates (replicate, sensor, node) of nodes (node, 2)."""
        at = [self.at[mesh.label(node)] for node in nodes]
        return self.found["replicates"].values[:, :, at]


def mesh_of(found: xr.Dataset) -> tuple[str, ...]:
    """Labels of the mesh's suns among the bins of coefficients."""
    return tuple(name for name in map(str, found["bin"].values) if name.startswith(mesh.PREFIX))


def _suns(nodes: np.ndarray, diameter: float) -> Suns:
    labels = tuple(map(mesh.label, nodes))
    return Suns(labels, mesh.directions_of(nodes), diameter, straight=False)


def _squared_error(difference: np.ndarray, axis: int | None = None) -> np.ndarray:
    """Mean over `axis` of squared differences, without what their noise adds.

    The mean of n replicates has the variance s²/n, which is part of its square.
    """
    mean, noise = difference.mean(axis=0), difference.var(axis=0, ddof=1) / len(difference)
    return np.maximum((mean**2 - noise).mean(axis=axis), 0)


def _miss(nodes: _Nodes, corners: np.ndarray) -> np.ndarray:
    """RMS over the sensors by which triangles (n, 3, 2) miss the middles of their edges, (n,)."""
    worst = np.zeros(len(corners))
    for i, middle in enumerate(np.moveaxis(mesh.midpoints(corners), 1, 0)):
        j, k = (i + 1) % 3, (i + 2) % 3
        ends = nodes.replicates(corners[:, j]) + nodes.replicates(corners[:, k])
        square = _squared_error(nodes.replicates(middle) - ends / 2, axis=0)
        worst = np.maximum(worst, np.sqrt(square))
    return worst


def _join(a: xr.Dataset, b: xr.Dataset) -> xr.Dataset:
    return xr.concat([a, b], "bin", data_vars="minimal", coords="minimal", compat="override")


def adaptive(
    scene: Scene, points: np.ndarray, normals: np.ndarray, suns: Suns, accuracy: Accuracy, *,
    latitude: float, tolerance: float, finest: int, subdivision: int = 1,
    known: tuple[str, ...] = (), progress: Progress = lambda share: None,
) -> xr.Dataset:  # fmt: skip
    """Coefficients of sky, mesh of suns, and of the time stamps' own suns where they are straight.

    Parameters
    ----------
    scene, points, normals, accuracy, subdivision, progress
        As for `coefficients.compute`.
    suns : Suns
        Those of the time stamps.
    latitude : float
        Of the place [deg north].
    tolerance : float
        Error that interpolation may make half way between two suns of the mesh: RMS over the
        sensors, relative to the RMS over sensors and suns of the interpolated coefficients.
    finest : int
        Level that the mesh is not refined beyond.
    known : tuple of str
        Nodes to take, as they were chosen for another state of the façade; none is added then.

    Returns
    -------
    xr.Dataset
        As from `compute`, with the mesh's suns among the bins, without straight light; and
        `sun_straight`, `sun_straight_se` (sensor, sun), `mesh_error` (sensor), all in sr.
        Attributes `mesh_suns`, `mesh_level` and `mesh_miss`, the RMS error at held-out suns over
        the RMS of their coefficients.
    """
    possible = mesh.possible_suns(latitude)
    if known:
        chosen = np.array([mesh.node(name) for name in known])
        found = compute(
            scene, points, normals, _suns(chosen, suns.diameter), accuracy,
            subdivision=subdivision, progress=part(progress, 0, 0.8),
        )  # fmt: skip
        level = 0
    else:
        found, level = _refined(
            scene, points, normals, suns.diameter, accuracy, possible, tolerance, finest,
            subdivision, part(progress, 0, 0.8),
        )  # fmt: skip
    error, miss = _held_out(scene, points, normals, found, accuracy, possible, suns.diameter)
    progress(0.85)
    straight, straight_se = straight_suns(scene, points, normals, suns, accuracy)
    found = found.assign_coords(sun=np.array(suns.labels, dtype=object))
    found["sun_straight"] = (("sensor", "sun"), straight)
    found["sun_straight_se"] = (("sensor", "sun"), straight_se)
    found["mesh_error"] = ("sensor", error)
    found.attrs |= {"mesh_suns": len(mesh_of(found)), "mesh_miss": miss}
    if level:
        found.attrs["mesh_level"] = level
    return describe(found)


def _refined(
    scene: Scene, points: np.ndarray, normals: np.ndarray, diameter: float, accuracy: Accuracy,
    possible: np.ndarray, tolerance: float, finest: int, subdivision: int, progress: Progress,
) -> tuple[xr.Dataset, int]:  # fmt: skip
    """Coefficients of the sky and of the nodes that the tolerance calls for, and their level."""
    live, level = possible, mesh.COARSEST
    nodes: _Nodes | None = None
    scale = 0.0
    while True:
        corners, of_sun = np.unique(
            mesh.triangles(live, level)[0].reshape(-1, 6), axis=0, return_inverse=True
        )
        corners = corners.reshape(-1, 3, 2)
        wanted = np.concatenate([corners, mesh.midpoints(corners)])
        if nodes is None:
            new = np.unique(wanted.reshape(-1, 2), axis=0)
            first = compute(
                scene, points, normals, _suns(new, diameter), accuracy, subdivision=subdivision
            )
            nodes = _Nodes(first)
            scale = _scale(nodes.replicates(new))
        elif len(new := nodes.missing(wanted)):
            more = compute(scene, points, normals, _suns(new, diameter), accuracy, subdivision=None)
            nodes = _Nodes(_join(nodes.found, more))
        level += 1
        progress((level - mesh.COARSEST) / (finest - mesh.COARSEST))
        live = live[(_miss(nodes, corners) > tolerance * scale)[of_sun.ravel()]]
        if level >= finest or len(live) == 0:
            return nodes.found, level


def _scale(replicates: np.ndarray) -> float:
    """RMS of coefficients (replicate, sensor, sun) over the sensors and the suns that give any."""
    mean = replicates.mean(axis=0)
    lit = mean.any(axis=0)
    return float(np.sqrt((mean[:, lit] ** 2).mean())) if lit.any() else 0.0


def _held_out(
    scene: Scene, points: np.ndarray, normals: np.ndarray, found: xr.Dataset, accuracy: Accuracy,
    possible: np.ndarray, diameter: float,
) -> tuple[np.ndarray, float]:  # fmt: skip
    """RMS error of interpolation at suns drawn from all possible ones: by sensor, and relative."""
    rng = np.random.default_rng(accuracy.seed)
    at = possible[np.sort(rng.choice(len(possible), min(HELD_OUT, len(possible)), replace=False))]
    labels = tuple(f"sun_held_out_{i:02d}" for i in range(len(at)))
    suns = Suns(labels, at, diameter, straight=False)
    exact = compute(scene, points, normals, suns, accuracy, subdivision=None)["replicates"].values
    blend = mesh.blend(at, np.ones(len(at), bool), list(map(str, found["bin"].values)))
    nodes = _Nodes(found)
    between = np.zeros_like(exact)
    for bins, weights in zip(blend.bins.T, blend.weights.T, strict=True):
        between += found["replicates"].values[:, :, [nodes.at[b] for b in bins]] * weights
    difference = between - exact
    scale = _scale(exact)
    rms = float(np.sqrt(_squared_error(difference)))
    error = np.sqrt(_squared_error(difference, axis=1)).astype(np.float32)
    return error, rms / scale if scale > 0 else 0.0
