"""Coefficients of straight light from suns alone."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.random_streams import Stream, launch_seed
from drcmitsuba.scene.scene import Scene
from drcmitsuba.schema import mean_and_error
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.launch_size import SENSORS
from drcmitsuba.transport.openings import hidden_in_disks, in_rooms
from drcmitsuba.transport.shadow_rays import RIM, pair_deposit, sun_deposit

EDGE_SAMPLES = 8
"""Directions on a sun's disk in each replicate, where the edge of a shadow crosses the disk."""
ALIKE = 0.1
"""Relative difference of D around a sun's disk below which no shadow edge is assumed."""


def sensor_numbers(here: slice) -> mi.UInt32:
    """Indices of the sensors of a block."""
    return dr.arange(mi.UInt32, here.stop - here.start) + dr.opaque(mi.UInt32, here.start)


def straight_suns(
    scene: Scene, points: np.ndarray, normals: np.ndarray, suns: Suns, accuracy: Accuracy,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Coefficients of straight light from suns alone.

    Parameters
    ----------
    scene, points, normals, suns, accuracy
        As for `coefficients.compute`.

    Returns
    -------
    mean, error : np.ndarray, shape (sensor, sun)
        Estimate and its standard error [sr]; the errors of all entries are independent.

    Notes
    -----
    Most sensors see all of a sun or nothing. Where `RIM` directions around the disk's edge agree,
    their mean is the result. Where they differ, a shadow's edge crosses the disk, which is then
    estimated with `EDGE_SAMPLES` directions in each replicate; so is a disk that may be seen
    through a slit. A straight edge that takes or leaves less than 1.5 % of the disk, or a bar
    across it of less than a tenth of its width, may go unnoticed.
    """
    shape = (len(points), len(suns.labels))
    mean, error = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    reached = scene.effects.enabled_suns(suns)
    if reached.any():
        followed = suns.where(reached)
        for start in range(0, len(points), SENSORS):
            here = slice(start, min(start + SENSORS, len(points)))
            mean[here, reached], error[here, reached] = _straight_suns(
                scene, points[here], normals[here], followed, accuracy, here
            )
    return mean, error


def _straight_suns(
    scene: Scene, points: np.ndarray, normals: np.ndarray, suns: Suns, accuracy: Accuracy,
    here: slice,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """`straight_suns` of some sensors."""
    p, n = flat(points), flat(normals)
    kind: dict[str, Any] = {"suns": suns.directions, "diameter": suns.diameter}
    kind["numbers"], within = sensor_numbers(here), in_rooms(scene, points)
    kind["within"] = None if within is None else mi.Bool(within)
    shape = (len(points), len(suns.labels))
    seed = launch_seed(accuracy.seed, Stream.SUN_RIMS)
    total, most = (dr.zeros(mi.Float, shape[0] * shape[1]) for _ in range(2))
    least = dr.full(mi.Float, dr.inf, shape[0] * shape[1])
    for i in range(RIM):
        d = sun_deposit(scene, p, n, **kind, samples=1, seed=seed, rim=i).array
        total += d
        least, most = dr.minimum(least, d), dr.maximum(most, d)
        dr.eval(total, least, most)
    slits = hidden_in_disks(scene, points, suns.directions, suns.diameter)
    edges = dr.compress((most - least > ALIKE * most) | (slits & (most == 0)))
    mean, error = total.numpy() / RIM, np.zeros(total.shape, np.float32)
    if dr.width(edges):
        kind["samples"], replicates = EDGE_SAMPLES, range(accuracy.replicates)
        seeds = [launch_seed(accuracy.seed, Stream.SUN_EDGES, r) for r in replicates]
        again = [pair_deposit(scene, p, n, edges, **kind, seed=s).numpy() for s in seeds]
        mean[edges.numpy()], error[edges.numpy()] = mean_and_error(np.stack(again))
    return mean.reshape(shape), error.reshape(shape)
