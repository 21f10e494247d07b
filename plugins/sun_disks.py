"""`sun_disks`: any number of suns of finite diameter in one emitter."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.checks import checked
from drcmitsuba_plugins.sampling import (
    disk_solid_angle,
    on_disk,
    radiance_of,
    radiances,
    sample_disk,
)
from drcmitsuba_plugins.symbolic import symbolic
from drcmitsuba_plugins.tables import table_of


def _directions(props) -> np.ndarray:
    """Unit vectors to the suns, shape (sun, 3)."""
    names = [name for name in ("direction", "directions") if name in props]
    if len(names) != 1:
        raise ValueError(
            f"sun_disks: {' and '.join(names) or 'no direction'}; give direction (a vector to one "
            "sun) or directions (several: a tensor (n, 3), a text of numbers, or a .npy or .csv)"
        )
    table = table_of("sun_disks", names[0], props[names[0]]).numpy().astype(float)
    flat = table.ndim == 1 and table.size % 3 == 0
    if table.size == 0 or not (flat or (table.ndim == 2 and table.shape[1] == 3)):
        raise ValueError(f"sun_disks: {names[0]}: shape {table.shape}; give (n, 3), n > 0")
    table = table.reshape(-1, 3)
    length = np.linalg.norm(table, axis=1)
    wrong = np.flatnonzero(~(np.isfinite(length) & (length > 1e-6)))
    if len(wrong):
        raise ValueError(
            f"sun_disks: {names[0]}: number {wrong[0] + 1} of {len(table)} is "
            f"{table[wrong[0]].tolist()}; give a vector that has a direction"
        )
    return table / length[:, None]


class SunDisks(mi.Emitter):
    """Suns: disks of constant radiance at infinity.

    =================  ===============  =========================================================
    parameter          type             meaning
    =================  ===============  =========================================================
    `direction`        vector           to the one sun, world frame, of any length; or
    `directions`       tensor (n, 3)    to several; from XML a text of numbers,
                                        "0 0.6 0.8; 0.6 0 0.8", or a file .npy or .csv
    `radiance`         tensor           radiance [W/(m² sr) or cd/m²], shape (n,) or (n, channel),
                                        also as a text or file; or a number for all; default 1.
                                        Differentiable.
    `diameter`         float            angle across the disk [deg], default 0.5
    =================  ===============  =========================================================

    Integrators find the suns by emitter sampling only (like a point light): Mitsuba knows one
    environment per scene, which the sky is. A perfect mirror or a view straight into the sun
    therefore does not show them except in `coefficient`, which tests the disks itself. Where disks
    overlap, `eval` is the radiance of the first alone; sampled light is that of all. Spectral
    variants take the first channel. A scene for Mitsuba's `path` is shipped as
    scenes/plugins/sun_and_sky.xml.
    """

    def __init__(self, props: mi.Properties):
        super().__init__(props)
        directions = _directions(props)
        self.bin_count = len(directions)
        self.directions = mi.Float(directions.astype(np.float32).ravel())
        table = table_of("sun_disks", "radiance", props.get("radiance", 1.0))
        self.radiance = radiances("sun_disks", table, self.bin_count, f"{self.bin_count} suns")
        self.diameter = float(
            checked("sun_disks", "diameter", props.get("diameter", 0.5), 1e-3, 90)
        )
        self.solid_angle = disk_solid_angle(self.diameter)
        self._set_distribution()
        # Infinite without Delta would make it the scene's one environment.
        self.m_flags = mi.EmitterFlags.Infinite | mi.EmitterFlags.DeltaDirection

    def _set_distribution(self):
        power = dr.mean(self._radiance_of(dr.arange(mi.UInt32, self.bin_count)))
        self.distribution = mi.DiscreteDistribution(dr.detach(power) + 1e-20)

    def _radiance_of(self, index, active=True):
        return radiance_of(self.radiance, index, active)

    def direction_of(self, index, active=True):
        """Unit vector to the centre of sun `index`."""
        return dr.gather(mi.Vector3f, self.directions, index, active)

    @symbolic
    def bin_of(self, d, active=True):
        """First sun whose disk holds direction `d`; `bin_count` where there is none."""
        index = mi.UInt32(self.bin_count)
        i = mi.UInt32(0)
        searching = mi.Bool(active)
        while searching & (i < self.bin_count):
            hit = on_disk(d, self.direction_of(i, searching), self.diameter)
            index = dr.select(hit, i, index)
            searching &= ~hit
            i += 1
        return index

    def traverse(self, cb):
        cb.put("radiance", self.radiance, mi.ParamFlags.Differentiable)

    def parameters_changed(self, keys=()):
        self._set_distribution()

    def set_scene(self, scene):
        pass

    def bbox(self):
        return mi.ScalarBoundingBox3f()

    def is_environment(self):
        return False

    def eval(self, si, active=True):
        index = self.bin_of(-si.wi, active)
        hit = active & (index < self.bin_count)
        return dr.select(hit, self._radiance_of(index, hit), 0)

    def sample_direction(self, ref, sample, active=True):
        index, u, pmf = self.distribution.sample_reuse_pmf(sample.x, active)
        d = sample_disk(self.direction_of(index, active), self.diameter, mi.Point2f(u, sample.y))
        ds = dr.zeros(mi.DirectionSample3f)
        ds.p = ref.p + d * 1e6
        ds.n = -d
        ds.d = d
        ds.dist = 1e6
        ds.time = ref.time
        ds.delta = True  # never found by BSDF sampling
        ds.pdf = pmf / self.solid_angle
        ds.emitter = mi.EmitterPtr(self)
        return ds, self._radiance_of(index, active) / ds.pdf

    def pdf_direction(self, ref, ds, active=True):
        return mi.Float(0)

    def eval_direction(self, ref, ds, active=True):
        index = self.bin_of(ds.d, active)
        hit = active & (index < self.bin_count)
        return dr.select(hit, self._radiance_of(index, hit), 0)

    def sample_ray(self, time, sample1, sample2, sample3, active=True):
        raise RuntimeError("sun_disks emits no rays: light is traced from sensors and cells")

    def to_string(self):
        return f"SunDisks[{self.bin_count} suns of {self.diameter} deg]"


mi.register_emitter("sun_disks", SunDisks)
