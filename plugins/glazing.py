"""`glazing`: a thin clear pane whose transmittance and reflectance depend on incidence."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.checks import checked, required
from drcmitsuba_plugins.cosine_tables import at_cosine, cosine_table
from drcmitsuba_plugins.sampling import valid_directions


class Glazing(mi.BSDF):
    """Thin clear pane: light goes straight through or is mirrored.

    ====================  ==============  ========================================================
    parameter             type            meaning
    ====================  ==============  ========================================================
    `transmittance`       float, tensor   at normal incidence, then τ(θ) = τ₀ [1 − (1 − cos θ)ᵖ];
                                          or a table over cos θ = 0 … 1 in equal steps
    `exponent`            float           exponent p of τ(θ), default 4.5
    `reflectance_front`   float, tensor   seen from the room (+z), then Schlick's
                                          ρ(θ) = ρ₀ + (1 − ρ₀)(1 − cos θ)⁵ where ρ₀ > 0; or a table
    `reflectance_back`    float, tensor   seen from outside (−z); default `reflectance_front`
    ====================  ==============  ========================================================

    The tables (`transmittance`, …) are exposed through `traverse` and differentiable. Both
    components are delta distributions: `eval` and `pdf` are 0. Limits: no thickness, no offset,
    one value for all channels; after loading, the caller keeps τ + ρ ≤ 1.
    """

    SIZE = 1025  # a table from a formula is exact to 1e-6 with linear interpolation

    def __init__(self, props: mi.Properties):
        super().__init__(props)
        c = np.linspace(0, 1, self.SIZE)
        transmittance = required("glazing", props, "transmittance", "a number or a tensor (n,)")
        if isinstance(transmittance, (int, float)):
            exponent = float(checked("glazing", "exponent", props.get("exponent", 4.5), 0, 100))
            transmittance = transmittance * (1 - (1 - c) ** exponent)
        front = props.get("reflectance_front", 0.0)
        back = props.get("reflectance_back", front)
        self.transmittance = cosine_table("glazing", "transmittance", transmittance)
        self.reflectance_front = cosine_table(
            "glazing", "reflectance_front", self._schlick(front, c)
        )
        self.reflectance_back = cosine_table("glazing", "reflectance_back", self._schlick(back, c))
        both = mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
        self.m_components = [mi.BSDFFlags.DeltaReflection | both, mi.BSDFFlags.Null | both]
        self.m_flags = self.m_components[0] | self.m_components[1]

    @staticmethod
    def _schlick(value, c):
        if not isinstance(value, (int, float)):
            return value
        return value + (1 - value) * (1 - c) ** 5 if value > 0 else value + 0 * c

    def _reflectance(self, cos_theta, active):
        front = at_cosine(self.reflectance_front, cos_theta, active)
        back = at_cosine(self.reflectance_back, -cos_theta, active)
        return dr.select(cos_theta > 0, front, back)

    def traverse(self, cb):
        for name in ("transmittance", "reflectance_front", "reflectance_back"):
            cb.put(name, getattr(self, name), mi.ParamFlags.Differentiable)

    def parameters_changed(self, keys=()):
        pass

    def eval_null_transmission(self, si, active=True):
        active = active & valid_directions(si.wi)
        tau = at_cosine(self.transmittance, dr.abs(si.wi.z), active)
        return mi.Spectrum(dr.select(active, tau, 0))

    def sample(self, ctx, si, sample1, sample2, active=True):
        active = active & valid_directions(si.wi)
        tau = at_cosine(self.transmittance, dr.abs(si.wi.z), active)
        rho = self._reflectance(si.wi.z, active)
        tau = tau * ctx.is_enabled(mi.BSDFFlags.Null, 1)
        rho = rho * ctx.is_enabled(mi.BSDFFlags.DeltaReflection, 0)
        total = tau + rho
        probability = dr.detach(dr.select(total > 0, tau / total, 0))
        straight = sample1 < probability
        bs = dr.zeros(mi.BSDFSample3f)
        bs.wo = dr.select(straight, -si.wi, mi.reflect(si.wi))
        bs.pdf = dr.select(straight, probability, 1 - probability)
        bs.eta = 1.0
        bs.sampled_component = dr.select(straight, mi.UInt32(1), mi.UInt32(0))
        bs.sampled_type = dr.select(
            straight, mi.UInt32(+mi.BSDFFlags.Null), mi.UInt32(+mi.BSDFFlags.DeltaReflection)
        )
        weight = dr.select(straight, tau, rho) / dr.select(bs.pdf > 0, bs.pdf, 1)
        return bs, mi.Spectrum(dr.select(active & (total > 0), weight, 0))

    def eval(self, ctx, si, wo, active=True):
        return mi.Spectrum(0)

    def pdf(self, ctx, si, wo, active=True):
        return mi.Float(0)

    def eval_pdf(self, ctx, si, wo, active=True):
        return mi.Spectrum(0), mi.Float(0)

    def to_string(self):
        return "Glazing[]"


mi.register_bsdf("glazing", Glazing)
