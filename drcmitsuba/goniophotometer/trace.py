"""Light through one period of a structure that is repeated without end.

A ray that leaves the period at one side enters at the opposite one; the distance to the border is
computed, there are no walls. Rays travel with the light (`TransportMode.Importance`), so refracted
and reflected light of a clear dielectric sum to the incident light.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.runtime.flat_arrays import flat_indices
from drcmitsuba.runtime.progress import Progress
from drcmitsuba.runtime.random_streams import even_numbers
from drcmitsuba.scene.materials import bsdf
from drcmitsuba.scene.meshes import mesh, quad_mesh
from drcmitsuba.scene.mitsuba_scenes import mitsuba_scene
from drcmitsuba.scene.structures.recipe import Glass
from drcmitsuba.scene.structures.structure import UnitCell, copies

OFFSET = 1e-5
"""Distance by which rays start off a surface to avoid meeting it again [period]."""
MARGIN = 0.01
"""Distance from the structure at which rays begin and end [period]."""
MOST_STEPS = 5000
"""Largest number of surfaces and borders that a ray meets; longer rays are lost."""
MOST_LANES = 1 << 20
"""Largest number of rays of one kernel."""
MOST_COUNTERS = 1 << 24
"""Largest number of counters, one for each pair of cells, of one kernel."""
ROULETTE_WEIGHT = 0.25
"""Weight below which rays go on with probability weight / ROULETTE_WEIGHT."""
BESIDE = 1e-6
"""Distance by which light in the plane of incidence is moved off the border of two cells."""


@dataclass(frozen=True)
class TracedPeriod:
    """Unit cell as Mitsuba traces it, in units of its longer period."""

    scene: mi.Scene
    """Structure with all repetitions that reach into one period, and its glass."""
    corner: tuple[float, ...]
    period: tuple[float, ...]
    """Lowest coordinates of the period and its lengths, along x and y."""
    bounds: tuple[float, ...]
    """Coordinates z of the planes, outside and room, where rays begin and end."""
    extruded: bool
    """Whether the structure is the same along x: rays are cast in its cross-section only."""


def _border(positions: np.ndarray, period: float) -> float:
    """Coordinate at which a period may begin, as far as possible from faces parallel to its border.

    A ray would meet such a face and the border at once, and light would leak.
    """
    at = np.sort(np.unique(np.mod(positions, period)))
    if not len(at):
        return 0.0
    gaps = np.diff(np.append(at, at[0] + period))
    widest = int(gaps.argmax())
    return float(np.mod(at[widest] + gaps[widest] / 2, period))


def _repeated(
    unit: UnitCell, vertices: np.ndarray, period: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices and faces of all surfaces that reach into a period, and its lowest x and y (2,)."""
    corners = vertices[unit.faces]
    spread = np.ptp(corners, axis=1)
    corner = np.zeros(2)
    shifts = [range(1), range(1)]
    for axis in (1,) if unit.extruded else (0, 1):
        flat = corners[spread[:, axis] < 1e-4, 0, axis]
        corner[axis] = _border(flat, period[axis])
        low, high = vertices[:, axis].min(), vertices[:, axis].max()
        shifts[axis] = copies(low - 0.01, high + 0.01, corner[axis], period[axis])
    moves = np.array([[i * period[0], j * period[1], 0] for i in shifts[0] for j in shifts[1]])
    faces = unit.faces[None] + len(vertices) * np.arange(len(moves))[:, None, None]
    return (vertices[None] + moves[:, None]).reshape(-1, 3), faces.reshape(-1, 3), corner


def _pane(
    glass: Glass, z: float, corner: np.ndarray, period: np.ndarray, extruded: bool
) -> mi.Mesh:
    """Glass in the plane z that covers the period and half of each neighbouring one."""
    x = [-1.0, 1.0] if extruded else corner[0] + period[0] * np.array([-0.5, 1.5])
    y = corner[1] + period[1] * np.array([-0.5, 1.5])
    quad = np.array([[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]])
    material = {"type": "glazing", "reflectance_front": glass.reflectance}
    material |= {"transmittance": glass.transmittance, "exponent": glass.exponent}
    return quad_mesh("glass", quad[None], mi.load_dict(material))


def prepare(unit: UnitCell) -> TracedPeriod:
    """Scale a unit cell to a period of 1 and load it with its repetitions and its glass."""
    scale = 1 / (unit.period[1] if unit.extruded else unit.period.max())
    # Subtracted, whatever the recipe's origin: float32 is finest about zero.
    v = unit.vertices - [0, 0, unit.vertices[:, 2].min()]
    v = v * ([1, scale, scale] if unit.extruded else scale)
    period = unit.period * scale
    vertices, faces, corner = _repeated(unit, v, period)
    shapes = {"structure": mesh("structure", vertices, faces, mi.load_dict(bsdf(unit.material)))}
    bounds = [v[:, 2].min() - MARGIN, v[:, 2].max() + MARGIN]
    if unit.glass is not None:
        z = v[:, 2].min() - unit.glass.distance * scale
        bounds[0] = z - MARGIN
        shapes["glass"] = _pane(unit.glass, z, corner, period, unit.extruded)
    scene = mitsuba_scene(shapes)
    start, length, ends = (tuple(map(float, pair)) for pair in (corner, period, bounds))
    return TracedPeriod(scene, start, length, ends, unit.extruded)


@symbolic
def follow(
    cell: TracedPeriod, sampler: mi.Sampler, p: mi.Point3f, d: mi.Vector3f
) -> tuple[mi.Vector3f, mi.Float, mi.Bool]:
    """Follow rays from surface to surface until they leave the structure.

    A step ends at a surface, where the BSDF is sampled; at a border of the period, beyond which
    the ray goes on from the opposite one; or at one of the planes `bounds`, where it leaves.

    Parameters
    ----------
    sampler : mi.Sampler
        Seeded for as many lanes as there are rays.
    p : mi.Point3f
        Origin of each ray [period].
    d : mi.Vector3f
        Direction of travel, a unit vector.

    Returns
    -------
    d : mi.Vector3f
        Direction in which the light leaves.
    weight : mi.Float
        Share of the light that was not absorbed.
    lost : mi.Bool
        Whether the light is still inside after `MOST_STEPS` surfaces and borders.
    """
    ctx = mi.BSDFContext(mi.TransportMode.Importance)
    flags = mi.RayFlags.Minimal | mi.RayFlags.ShadingFrame
    scene = cell.scene
    ends = [cell.corner[axis] + cell.period[axis] for axis in range(2)]
    low = mi.Point3f(*(dr.opaque(mi.Float, v) for v in (*cell.corner, cell.bounds[0])))
    high = mi.Point3f(*(dr.opaque(mi.Float, v) for v in (*ends, cell.bounds[1])))
    # An extruded structure is the same at any x: rays are cast in its cross-section.
    seen = mi.Vector3f(0, 1, 1) if cell.extruded else mi.Vector3f(1, 1, 1)
    p, d = mi.Point3f(p), mi.Vector3f(d)
    weight, step, active = mi.Float(1), mi.UInt32(0), mi.Bool(True)
    while dr.hint(active, exclude=[scene, ctx, cell]):
        cast = dr.normalize(d * seen)
        ahead = (dr.select(cast > 0, high, low) - p) / cast
        ahead = dr.select(cast == 0, dr.inf, dr.maximum(ahead, 0))
        border = dr.minimum(ahead.x, ahead.y)
        ray = mi.Ray3f(p, cast)
        ray.maxt = dr.minimum(border, ahead.z)
        si = scene.ray_intersect(ray, flags, coherent=False, active=active)
        met = active & si.is_valid()
        si.wi = si.to_local(-d)
        bs, w = si.bsdf().sample(ctx, si, sampler.next_1d(met), sampler.next_2d(met), met)
        onward = dr.normalize(si.to_world(bs.wo))
        left = active & ~met & (ahead.z <= border)
        moved = p + cast * ray.maxt
        # Borders are set, not added: a ray must not miss the period by a rounding.
        over_x = ahead.x <= ahead.y
        enter = dr.select(cast > 0, low, high)
        wrapped = mi.Point3f(
            dr.select(over_x, enter.x, moved.x), dr.select(over_x, moved.y, enter.y), moved.z
        )
        off = si.p + si.n * dr.copysign(mi.Float(OFFSET), dr.dot(si.n, onward))
        weight = dr.select(met, weight * w[0], weight)
        d = dr.select(met, onward, d)
        p = dr.select(met, off, wrapped)
        step += 1
        active &= ~left & (weight > 0) & (step < MOST_STEPS)
        survives = sampler.next_1d(active) * ROULETTE_WEIGHT < weight
        weak = met & active & (weight < ROULETTE_WEIGHT)
        weight = dr.select(weak, dr.select(survives, ROULETTE_WEIGHT, 0), weight)
        active &= weight > 0
    lost = (step >= MOST_STEPS) & (weight > 0)
    return d, weight, lost


def _start(
    cell: TracedPeriod, from_side: int, at: mi.Point2f, u: mi.Float, v: mi.Float
) -> tuple[mi.Point3f, mi.Vector3f]:
    """Origin at (u, v) of the period before the structure; direction from a point of the disk."""
    z = dr.sqrt(dr.maximum(1 - dr.squared_norm(at), 0))
    d = mi.Vector3f(at.x, at.y, -from_side * dr.maximum(z, 1e-5))
    x = 0 if cell.extruded else cell.corner[0] + u * cell.period[0]
    y = cell.corner[1] + v * cell.period[1]
    return mi.Point3f(x, y, cell.bounds[0 if from_side < 0 else 1]), dr.normalize(d)


def _incidence(
    rank: int, n: int, incident: mi.UInt32, a: mi.Float, b: mi.Float
) -> tuple[mi.Point2f, mi.Float, mi.Float]:
    """Point of the unit disk within an incident cell, and sine and cosine of its azimuth.

    A cell of rank 4 is a square of side 1/n, with azimuth 0; a cell of rank 3 is a ring.
    """
    if rank == 4:
        s, t = (mi.Float(incident // n) + a) / n, (mi.Float(incident % n) + b) / n
        at = mi.warp.square_to_uniform_disk_concentric(mi.Point2f(s, t))
        return at, mi.Float(0), mi.Float(1)
    radius = 1 - 2 * (mi.Float(incident) + a) / n
    sin, cos = dr.sincos(dr.two_pi * b)
    return mi.Point2f(radius * cos, radius * sin), sin, cos


def _launch(
    cell: TracedPeriod, from_side: int, rank: int, n: int, cells: np.ndarray, samples: int,
    seed: int,
) -> tuple[np.ndarray, float]:  # fmt: skip
    """Trace some incident cells: their `shares` (cell, 2, n²), and the weight lost [rays]."""
    lanes, per_cell = len(cells) * samples, dr.opaque(mi.UInt32, samples)
    lane = dr.arange(mi.UInt32, lanes)
    slot, index = lane // per_cell, lane % per_cell
    incident = dr.gather(mi.UInt32, flat_indices(cells), slot)
    number = [x for pair in (0, 1) for x in even_numbers(index, incident, seed, pair)]
    at, sin, cos = _incidence(rank, n, incident, number[0], number[1])
    p, d = _start(cell, from_side, at, number[3], number[2])
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, lanes)
    d, weight, lost = follow(cell, sampler, p, d)
    out = mi.Point2f(cos * d.x + sin * d.y, cos * d.y - sin * d.x)
    if rank == 3:
        # Isotropic structures are their own mirror images. Undeviated light falls on the border
        # of two cells, so each gets a half instead of a share that rounding decides.
        mirror = dr.select((lane & 1) == 0, mi.Float(1), -1)
        out.y = mirror * (out.y + BESIDE)
    square = mi.warp.uniform_disk_to_square_concentric(out)
    column = [dr.minimum(mi.UInt32(dr.maximum(c, 0) * n), n - 1) for c in square]
    reflected = dr.select(d.z * from_side > 0, mi.UInt32(1), mi.UInt32(0))
    target = ((slot * 2 + reflected) * n + column[0]) * n + column[1]
    counts = dr.zeros(mi.Float64, len(cells) * 2 * n * n)
    dr.scatter_add(counts, mi.Float64(weight), target, ~lost)
    given_up = dr.sum(dr.select(lost, mi.Float64(weight), 0))
    dr.eval(counts, given_up)
    return counts.numpy().reshape(len(cells), 2, n * n) / samples, float(given_up[0])


def shares(
    cell: TracedPeriod, from_side: int, *, rank: int, depth: int, samples: int, seed: int,
    progress: Progress,
) -> tuple[np.ndarray, float]:  # fmt: skip
    """Trace the light of every incident cell to the outgoing cells.

    Parameters
    ----------
    from_side : int
        −1 for light from outside, 1 for light from the room.
    rank, depth : int
        Rank and levels of the tree: n = 2ᵈᵉᵖᵗʰ cells along each side of the square of directions.
    samples : int
        Number of rays per incident cell.
    progress : callable
        Called with the share of the incident cells that are done, 0 to 1.

    Returns
    -------
    shares : np.ndarray, shape (2, incident, n²)
        Shares of the incident light that are transmitted and reflected into each outgoing cell.
        Incident cells are n² cells of the square (rank 4) or n/2 rings from grazing to normal
        (rank 3).
    lost : float
        Share of the light that was still inside after `MOST_STEPS` steps.
    """
    n = 1 << depth
    incident = n * n if rank == 4 else n // 2
    block = max(1, min(MOST_LANES // samples, MOST_COUNTERS // (2 * n * n)))
    result = np.zeros((2, incident, n * n), np.float32)
    given_up = 0.0
    for start in range(0, incident, block):
        cells = np.arange(start, min(start + block, incident))
        counts, lost = _launch(cell, from_side, rank, n, cells, samples, seed * 4096 + start)
        result[:, cells] = counts.transpose(1, 0, 2)
        given_up += lost
        progress(min(1.0, (start + block) / incident))
    return result, given_up / (incident * samples)
