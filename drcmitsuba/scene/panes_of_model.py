"""Panes of a model: which side faces the room, and where light may enter.

Files say nothing about the front of glass. The side from which fewer rays escape to the sky and
the ground is the room's; a pane from which no ray escapes on either side stands between rooms.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.model.materials import FacedBsdf, SurfaceMaterial
from drcmitsuba.model.model import Model, ModelShape, areas
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.runtime.random_streams import even_numbers
from drcmitsuba.scene.geometry import normals, points_on, reversed_quads, turn
from drcmitsuba.scene.meshes import quad_mesh
from drcmitsuba.scene.mitsuba_scenes import mitsuba_scene

RAYS = 256
"""Number of rays from each side of a pane."""
AWAY = 0.02
"""Share of rays that escape from a pane's outer side, at least [–]."""
SEES_SKY = 0.1
"""Share of rays that escape by way of other panes from which on a pane has its outer side there."""
OFFSET = 1e-4
"""Distance of the rays' origins from the pane, per metre of the model's extent."""

Materials = tuple[SurfaceMaterial | None, ...]
"""Materials of the same panes in several states; None of holes."""


@dataclass(frozen=True, eq=False)
class ModelPanes:
    """Panes of a model, polygon by polygon."""

    layer: np.ndarray
    """Index of the layer of every polygon, int, shape (polygon,)."""
    polygon: np.ndarray
    """Index of the polygon in its layer, int, shape (polygon,)."""
    outside: np.ndarray
    """Whether the sky or the ground is on one side, shape (polygon,)."""
    facing: tuple[str, ...]
    """Words of `side_name` for the direction of each polygon's outer side."""
    front: np.ndarray
    """Unit normals towards the room, shape (polygon, 3)."""
    frame: np.ndarray
    """Smallest upright rectangles around the polygons, fronts towards the room [m], shape
    (polygon, 4, 3)."""
    width: np.ndarray
    """Area over the longer edge of that rectangle [m], shape (polygon,)."""
    quads: tuple[np.ndarray, ...]
    """Quads of every layer of the model, those of panes with their fronts towards the room."""
    turned: tuple[np.ndarray, ...]
    """Whether each of these quads has its front where its back was drawn, bool, shape (quad,)."""


def panes_of_model(model: Model) -> ModelPanes:
    """Turn the panes of a model towards its rooms, once for models of one shape."""
    return _panes_of(model.shape)


@lru_cache(maxsize=4)
def _panes_of(shape: ModelShape) -> ModelPanes:
    """Panes of all models of a shape."""
    model = shape.model
    members: list[tuple[int, int, np.ndarray]] = []
    for i, layer in enumerate(model.layers):
        if layer.role == "pane":
            order = np.argsort(layer.polygon, kind="stable")
            polygons, first = np.unique(layer.polygon[order], return_index=True)
            mine = np.split(order, first[1:])
            members += [(i, int(p), own) for p, own in zip(polygons, mine, strict=True)]
    is_pane = [layer.role == "pane" for layer in model.layers]
    quads = [x.quads.copy() if p else x.quads for x, p in zip(model.layers, is_pane, strict=True)]
    turned = [np.zeros(len(layer.quads), bool) for layer in model.layers]
    if not members:
        empty = np.zeros((0, 4, 3))
        return ModelPanes(
            np.zeros(0, int),
            np.zeros(0, int),
            np.zeros(0, bool),
            (),
            empty[:, 0],
            empty,
            np.zeros(0),
            tuple(quads),
            tuple(turned),
        )
    escaping = _escaping(all_surfaces(model, mi.variant()), model, members)
    is_outside = escaping.max(axis=1) > AWAY
    sides = _sides_of_hidden(model, members, escaping, is_outside)
    front, frames, width = [], [], []
    for (i, _, own), (before, behind) in zip(members, sides, strict=True):
        if before > behind:
            quads[i][own], turned[i][own] = reversed_quads(quads[i][own]), True
        front.append(normals(quads[i][own[:1]])[0])
        frames.append(rectangle_around(quads[i][own].reshape(-1, 3), front[-1]))
        longest = np.linalg.norm(frames[-1][[1, 3]] - frames[-1][0], axis=1).max()
        width.append(areas(quads[i][own]).sum() / longest)
    turned_north = np.array(front) @ turn(-model.north).T
    facing = tuple(map(side_name, turned_north, is_outside.tolist()))
    of_layer, polygon = (np.array([member[k] for member in members]) for k in (0, 1))
    return ModelPanes(
        of_layer,
        polygon,
        is_outside,
        facing,
        np.array(front),
        np.array(frames),
        np.array(width),
        tuple(quads),
        tuple(turned),
    )


def by_side(materials: Materials, turned: np.ndarray) -> Iterator[tuple[np.ndarray, Materials]]:
    """Yield quads, bool (quad,), and their materials, by whether they are `ModelPanes.turned`.

    Of a film of the model's own, the corners as drawn say which side is which; all others have the
    same materials on all quads.
    """
    if not any(isinstance(material, FacedBsdf) for material in materials):
        yield np.ones(len(turned), bool), materials
        return
    yield ~turned, materials
    flipped = (
        m.model_copy(update={"flip": not m.flip}) if isinstance(m, FacedBsdf) else m
        for m in materials
    )
    yield turned, tuple(flipped)


@lru_cache(maxsize=1)
def all_surfaces(model: Model, variant: str) -> tuple[mi.Scene, np.ndarray, float]:
    """Scene of all surfaces of a model, its lowest corner (3,), and its extent [m].

    The scene is relative to that corner: coordinates near 0 keep their digits. It is built once
    for a variant of Mitsuba.
    """
    every = np.concatenate([layer.quads for layer in model.layers])
    low, high = every.min(axis=(0, 1)), every.max(axis=(0, 1))
    scene = mitsuba_scene({"all": quad_mesh("all", every - low)})
    return scene, low, float((high - low).max())


def _sides_of_hidden(
    model: Model, members: list[tuple[int, int, np.ndarray]], escaping: np.ndarray,
    is_outside: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Shares as `escaping`, but of panes behind others outside where rays pass those.

    A film of a box window so has its side by the sky that it sees through the outer pane. Panes
    between rooms see little of it, on either side, and keep theirs.
    """
    if is_outside.all() or not is_outside.any():
        return escaping
    hidden = np.flatnonzero(~is_outside)
    left = [np.ones(len(layer.quads), bool) for layer in model.layers]
    for k in np.flatnonzero(is_outside):
        i, _, mine = members[k]
        left[i][mine] = False
    rest = [layer.quads[kept] for layer, kept in zip(model.layers, left, strict=True)]
    _, low, extent = all_surfaces(model, mi.variant())
    scene = mitsuba_scene({"all": quad_mesh("all", np.concatenate(rest) - low)})
    beyond = _escaping((scene, low, extent), model, [members[k] for k in hidden])
    told = (beyond.max(axis=1) > SEES_SKY) & (beyond.max(axis=1) > 3 * beyond.min(axis=1))
    out = escaping.copy()
    out[hidden[told]] = beyond[told]
    return out


def _escaping(
    surfaces: tuple[mi.Scene, np.ndarray, float], model: Model,
    members: list[tuple[int, int, np.ndarray]],
) -> np.ndarray:  # fmt: skip
    """Share of rays that leave from both sides of panes, shape (polygon, side).

    `surfaces` are as from `all_surfaces`.
    """
    scene, low, extent = surfaces
    rng, points, fronts = np.random.default_rng(1), [], []
    for i, _, mine in members:
        quads = model.layers[i].quads[mine] - low
        share = areas(quads)
        some = quads[rng.choice(len(quads), 2 * RAYS, p=share / share.sum())]
        n = normals(some) * np.repeat([[1.0], [-1.0]], RAYS, axis=0)
        points.append(points_on(some, rng.random((2 * RAYS, 2))) + OFFSET * (1 + extent) * n)
        fronts.append(n)
    return escaping(scene, np.concatenate(points), np.concatenate(fronts)).reshape(-1, 2)


def escaping(scene: mi.Scene, points: np.ndarray, fronts: np.ndarray) -> np.ndarray:
    """Share of diffuse rays that meet no surface, `RAYS` after another.

    Parameters
    ----------
    points, fronts : np.ndarray, shape (ray, 3)
        Where each ray starts [m], and the unit normal about which it is drawn.
    """
    lane = dr.arange(mi.UInt32, len(points))
    uv = even_numbers(lane % RAYS, lane // RAYS, 1, 0)
    p, n = (dr.gather(mi.Vector3f, flat(x), lane) for x in (points, fronts))
    d = mi.Frame3f(n).to_world(mi.warp.square_to_cosine_hemisphere(uv))
    hit = scene.ray_test(mi.Ray3f(mi.Point3f(p), d), coherent=False)
    return np.asarray(1 - hit.numpy().reshape(-1, RAYS).mean(axis=1))


def rectangle_around(corners: np.ndarray, front: np.ndarray) -> np.ndarray:
    """Rectangle (4, 3) around corners (corner, 3) in a plane; its edges are level and steepest."""
    level = np.cross([0.0, 0.0, 1.0], front)
    if np.linalg.norm(level) < 1e-6:
        level = np.array([1.0, 0.0, 0.0])
    level /= np.linalg.norm(level)
    up = np.cross(front, level)
    at = np.stack([corners @ level, corners @ up], axis=1)
    (x0, y0), (x1, y1) = at.min(axis=0), at.max(axis=0)
    height = float(corners[0] @ front)
    ends = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    return np.array([x * level + y * up + height * front for x, y in ends])


def side_name(front: np.ndarray, is_outside: bool) -> str:
    """Words for the direction that the outer side of a pane faces, such as "south"."""
    if not is_outside:
        return "between rooms"
    x, y, z = -front
    if abs(z) > 0.9:
        return "above" if z > 0 else "below"
    names = ("north", "north-east", "east", "south-east", "south", "south-west", "west")
    octant = round(float(np.degrees(np.arctan2(x, y))) / 45) % 8
    return (*names, "north-west")[octant]
