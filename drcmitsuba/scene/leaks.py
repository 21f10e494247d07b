"""Leaks of a model: ways by which its rooms are open to the sky where there is no pane.

Paths go from the sensors through the rooms, diffusely from surface to surface. Panes to the outside
end them; a path that leaves the model has passed a leak.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.sensors import AnySensors, file_of_points
from drcmitsuba.model.model import Model, ModelShape
from drcmitsuba.model.space import space_at
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.random_streams import even_numbers
from drcmitsuba.runtime.toml import shortened
from drcmitsuba.scene.meshes import quad_mesh
from drcmitsuba.scene.mitsuba_scenes import mitsuba_scene
from drcmitsuba.scene.panes_of_model import panes_of_model
from drcmitsuba.scene.sensors import sensors_of_model

PATHS, BOUNCES = 1 << 15, 6
"""Number of paths, and of their rays."""
TIGHT = 1e-4
"""Share of the rays that may leave a model: cracks between polygons that were drawn apart [–]."""
NEAR = 0.25
"""Distance within which lines pass the same leak [m]."""
NARROW = 5e-3
"""Share of the rays that may leave a model by cracks, with a note [–]."""
CRACK, AROUND = 0.03, 8
"""Distance of rays beside a lost one by which it has passed a crack or a hole [m]; their number."""
OFF_PLANE = 1e-3
"""Distance within which the start of a ray lies in the plane of a surface [m]."""
MOST_WIDE = 0.25
"""Share of the lost rays that may pass a hole where a leak counts as cracks [–]."""
MOST_LINES = 200
"""Number of lost rays by which a leak is located."""


class Leak(NamedTuple):
    """Way by which the rooms of a model are open to the sky."""

    share: float
    """Share of the rays in the rooms that leave the model [–]."""
    place: np.ndarray
    """Point near the opening in the model's frame [m], shape (3,)."""
    is_crack: bool
    """Whether the leak is so narrow, and passed by so few rays, that it may stay."""
    space: str = ""
    """Name of the space that most of these rays leave; empty where spaces are not known."""

    @property
    def words(self) -> str:
        """Share, place and space in a message."""
        where = ", ".join(f"{v:.2f}" for v in self.place)
        words = f"{100 * self.share:.2g} % of the rays in its rooms leave it near ({where})"
        return f"{words}, most from {shortened(self.space)}" if self.space else words


def refuse_leaks(case: Case) -> None:
    """Raise InputError, with a place, where the rooms of the sensors are open without a pane.

    A case without a model, and one whose `[model]` allows leaks, is not looked at.
    """
    leak = _leak(case)
    if leak is not None and not leak.is_crack:
        remedy = 'close the room there, draw a pane, or write leaks = "allow" in [model]'
        raise InputError(case.source, "model", leak.words, remedy)


def crack_notes(case: Case) -> list[str]:
    """Note cracks through which rays leave the rooms; errors are those of `refuse_leaks`."""
    leak = _leak(case)
    if leak is None or not leak.is_crack:
        return []
    return [f"model: {leak.words}, by cracks below {1000 * CRACK:g} mm, whose light counts"]


def _leak(case: Case) -> Leak | None:
    """Leak of a case's model; None where it has none, or where it is not looked for."""
    if not case.building.layers or case.model is None or case.model.leaks == "allow":
        return None
    written = file_of_points(case.sensors)
    return leak_of(case.building.shape, case.sensors, case.source, mi.variant(), written)


@lru_cache(maxsize=64)  # all rows of a study are asked for one by one, several times
def leak_of(
    shape: ModelShape, sensors: AnySensors, source: str, variant: str, written: tuple[int, ...]
) -> Leak | None:
    """Leak of a model's rooms, those of the sensors; None where they are closed.

    It is looked for once for models of one shape and a variant of Mitsuba; errors are those of
    `sensors.sensors_of_model`.
    """
    model = shape.model
    placed = sensors_of_model(model, sensors, source, variant, outside=False)
    if placed.outside:
        return None
    low = np.min([layer.quads.min(axis=(0, 1)) for layer in model.layers], axis=0)
    scene = _closed(model, low)
    start, ends, among = _lost(scene, placed.points - low, placed.normals)
    if len(start) < TIGHT * among:
        return None
    share = len(start) / among
    is_crack = share < NARROW and _wide(scene, start, ends) < MOST_WIDE
    return Leak(share, _place(start, ends) + low, is_crack, _space(model, start + low))


def _space(model: Model, points: np.ndarray) -> str:
    """Name of the space in which most of the points lie; empty where they lie in none."""
    at = space_at(model.spaces, points)
    inside = at[at >= 0]
    return model.spaces[np.bincount(inside).argmax()].name if len(inside) else ""


def _closed(model: Model, low: np.ndarray) -> mi.Scene:
    """Surfaces of a model and its panes to the outside, relative to its lowest corner [m]."""
    panes, quads = panes_of_model(model), []
    for i, layer in enumerate(model.layers):
        between = panes.polygon[(panes.layer == i) & ~panes.outside]
        quads.append(panes.quads[i][~np.isin(layer.polygon, between)])
    corners = np.concatenate(quads) - low
    return mitsuba_scene({"all": quad_mesh("all", corners)})


def _wide(scene: mi.Scene, start: np.ndarray, direction: np.ndarray) -> float:
    """Share of lost rays beside which all others at the distance `CRACK` are lost, too [–].

    A surface between the lost ray and one beside it counts as well; the surface that the lost ray
    leaves tells nothing.
    """
    turn = np.arange(AROUND) * (2 * np.pi / AROUND)
    ring = CRACK * np.stack([np.cos(turn), np.sin(turn)])
    lane = dr.arange(mi.UInt32, len(start) * AROUND)
    ray, beside = lane // AROUND, lane % AROUND
    d = dr.gather(mi.Vector3f, flat(direction), ray)
    away = dr.gather(mi.Vector2f, flat(ring.T), beside)
    frame = mi.Frame3f(d)
    own = dr.gather(mi.Point3f, flat(start), ray)
    aside = frame.s * away.x + frame.t * away.y
    hit = mi.Bool(False)
    for each in (mi.Ray3f(own, aside, 1, 0, []), mi.Ray3f(own + aside, d)):
        met = scene.ray_intersect(each)
        hit |= met.is_valid() & (dr.abs(dr.dot(met.n, own - met.p)) > OFF_PLANE)
    return float((~hit.numpy().reshape(len(start), AROUND).any(axis=1)).mean())


def _lost(
    scene: mi.Scene, points: np.ndarray, normals: np.ndarray
) -> tuple[np.ndarray, np.ndarray, int]:
    """Starts and directions of rays that leave a scene, (ray, 3) each, and the number of rays."""
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
