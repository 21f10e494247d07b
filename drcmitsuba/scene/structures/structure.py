"""One period of a recipe's surfaces, as plain geometry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drcmitsuba.model.materials import DielectricMaterial, MirrorMaterial
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.structures.mesh import read_mesh
from drcmitsuba.scene.structures.polygon import cross
from drcmitsuba.scene.structures.recipe import Glass, Lamellae, Mesh, Opaque, Prism, Recipe, Slots

ARC_STEP = 0.5
"""Largest angle by which an arc turns from facet to facet [deg]."""
SAME = 1e-6
"""Corners closer than this fraction of the period count as one."""
MOST_EDGES = 1500
MOST_PERIODS = 20
"""Largest extent of the surfaces of one period [period]."""
MOST_TRIANGLES = 4_000_000


StructureMaterial = MirrorMaterial | DielectricMaterial


@dataclass(frozen=True)
class UnitCell:
    """One period of a structure."""

    vertices: np.ndarray
    """x, y, z [mm], shape (vertex, 3); x of an extruded structure is −1 or 1 and has no meaning."""
    faces: np.ndarray
    """Vertices of each triangle, counter-clockwise as seen from the air, shape (face, 3)."""
    period: np.ndarray
    """Distances from one repetition to the next along x and y [mm], shape (2,)."""
    extruded: bool
    """Whether the structure is the same along all of x."""
    material: StructureMaterial
    glass: Glass | None = None

    @property
    def thickness(self) -> float:
        """Extent along z [mm], without the glass."""
        return float(np.ptp(self.vertices[:, 2]))


def _opaque(s: Lamellae | Opaque) -> MirrorMaterial:
    return MirrorMaterial(type="mirror", reflectance=s.reflectance, specular=s.specular)


def _facets(turn: float = 0.0) -> int:
    """Number of facets that an arc is cut into."""
    return max(1, int(np.ceil(abs(turn) / ARC_STEP)))


def arc(start: np.ndarray, end: np.ndarray, turn: float) -> np.ndarray:
    """Points (k, 2) from start to before end on an arc that turns left by `turn` degrees."""
    k = _facets(turn)
    if k == 1:
        return start[None]
    chord = end - start
    angle = np.radians(turn)
    radius = np.hypot(*chord) / (2 * np.sin(angle / 2))
    tangent = np.arctan2(chord[1], chord[0]) - angle / 2 + angle * np.arange(k) / k
    step = [np.sin(tangent) - np.sin(tangent[0]), np.cos(tangent[0]) - np.cos(tangent)]
    return start + radius * np.stack(step, axis=1)


def _closed(corners: tuple[tuple[float, ...], ...]) -> np.ndarray:
    """Edges (edge, 2, 2) of a polygon in (z, y), counter-clockwise, arcs cut into facets."""
    at = np.array([c[:2] for c in corners], float)
    after = np.roll(at, -1, axis=0)
    sense = np.sign(cross(at, after).sum()) or 1.0
    turns = [c[2] if len(c) > 2 else 0.0 for c in corners]
    pieces = [arc(a, b, sense * t) for a, b, t in zip(at, after, turns, strict=True)]
    points = np.concatenate(pieces)
    if sense < 0:
        points = points[::-1]
    return np.stack([points, np.roll(points, -1, axis=0)], axis=1)


def _outer(edges: np.ndarray, period: float) -> np.ndarray:
    """Edges without those that neighbours, or neighbouring periods, share back to back."""
    middle = edges.mean(axis=1)[:, 1]
    shift = np.floor(middle / period + SAME) * period
    return edges[alone(edges - np.stack([0 * shift, shift], axis=1)[:, None], period)]


def alone(edges: np.ndarray, period: float) -> np.ndarray:
    """Whether each edge (edge, 2, 2) lies back to back with no other edge, shape (edge,)."""
    whole = np.round(edges / (period * SAME)).astype(np.int64)
    keys = [tuple(e) for e in whole.reshape(-1, 4).tolist()]
    known = set(keys)
    return np.array([(*key[2:], *key[:2]) not in known for key in keys])


def _crossing(a: np.ndarray, b: np.ndarray, tolerance: float) -> bool:
    """Whether some edge of a properly crosses one of b; edges that only touch do not."""
    p, r = a[:, None, 0], a[:, None, 1] - a[:, None, 0]
    q, s = b[None, :, 0], b[None, :, 1] - b[None, :, 0]
    apart = []  # the ends of one edge lie on both sides of the other
    for along, ends in ((r, (q - p, q + s - p)), (s, (p - q, p + r - q))):
        side = [cross(along, end) for end in ends]
        limit = tolerance * np.hypot(along[..., 0], along[..., 1])
        apart.append((np.minimum(*side) < -limit) & (np.maximum(*side) > limit))
    return bool((apart[0] & apart[1]).any())


def copies(low: float, high: float, start: float, period: float) -> range:
    """Shifts [period] that bring the interval from low to high into the period at `start`."""
    return range(int(np.ceil((start - high) / period)), int((start + period - low) // period) + 1)


def _check_crossing(source: str, edges: np.ndarray, period: float) -> None:
    low, high = edges[..., 1].min(), edges[..., 1].max()
    if (high - low) / period > MOST_PERIODS:
        got = f"reaches over {(high - low) / period:.0f} periods"
        raise InputError(source, "structure", got, "give one period")
    for k in range(int((high - low) // period) + 1):
        if _crossing(edges, edges + [0, k * period], SAME * period):
            where = "itself" if k == 0 else "its repetition"
            remedy = "correct the corners or give a longer period"
            raise InputError(source, "structure", f"the outline crosses {where}", remedy)


def _extruded(
    edges: np.ndarray, period: float, material: StructureMaterial, glass: Glass | None
) -> UnitCell:
    """Unit cell of edges (edge, 2, 2) in (z, y), with air on the right-hand side of each."""
    a, b = edges[:, 0], edges[:, 1]
    ends = [np.stack([np.full(len(e), x), e[:, 1], e[:, 0]], axis=1)
            for x, e in ((-1.0, a), (1.0, a), (1.0, b), (-1.0, b))]  # fmt: skip
    first = 4 * np.arange(len(edges))[:, None]
    faces = np.concatenate([first + [0, 1, 2], first + [0, 2, 3]])
    vertices = np.stack(ends, axis=1).reshape(-1, 3)
    return UnitCell(vertices, faces, np.array([period, period]), True, material, glass)


def _slot_polygons(s: Slots) -> list[tuple[tuple[float, float], ...]]:
    """Cross-section of a laser-cut panel, the slot in the middle of the period."""
    low, high = (s.period - s.slot) / 2, (s.period + s.slot) / 2
    back = s.thickness - s.depth
    if back <= SAME * s.period:
        bottom = high - s.period  # of the piece between two slots, about the period's border
        return [((0, bottom), (s.thickness, bottom), (s.thickness, low), (0, low))]
    return [(
        (0, 0), (s.thickness, 0), (s.thickness, low), (back, low),
        (back, high), (s.thickness, high), (s.thickness, s.period), (0, s.period),
    )]  # fmt: skip


def _from_mesh(recipe: Recipe, s: Mesh) -> UnitCell:
    """Unit cell of a mesh file; a clear mesh has to be closed, with normals outward."""
    file = recipe.path(s.file)
    vertices, faces = read_mesh(file)
    used, numbers = np.unique(faces, return_inverse=True)  # unused vertices would be repeated
    vertices, faces = vertices[used] * s.scale, numbers.reshape(faces.shape)
    extent = np.ptp(vertices, axis=0)[:2] / s.period
    repeated = len(faces) * np.prod(np.ceil(extent) + 1)
    if extent.max() > MOST_PERIODS or repeated > MOST_TRIANGLES:
        got = f"{len(faces)} triangles over {extent.max():.0f} periods"
        raise InputError(file, "mesh", got, "give one period, coarser, or check the scale")
    if isinstance(s.material, Opaque):
        material: StructureMaterial = _opaque(s.material)
    else:
        material = DielectricMaterial(type="dielectric", ior=s.material.n)
        a, b, c = (vertices[faces[:, i]] for i in range(3))
        # Sides that a neighbour closes are upright: only the area seen along z has to balance.
        area = cross(b[:, :2] - a[:, :2], c[:, :2] - a[:, :2]) / 2
        if abs(area.sum()) > 1e-3 * abs(area).sum():
            remedy = "give a mesh that is closed but for the borders of its period"
            raise InputError(file, "mesh", "the surface is not closed", remedy)
        if (area * (a + b + c)[:, 2]).sum() < 0:
            raise InputError(file, "mesh", "the normals point inward", "turn the faces over")
    return UnitCell(vertices, faces, np.array(s.period), False, material, recipe.glass)


def _check_distance(recipe: Recipe, period: float) -> None:
    """Refuse glass so close that rays would skip it, or so far that grazing rays are lost."""
    low, high = period / 100, period * 50
    if recipe.glass is not None and not low <= recipe.glass.distance <= high:
        got = f"{recipe.glass.distance:g} mm"
        remedy = f"give {low:g} to {high:g}, a hundredth to fifty periods"
        raise InputError(recipe.source, "glass.distance", got, remedy)


def unit_cell(recipe: Recipe) -> UnitCell:
    """Make the surfaces of a recipe.

    Raises
    ------
    InputError
        An outline crosses itself or its repetition or has no outer edge, or a mesh is unfit.
    """
    s = recipe.structure
    _check_distance(recipe, max(s.period) if isinstance(s, Mesh) else s.period)
    if isinstance(s, Mesh):
        return _from_mesh(recipe, s)
    edges = np.concatenate(outlines(recipe))
    if isinstance(s, Lamellae):
        _check_crossing(recipe.source, edges, s.period)
        return _extruded(edges, s.period, _opaque(s), recipe.glass)
    edges = _outer(edges, s.period)
    if len(edges) == 0:
        raise InputError(recipe.source, "structure.polygons", "no surface", "give a cross-section")
    _check_crossing(recipe.source, edges, s.period)
    clear = DielectricMaterial(type="dielectric", ior=s.n)
    return _extruded(edges, s.period, clear, recipe.glass)


def outlines(recipe: Recipe) -> list[np.ndarray]:
    """Cross-section of an extruded structure: edges (edge, 2, 2) in (z, y) of each part [mm].

    A part of a clear structure is a closed polygon, counter-clockwise; slats are open.
    """
    s = recipe.structure
    assert not isinstance(s, Mesh)
    if isinstance(s, Lamellae):
        direction = np.array([np.cos(np.radians(s.tilt)), np.sin(np.radians(s.tilt))])
        ends = np.array([-0.5, 0.5])[:, None] * s.width * direction
        points = np.concatenate([arc(ends[0], ends[1], -s.turn), ends[1:]])
        return [np.stack([points[:-1], points[1:]], axis=1)]
    polygons = s.polygons if isinstance(s, Prism) else _slot_polygons(s)
    count = sum(_facets(*corner[2:]) for polygon in polygons for corner in polygon)
    if count > MOST_EDGES:
        got = f"{count} edges, arcs resolved"
        raise InputError(recipe.source, "structure.polygons", got, f"give at most {MOST_EDGES}")
    return [_closed(p) for p in polygons]
