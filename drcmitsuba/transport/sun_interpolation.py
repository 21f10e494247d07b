"""Adaptive suns: straight light at every time stamp, all other light between suns of a mesh.

Straight sun jumps at the edges of shadows, so it is traced for every time stamp. Scattered and
interreflected light mostly changes slowly with the sun: its coefficients are interpolated between
suns of a mesh. A triangle of the mesh is tested with suns half way along its edges; where the
interpolation errs by more than the tolerance, its children are tested in turn. The mesh covers all
suns that are possible at the place, independent of weather and time stamps.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.launch_size import SENSORS
from drcmitsuba.runtime.progress import Progress, part
from drcmitsuba.scene.scene import Scene
from drcmitsuba.schema import describe, mean_and_error, positions
from drcmitsuba.sky.sun_models import Blend, Suns, mesh
from drcmitsuba.transport.coefficients import compute
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.rays.openings import in_rooms, within_of
from drcmitsuba.transport.rays.straight_suns import sensor_numbers, straight_suns

HELD_OUT = 48
"""Number of suns that only check the interpolation."""


class _Nodes:
    """Coefficients of the nodes known so far, by node."""

    def __init__(self, C: xr.Dataset):
        self.C, self.labels = C, mesh_of(C)

    def missing(self, nodes: np.ndarray) -> np.ndarray:
        """Distinct nodes of an array (…, 2) that are not known yet."""
        each, known = np.unique(nodes.reshape(-1, 2), axis=0), set(self.labels)
        return each[[mesh.label(node) not in known for node in each]]

    def replicates(self, labels: ArrayLike) -> np.ndarray:
        """Replicates (replicate, sensor, label) of bins by label."""
        return self.C["replicates"].values[:, :, positions(labels, self.C["bin"].values)]

    def blended(self, blend: Blend) -> np.ndarray:
        """Replicates (replicate, sensor, sun) of suns between the nodes."""
        each = zip(blend.bins.T, blend.weights.T, strict=True)
        return sum(self.replicates(bins) * weights for bins, weights in each)


def _scale(replicates: np.ndarray) -> float:
    """RMS of coefficients (replicate, sensor, sun) over the sensors and the suns with light."""
    mean = replicates.mean(axis=0)
    lit = mean.any(axis=0)
    return float(np.sqrt((mean[:, lit] ** 2).mean())) if lit.any() else 0.0


def mesh_of(C: xr.Dataset) -> tuple[str, ...]:
    """Labels of the mesh's suns among the bins of coefficients."""
    return tuple(name for name in map(str, C["bin"].values) if name.startswith(mesh.PREFIX))


def _squared_error(difference: np.ndarray, axis: int | None = None) -> np.ndarray:
    """Mean over `axis` of squared differences, less the variance s²/n of n replicates."""
    mean, noise = difference.mean(axis=0), difference.var(axis=0, ddof=1) / len(difference)
    return np.maximum((mean**2 - noise).mean(axis=axis), 0)


def _miss(nodes: _Nodes, corners: np.ndarray) -> np.ndarray:
    """RMS error over the sensors at the worst edge midpoint of triangles (n, 3, 2), (n,)."""
    worst = np.zeros(len(corners))

    def at(places: np.ndarray) -> np.ndarray:
        return nodes.replicates([mesh.label(node) for node in places])

    for i, middle in enumerate(np.moveaxis(mesh.midpoints(corners), 1, 0)):
        ends = at(corners[:, (i + 1) % 3]) + at(corners[:, (i + 2) % 3])
        square = _squared_error(at(middle) - ends / 2, axis=0)
        worst = np.maximum(worst, np.sqrt(square))
    return worst


def meshed(
    scene: Scene, points: np.ndarray, normals: np.ndarray, diameter: float, accuracy: Accuracy, *,
    latitude: float, tolerance: float, finest: int, subdivision: int = 1,
    known: tuple[str, ...] = (), progress: Progress = lambda share: None,
) -> xr.Dataset:  # fmt: skip
    """Coefficients of the sky and of a mesh of suns, fine enough to interpolate between them.

    Parameters
    ----------
    scene, points, normals, accuracy, subdivision, progress
        As for `coefficients.compute`.
    diameter : float
        Angle across the sun [deg].
    latitude : float
        Latitude of the place [deg north].
    tolerance : float
        Largest error of interpolation half way between two suns of the mesh: RMS over the
        sensors, relative to the RMS over sensors and suns of the interpolated coefficients.
    finest : int
        Finest level of the mesh.
    known : tuple of str
        Suns of the mesh for another state of the façade, which are taken without refinement.

    Returns
    -------
    xr.Dataset
        As from `compute`, with the mesh's suns, without straight light, among the bins, and
        `mesh_error` (sensor) [sr]: RMS error of interpolation at suns outside the mesh. Attributes:
        `mesh_suns`, the number of suns, and `mesh_miss`, the error over all sensors relative to the
        RMS of the coefficients.
    """
    possible = mesh.possible_suns(latitude)
    drawn = np.random.default_rng(accuracy.seed).choice(len(possible), HELD_OUT, replace=False)
    held_out = possible[np.sort(drawn)]
    held_out_labels = tuple(f"sun_held_out_{i:02d}" for i in range(HELD_OUT))
    first = mesh.nodes_of(possible, mesh.COARSEST)
    if known:
        first = np.array([mesh.node(name) for name in known])
    both = Suns(
        (*map(mesh.label, first), *held_out_labels),
        np.concatenate([mesh.directions_of(first), held_out]), diameter, straight=False,
    )  # fmt: skip
    whole = part(progress, 0, 1 if known else 0.5)
    C = compute(scene, points, normals, both, accuracy, subdivision=subdivision, progress=whole)
    is_held_out = np.isin(C["bin"].values.astype(str), held_out_labels)
    exact = C["replicates"].values[:, :, is_held_out]
    nodes = _Nodes(C.isel(bin=~is_held_out))
    scale = _scale(exact)
    live, level = (possible, mesh.COARSEST) if not known else (possible[:0], finest)
    while len(live) and level < finest:
        corners, of_sun = mesh.triangles_of(live, level)
        if len(new := nodes.missing(mesh.midpoints(corners))):
            labels = tuple(map(mesh.label, new))
            suns = Suns(labels, mesh.directions_of(new), diameter, straight=False)
            more = compute(scene, points, normals, suns, accuracy, subdivision=None)
            joined = xr.concat(
                [nodes.C, more], "bin", data_vars="minimal", coords="minimal", compat="override"
            )
            nodes = _Nodes(joined)
        level += 1
        progress(0.5 + 0.5 * (level - mesh.COARSEST) / (finest - mesh.COARSEST))
        live = live[(_miss(nodes, corners) > tolerance * scale)[of_sun]]
    blend = mesh.blend(held_out, np.ones(HELD_OUT, bool), nodes.labels)
    difference = nodes.blended(blend) - exact
    error = np.sqrt(_squared_error(difference, axis=1)).astype(np.float32)
    C = nodes.C.assign(mesh_error=("sensor", error))
    miss = float(np.sqrt(_squared_error(difference))) / scale if scale > 0 else 0.0
    C.attrs |= {"mesh_suns": len(nodes.labels), "mesh_miss": miss}
    return describe(C)


def with_straight(
    C: xr.Dataset, scene: Scene, points: np.ndarray, normals: np.ndarray, suns: Suns,
    accuracy: Accuracy,
) -> xr.Dataset:  # fmt: skip
    """Add C of straight sun, by way of mirrors as well.

    Parameters
    ----------
    C : xr.Dataset
        Coefficients from `meshed`; the coordinate `sun` is replaced.
    suns : Suns
        Suns of the time stamps.
    scene, points, normals, accuracy
        As for `coefficients.compute`.

    Returns
    -------
    xr.Dataset
        C with `sun_straight` and `sun_straight_se` (sensor, sun) [sr].
    """
    mean, error = straight_suns(scene, points, normals, suns, accuracy)
    mirrored, own = _mirrored_suns(scene, points, normals, suns, accuracy)
    mean, error = mean + mirrored, np.hypot(error, own)
    C = C.drop_dims("sun", errors="ignore")
    C = C.assign_coords(sun=np.array(suns.labels, dtype=object))
    return describe(
        C.assign(sun_straight=(("sensor", "sun"), mean), sun_straight_se=(("sensor", "sun"), error))
    )


def _mirrored_suns(
    scene: Scene, points: np.ndarray, normals: np.ndarray, suns: Suns, accuracy: Accuracy
) -> tuple[np.ndarray, np.ndarray]:
    """C of suns in mirrors and its standard error [sr], as from `straight_suns`."""
    mean, error = np.zeros((2, len(points), len(suns.labels)), np.float32)
    reached = scene.effects.enabled_suns(suns)
    followed, every = suns.where(reached), range(accuracy.replicates)
    deposit = Deposit(scene, followed.directions, suns.diameter, None, accuracy, None)
    if not (reached.any() and deposit.mirrors):
        return mean, error
    for start in range(0, len(points), SENSORS):
        here = slice(start, min(start + SENSORS, len(points)))
        some = points[here]
        within = within_of(scene, some, in_rooms(scene, some))
        light = deposit.mirrored_on_sensors(
            flat(some), flat(normals[here]), sensor_numbers(here), every,
            accuracy.sensor_sun_samples, within,
        )  # fmt: skip
        assert light is not None
        replicates = light.numpy().reshape(len(every), len(some), -1)
        mean[here, reached], error[here, reached] = mean_and_error(replicates)
    return mean, error
