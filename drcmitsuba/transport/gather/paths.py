"""Gather: paths from the sensors backward through the room to diffuse surfaces.

With D[cell, bin] the irradiance that a bin of unit radiance puts on a cell before any diffuse
reflection, the interreflected coefficient of a sensor is

    C[sensor, bin] = Σ_cell G[sensor, cell] · D[cell, bin],

and G is estimated by paths whose directions follow the cosine law and the BSDFs: every diffuse
vertex adds its throughput (1/paths × the product of the albedos up to and with it) to its cell.
Sources are not collected: a path that leaves the scene adds nothing.
"""

from __future__ import annotations

from typing import Protocol

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.sampling import streams
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.model.materials import Lambertian
from drcmitsuba.runtime.flat_arrays import flat, flat_indices, row_and_column
from drcmitsuba.runtime.random_streams import even_numbers
from drcmitsuba.scene.materials import ends_paths, max_reflectance
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.cells.cells import CellGrid
from drcmitsuba.transport.cells.vertices import VertexStore, Vertices
from drcmitsuba.transport.rays.bsdf_lookup import absorption, absorption_after, share_left
from drcmitsuba.transport.rays.even_rays import first_directions
from drcmitsuba.transport.rays.first_hit import InBox

ROULETTE_DEPTH = 3
"""Depth from which paths undergo roulette."""
ANY_DEPTH = 1 << 31
MOST_SURVIVAL = 0.999
"""Largest survival probability of a path.

A survivor's weight is divided by the probability. Where the reflectance exceeds the root of the
probability the variance grows without bound: at 0.95, rooms of a reflectance above 0.975 lost
light, up to four fifths, with no sign of it in the standard error. The bound serves rooms of
reflectance 1, which no path leaves.
"""
USUAL = 5.0
"""Number of vertices per path that memory is reserved for first: 1 / (1 − 0.8)."""
WHITE = 0.85
"""Reflectance of a surface above which the vertices of `PILOT` sensors are counted first."""
PILOT = 16
_APART = 0x9E3779B1
"""Distance between the numbers of a path's vertices, where rows have numbers of their own."""


class Marks(Protocol):
    """Marks: one number per path that stores the surfaces that it met; 0 at the start."""

    context: mi.BSDFContext
    """Lobes that are followed."""

    def meet(
        self, si: mi.SurfaceInteraction3f, mark: mi.UInt32, number: mi.Float
    ) -> tuple[mi.BSDFPtr, mi.UInt32, mi.Float, mi.Bool, mi.Bool]:
        """Scatter at a surface.

        Parameters
        ----------
        mark : mi.UInt32
            Mark of the path so far.
        number : mi.Float
            Uniform in [0, 1).

        Returns
        -------
        bsdf : mi.BSDFPtr
            BSDF that scatters the path.
        mark : mi.UInt32
            Mark with this surface.
        weight : mi.Float
            Factor of the path's throughput; 0 ends the path.
        may_be_cell : mi.Bool
            Whether light is deposited on the surface where it reflects diffusely.
        scatters : mi.Bool
            Whether light is deposited on the surface wherever it reflects: light counts as if it
            came from all directions alike.
        """


class Crossings(Protocol):
    """Windows that paths pass on their way out; the first one becomes the mark of a path."""

    def mark(self, ray: mi.Ray3f, t: mi.Float, mark: mi.UInt32, active: mi.Bool) -> mi.UInt32:
        """Mark paths that leave by a window within the distance t [m]; 0 stands for none so far."""


def gather(
    scene: Scene, points: np.ndarray | mi.Float, normals: np.ndarray | mi.Float, *,
    replicates: int, paths: int, grid: CellGrid, seed: int, marks: Marks | None = None,
    bounces: float = USUAL, first: int = 0, among: int | None = None,
    within: np.ndarray | mi.UInt32 | None = None, once: bool = False,
    numbers: mi.UInt32 | None = None, crossings: Crossings | None = None,
) -> Vertices:  # fmt: skip
    """Trace the paths of all sensors and replicates and keep their diffuse vertices.

    Parameters
    ----------
    points, normals : np.ndarray, shape (sensor, 3), or mi.Float
        Positions [m] and unit normals of the sensors; on the device, three numbers a sensor.
    replicates : int
        Independent repetitions; row r·sensors + s belongs to replicate r and sensor s.
    paths : int
        Paths per sensor and replicate.
    grid : Grid
        Grid of the cells.
    marks : Marks, optional
        Rule that marks every vertex with the surfaces of its path.
    bounces : float
        Expected vertices per path, see `expected_bounces`.
    first, among : int, optional
        Index of the first of these sensors, and the number of all sensors: paths are the same in
        one launch and in several.
    within : int, shape (sensor,), optional
        Number of the room of a model in which each sensor lies, from 1 on, 0 outside; the vertices
        then say it, too.
    once : bool
        Whether paths end at their first diffuse vertex; every path then has one entry, in order,
        of weight 0 where it met none.
    numbers : mi.UInt32, optional
        Seeds of the rows' random numbers, independent of the launch.
    crossings : Crossings, optional
        Rule that marks every vertex with the window that its path has left by.

    Returns
    -------
    Vertices
    """
    if scene.effects.depth == 0:
        number, value = mi.UInt32(), mi.Float()
        return Vertices(number, value, number, number, value, value, number, number)
    p, n = flat(points), flat(normals)
    count = dr.width(p) // 3
    lanes = replicates * count * paths
    capacity = lanes if once else int(bounces * lanes)
    while True:
        vertices, met = _trace(
            scene, p, n, count, lanes, paths, grid, seed, capacity, marks,
            first, among or count, within, once, numbers, crossings,
        )  # fmt: skip
        if met <= capacity:
            return vertices
        capacity = met  # the same paths once more with room for all vertices


def expected_bounces(
    scene: Scene, points: np.ndarray, normals: np.ndarray, paths: int, grid: CellGrid, seed: int
) -> float:
    """Expected vertices per path, at least `USUAL`; counted where a surface is very white.

    In a closed room of reflectance ρ their number is 1 / (1 − ρ); each takes 40 bytes.
    """
    each = (getattr(part.material, "reflectance", 0.0) for part in scene.parts)
    if len(points) == 0 or max(map(max_reflectance, each), default=0.0) < WHITE:
        return USUAL
    some = np.unique(np.linspace(0, len(points) - 1, PILOT).astype(int))
    met = gather(
        scene, points[some], normals[some], replicates=1, paths=paths, grid=grid, seed=seed
    )
    return max(USUAL, 1.2 * len(met) / (len(some) * paths))


def _numbers(
    sensors: int, lanes: int, paths: int, first: int, among: int
) -> tuple[mi.UInt32, mi.UInt32, mi.UInt32]:
    """Row of every lane, its row among all sensors, which gives the random numbers, and path."""
    lane = dr.arange(mi.UInt32, lanes)
    here = dr.opaque(mi.UInt32, sensors)  # a literal would be compiled anew
    row, index = row_and_column(lane, paths)
    own = row // here * dr.opaque(mi.UInt32, among) + row % here + dr.opaque(mi.UInt32, first)
    return row, own, index


def deviates(flags: mi.UInt32) -> mi.Bool:
    """Whether a BSDF deviates light that it transmits, which gaps and clear glass do not."""
    diffuse = mi.has_flag(flags, mi.BSDFFlags.DiffuseTransmission)
    glossy = mi.has_flag(flags, mi.BSDFFlags.GlossyTransmission)
    return diffuse | glossy | mi.has_flag(flags, mi.BSDFFlags.DeltaTransmission)


def ends_at_once(scene: Scene) -> bool:
    """Whether every path ends at the first surface: a matt one, or a pane that reflects nothing."""
    return all(
        isinstance(part.material, Lambertian)
        or (ends_paths(part.material) and not scene.effects.beyond)
        for part in scene.parts
    )


@symbolic
def _trace(
    scene: Scene, points: mi.Float, normals: mi.Float, sensors: int,
    lanes: int, paths: int, grid: CellGrid, seed: int, capacity: int, marks: Marks | None,
    first: int, among: int, within: np.ndarray | mi.UInt32 | None, once: bool,
    numbers: mi.UInt32 | None, crossings: Crossings | None,
) -> tuple[Vertices, int]:  # fmt: skip
    """Trace all lanes in one symbolic loop: the vertices, and the number that were met."""
    row, own, index = _numbers(sensors, lanes, paths, first, among)
    count = dr.opaque(mi.UInt32, lanes // sensors * among & 0xFFFFFFFF)
    if numbers is not None:
        own, count = dr.gather(mi.UInt32, numbers, row), dr.opaque(mi.UInt32, _APART)
    random, sensor = streams(own, seed, index), row % dr.opaque(mi.UInt32, sensors)
    p = dr.gather(mi.Point3f, points, sensor)
    n = dr.gather(mi.Normal3f, normals, sensor)
    wo = mi.Frame3f(n).to_world(first_directions(index, own, seed))
    told = within is not None
    marked = not (marks is None and crossings is None)
    store = VertexStore(capacity, marked, told, once)
    room = mi.UInt32(0)
    if told:
        room = dr.gather(mi.UInt32, flat_indices(within), sensor)
    ctx = mi.BSDFContext() if marks is None else marks.context
    ray = mi.Ray3f(p, wo)
    beta = mi.Float(1)
    depth, mark = mi.UInt32(0), mi.UInt32(0)
    solids = absorption(scene)
    inside, before = mi.Float(0), mi.Point3f(p)
    active = dr.full(mi.Bool, True, lanes)
    surfaces = InBox.of(scene)
    share = dr.opaque(mi.Float, 1 / paths)
    tag = own * dr.opaque(mi.UInt32, paths) + index
    limit = dr.opaque(mi.UInt32, ANY_DEPTH if scene.effects.depth is None else scene.effects.depth)
    grid.prepare()
    # Where every path ends at the surface that it meets first, there is nothing to repeat: a loop
    # that is not recorded takes less time.
    single, turns = once and marks is None and ends_at_once(scene), iter([True])
    while dr.hint(
        next(turns, False) if single else active,
        mode="scalar" if single else "symbolic",
        exclude=[grid, scene, surfaces, count, share, store, marks, solids, limit, told, once,
                 crossings, single, turns],
    ):  # fmt: skip
        scene.ray_counter.add("path", active)
        si = surfaces.intersect(ray, active)
        if dr.hint(crossings is not None, mode="scalar"):
            mark = crossings.mark(ray, si.t, mark, active)  # type: ignore[union-attr]
        active &= si.is_valid()
        if dr.hint(solids is not None, mode="scalar"):
            beta *= share_left(inside, si.p - before)
        bsdf, may_be_cell, scatters = si.bsdf(), mi.Bool(True), mi.Bool(False)
        if dr.hint(marks is not None, mode="scalar"):
            bsdf, mark, factor, may_be_cell, scatters = marks.meet(  # type: ignore[union-attr]
                si, mark, random.next_float32()
            )
            beta *= factor
            active &= beta > 0
        later = mi.Point2f(random.next_float32(), random.next_float32())
        uv = dr.select(depth == 0, even_numbers(index, own, seed, 1), later)
        bs, weight = bsdf.sample(ctx, si, random.next_float32(), uv, active)
        beta *= weight[0]
        active &= beta > 0
        # A surface that mirrors in part is a cell only where its diffuse part was drawn.
        is_cell = (
            may_be_cell
            & mi.has_flag(bs.sampled_type, mi.BSDFFlags.DiffuseReflection)
            & ~deviates(bsdf.flags())
        )
        is_cell = active & (is_cell | (scatters & (bs.wo.z * si.wi.z > 0)))
        if dr.hint(not scene.effects.beyond, mode="scalar"):
            # Nothing stands beyond the panes: transmitted rays would meet nothing.
            active &= bs.wo.z * si.wi.z > 0
        if dr.hint(solids is not None, mode="scalar"):
            inside, before = absorption_after(solids, bsdf, bs, inside, active), si.p
        facing = dr.select(dr.dot(si.n, ray.d) < 0, si.n, -si.n)
        store.add(
            is_cell, row=row, weight=beta * share, key=grid.key(si.p, facing),
            tag=depth * count + tag, mark=mark, within=room, p=si.spawn_ray(facing).o, n=facing,
        )  # fmt: skip
        if dr.hint(once, mode="scalar"):
            active &= ~is_cell
        if dr.hint(told, mode="scalar"):
            room = dr.select(bs.wo.z * si.wi.z > 0, room, 0)
        ray = si.spawn_ray(si.to_world(bs.wo))
        depth += 1
        active &= depth < limit
        # √β instead of β: the longer paths cost a tenth more rays and halve the variance.
        survival = dr.clip(dr.sqrt(beta), 0.05, MOST_SURVIVAL)
        roulette = depth >= ROULETTE_DEPTH
        survives = ~roulette | (random.next_float32() < survival)
        beta = dr.select(roulette, beta / survival, beta)
        active &= survives
    return store.vertices()
