"""Upright surfaces of a model by the plane that they lie in, and shapes in such planes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from drcmitsuba.model.materials import Lambertian
from drcmitsuba.model.model import Layer, Model, areas
from drcmitsuba.model.plane import Plane
from drcmitsuba.model.windows import GRID, SAME_PLANE, shape_in
from drcmitsuba.runtime import lazy
from drcmitsuba.scene.geometry import normals

sparse, csgraph = lazy.module("scipy.sparse"), lazy.module("scipy.sparse.csgraph")
spatial = lazy.module("scipy.spatial")

UPRIGHT = 0.02
"""Largest vertical part of an upright wall's normal [–]."""
LEAST = 0.01
"""Area of the smallest wall [m²]."""


@dataclass(frozen=True, eq=False)
class PlaneSurfaces:
    """Surfaces of a model in one plane."""

    plane: Plane
    quads: Mapping[int, np.ndarray]
    """Indices of the quads in the plane, by layer."""

    def shape(self, model: Model, layer: int) -> Any:
        """Union of a layer's quads in the plane, as shapely's geometry [m]."""
        return shape_in(self.plane, model.layers[layer].quads[self.quads[layer]])


def upright_plane(corner: np.ndarray, outward: np.ndarray) -> Plane:
    """Plane through a corner (3,) [m]; seen from outside, u goes to the right, and v up."""
    u = np.cross([0.0, 0.0, 1.0], outward)
    u /= np.linalg.norm(u)
    return Plane(outward * (corner @ outward), u, np.cross(outward, u), outward)


def upright_planes(model: Model) -> list[PlaneSurfaces]:
    """Upright surfaces and panes of a model, without its context, by plane."""
    members: list[tuple[int, np.ndarray]] = []
    for i, layer in enumerate(model.layers):
        if layer.role != "context":
            n, size = _normals(layer.quads)
            members.append((i, np.flatnonzero((size > GRID) & (np.abs(n[:, 2]) < UPRIGHT))))
    of_layer = np.repeat([i for i, _ in members], [len(some) for _, some in members])
    index = np.concatenate([np.zeros(0, int), *(some for _, some in members)])
    if not len(index):
        return []
    quads = np.concatenate([model.layers[i].quads[some] for i, some in members])
    n, size = _normals(quads)
    n = n * np.where(n @ [0.61, 0.77, 0.0] < 0, -1, 1)[:, None]
    start = quads.min(axis=(0, 1))
    keys = np.column_stack([n, np.einsum("qi,qi->q", n, quads[:, 0] - start)]) / SAME_PLANE
    rough, place = np.unique(np.round(keys), axis=0, return_inverse=True)
    pairs = spatial.cKDTree(rough).query_pairs(1.8, output_type="ndarray").T
    links = sparse.coo_matrix((np.ones(pairs.shape[1], bool), pairs), (len(rough), len(rough)))
    number = csgraph.connected_components(links, directed=False)[1][place.ravel()]
    planes = []
    for k in range(number.max() + 1):
        mine = np.flatnonzero(number == k)
        largest = mine[np.argmax(size[mine])]
        plane = upright_plane(quads[largest, 0], n[largest])
        by_layer = {i: index[mine[of_layer[mine] == i]] for i in np.unique(of_layer[mine]).tolist()}
        planes.append(PlaneSurfaces(plane, by_layer))
    return planes


def is_wall(layer: Layer) -> bool:
    """Whether a layer is opaque, diffuse and always stands."""
    changes = layer.group or layer.stands_in or layer.states
    return layer.role == "surface" and isinstance(layer.material, Lambertian) and not changes


def _normals(quads: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (quad, 3), and areas (quad,) [m²]."""
    size = areas(quads)
    n = np.zeros((len(quads), 3))
    some = size > 0
    n[some] = normals(quads[some])
    return n, size


def common(one: Any, other: Any) -> Any:
    """Polygons that two shapes share; lines where they only touch are left out."""
    both = shapely.intersection(one, other, grid_size=GRID)
    parts = [p for p in shapely.get_parts(both) if p.geom_type == "Polygon"]
    return shapely.MultiPolygon(parts)


def filled(shape: Any) -> Any:
    """Shape without its holes."""
    return shapely.union_all([shapely.Polygon(p.exterior) for p in shapely.get_parts(shape)])
