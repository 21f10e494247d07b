"""Start of photons: directions to sky or suns, and origins before a port or the whole scene.

A photon that carries flux from radiance L starts with Φ = L Ω A / (N p), where Ω is the solid angle
of its bin [sr], A the target's area normal to its direction [m²], N the number of photons and p the
probability of its bin.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.sampling import on_disk, radiance_of, sample_disk, transmittance
from drcmitsuba_plugins.symbolic import symbolic


class PhotonBins:
    """The bins of a scene's environment, followed by those of its suns, with their radiances.

    An environment other than `tregenza_sky` is one bin and keeps its radiance.

    Parameters
    ----------
    scene : mi.Scene

    Raises
    ------
    ValueError
        The scene has no source, or an emitter that is neither an environment nor `sun_disks`.
    """

    def __init__(self, scene):
        self.sky: Any = scene.environment()
        self.suns: Any = None
        for emitter in scene.emitters():
            if type(emitter).__name__ == "SunDisks":
                self.suns = emitter
            elif not emitter.is_environment():
                raise ValueError(
                    f"photon_map: emitter {emitter.id()!r}: photons start from an environment and "
                    "from sun_disks only; take it out of the scene"
                )
        if self.sky is None and self.suns is None:
            raise ValueError("photon_map: the scene has neither an environment nor sun_disks")
        self.has_patches = hasattr(self.sky, "sample_bin")
        self.sky_bins = 0 if self.sky is None else getattr(self.sky, "bin_count", 1)
        self.bin_count = self.sky_bins + (0 if self.suns is None else self.suns.bin_count)

    def _patch(self, index, active):
        """Radiance times solid angle [sr] of a sky patch."""
        solid_angle = dr.gather(mi.Float, self.sky.solid_angles, index, active)
        return radiance_of(self.sky.radiance, index, active) * solid_angle

    def _sun(self, index, active):
        """Radiance times solid angle [sr] of a sun."""
        return radiance_of(self.suns.radiance, index, active) * self.suns.solid_angle

    def _probabilities(self) -> np.ndarray:
        """Fraction of the photons for every bin, in proportion to its normal irradiance."""
        power: list = []
        if self.has_patches:
            patches = dr.arange(mi.UInt32, self.sky_bins)
            power.append(dr.mean(self._patch(patches, True)).numpy())
        elif self.sky is not None:
            u = (np.arange(4096) + 0.5) / 4096
            uv = mi.Point2f(mi.Float(u), mi.Float(u * 1597 % 1))  # a lattice of rank 1
            _, weight = self.sky.sample_direction(dr.zeros(mi.Interaction3f, len(u)), uv)
            power.append([float(dr.mean(dr.mean(weight))[0])])
        if self.suns is not None:
            suns = dr.arange(mi.UInt32, self.suns.bin_count)
            power.append(dr.mean(self._sun(suns, True)).numpy())
        powers = np.concatenate(power).astype(float) + 1e-20
        return powers / powers.sum()

    def sample(self, sampler, photons: int):
        """Draw the bins and directions of photons.

        Parameters
        ----------
        sampler : mi.Sampler
        photons : int
            Number of photons, the sampler's width; every bin gets exactly its fraction of them.

        Returns
        -------
        bin : mi.UInt32
        towards : mi.Vector3f
            Unit vector to the source.
        irradiance : mi.Spectrum
            Irradiance that the photon represents, normal to its direction [W/m² or lx].
        """
        p = self._probabilities()
        shares, cumulated = mi.Float64(p), mi.Float64(np.cumsum(p))
        lane, n = dr.arange(mi.UInt32, photons), dr.opaque(mi.Float64, photons)
        u = (mi.Float64(lane) + mi.Float64(sampler.next_1d())) / n
        bin = dr.zeros(mi.UInt32, photons) + mi.UInt32(  # one number where there is one bin
            dr.binary_search(
                0, self.bin_count - 1, lambda i: dr.gather(mi.Float64, cumulated, i) <= u
            )
        )
        uv = sampler.next_2d()
        towards, light = mi.Vector3f(0, 0, 1), mi.Spectrum(0)
        if self.sky is not None:
            above = bin < self.sky_bins
            if self.has_patches:
                towards = self.sky.sample_bin(bin, uv, above)
                light = self._patch(bin, above)
            else:
                ds, light = self.sky.sample_direction(dr.zeros(mi.Interaction3f, photons), uv)
                towards = ds.d
        if self.suns is not None:
            sun, shines = bin - self.sky_bins, bin >= self.sky_bins
            centre = self.suns.direction_of(sun, shines)
            towards = dr.select(shines, sample_disk(centre, self.suns.diameter, uv), towards)
            light = dr.select(shines, self._sun(sun, shines), light)
        return bin, towards, light / mi.Float(n * dr.gather(mi.Float64, shares, bin))

    @symbolic
    def seen(self, d, active):
        """Radiance of environment and suns in world directions `d` [W/(m² sr) or cd/m²]."""
        light = mi.Spectrum(0)
        if dr.hint(self.sky is not None, mode="scalar"):
            si = dr.zeros(mi.SurfaceInteraction3f)
            si.wi = -d
            light = dr.select(active, self.sky.eval(si, active), 0)
        if dr.hint(self.suns is not None, mode="scalar"):
            sun = mi.UInt32(0)
            while active & (sun < self.suns.bin_count):
                hit = on_disk(d, self.suns.direction_of(sun, active), self.suns.diameter)
                radiance = radiance_of(self.suns.radiance, sun, active)
                light += dr.select(active & hit, radiance, 0)
                sun += 1
        return light


class UnitSources(PhotonBins):
    """The bins of `PhotonBins`, each with unit radiance.

    Half of the photons are distributed equally, half by solid angle: every bin has photons, and the
    ground, half of all directions, has more than a few.
    """

    def _patch(self, index, active):
        return mi.Spectrum(dr.gather(mi.Float, self.sky.solid_angles, index, active))

    def _sun(self, index, active):
        return mi.Spectrum(dr.full(mi.Float, self.suns.solid_angle, dr.width(index)))

    def _probabilities(self):
        equal = np.full(self.bin_count, 1 / self.bin_count)
        return (equal + super()._probabilities()) / 2


class Ports:
    """Rectangles through which light enters, straight from its source.

    A photon counts if nothing but panes with a straight-through (`Null`) component lies between its
    port and the source; they attenuate it by their transmittance (first channel).

    Parameters
    ----------
    quads : array, shape (port, 4, 3)
        Corners q0 … q3 [m]; light enters along the normal (q1 − q0) × (q3 − q0).
    """

    def __init__(self, quads):
        quads = np.asarray(quads, float)
        if quads.ndim < 3 and quads.size % 12 == 0:  # a text, one port or corner a row
            quads = quads.reshape(-1, 4, 3)
        if quads.ndim != 3 or quads.shape[1:] != (4, 3) or len(quads) == 0:
            raise ValueError(f"photon_map: ports: shape {quads.shape}; give (n, 4, 3), n > 0")
        u, v = quads[:, 1] - quads[:, 0], quads[:, 3] - quads[:, 0]
        lengths = np.linalg.norm(u, axis=1), np.linalg.norm(v, axis=1)
        size = np.maximum(*lengths)
        skew = np.linalg.norm(quads[:, 2] - quads[:, 0] - u - v, axis=1) > 1e-3 * size
        skew |= abs((u * v).sum(axis=1)) > 1e-3 * lengths[0] * lengths[1]
        normal = np.cross(u, v)
        areas = np.linalg.norm(normal, axis=1)
        bad = np.flatnonzero(~(areas > 1e-12) | skew)
        if len(bad):
            raise ValueError(
                f"photon_map: ports: number {bad[0]} is no rectangle; "
                "give its four corners in order, round its edge"
            )
        self.corner, self.u, self.v, self.normal = (
            mi.Float(a.astype(np.float32).ravel())
            for a in (quads[:, 0], u, v, normal / areas[:, None])
        )
        self.count, self.area = len(quads), float(areas.sum())
        self.cumulated = mi.Float(np.cumsum(areas) / self.area)

    def aim(self, scene, towards, sampler):
        """Origin of photons that come from `towards`, and the area they stand for [m²]."""
        u = sampler.next_1d()
        port = dr.binary_search(
            0, self.count - 1, lambda i: dr.gather(mi.Float, self.cumulated, i) <= u
        )
        corner, across, along, normal = (
            dr.gather(mi.Vector3f, a, port) for a in (self.corner, self.u, self.v, self.normal)
        )
        uv = sampler.next_2d()
        p = mi.Point3f(corner + uv.x * across + uv.y * along)
        cosine = dr.maximum(-dr.dot(normal, towards), 0)
        # Just outside: surfaces in the port's plane count as behind the port.
        p += towards * ((1 + dr.max(dr.abs(p))) * 2 * mi.math.RayEpsilon / dr.maximum(cosine, 0.01))
        seen = transmittance(scene, mi.Ray3f(p, towards), cosine > 0)
        return p, cosine * seen * self.area


class Surroundings:
    """The disk, normal to the light, that holds the whole scene.

    Parameters
    ----------
    scene : mi.Scene
    points : array, shape (n, 3)
        Further points [m] that the disk holds.
    """

    def __init__(self, scene, points):
        box = scene.bbox()
        ends = [np.array(box.min), np.array(box.max)] if box.valid() else []
        corners = np.array([*ends, *np.asarray(points, float).reshape(-1, 3)])
        if len(corners) == 0:
            raise ValueError("photon_map: the scene is empty; give it a shape")
        low, high = corners.min(axis=0), corners.max(axis=0)
        self.centre = mi.Point3f(*map(float, (low + high) / 2))
        self.radius = max(1.001 * float(np.linalg.norm(high - low)) / 2, 1e-6)

    def aim(self, scene, towards, sampler):
        """Origin of photons that come from `towards`, and the area they stand for [m²]."""
        disk = mi.warp.square_to_uniform_disk_concentric(sampler.next_2d())
        local = self.radius * mi.Vector3f(disk.x, disk.y, 1)
        p = self.centre + mi.Frame3f(towards).to_world(local)
        return p, mi.Float(np.pi * self.radius**2)
