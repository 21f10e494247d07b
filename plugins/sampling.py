"""Random numbers, disks of suns, radiances and panes, for the plugins and for transport."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.checks import checked
from drcmitsuba_plugins.symbolic import symbolic

TO_UNIT = 2.0**-24
"""Turns the upper 24 bits of a random 32-bit number into a number in [0, 1)."""


def random_bits(index, seed, place=0):
    """Two random 32-bit numbers for every index, and every place of it, the same for any launch.

    Eight rounds of the cipher: with the usual four, neighbouring indices are correlated (by 0.44).
    Lanes may have seeds of their own, mi.UInt32.
    """
    own = seed if isinstance(seed, mi.UInt32) else dr.opaque(mi.UInt32, seed & 0xFFFFFFFF)
    key = own + mi.UInt32(place) * 0x85EBCA6B
    return mi.sample_tea_32(index, key, 8)


def streams(index, seed, place=0):
    """Random generators, one for every index and place, the same for any launch."""
    state, sequence = random_bits(index, seed, place)
    return mi.PCG32(1, mi.UInt64(state), mi.UInt64(sequence))


def clamped_index(x, count):
    """Whole part of `x`, clamped to 0 … count − 1; 0 for NaN, which `dr.clip` would let through."""
    return mi.UInt32(dr.fmin(dr.fmax(x, 0), count - 1))


def valid_directions(*directions):
    """Mask of directions of the local frame for which a BSDF is defined; for others it is 0.

    Parameters
    ----------
    *directions : mi.Vector3f

    Returns
    -------
    mi.Bool
        True where all are of unit length (±5 %) and none lies in the surface's plane; false for
        NaN, and for directions of an interaction without a shading frame.
    """
    valid = mi.Bool(True)
    for w in directions:
        valid &= (dr.abs(dr.squared_norm(w) - 1) < 0.1) & (w.z != 0)
    return valid


def radiance_of(table, index, active=True):
    """Radiance of sources, looked up in a table.

    Parameters
    ----------
    table : mi.TensorXf, shape (source,) or (source, channel)
        Channels that the table lacks take its last one; spectral variants take its first one for
        all wavelengths.
    index : mi.UInt32
        Number of the source.
    active : mi.Bool

    Returns
    -------
    mi.Spectrum
    """
    channels = 1 if table.ndim == 1 else table.shape[1]
    last = 0 if mi.is_spectral else channels - 1
    at = [index * channels + min(c, last) for c in range(len(mi.Spectrum()))]
    return mi.Spectrum([dr.gather(mi.Float, table.array, i, active) for i in at])


def radiances(plugin: str, table, count: int, sources: str):
    """Radiance table of a plugin with `count` sources.

    Parameters
    ----------
    plugin : str
        Named in the error.
    table : mi.TensorXf, shape (), (count,) or (count, channel)
        One number serves for all sources.
    count : int
    sources : str
        Words for the sources in the error.

    Returns
    -------
    mi.TensorXf, shape (count,) or (count, channel)

    Raises
    ------
    ValueError
        Another shape, or a radiance that is negative or not finite.
    """
    if dr.prod(table.shape) == 1 and count != 1:
        table = mi.TensorXf(dr.repeat(table.array, count), (count,))
    table = dr.reshape(table, (1,)) if table.ndim == 0 else table
    if table.ndim > 2 or table.shape[0] != count or dr.prod(table.shape) == 0:
        raise ValueError(
            f"{plugin}: radiance: shape {table.shape} for {sources}; give one for each"
        )
    return checked(plugin, "radiance", table, 0)


def disk_solid_angle(diameter: float) -> float:
    """Solid angle of a disk, Ω = 4π sin²(δ/4) [sr].

    Parameters
    ----------
    diameter : float
        Angle δ across the disk [deg].

    Returns
    -------
    float
    """
    return 4 * np.pi * np.sin(np.radians(diameter) / 4) ** 2


def sample_disk(centre, diameter: float, uv):
    """Direction drawn uniformly in solid angle from a disk on the sky.

    With h the half angle, a disk of radius sin(h/2)·2 mapped by the equal-area (Lambert azimuthal)
    projection keeps full float32 resolution, which drawing cos θ from [cos h, 1] does not.

    Parameters
    ----------
    centre : mi.Vector3f
        Unit vector to the disk's centre.
    diameter : float
        Angle across the disk [deg].
    uv : mi.Point2f
        Uniform numbers in [0, 1)².

    Returns
    -------
    mi.Vector3f
        Unit vectors.
    """
    return from_disk(centre, diameter, mi.warp.square_to_uniform_disk_concentric(uv))


def from_disk(centre, diameter: float, p):
    """Direction to a point of a disk on the sky; see `sample_disk`.

    Parameters
    ----------
    centre : mi.Vector3f
        Unit vector to the disk's centre.
    diameter : float
        Angle across the disk [deg].
    p : mi.Point2f
        Point of the unit disk.

    Returns
    -------
    mi.Vector3f
    """
    p = p * (2 * np.sin(np.radians(diameter) / 4))
    r2 = dr.squared_norm(p)  # chord², = 2 (1 - cos θ)
    xy = p * dr.sqrt(1 - 0.25 * r2)
    return mi.Frame3f(centre).to_world(mi.Vector3f(xy.x, xy.y, 1 - 0.5 * r2))


def on_disk(d, centre, diameter: float):
    """Mask of directions on a disk, by the chord between unit vectors (exact in float32)."""
    return dr.squared_norm(d - centre) <= 4 * np.sin(np.radians(diameter) / 4) ** 2


def directions_of(plugin, props):
    """World directions `up` and `level` of a pane, see `pane_axes`; ValueError for no numbers."""
    made = []
    for name, default in (("up", (0, 0, 1)), ("level", (0, 1, 0))):
        value = props.get(name, mi.ScalarVector3f(default))
        checked(plugin, name, np.array(value, float), -np.inf)
        made.append(mi.Vector3f(value))
    return made


def pane_axes(si, up, level):
    """Axes x and y of a pane in the local frame; z is the same.

    Parameters
    ----------
    si : mi.SurfaceInteraction3f
        Interaction whose shading frame is the pane's orientation in the world.
    up : mi.Vector3f
        World direction whose projection on the pane is y.
    level : mi.Vector3f
        World direction that takes its place where the pane is horizontal.

    Returns
    -------
    x, y : mi.Vector2f
        Unit vectors; NaN where the shading frame is zero.

    Raises
    ------
    ValueError
        The interaction was made without a shading frame.
    """
    if dr.width(si.sh_frame.n) == 0:
        raise ValueError(
            "the surface interaction has no shading frame; set si.sh_frame, as `up` is a direction "
            "of the world"
        )
    up = si.to_local(up)
    flat = dr.abs(up.x) + dr.abs(up.y) < 1e-4
    other = si.to_local(level)
    y = dr.select(flat, mi.Vector2f(other.x, other.y), mi.Vector2f(up.x, up.y))
    y = dr.normalize(y)
    return mi.Vector2f(y.y, -y.x), y


def to_pane(w, axes):
    """Local direction in the frame of a pane's axes."""
    x, y = axes
    return mi.Vector3f(w.x * x.x + w.y * x.y, w.x * y.x + w.y * y.y, w.z)


def pane_to_local(w, axes):
    """Direction of the frame of a pane's axes in the local one."""
    x, y = axes
    return mi.Vector3f(w.x * x.x + w.y * y.x, w.x * x.y + w.y * y.y, w.z)


def _computed(scene, ray, active):
    """Surface that Mitsuba computes, with its frame."""
    si = scene.ray_intersect(ray, mi.RayFlags.Minimal, coherent=False, active=active)
    si.sh_frame = mi.Frame3f(si.n)
    si.wi = si.to_local(-ray.d)
    return si


@symbolic
def transmittance(scene, ray, active, intersect=None):
    """Product of the straight-through transmittances of all panes on a ray.

    Zero where the ray meets anything without a straight-through (`Null`) component.

    Parameters
    ----------
    scene : mi.Scene
        Scene with the panes.
    ray : mi.Ray3f
        Rays, followed up to their `maxt`.
    active : mi.Bool
        Lanes that count.
    intersect : callable, optional
        Gives the surface of a scene that active rays meet, with its mesh, its frame and `wi`; by
        default Mitsuba computes it.

    Returns
    -------
    mi.Float
        First channel of the transmittance.
    """
    intersect = intersect or _computed
    result = dr.select(active, mi.Float(1), mi.Float(0))
    ray = mi.Ray3f(ray)
    active = mi.Bool(active)
    while dr.hint(active, exclude=[intersect]):
        si = intersect(scene, ray, active)
        active &= si.is_valid()
        bsdf = si.bsdf()
        clear = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null)
        through = dr.select(clear, bsdf.eval_null_transmission(si, active)[0], 0)
        result = dr.select(active, result * through, result)
        active &= result > 0
        # Along the ray, beyond what Mitsuba takes off a surface: it ends where it should.
        off = si.spawn_ray(ray.d).o - si.p
        least = 1e-3 * dr.norm(off)
        step = dr.squared_norm(off) / dr.maximum(dr.dot(off, ray.d), least)
        onward = mi.Ray3f(ray)
        onward.o, onward.maxt = si.p + step * ray.d, ray.maxt - si.t - step
        ray = dr.select(active, onward, ray)
    return result
