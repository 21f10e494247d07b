"""Rooms of a model that no daylight enters: without an opening, or behind panes on closed walls.

Paths go from the sensors of each grid through the rooms, diffusely from surface to surface, and
look for panes to the outside. A grid whose paths meet none is dark.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.sensors import AnySensors, file_of_points
from drcmitsuba.model.model import Layer, Model, ModelShape
from drcmitsuba.model.notes import Notes
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.random_streams import even_numbers
from drcmitsuba.scene.geometry import normals, points_on
from drcmitsuba.scene.meshes import quad_mesh
from drcmitsuba.scene.mitsuba_scenes import mitsuba_scene
from drcmitsuba.scene.panes_of_model import ModelPanes, panes_of_model
from drcmitsuba.scene.sensors import sensors_of_model

PATHS, MOST_PATHS, BOUNCES = 1 << 12, 1 << 20, 8
"""Number of paths of each grid, of all grids at most, and of the rays of a path."""
UPON = 0.01
"""Distance of a wall within which a pane is drawn upon it [m]."""
POINTS = 64
"""Number of points of a pane at which a wall is looked for."""
COVERED = 0.9
"""Share of these points before or behind which a wall closes a pane, at least [–]."""


class Darkness(NamedTuple):
    """Panes and grids of a model that no daylight reaches."""

    closed: tuple[str, ...]
    """Places of panes that are drawn upon a surface without a hole."""
    panes: int
    """Number of panes to the outside, those included."""
    grids: tuple[str, ...]
    """Names of the grids whose rooms have no opening."""
    is_all: bool
    """Whether these are all grids."""


def refuse_darkness(case: Case) -> None:
    """Raise InputError where no daylight enters the rooms of a model, or panes have no hole.

    A case without a model, one whose `[model]` allows leaks, and one with components, which may
    lead light into a room, is not looked at.
    """
    dark = _darkness(case)
    if dark is None:
        return
    if dark.closed and len(dark.closed) == dark.panes:
        more = f" and {len(dark.closed) - 1} more panes" if len(dark.closed) > 1 else ""
        got = f"{dark.closed[0]}{more}: drawn on a surface without a hole, which no light passes"
        raise InputError(case.source, "model", got, "cut the hole into the surface")
    if dark.is_all:
        got = "no pane and no opening lets daylight into the rooms of its sensors"
        remedy = 'draw a pane; for holes without glass write leaks = "allow" in [model]'
        raise InputError(case.source, "model", got, remedy)


def darkness_notes(case: Case) -> list[str]:
    """Note panes without a hole, and grids in rooms without an opening."""
    dark = _darkness(case)
    if dark is None:
        return []
    notes = Notes()
    for place in dark.closed:
        notes.add("model: panes drawn on a surface without a hole let no light through", place)
    for name in dark.grids:
        notes.add("sensors: no pane or opening lets daylight into the rooms of the grids", name)
    return list(notes.sentences())


def _darkness(case: Case) -> Darkness | None:
    """Find what daylight does not reach in a case's model; None where nobody looks for it."""
    if not case.building.layers or case.model is None or case.model.leaks == "allow":
        return None
    matt = case.without_polish()
    if matt.standing:
        return None
    written = file_of_points(case.sensors)
    return darkness_of(matt.building.shape, case.sensors, case.source, mi.variant(), written)


@lru_cache(maxsize=64)  # all rows of a study are asked for one by one, several times
def darkness_of(
    shape: ModelShape, sensors: AnySensors, source: str, variant: str, written: tuple[int, ...]
) -> Darkness:
    """Find what daylight does not reach in models of one shape, once for them and a variant."""
    model = shape.model
    panes = panes_of_model(model)
    low = np.min([layer.quads.min(axis=(0, 1)) for layer in model.layers], axis=0)
    on_walls = _on_walls(model, panes, low)
    closed = tuple(
        model.layers[i].place(int(np.argmax(model.layers[i].polygon == p)))
        for i, p, on in zip(panes.layer, panes.polygon, on_walls, strict=True)
        if on
    )
    outside = int((panes.outside | on_walls).sum())
    placed = sensors_of_model(model, sensors, source, variant, outside=False)
    if placed.outside:
        return Darkness(closed, outside, (), is_all=False)
    seen = _seen(model, panes, low, placed.points - low, [len(g.points) for g in placed.grids])
    grids = tuple(grid.name for grid, found in zip(placed.grids, seen, strict=True) if not found)
    return Darkness(closed, outside, grids, is_all=not any(seen))


def _on_walls(model: Model, panes: ModelPanes, low: np.ndarray) -> np.ndarray:
    """Whether panes of a model lie upon a surface that has no hole there, bool (pane,)."""
    walls = [layer.quads for layer in model.layers if layer.role == "surface"]
    if not walls or not len(panes.layer):
        return np.zeros(len(panes.layer), bool)
    scene = _scene(walls=np.concatenate(walls) - low)
    rng, points, along = np.random.default_rng(1), [], []
    for i, polygon in zip(panes.layer, panes.polygon, strict=True):
        quads = _quads(model.layers[i], panes.quads[i], polygon) - low
        some = quads[rng.integers(len(quads), size=POINTS)]
        points.append(points_on(some, rng.random((POINTS, 2))))
        along.append(normals(some))
    n = np.concatenate(along)
    p = mi.Point3f(dr.gather(mi.Point3f, flat(np.concatenate(points) - UPON * n), _lanes(len(n))))
    d = dr.gather(mi.Vector3f, flat(n), _lanes(len(n)))
    hit = scene.ray_test(mi.Ray3f(p, d, 2 * UPON, 0, []), coherent=False)
    return np.asarray(hit.numpy().reshape(-1, POINTS).mean(axis=1) >= COVERED)


def _seen(
    model: Model, panes: ModelPanes, low: np.ndarray, points: np.ndarray, counts: list[int]
) -> list[bool]:
    """Whether paths from the points (sensor, 3) of each grid meet a pane to the outside."""
    glass, walls = [], []
    for i, layer in enumerate(model.layers):
        mine = panes.layer == i
        lit = np.isin(layer.polygon, panes.polygon[mine & panes.outside])
        glass.append(panes.quads[i][lit])
        walls.append(panes.quads[i][~np.isin(layer.polygon, panes.polygon[mine])])
    openings = np.concatenate(glass)
    if not len(openings):
        return [False] * len(counts)
    scene = _scene(walls=np.concatenate(walls) - low, openings=openings - low)
    [shape] = [each for each in scene.shapes() if each.id() == "openings"]
    each = max(1, min(PATHS, MOST_PATHS // len(counts)))
    first = np.cumsum([0, *counts[:-1]])
    sensor = np.concatenate([s + np.arange(each) % c for s, c in zip(first, counts, strict=True)])
    lane = _lanes(len(sensor))
    p = dr.gather(mi.Point3f, flat(points[sensor]), lane)
    n = mi.Normal3f(0, 0, 1)
    active, found = dr.full(mi.Bool, True, len(sensor)), dr.full(mi.Bool, False, len(sensor))
    for bounce in range(BOUNCES):
        uv = even_numbers(lane % each, dr.full(mi.UInt32, bounce, len(sensor)), 7, 0)
        if bounce == 0:  # whichever way the sensors face
            d = mi.warp.square_to_uniform_sphere(uv)
        else:
            d = mi.Frame3f(n).to_world(mi.warp.square_to_cosine_hemisphere(uv))
        si = scene.ray_intersect(mi.Ray3f(p, d), mi.RayFlags.Minimal, coherent=False, active=active)
        active &= si.is_valid()
        found |= active & (si.shape == mi.ShapePtr(shape))
        n = dr.select(dr.dot(si.n, d) < 0, si.n, -si.n)
        p = si.spawn_ray(n).o
        dr.eval(p, n, active, found)
    return [bool(own.any()) for own in found.numpy().reshape(len(counts), each)]


def _quads(layer: Layer, quads: np.ndarray, polygon: int) -> np.ndarray:
    """Quads (quad, 4, 3) of one polygon of a layer [m]."""
    return quads[layer.polygon == polygon]


def _lanes(count: int) -> mi.UInt32:
    return dr.arange(mi.UInt32, count)


def _scene(**parts: np.ndarray) -> mi.Scene:
    """Scene of meshes of quads (quad, 4, 3) [m] by name."""
    meshes = {name: quad_mesh(name, quads) for name, quads in parts.items() if len(quads)}
    return mitsuba_scene(meshes)
