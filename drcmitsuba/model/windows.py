"""New windows in a model: panes that are cut out of its walls.

A window lies in the plane of a wall. What it covers there is wall no more: light would not pass it.
Where the wall has a second, outer face, the window's hole goes on through that face, between
reveals of the face's material.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import shapely

from drcmitsuba.model.materials import Lambertian, SurfaceMaterial, two_sided
from drcmitsuba.model.model import Layer, Model, areas
from drcmitsuba.model.plane import Plane
from drcmitsuba.model.polygon import quads_of
from drcmitsuba.runtime.errors import InputError

SAME_PLANE = 1e-3
"""Distance [m], and difference of normals [–], within which surfaces lie in one plane."""
GRID = 1e-6
"""Grid to which corners of cut shapes are rounded [m]."""
DEEPEST = 1.0
"""Largest distance between the two faces of one wall [m]."""


@dataclass(frozen=True, eq=False)
class NewWindow:
    """Pane in the plane of a wall."""

    name: str
    """Name of its material; windows of one name are one layer."""
    quads: np.ndarray
    """Its parts, fronts to the room, in the coordinates of the model [m], shape (quad, 4, 3)."""
    place: str
    """Words for messages."""
    depth: float = 0.0
    """Distance of the wall's outer face behind it [m]; 0 where the wall has one face."""

    @property
    def plane(self) -> Plane:
        """Plane whose front is that of the window."""
        return Plane.of(self.quads[np.argmax(areas(self.quads))])


def shape_in(plane: Plane, quads: np.ndarray) -> Any:
    """Union of quads (quad, 4, 3) in a plane, as shapely's geometry [m]."""
    return shapely.union_all(_each_in(plane, quads), grid_size=GRID)


def quads_in(plane: Plane, shape: Any) -> np.ndarray:
    """Quads (quad, 4, 3) of a shape in a plane [m], fronts as the plane's."""
    shape = shapely.simplify(shape, GRID)  # corners along straight edges would make triangles
    parts = [quads_of(rings[0], rings[1:]) for rings in plane.rings(shape, GRID)]
    return np.concatenate([np.zeros((0, 4, 3)), *parts])


def with_windows(
    model: Model, windows: Sequence[NewWindow], materials: Mapping[str, SurfaceMaterial]
) -> Model:
    """Cut windows out of the surfaces of a model that lie in their planes.

    A window with a depth is cut out of the outer face, too. Each is a hole of its own: reveals
    stand around it, also between windows side by side, of the material of the outer face.

    Parameters
    ----------
    model : Model
    windows : sequence of NewWindow
    materials : mapping of str to SurfaceMaterial
        Material of every name of the windows.

    Returns
    -------
    Model
        A layer of panes for each name comes behind the layers that the model has, unless one of
        these holds panes of that name and belongs to no group. Layers that windows cover altogether
        are left out.

    Raises
    ------
    InputError
        A window lies in no wall, or no outer face at its depth.
    """
    layers = list(model.layers)
    of_plane: dict[tuple[float, ...], list[NewWindow]] = defaultdict(list)
    for window in windows:
        plane = window.plane
        key = np.round([*plane.normal, plane.corner @ plane.normal, window.depth], 4)
        of_plane[tuple(key.tolist())].append(window)
    for mine in of_plane.values():
        plane, depth = mine[0].plane, mine[0].depth
        remedy = "give corners in the plane of a wall, in the model's coordinates [m]"
        layers = _cut_out(layers, mine, plane, "no wall lies in its plane", remedy)
        if depth > 0:
            outer = replace(plane, corner=plane.corner - depth * plane.normal)
            lost = f"no outer face of the wall lies {depth:.4g} m behind it"
            remedy = "give corners counter-clockwise from the room, and the wall's depth [m]"
            cut = _cut_out(layers, mine, outer, lost, remedy)
            removed = [_area_in(a, outer) - _area_in(b, outer)
                       for a, b in zip(layers, cut, strict=True)]  # fmt: skip
            at = int(np.argmax(removed))
            faces_in = _in_plane(layers[at], outer)[1].sum() > 0
            cut[at] = _joined(cut[at], _reveals(mine, plane, depth, faces_in))
            layers = cut
    named: dict[str, list[NewWindow]] = defaultdict(list)
    for window in windows:
        named[window.name].append(window)
    for name, mine in named.items():
        at = next((i for i, layer in enumerate(layers) if _holds(layer, name)), len(layers))
        empty = Layer(name, materials[name], "pane", np.zeros((0, 4, 3)), np.zeros(0, int), ())
        layer = (layers[at:] or [empty])[0]
        layers[at : at + 1] = [_joined(layer, [(w.quads, w.place) for w in mine])]
    return replace(model, layers=tuple(layer for layer in layers if len(layer.quads)))


def _cut_out(
    layers: Sequence[Layer], windows: Sequence[NewWindow], plane: Plane, lost: str, remedy: str
) -> list[Layer]:
    """Layers without what windows cover in a plane; InputError where that is nothing."""
    shape = shape_in(plane, np.concatenate([window.quads for window in windows]))
    cut = [_without(x, plane, shape) if x.role == "surface" else x for x in layers]
    if all(new is old for new, old in zip(cut, layers, strict=True)):
        raise InputError("model.windows", windows[0].place, lost, remedy)
    return cut


def _reveals(
    windows: Sequence[NewWindow], plane: Plane, depth: float, faces_in: bool
) -> list[tuple[np.ndarray, str]]:
    """Reveals (quad, 4, 3) behind windows in a plane [m], and the place of each window.

    They show their fronts to the hole, or, where the outer face shows its own to the room, their
    backs. What two windows share stands once.
    """
    out, drawn = [], shapely.LineString()
    for window in windows:
        shape = shapely.simplify(shape_in(plane, window.quads), GRID)
        edges = shapely.difference(shape.boundary, drawn, grid_size=GRID)
        drawn = shapely.union(drawn, shape.boundary, grid_size=GRID)
        quads = []
        for line in shapely.get_parts(edges):
            corners = shapely.get_coordinates(line)
            for a, b in pairwise(corners):
                left = np.array([a[1] - b[1], b[0] - a[0]]) / np.linalg.norm(b - a)
                is_inside = shape.contains(shapely.Point((a + b) / 2 + SAME_PLANE * left))
                if is_inside == faces_in:
                    a, b = b, a
                p, q = plane.points(np.stack([a, b]))
                back = depth * plane.normal
                quads.append([p, q, q - back, p - back])
        if quads:
            out.append((np.array(quads), f"reveals of {window.place}"))
    return out


def _each_in(plane: Plane, quads: np.ndarray) -> np.ndarray:
    """Quads (quad, 4, 3) in a plane, as shapely's polygons (quad,) [m]."""
    flat = quads - plane.corner
    polygons: np.ndarray = shapely.polygons(np.stack([flat @ plane.u, flat @ plane.v], axis=-1))
    return polygons


def _in_plane(layer: Layer, plane: Plane) -> tuple[np.ndarray, np.ndarray]:
    """Indices of a layer's quads in a plane, and their areas, negative if they show it their back.

    Areas are in m², both arrays of shape (quad,).
    """
    vectors = np.cross(layer.quads[:, 2] - layer.quads[:, 0], layer.quads[:, 3] - layer.quads[:, 1])
    length, along = np.linalg.norm(vectors, axis=1), vectors @ plane.normal
    off = np.abs((layer.quads - plane.corner) @ plane.normal).max(axis=1, initial=0.0)
    near = (length > 0) & (np.abs(along) > (1 - SAME_PLANE) * length) & (off < 2 * SAME_PLANE)
    return np.flatnonzero(near), along[near] / 2


def _area_in(layer: Layer, plane: Plane) -> float:
    """Area of a layer in a plane [m²]."""
    return float(np.abs(_in_plane(layer, plane)[1]).sum())


def material_in(layer: Layer, plane: Plane) -> Lambertian:
    """Material of a diffuse layer in a plane, which mirrors nothing, with the plane's front."""
    assert isinstance(layer.material, Lambertian)
    front, back = layer.material.sides
    is_turned = _in_plane(layer, plane)[1].sum() < 0
    return two_sided(*map(Lambertian, (back, front) if is_turned else (front, back)))


def materials_around(model: Model, quads: np.ndarray) -> dict[Lambertian, str]:
    """Diffuse surfaces that touch a pane in its plane, by their material, with a name of each.

    The fronts of the materials are that of the pane, quads (quad, 4, 3) in one plane [m].
    """
    plane = Plane.of(quads[np.argmax(areas(quads))])
    shape, around = shape_in(plane, quads), dict[Lambertian, str]()
    for layer in model.layers:
        if layer.role == "surface" and isinstance(layer.material, Lambertian):
            near, _ = _in_plane(layer, plane)
            if shapely.dwithin(_each_in(plane, layer.quads[near]), shape, 2 * SAME_PLANE).any():
                around.setdefault(material_in(layer, plane), layer.name)
    return around


def _without(layer: Layer, plane: Plane, shape: Any) -> Layer:
    """Layer without a shape in a plane: quads that it touches become the wall around it."""
    near, along = _in_plane(layer, plane)
    shared = shapely.intersection(_each_in(plane, layer.quads[near]), shape)
    touched = near[shapely.area(shared) > GRID]
    if not len(touched):
        return layer
    rest = shapely.difference(shape_in(plane, layer.quads[touched]), shape, grid_size=GRID)
    polygons = plane.rings(shapely.simplify(rest, GRID), GRID)
    if along[near == touched[0]] < 0:
        polygons = [tuple(ring[::-1] for ring in rings) for rings in polygons]
    place = layer.place(int(touched[0]))
    kept = np.delete(np.arange(len(layer.quads)), touched)
    left = replace(layer, quads=layer.quads[kept], polygon=layer.polygon[kept])
    return _joined(left, [(quads_of(rings[0], rings[1:]), place) for rings in polygons])


def _holds(layer: Layer, name: str) -> bool:
    """Whether a layer holds panes of a name that always stand as they are."""
    return layer.name == name and layer.role == "pane" and not (layer.group or layer.stands_in)


def _joined(layer: Layer, polygons: Sequence[tuple[np.ndarray, str]]) -> Layer:
    """Layer with further polygons: quads (quad, 4, 3) [m] and place of each."""
    first = max(len(layer.places), int(layer.polygon.max(initial=-1)) + 1)
    known = (*layer.places, *layer.places[-1:] * (first - len(layer.places)))
    count = [len(quads) for quads, _ in polygons]
    return replace(
        layer,
        quads=np.concatenate([layer.quads, *(quads for quads, _ in polygons)]),
        polygon=np.concatenate([layer.polygon, np.repeat(first + np.arange(len(count)), count)]),
        places=(*known, *(place for _, place in polygons)),
    )
