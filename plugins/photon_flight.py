"""Flight of photons from the sources to the diffuse surfaces they meet, and their ledger."""

from __future__ import annotations

from dataclasses import dataclass, fields

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.photon_grid import Store, kernel_density
from drcmitsuba_plugins.symbolic import symbolic


@dataclass(frozen=True)
class Ledger:
    """Balance of the photons' flux [W or lm; m² sr at unit radiance], mean of channels and passes.

    emitted = absorbed + escaped + lost; `stored` counts a photon at each diffuse surface it meets.
    `lost` is the flux that still travelled after `max_depth` scattering events.
    """

    emitted: float
    stored: float
    absorbed: float
    escaped: float
    lost: float

    @classmethod
    def mean(cls, ledgers):
        """Mean of several ledgers."""
        return cls(*(np.mean([getattr(x, f.name) for x in ledgers]).item() for f in fields(cls)))


class SensorDisks:
    """Disks round sensors that record the photons which cross them, and let them go on."""

    def __init__(self, points, normals, bins, kernel, radius):
        self.count, self.bins, self.kernel = len(points), bins, kernel
        self.points = mi.Float(points.astype(np.float32).ravel())
        self.normals = mi.Float(normals.astype(np.float32).ravel())
        self.radius2 = dr.opaque(mi.Float, radius**2)
        self.out = dr.zeros(mi.Float64, 2 * self.count * bins)

    @symbolic
    def record(self, ray, t, flux, bin, met, active):
        """Add the flux of a photon to the disks that it crosses within distance `t` [m]."""
        base = bin + dr.select(met, self.count * self.bins, 0)
        k = mi.UInt32(0)
        while active & (k < self.count):
            n = dr.gather(mi.Normal3f, self.normals, k, active)
            out = dr.gather(mi.Point3f, self.points, k, active) - ray.o
            cosine = dr.dot(n, ray.d)
            s = dr.dot(n, out) / cosine
            crosses = active & (cosine < 0) & (s > 0) & (s < t)
            d2 = dr.squared_norm(s * ray.d - out)
            crosses &= d2 < self.radius2
            light = flux * kernel_density(self.kernel, d2, self.radius2)
            dr.scatter_add(self.out, mi.Float64(light), base + k * self.bins, crosses)
            k += 1


class Photons:
    """Photons of a scene: their sources, their aim, and how long they are followed.

    Parameters
    ----------
    scene : mi.Scene
    sources : Sources
    aim : Ports or Surroundings
    max_depth, rr_depth : int
        See `photon_map`.
    """

    def __init__(self, scene, sources, aim, max_depth: int, rr_depth: int):
        self.scene, self.sources, self.aim = scene, sources, aim
        self.max_depth, self.rr_depth = max_depth, rr_depth

    def send(self, photons: int, seed: int, receivers=None):
        """Send photons out; if the store was too small for them, send the same photons again.

        Parameters
        ----------
        photons, seed : int
        receivers : Receivers or None
            Disks that record the photons which cross them.

        Returns
        -------
        Store, Ledger
        """
        sampler = mi.load_dict({"type": "independent"})
        capacity = photons
        while True:
            store = Store(capacity)
            sampler.seed(seed, photons)
            ledger = self._trace(sampler, photons, store, receivers)
            if store.count <= capacity:
                return store, ledger
            capacity = store.count
            if receivers is not None:
                receivers.out = dr.zeros_like(receivers.out)

    @symbolic
    def _trace(self, sampler, photons, store, receivers):
        """Follow photons, keep them in `store`, and return their ledger."""
        ctx = mi.BSDFContext(mi.TransportMode.Importance)
        bin, towards, irradiance = self.sources.sample(sampler, photons)
        origin, area = self.aim.aim(self.scene, towards, sampler)
        ray, flux = mi.Ray3f(origin, -towards), irradiance * area
        emitted = mi.Spectrum(flux)
        stored, absorbed, escaped = mi.Float64(0), mi.Float64(0), mi.Float64(0)
        met, depth = mi.Bool(False), mi.UInt32(0)
        active = dr.any(flux > 0)
        while active:
            si = self.scene.ray_intersect(ray, mi.RayFlags.All, coherent=False, active=active)
            if dr.hint(receivers is not None, mode="scalar"):
                receivers.record(ray, si.t, flux[0], bin, met, active)
            escaped += dr.select(active & ~si.is_valid(), _total(flux), 0)
            active &= si.is_valid()
            bsdf = si.bsdf(ray)
            lands = active & is_diffuse(bsdf)
            stored += dr.select(lands, _total(flux), 0)
            store.keep(
                lands, position=si.p, towards=-ray.d, normal=facing(si),
                flux=flux, bin=bin, met=met,
            )  # fmt: skip
            bs, weight = bsdf.sample(
                ctx, si, sampler.next_1d(active), sampler.next_2d(active), active
            )
            onward = si.to_world(bs.wo)
            kept = flux * weight * _shading_correction(si, -ray.d, bs.wo, onward)
            roulette = depth >= self.rr_depth
            share = dr.max(kept) / dr.max(flux)
            chance = dr.select(roulette, dr.minimum(share, 1), 1)
            kept = dr.select(sampler.next_1d(active) < chance, kept / chance, 0)
            absorbed += dr.select(active, _total(flux) - _total(kept), 0)
            flux = dr.select(active, kept, 0)  # flux left after the loop was lost to `max_depth`
            specular = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
            met |= lands & ~specular
            ray = si.spawn_ray(onward)
            depth += 1
            active &= dr.any(flux > 0)
            if dr.hint(self.max_depth >= 0, mode="scalar"):
                active &= depth < self.max_depth
        sums = (_total(emitted), stored, absorbed, escaped, _total(flux))
        dr.eval(sums)  # together: each later evaluation would run the loop anew
        return Ledger(*(float(dr.sum(x)[0]) for x in sums))


def _total(flux):
    """Mean flux of the channels."""
    return mi.Float64(dr.mean(flux))


def is_diffuse(bsdf):
    """True where photons are stored: an opaque BSDF with a diffuse lobe."""
    diffuse = mi.has_flag(bsdf.flags(), mi.BSDFFlags.DiffuseReflection)
    return diffuse & ~mi.has_flag(bsdf.flags(), mi.BSDFFlags.Transmission)


def facing(si):
    """Geometric normal on the side from which the ray arrives."""
    return si.n * dr.sign(dr.dot(si.n, si.to_world(si.wi)))


def _shading_correction(si, towards, wo, onward):
    """Veach's factor for a photon's weight at an interpolated normal; zero where light leaks."""
    before, after = dr.dot(si.n, towards), dr.dot(si.n, onward)
    consistent = (before * si.wi.z > 0) & (after * wo.z > 0)
    factor = dr.abs(si.wi.z * after / (wo.z * before))
    return dr.select(consistent, factor, 0)
