r"""Sunlight by the narrow peaks of films that other surfaces shade.

A film may send the light of a sun into one or two outgoing cells. A receiver then gets this light
from a small part of the film only. Where some of that part lies in shadow, all points of
`panes.transfer.looks` may miss the rest: the mean is unbiased, but the replicates' scatter shows
no error. Here directions are drawn from the receiver back along a peak's outgoing cell; from the
points where they meet the film, shadow rays go to all suns of the peak:

.. math:: D[r, b] = \sum_j w_{rj} \, f(\omega_b \to c_j) \, D_a[p_j, b], \quad
    w_{rj} = \frac{\cos\theta_r \, P}{n \cos\theta_p}

with n directions drawn evenly by projected solid angle from the cells of all peaks, P [sr] in
sum. The peaks are taken out of the table that `Films.sent` uses.

Limits: exposed films (`Mount.exposed`) are left to `looks`.
"""

from __future__ import annotations

from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.sampling import TO_UNIT, disk_solid_angle, random_bits, sample_disk
from drcmitsuba_plugins.symbolic import symbolic

from drcmitsuba.runtime.flat_arrays import add_at, first_of_rows, flat, flat_indices, row_and_column
from drcmitsuba.runtime.launch_size import SHADOW_RAYS
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.films.orientation import Mount
from drcmitsuba.transport.panes.patches import OFFSET, PanePatches
from drcmitsuba.transport.rays.shadow_rays import visibility

STANDS_OUT = 8.0
"""A cell is a peak where f is above this times the mean f of its side."""
DIRECTIONS = 16
"""Number of directions into a peak's cell per receiver and replicate."""


class Peaks(NamedTuple):
    """Peaks of the films of one orientation."""

    owner: int
    """Index of the mount."""
    rows: mi.UInt32
    """Outgoing cells in which some sun has a peak."""
    size: mi.Float
    """Projected solid angles of these cells [sr], shape (cell,)."""
    first: mi.UInt32
    """First entry of every cell in `sun` and `f`, and last their length."""
    sun: mi.UInt32
    """Indices of the suns that have a peak in the cell."""
    f: mi.Float
    """BSDF from these suns into the cell [1/sr]."""


def take_out(
    mount: Mount, owner: int, f: mi.Float, suns: mi.UInt32
) -> tuple[mi.Float, Peaks | None]:
    """Take the peaks out of a table of f.

    Parameters
    ----------
    owner : int
        Index of the mount.
    f : mi.Float, shape (row · sun,)
        BSDF from every sun into every outgoing cell [1/sr].
    suns : mi.UInt32, shape (sun,)
        Indices of the suns.

    Returns
    -------
    f : mi.Float, shape (row · sun,)
        BSDF [1/sr], 0 in the peaks.
    peaks : Peaks or None
        None where no cell stands out.
    """
    cells, shining, sizes = mount.bsdf.out_cells, dr.width(suns), flat(mount.cell_size)
    row, sun = row_and_column(dr.arange(mi.UInt32, dr.width(f)), shining)
    side, cell = row_and_column(row, cells)
    size = dr.gather(mi.Float, sizes, cell)
    side = side * dr.opaque(mi.UInt32, shining) + sun
    flux = dr.zeros(mi.Float64, len(mount.sides) * dr.width(suns))
    add_at(flux, mi.Float64(f) * mi.Float64(size), side)
    mean = mi.Float(flux / np.pi)
    peaked = f > STANDS_OUT * dr.gather(mi.Float, mean, side)
    at = dr.compress(peaked)
    if dr.width(at) == 0:
        return f, None
    row, sun = row_and_column(at, shining)
    first = first_of_rows(row, mount.rows)
    every = dr.arange(mi.UInt32, mount.rows)
    rows = dr.compress(dr.gather(mi.UInt32, first, every + 1) > dr.gather(mi.UInt32, first, every))
    peaks = Peaks(
        owner, rows, dr.gather(mi.Float, sizes, row_and_column(rows, cells)[1]),
        dr.concat([dr.gather(mi.UInt32, first, rows), mi.UInt32(dr.width(at))]),
        dr.gather(mi.UInt32, suns, sun), dr.gather(mi.Float, f, at),
    )  # fmt: skip
    rest = dr.select(peaked, 0, f)
    dr.eval(rest, peaks)
    return rest, peaks


def peak_deposit(
    scene: Scene, patches: PanePatches, mount: Mount, peaks: Peaks,
    points: mi.Float, normals: mi.Float, *,
    suns: np.ndarray, diameter: float, most: int, seed: int, numbers: mi.UInt32 | None = None,
) -> mi.TensorXf:  # fmt: skip
    """Irradiance of receivers by the peaks of films, per unit radiance of every sun.

    Parameters
    ----------
    patches : PanePatches
        Patches of all films.
    peaks : Peaks
        Peaks of this mount.
    most : int
        Largest number of directions from a receiver.
    scene, points, normals, suns, diameter, seed, numbers
        As for `shadow_rays.sun_deposit`.

    Returns
    -------
    mi.TensorXf, shape (receiver, sun)
        D [sr].
    """
    count, n_suns = dr.width(points) // 3, len(suns)
    n = min(DIRECTIONS * dr.width(peaks.rows), most)
    out = dr.zeros(mi.Float64, count * n_suns)
    share, whole = mi.DiscreteDistribution(peaks.size), mi.Float(dr.sum(mi.Float64(peaks.size)))
    centres, owners = flat(suns), flat_indices(patches.owner)
    numbers = dr.arange(mi.UInt32, count) if numbers is None else numbers
    block = max(1, SHADOW_RAYS // n)
    for start in range(0, count, block):
        lane = dr.arange(mi.UInt32, min(block, count - start) * n)
        receiver, index = row_and_column(lane, n)
        receiver += dr.opaque(mi.UInt32, start)
        number = dr.gather(mi.UInt32, numbers, receiver)
        a, b = (mi.Float(v >> 8) * TO_UNIT for v in random_bits(number, seed, index))
        cell, u = share.sample_reuse((mi.Float(index) + a) / n)
        row = dr.gather(mi.UInt32, peaks.rows, cell)
        outgoing = mount.outgoing(row, mi.Point2f(u, b))
        p = dr.gather(mi.Point3f, points, receiver)
        d = -mount.turn.to_world(outgoing)
        cosine = dr.dot(dr.gather(mi.Normal3f, normals, receiver), d)
        hit = patches.scene.ray_intersect_preliminary(mi.Ray3f(p, d), coherent=False)
        seen = hit.is_valid() & (cosine > 0)
        seen &= dr.gather(mi.UInt32, owners, hit.prim_index // 2, seen) == peaks.owner
        before = mi.Ray3f(p, d, hit.t * (1 - 1e-4) - OFFSET, 0, [])
        scene.ray_counter.add("pane", seen, dr.width(lane))
        weight = cosine * whole / (dr.abs(outgoing.z) * n) * visibility(scene, before, seen)
        seen &= weight > 0
        columns = (receiver, number, index, cell, weight, *(p + hit.t * d))
        dr.eval(seen, columns)  # in one launch: each column alone would trace the rays anew
        at = dr.compress(seen)
        if dr.width(at) == 0:
            continue
        *kept, w, x, y, z = (dr.gather(type(column), column, at) for column in columns)
        q = mi.Point3f(x, y, z)
        dr.eval(kept, w, q)
        _add_suns(scene, mount, peaks, centres, diameter, kept, w, q, seed, n_suns, out)
        dr.eval(out)
    return mi.TensorXf(mi.Float(out), (count, n_suns))


@symbolic
def _add_suns(
    scene: Scene, mount: Mount, peaks: Peaks, centres: mi.Float, diameter: float,
    lanes: list[mi.UInt32], weight: mi.Float, q: mi.Point3f, seed: int, n_suns: int,
    out: mi.Float64,
) -> None:  # fmt: skip
    """Add w · f · D_a of all suns of the peaks that directions meet, at points q of the film."""
    receiver, number, index, cell = lanes
    normal, stride = mount.turn.n, dr.opaque(mi.UInt32, n_suns)
    omega = disk_solid_angle(diameter)
    uv = mi.Point2f(*(mi.Float(v >> 8) * TO_UNIT for v in random_bits(number, seed + 1, index)))
    entry = dr.gather(mi.UInt32, peaks.first, cell)
    end = dr.gather(mi.UInt32, peaks.first, cell + 1)
    while dr.hint(
        entry < end,
        exclude=[scene, mount, peaks, centres, receiver, weight, q, uv, normal, stride, omega, out],
    ):
        sun = dr.gather(mi.UInt32, peaks.sun, entry)
        d = sample_disk(dr.gather(mi.Vector3f, centres, sun), diameter, uv)
        cosine = dr.dot(normal, d)
        origin = mi.Point3f(q + dr.mulsign(mi.Float(OFFSET), cosine) * normal)
        scene.ray_counter.add("shadow", mi.Bool(True))
        tau = visibility(scene, mi.Ray3f(origin, d), mi.Bool(True))
        value = weight * dr.gather(mi.Float, peaks.f, entry) * tau * dr.abs(cosine) * omega
        dr.scatter_add(out, mi.Float64(value), receiver * stride + sun, value > 0)
        entry += 1
