"""`diffuser`: a thin Lambertian pane, such as a sun shade, a fabric or opal glass."""

from __future__ import annotations

from functools import reduce
from operator import or_

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.checks import checked, required
from drcmitsuba_plugins.cosine_tables import at_cosine, cosine_table
from drcmitsuba_plugins.sampling import valid_directions


class Diffuser(mi.BSDF):
    """Thin pane whose transmitted and reflected light is Lambertian, but for a straight part.

    ====================  ==========  =============================================================
    parameter             type        meaning
    ====================  ==========  =============================================================
    `transmittance`       float,      diffuse transmittance T: f = T/π across the pane; or a table
                          tensor      T(θ) over the cosine of the light's incidence, as `straight`
    `reflectance_front`   float       diffuse reflectance seen from the room (+z), default 0
    `reflectance_back`    float       seen from outside (−z); default `reflectance_front`
    `straight`            float,      share τ(θ) of the light that passes undeviated, beside T,
                          tensor      default 0; or a table over cos θ = 0 … 1 in equal steps
    ====================  ==========  =============================================================

    Where T depends on the incidence, light comes along `wo` in `TransportMode.Radiance`, and along
    `wi` in `Importance`: what leaves is Lambertian, so that such a pane is not reciprocal.

    All four are exposed through `traverse` and differentiable. Components: 0 diffuse reflection, 1
    diffuse transmission, and 2 the straight one (null), where there is one. Limits: after loading,
    the caller keeps T + R + τ ≤ 1; one value for all channels.
    """

    def __init__(self, props: mi.Properties):
        super().__init__(props)
        front = props.get("reflectance_front", 0.0)
        through = required("diffuser", props, "transmittance", "a number from 0 to 1, or a table")
        if isinstance(through, (int, float)):
            self.transmittance = mi.Float(checked("diffuser", "transmittance", through, 0, 1))
        else:
            self.transmittance = cosine_table("diffuser", "transmittance", through)
        values = {
            "reflectance_front": front,
            "reflectance_back": props.get("reflectance_back", front),
        }
        for name, value in values.items():
            setattr(self, name, mi.Float(checked("diffuser", name, value, 0, 1)))
        both = mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
        straight = props.get("straight", 0.0)
        if isinstance(straight, (int, float)):
            straight = np.full(2, straight)
        self.straight = cosine_table("diffuser", "straight", straight)
        self.has_straight = bool(np.asarray(dr.detach(straight)).max() > 0)
        kinds = [mi.BSDFFlags.DiffuseReflection | both, mi.BSDFFlags.DiffuseTransmission | both]
        if self.has_straight:
            kinds.append(mi.BSDFFlags.Null | both)
        self.m_components, self.m_flags = kinds, reduce(or_, kinds)

    def _straight(self, ctx, si, active):
        """Share of the light that passes undeviated; 0 where the component is not asked for."""
        if not self.has_straight or not ctx.is_enabled(mi.BSDFFlags.Null, 2):
            return mi.Float(0)
        return at_cosine(self.straight, dr.abs(si.wi.z), active)

    def eval_null_transmission(self, si, active=True):
        active = active & valid_directions(si.wi)
        return mi.Spectrum(dr.select(active, at_cosine(self.straight, dr.abs(si.wi.z), active), 0))

    def _reflectance(self, si):
        return dr.select(si.wi.z > 0, self.reflectance_front, self.reflectance_back)

    def _albedos(self, ctx, si):
        """Reflectance, and transmittance or its mean, of the components that are asked for."""
        through = self.transmittance
        if dr.is_tensor_v(through):
            n = through.shape[0]
            c = dr.linspace(mi.Float, 0, 1, n)
            through = dr.sum(through.array * c) / dr.sum(c)
        return (
            self._reflectance(si) * ctx.is_enabled(mi.BSDFFlags.DiffuseReflection, 0),
            through * ctx.is_enabled(mi.BSDFFlags.DiffuseTransmission, 1),
        )

    def _transmitted(self, ctx, si, wo, active):
        """Transmittance of light along a direction."""
        through = self.transmittance
        if dr.is_tensor_v(through):
            light = wo if ctx.mode == mi.TransportMode.Radiance else si.wi
            through = at_cosine(through, dr.abs(light.z), active)
        return through * ctx.is_enabled(mi.BSDFFlags.DiffuseTransmission, 1)

    def _reflect_probability(self, ctx, si):
        reflectance, transmittance = self._albedos(ctx, si)
        total = reflectance + transmittance
        return dr.detach(dr.select(total > 0, reflectance / total, 0.5))

    def _scattered(self, ctx, si, active):
        """Share of the samples that are scattered, and the share of the light that is not."""
        tau = self._straight(ctx, si, active)
        diffuse = sum(self._albedos(ctx, si))
        total = diffuse + tau
        return dr.detach(dr.select(total > 0, diffuse / total, 1)), tau

    def traverse(self, cb):
        for name in ("transmittance", "reflectance_front", "reflectance_back", "straight"):
            cb.put(name, getattr(self, name), mi.ParamFlags.Differentiable)

    def parameters_changed(self, keys=()):
        pass

    def sample(self, ctx, si, sample1, sample2, active=True):
        active = active & valid_directions(si.wi)
        scattered, tau = self._scattered(ctx, si, active)
        passes = sample1 >= scattered
        sample1 = dr.select(passes, 0, sample1 / dr.select(scattered > 0, scattered, 1))
        probability = self._reflect_probability(ctx, si)
        reflected = ~passes & (sample1 < probability)
        wo = mi.warp.square_to_cosine_hemisphere(sample2)
        pdf = mi.warp.square_to_cosine_hemisphere_pdf(wo)
        wo.z = dr.select(reflected == (si.wi.z > 0), wo.z, -wo.z)
        bs = dr.zeros(mi.BSDFSample3f)
        bs.wo = dr.select(passes, -si.wi, wo)
        pdf *= scattered * dr.select(reflected, probability, 1 - probability)
        bs.pdf = dr.select(passes, 1 - scattered, pdf)
        bs.eta = 1.0
        across = dr.select(passes, mi.UInt32(2), 1)
        bs.sampled_component = dr.select(reflected, mi.UInt32(0), across)
        kinds = mi.BSDFFlags.DiffuseReflection, mi.BSDFFlags.DiffuseTransmission, mi.BSDFFlags.Null
        diffuse, through, null = (mi.UInt32(+kind) for kind in kinds)
        bs.sampled_type = dr.select(reflected, diffuse, dr.select(passes, null, through))
        active &= bs.pdf > 0
        light = dr.select(passes, mi.Spectrum(tau), self.eval(ctx, si, wo, active))
        weight = light / dr.select(active, bs.pdf, 1)
        return bs, dr.select(active, weight, 0)

    def eval(self, ctx, si, wo, active=True):
        active = active & valid_directions(si.wi, wo)
        across = self._transmitted(ctx, si, wo, active)
        albedo = dr.select(si.wi.z * wo.z > 0, self._albedos(ctx, si)[0], across)
        return mi.Spectrum(dr.select(active, albedo * dr.abs(wo.z) * dr.inv_pi, 0))

    def pdf(self, ctx, si, wo, active=True):
        active = active & valid_directions(si.wi, wo)
        probability = self._reflect_probability(ctx, si)
        share = dr.select(si.wi.z * wo.z > 0, probability, 1 - probability)
        share *= self._scattered(ctx, si, active)[0]
        return dr.select(active, share * dr.abs(wo.z) * dr.inv_pi, 0)

    def eval_pdf(self, ctx, si, wo, active=True):
        return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

    def to_string(self):
        return "Diffuser[]"


mi.register_bsdf("diffuser", Diffuser)
