"""`tregenza_sky`: the hemisphere in patches of constant radiance, and the ground below it."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.checks import checked, checked_whole
from drcmitsuba_plugins.patches import Patches, patch_index
from drcmitsuba_plugins.sampling import radiance_of, radiances
from drcmitsuba_plugins.tables import table_of


class TregenzaSky(mi.Emitter):
    """Environment emitter of sky patches and ground.

    =================  ===============  =========================================================
    parameter          type             meaning
    =================  ===============  =========================================================
    `radiance`         tensor           radiance of every bin [W/(m² sr) or cd/m²], shape (bin,)
                                        or (bin, channel), ground first; from XML a text of
                                        numbers or a file .npy or .csv; or a number for all;
                                        default 1. Differentiable.
    `subdivision`      int              Reinhart's factor MF; 1 (default) is Tregenza's sky
    `to_world`         transform        turns the sky's frame (x east, y north, z up)
    =================  ===============  =========================================================

    Sampling picks a bin in proportion to radiance times solid angle and a direction uniformly
    within it. Limits: radiance is piecewise constant; spectral variants take the first channel.
    """

    def __init__(self, props: mi.Properties):
        super().__init__(props)
        subdivision = props.get("subdivision", 1)
        self.subdivision = checked_whole("tregenza_sky", "subdivision", subdivision, 1, 6)
        patches = Patches(self.subdivision)
        n = len(patches)
        table = table_of("tregenza_sky", "radiance", props.get("radiance", 1.0))
        bins = f"the {n} bins of subdivision {self.subdivision}"
        self.radiance = radiances("tregenza_sky", table, n, bins)
        # Properties keep transforms in double precision, which Transform4f refuses.
        to_world = props.get("to_world", mi.ScalarTransform4f())
        axes = np.linalg.norm(np.array(to_world.matrix)[:3, :3], axis=0)
        checked("tregenza_sky", "to_world, length of its axes", axes, 1 - 1e-3, 1 + 1e-3)
        self.frame = mi.Transform4f(mi.ScalarTransform4f(to_world.matrix))
        self.bounds = mi.Float(patches.bounds.astype(np.float32).ravel())
        self.solid_angles = mi.Float(patches.solid_angles.astype(np.float32))
        self.bin_count = n
        self.labels = patches.labels
        self._set_distribution()
        self.m_flags = mi.EmitterFlags.Infinite

    def _set_distribution(self):
        bins = dr.arange(mi.UInt32, self.bin_count)
        power = dr.mean(self._radiance_of(bins)) * self.solid_angles
        self.distribution = mi.DiscreteDistribution(dr.detach(power) + 1e-20)

    def _radiance_of(self, index, active=True):
        return radiance_of(self.radiance, index, active)

    def bin_of(self, d):
        """Bin that world directions `d` fall in."""
        return patch_index(dr.normalize(self.frame.inverse() @ d), self.subdivision)

    def sample_bin(self, index, uv, active=True):
        """World direction drawn uniformly, by solid angle, from bin `index`."""
        low, high, west, east = (
            dr.gather(mi.Float, self.bounds, index * 4 + i, active) for i in range(4)
        )
        z = dr.lerp(dr.sin(low), dr.sin(high), uv.x)
        s, c = dr.sincos(dr.lerp(west, east, uv.y))
        r = dr.safe_sqrt(1 - z * z)
        return self.frame @ mi.Vector3f(r * s, r * c, z)

    def traverse(self, cb):
        cb.put("radiance", self.radiance, mi.ParamFlags.Differentiable)

    def parameters_changed(self, keys=()):
        self._set_distribution()

    def set_scene(self, scene):
        pass

    def bbox(self):
        return mi.ScalarBoundingBox3f()

    def is_environment(self):
        return True

    def eval(self, si, active=True):
        return self._radiance_of(self.bin_of(-si.wi), active)

    def sample_direction(self, ref, sample, active=True):
        index, u, pmf = self.distribution.sample_reuse_pmf(sample.x, active)
        d = self.sample_bin(index, mi.Point2f(u, sample.y), active)
        ds = dr.zeros(mi.DirectionSample3f)
        ds.p = ref.p + d * 1e6  # beyond the scene
        ds.n = -d
        ds.d = d
        ds.dist = 1e6
        ds.time = ref.time
        ds.pdf = pmf / dr.gather(mi.Float, self.solid_angles, index, active)
        ds.emitter = mi.EmitterPtr(self)
        return ds, self._radiance_of(index, active) / ds.pdf

    def pdf_direction(self, ref, ds, active=True):
        index = self.bin_of(ds.d)
        solid_angle = dr.gather(mi.Float, self.solid_angles, index, active)
        return self.distribution.eval_pmf_normalized(index, active) / solid_angle

    def eval_direction(self, ref, ds, active=True):
        return self._radiance_of(self.bin_of(ds.d), active)

    def sample_ray(self, time, sample1, sample2, sample3, active=True):
        raise RuntimeError("tregenza_sky emits no rays: light is traced from sensors and cells")

    def to_string(self):
        return f"TregenzaSky[subdivision={self.subdivision}, bins={self.bin_count}]"


mi.register_emitter("tregenza_sky", TregenzaSky)
