"""Leaks of a model: ways by which its rooms are open to the sky where there is no pane.

Paths go from the sensors through the rooms, diffusely from surface to surface. Panes to the outside
end them; a path that leaves the model has passed a leak.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.random_streams import even_numbers
from drcmitsuba.scene.geometry import origin, rotation
from drcmitsuba.scene.meshes import quad_mesh
from drcmitsuba.scene.panes_of_model import panes_of_model
from drcmitsuba.scene.sensors import sensor_points

PATHS, BOUNCES = 1 << 15, 6
"""Number of paths, and of their rays."""
TIGHT = 1e-4
"""Share of the rays that may leave a model: cracks between polygons that were drawn apart [–]."""
NEAR = 0.25
"""Distance within which lines pass the same leak [m]."""
MOST_LINES = 200
"""Number of lost rays by which a leak is located."""


def refuse_leaks(case: Case) -> None:
    """Raise InputError, with a place, where the rooms of the sensors are open without a pane.

    A case without a model, and one whose `[model]` allows leaks, is not looked at.
    """
    if not case.building.layers or case.model is None or case.model.leaks == "allow":
        return
    points, normals = sensor_points(case)
    start, ends, among = _lost(case, points, normals)
    if len(start) < TIGHT * among:
        return
    place = _place(start, ends) @ rotation(case) + origin(case)
    where = ", ".join(f"{v:.2f}" for v in place)
    share = 100 * len(start) / among
    raise InputError(
        case.source, "model", f"{share:.2g} % of the rays in its rooms leave it near ({where})",
        'close the room there, draw a pane, or write leaks = "allow" in [model]',
    )  # fmt: skip


def _lost(
    case: Case, points: np.ndarray, normals: np.ndarray
) -> tuple[np.ndarray, np.ndarray, int]:
    """Starts and directions of rays that leave the model, (ray, 3) each, and the number of rays."""
    panes, turn, quads = panes_of_model(case.building), rotation(case).T, []
    for i, layer in enumerate(case.building.layers):
        between = panes.polygon[(panes.layer == i) & ~panes.outside]
        quads.append(panes.quads[i][~np.isin(layer.polygon, between)])
    corners = (np.concatenate(quads) - origin(case)) @ turn
    scene = mi.load_dict({"type": "scene", "all": quad_mesh("all", corners)}, optimize=False)
    lane = dr.arange(mi.UInt32, PATHS)
    sensor = lane % len(points)
    p = dr.gather(mi.Point3f, flat(points), sensor)
    n = dr.gather(mi.Normal3f, flat(normals), sensor)
    active = dr.full(mi.Bool, True, PATHS)
    starts, directions, among = [], [], 0
    for bounce in range(BOUNCES):
        uv = even_numbers(lane, dr.full(mi.UInt32, bounce, PATHS), 5, 0)
        d = mi.Frame3f(n).to_world(mi.warp.square_to_cosine_hemisphere(uv))
        if bounce == 0:  # below the sensors, too: floors have holes
            d = dr.select(lane % 2 == 0, d, -d)
        si = scene.ray_intersect(mi.Ray3f(p, d), mi.RayFlags.Minimal, coherent=False, active=active)
        among += int(dr.count(active)[0])
        lost = dr.compress(active & ~si.is_valid())
        if dr.width(lost):
            starts.append(dr.gather(mi.Point3f, p, lost).numpy().T)
            directions.append(dr.gather(mi.Vector3f, d, lost).numpy().T)
        active &= si.is_valid()
        n = dr.select(dr.dot(si.n, d) < 0, si.n, -si.n)
        p = si.spawn_ray(n).o
        dr.eval(p, n, active)
    empty = np.zeros((0, 3))
    return np.concatenate([empty, *starts]), np.concatenate([empty, *directions]), among


def _place(start: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Point on the first of some rays that most of the others pass."""
    start, direction = start[:MOST_LINES], direction[:MOST_LINES]
    extent = max(1.0, 2 * float(np.ptp(start, axis=0).max()))
    along = start[0] + np.linspace(0, extent, 200)[:, None] * direction[0]
    apart = along[:, None] - start
    ahead = np.einsum("pri,ri->pr", apart, direction)
    distance = np.linalg.norm(apart - ahead[..., None] * direction, axis=2)
    # Rays that start together pass no leak there: every start counts once, from a distance on.
    _, starts = np.unique(np.round(start / NEAR), axis=0, return_inverse=True)
    near = (distance < NEAR) & (ahead > 2 * NEAR)
    passing = [len(np.unique(starts.ravel()[row])) for row in near]
    return np.asarray(along[int(np.argmax(passing))])
