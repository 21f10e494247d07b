"""Deposit through scattering panes: light that meets one of them, or several in turn.

A Lambertian pane turns the irradiance of its two faces into radiance, T·E of the far face and R·E
of the near one, over π. Where T depends on the incidence, E of the outer face counts light by
T(θ)/T, with T the mean; light from within the room counts by T. The pane is cut into patches, so
that

    D_b[receiver, bin] = Σ_face K[receiver, face] · E[face, bin],

where K holds geometry, visibility and the pane's optics, and shadow rays from the faces give E.
Light from pane to pane is the geometric series E = D_a + K' E.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.sampling import TO_UNIT, random_bits

from drcmitsuba.runtime.flat_arrays import add_at, flat, row_and_column
from drcmitsuba.scene.materials import lets_through
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.panes.patches import OFFSET, PanePatches
from drcmitsuba.transport.rays.even_rays import first_directions
from drcmitsuba.transport.rays.openings import Openings, Within
from drcmitsuba.transport.rays.shadow_rays import visibility


class PaneLook(NamedTuple):
    """Directions from receivers to panes, one lane each.

    `weight` is cos θ / (π · p), with p the sum of the densities of both ways to draw the direction
    times `rays`, times the transmittance of clear panes in between; 0 where no pane is seen.
    """

    row: mi.UInt32
    patch: mi.UInt32
    d: mi.Vector3f
    front: mi.Bool
    weight: mi.Float


def looks(
    scene: Scene, patches: PanePatches, points: mi.Float, normals: mi.Float, *,
    rays: int, seed: int, numbers: mi.UInt32 | None = None, within: Within = None,
) -> tuple[PaneLook, PaneLook]:  # fmt: skip
    """Directions from receivers to the patches, drawn in two ways.

    Points on the panes and cosine-distributed directions are combined by the balance heuristic:
    the first suit small and far panes, the second keep the estimate bounded close to a pane.

    Parameters
    ----------
    points, normals : mi.Float
        Receivers, three numbers each.
    rays : int
        Directions of each of the two kinds per receiver.
    numbers, within : optional
        As for `shadow_rays.sky_deposit`.

    Returns
    -------
    tuple of Look
        By points and by directions, lanes receiver · rays + index.
    """
    count = dr.width(points) // 3
    normal = flat(patches.normal)
    total_area = dr.opaque(mi.Float, float(patches.area.sum()))
    many = dr.opaque(mi.Float, rays)
    share = mi.DiscreteDistribution(flat(patches.area))
    lane = dr.arange(mi.UInt32, count * rays)
    row, index = row_and_column(lane, rays)
    number = row if numbers is None else dr.gather(mi.UInt32, numbers, row)
    a, b = (mi.Float(v >> 8) * TO_UNIT for v in random_bits(number, seed, index))
    p = dr.gather(mi.Point3f, points, row)
    n = dr.gather(mi.Normal3f, normals, row)
    openings = Openings.of(scene, points, within)  # rays to its panes stay in a box

    def look(
        patch: mi.UInt32, d: mi.Vector3f, distance: mi.Float, seen: mi.Bool, *, is_first: bool
    ) -> PaneLook:
        """Weigh directions drawn in either way.

        `is_first` tells whether no other patch can lie on the way.
        """
        pane_normal = dr.gather(mi.Normal3f, normal, patch, seen)
        cos_pane, cosine = dr.dot(pane_normal, -d), dr.dot(n, d)
        seen = seen & (cosine > 0) & (cos_pane != 0)
        # The ray ends before the pane, which may let straight light through as well.
        before = mi.Ray3f(p, d, distance * (1 - 1e-4) - OFFSET, 0, [])
        scene.ray_counter.add("pane", seen, dr.width(d))
        tau = visibility(scene, before, seen, openings)
        by_area = dr.square(distance) / (dr.abs(cos_pane) * total_area)
        by_cosine = cosine * dr.inv_pi
        p_cosine = by_cosine
        if not is_first:  # directions by the cosine law end at the first patch
            beyond = patches.scene.ray_test(before, coherent=False, active=tau > 0)
            p_cosine = dr.select(beyond, 0, by_cosine)
        weight = dr.select(tau > 0, by_cosine * tau / (many * (by_area + p_cosine)), 0)
        return PaneLook(row, dr.select(seen, patch, 0), d, cos_pane > 0, weight)

    # Points on the panes.
    stratum = (mi.Float(index) + a) / many
    patch, u = share.sample_reuse(stratum)
    y = patches.at(patch, u, b)
    distance = dr.norm(y - p)
    d = (y - p) / dr.maximum(distance, 1e-9)
    by_point = look(patch, d, distance, mi.Bool(True), is_first=not _are_seen_through(scene))

    # Directions by the cosine law.
    d = mi.Frame3f(n).to_world(first_directions(index, number, seed))
    hit = patches.scene.ray_intersect_preliminary(mi.Ray3f(p, d), coherent=False)
    by_direction = look(hit.prim_index // 2, d, hit.t, hit.is_valid(), is_first=True)
    return by_point, by_direction


def _are_seen_through(scene: Scene) -> bool:
    """Whether a scattering pane may be seen straight through another one."""
    return any(lets_through(part.material) for part in (*scene.scattering, *scene.films))


def pane_transfer(
    scene: Scene, patches: PanePatches, points: mi.Float, normals: mi.Float, *,
    rays: int, seed: int, numbers: mi.UInt32 | None = None, within: Within = None,
) -> mi.TensorXf:  # fmt: skip
    """Irradiance at points per irradiance on the faces of panes that scatter evenly.

    Parameters
    ----------
    patches : PanePatches
        Patches of `scene.scattering`.
    scene, points, normals, rays, seed, numbers, within
        As for `looks`.

    Returns
    -------
    mi.TensorXf, shape (receiver, face)
        K, dimensionless.
    """
    every = looks(
        scene, patches, points, normals, rays=rays, seed=seed, numbers=numbers, within=within
    )
    return transfer_by(every, scene, patches, dr.width(points) // 3)


def transfer_by(
    every: Sequence[PaneLook], scene: Scene, patches: PanePatches, count: int
) -> mi.TensorXf:
    """K of so many receivers, as `pane_transfer`, by directions that were drawn before."""
    faces = 2 * len(patches)
    out, stride = dr.zeros(mi.Float64, count * faces), dr.opaque(mi.UInt32, faces)
    optics: list[Any] = [pane.material for pane in scene.scattering]
    through = flat([optics[i].scattered for i in patches.owner])
    back = flat([optics[i].sides for i in patches.owner])
    dr.eval([(look.row, look.patch, look.front, look.weight) for look in every])
    for look in every:
        seen = look.weight > 0
        near = 2 * look.patch + dr.select(look.front, mi.UInt32(0), 1)
        sent = (
            (near ^ 1, dr.gather(mi.Float, through, look.patch, seen)),
            (near, dr.gather(mi.Float, back, near, seen)),
        )
        for face, albedo in sent:
            value = look.weight * albedo
            add_at(out, mi.Float64(value), look.row * stride + face, seen & (value > 0))
    dr.eval(out)
    return mi.TensorXf(mi.Float(out), (count, faces))


def neumann_series(between: mi.TensorXf, received: mi.TensorXf) -> mi.TensorXf:
    """Irradiance of the faces with the light between panes, E = D_a + K' E.

    Parameters
    ----------
    between : mi.TensorXf, shape (face, face)
        K' from the faces to the faces.
    received : mi.TensorXf, shape (face, bin)
        D_a, straight from sky and suns [sr].

    Returns
    -------
    mi.TensorXf, shape (face, bin)
        E [sr].
    """
    faces, bins = received.shape
    K = between.numpy()
    rows = np.flatnonzero(K.any(axis=1))  # faces that see panes: those outside mostly see none
    if not len(rows) or not bins:
        return received
    onto, among = (mi.TensorXf(np.ascontiguousarray(k)) for k in (K[rows], K[np.ix_(rows, rows)]))
    more = term = onto @ received
    least = 1e-7 * max(1e-30, float(dr.max(received.array)[0]))
    while float(dr.max(term.array)[0]) > least:
        term = among @ term
        more = more + term
        dr.eval(more, term)
    place = np.full(faces, -1)
    place[rows] = np.arange(len(rows))
    entry, count = dr.arange(mi.UInt32, faces * bins), dr.opaque(mi.UInt32, bins)
    at = dr.gather(mi.Int32, mi.Int32(place), entry // count)
    added = dr.gather(mi.Float, more.array, mi.UInt32(at) * count + entry % count, at >= 0)
    return mi.TensorXf(received.array + added, received.shape)
