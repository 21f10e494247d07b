"""`diffuser`: a thin Lambertian pane, such as a sun shade, a fabric or opal glass."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
from drcmitsuba_plugins.checks import checked, required
from drcmitsuba_plugins.sampling import valid_directions


class Diffuser(mi.BSDF):
    """Thin pane whose transmitted and reflected light is Lambertian.

    ====================  ==========  =============================================================
    parameter             type        meaning
    ====================  ==========  =============================================================
    `transmittance`       float       diffuse transmittance T: f = T/π across the pane
    `reflectance_front`   float       diffuse reflectance seen from the room (+z), default 0
    `reflectance_back`    float       seen from outside (−z); default `reflectance_front`
    ====================  ==========  =============================================================

    All three are exposed through `traverse` and differentiable. Limits: after loading, the caller
    keeps T + R ≤ 1; one value for all channels.
    """

    def __init__(self, props: mi.Properties):
        super().__init__(props)
        front = props.get("reflectance_front", 0.0)
        values = {
            "transmittance": required("diffuser", props, "transmittance", "a number from 0 to 1"),
            "reflectance_front": front,
            "reflectance_back": props.get("reflectance_back", front),
        }
        for name, value in values.items():
            setattr(self, name, mi.Float(checked("diffuser", name, value, 0, 1)))
        both = mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
        self.m_components = [
            mi.BSDFFlags.DiffuseReflection | both,
            mi.BSDFFlags.DiffuseTransmission | both,
        ]
        self.m_flags = self.m_components[0] | self.m_components[1]

    def _reflectance(self, si):
        return dr.select(si.wi.z > 0, self.reflectance_front, self.reflectance_back)

    def _albedos(self, ctx, si):
        return (
            self._reflectance(si) * ctx.is_enabled(mi.BSDFFlags.DiffuseReflection, 0),
            self.transmittance * ctx.is_enabled(mi.BSDFFlags.DiffuseTransmission, 1),
        )

    def _reflect_probability(self, ctx, si):
        reflectance, transmittance = self._albedos(ctx, si)
        total = reflectance + transmittance
        return dr.detach(dr.select(total > 0, reflectance / total, 0.5))

    def traverse(self, cb):
        for name in ("transmittance", "reflectance_front", "reflectance_back"):
            cb.put(name, getattr(self, name), mi.ParamFlags.Differentiable)

    def parameters_changed(self, keys=()):
        pass

    def sample(self, ctx, si, sample1, sample2, active=True):
        probability = self._reflect_probability(ctx, si)
        reflected = sample1 < probability
        wo = mi.warp.square_to_cosine_hemisphere(sample2)
        pdf = mi.warp.square_to_cosine_hemisphere_pdf(wo)
        wo.z = dr.select(reflected == (si.wi.z > 0), wo.z, -wo.z)
        bs = dr.zeros(mi.BSDFSample3f)
        bs.wo = wo
        bs.pdf = pdf * dr.select(reflected, probability, 1 - probability)
        bs.eta = 1.0
        bs.sampled_component = dr.select(reflected, mi.UInt32(0), mi.UInt32(1))
        bs.sampled_type = dr.select(
            reflected,
            mi.UInt32(+mi.BSDFFlags.DiffuseReflection),
            mi.UInt32(+mi.BSDFFlags.DiffuseTransmission),
        )
        active = active & valid_directions(si.wi) & (bs.pdf > 0)
        weight = self.eval(ctx, si, wo, active) / dr.select(active, bs.pdf, 1)
        return bs, dr.select(active, weight, 0)

    def eval(self, ctx, si, wo, active=True):
        reflectance, transmittance = self._albedos(ctx, si)
        albedo = dr.select(si.wi.z * wo.z > 0, reflectance, transmittance)
        active = active & valid_directions(si.wi, wo)
        return mi.Spectrum(dr.select(active, albedo * dr.abs(wo.z) * dr.inv_pi, 0))

    def pdf(self, ctx, si, wo, active=True):
        probability = self._reflect_probability(ctx, si)
        share = dr.select(si.wi.z * wo.z > 0, probability, 1 - probability)
        return dr.select(active & valid_directions(si.wi, wo), share * dr.abs(wo.z) * dr.inv_pi, 0)

    def eval_pdf(self, ctx, si, wo, active=True):
        return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

    def to_string(self):
        return "Diffuser[]"


mi.register_bsdf("diffuser", Diffuser)
