"""`coated_mirror`: a mirror below a clear layer, such as lacquer on aluminium or silvered glass."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
from drcmitsuba_plugins.checks import checked, required
from drcmitsuba_plugins.sampling import valid_directions


class CoatedMirror(mi.BSDF):
    r"""Smooth clear layer on a smooth mirror; all reflected light leaves in the mirrored direction.

    ===============  ======  =====================================================================
    parameter        type    meaning
    ===============  ======  =====================================================================
    `reflectance`    float   ρ of the mirror below, seen from within the layer, at any incidence
    `ior`            float   refractive index of the layer, at least 1; air outside
    ===============  ======  =====================================================================

    Light bounces between the mirror and the layer's surface, whose reflectance r(θ) is Fresnel's
    for unpolarised light; the orders add up without interference:

    .. math:: R(θ) = r + \frac{(1 - r)^2 ρ}{1 - r ρ}

    `reflectance` is exposed through `traverse` and differentiable. One delta component: `eval` and
    `pdf` are 0. One-sided (+z); `twosided` makes it a sheet. Limits: a thin layer without
    absorption and without offset, no polarisation, one value for all channels.
    """

    def __init__(self, props: mi.Properties):
        super().__init__(props)
        for name, low, high in (("reflectance", 0, 1), ("ior", 1, 100)):
            value = required("coated_mirror", props, name, f"a number from {low} to {high}")
            setattr(self, name, mi.Float(checked("coated_mirror", name, value, low, high)))
        self.m_components = [mi.BSDFFlags.DeltaReflection | mi.BSDFFlags.FrontSide]
        self.m_flags = self.m_components[0]

    def _coated(self, cos_theta):
        """R(θ)."""
        r = mi.fresnel(cos_theta, self.ior)[0]
        # The denominator vanishes only where no light enters the layer, r = ρ = 1.
        inside = dr.maximum(1 - r * self.reflectance, 1e-6)
        return r + dr.square(1 - r) * self.reflectance / inside

    def traverse(self, cb):
        cb.put("reflectance", self.reflectance, mi.ParamFlags.Differentiable)

    def parameters_changed(self, keys=()):
        pass

    def sample(self, ctx, si, sample1, sample2, active=True):
        active = active & valid_directions(si.wi) & (si.wi.z > 0)
        active &= ctx.is_enabled(mi.BSDFFlags.DeltaReflection, 0)
        bs = dr.zeros(mi.BSDFSample3f)
        bs.wo = mi.reflect(si.wi)
        bs.pdf = 1.0
        bs.eta = 1.0
        bs.sampled_component = mi.UInt32(0)
        bs.sampled_type = mi.UInt32(+mi.BSDFFlags.DeltaReflection)
        return bs, mi.Spectrum(dr.select(active, self._coated(si.wi.z), 0))

    def eval(self, ctx, si, wo, active=True):
        return mi.Spectrum(0)

    def pdf(self, ctx, si, wo, active=True):
        return mi.Float(0)

    def eval_pdf(self, ctx, si, wo, active=True):
        return mi.Spectrum(0), mi.Float(0)

    def to_string(self):
        return "CoatedMirror[]"


mi.register_bsdf("coated_mirror", CoatedMirror)
