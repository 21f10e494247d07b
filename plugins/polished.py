"""`polished`: a smooth surface that mirrors more at grazing incidence, such as parquet."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
from drcmitsuba_plugins.checks import checked, required
from drcmitsuba_plugins.grazing import more_at_grazing
from drcmitsuba_plugins.sampling import valid_directions


class Polished(mi.BSDF):
    r"""Diffuse surface below a smooth clear one, by the formula of Radiance's smooth materials.

    ===============  ======  =====================================================================
    parameter        type    meaning
    ===============  ======  =====================================================================
    `mirrored`       float   m, mirrored share of the light at normal incidence
    `matt`           float   d, diffusely reflected share at normal incidence; m + d is 1 at most
    ===============  ======  =====================================================================

    With θ the angle at which the surface is seen and F an estimate of what Fresnel's formulas add,

    .. math::

        F(θ) = e^{-5.85 \cos θ} - e^{-5.85}, \qquad
        R(θ) = \underbrace{m + (1 - m) F}_{\text{mirrored}} +
            \underbrace{d (1 - F)}_{\text{diffuse}}

    Paths from the eye never gain energy: R ≤ 1 at any θ. The diffuse part, d (1 − F) / π, depends
    on the direction of the eye and not on that of the light, as Radiance has it for light from the
    sky; a beam at 80° and more, most of which is mirrored, is reflected diffusely as if it were
    not. A surface under even light is right.

    Components: 0 diffuse, 1 mirrored (delta). In `TransportMode.Radiance` the eye is along `wi`, in
    `Importance` along `wo`. One-sided (+z); `twosided` makes it a sheet. One value for all
    channels.
    """

    def __init__(self, props: mi.Properties):
        super().__init__(props)
        for name in ("mirrored", "matt"):
            value = required("polished", props, name, "a number from 0 to 1")
            setattr(self, name, mi.Float(checked("polished", name, value, 0, 1)))
        diffuse, delta = mi.BSDFFlags.DiffuseReflection, mi.BSDFFlags.DeltaReflection
        self.m_components = [diffuse | mi.BSDFFlags.FrontSide, delta | mi.BSDFFlags.FrontSide]
        self.m_flags = self.m_components[0] | self.m_components[1]

    def _shares(self, ctx, cos_theta):
        """Mirrored share at an incidence, and the diffuse one at an eye there."""
        f = more_at_grazing(cos_theta, dr.exp)
        mirrored, matt = self.mirrored + (1 - self.mirrored) * f, self.matt * (1 - f)
        none = mi.Float(0)
        return (
            mirrored if ctx.is_enabled(mi.BSDFFlags.DeltaReflection, 1) else none,
            matt if ctx.is_enabled(mi.BSDFFlags.DiffuseReflection, 0) else none,
        )

    def _probability(self, ctx, cos_theta):
        """Share of the samples that are mirrored."""
        mirrored, matt = self._shares(ctx, cos_theta)
        return dr.select(mirrored > 0, mirrored / (mirrored + matt), 0)

    def _matt(self, ctx, si, wo):
        """Diffuse share at the eye."""
        eye = si.wi.z if ctx.mode == mi.TransportMode.Radiance else wo.z
        return self._shares(ctx, eye)[1]

    def traverse(self, cb):
        cb.put("mirrored", self.mirrored, mi.ParamFlags.Differentiable)
        cb.put("matt", self.matt, mi.ParamFlags.Differentiable)

    def parameters_changed(self, keys=()):
        pass

    def sample(self, ctx, si, sample1, sample2, active=True):
        active = active & valid_directions(si.wi) & (si.wi.z > 0)
        mirrored = self._shares(ctx, si.wi.z)[0]
        probability = dr.detach(self._probability(ctx, si.wi.z))
        mirrors = sample1 < probability
        scattered = mi.warp.square_to_cosine_hemisphere(sample2)
        bs = dr.zeros(mi.BSDFSample3f)
        bs.wo = dr.select(mirrors, mi.reflect(si.wi), scattered)
        density = mi.warp.square_to_cosine_hemisphere_pdf(scattered)
        bs.pdf = dr.select(mirrors, probability, (1 - probability) * density)
        bs.eta = 1.0
        bs.sampled_component = dr.select(mirrors, mi.UInt32(1), 0)
        delta, diffuse = mi.BSDFFlags.DeltaReflection, mi.BSDFFlags.DiffuseReflection
        bs.sampled_type = dr.select(mirrors, mi.UInt32(+delta), mi.UInt32(+diffuse))
        share = dr.select(mirrors, mirrored, self._matt(ctx, si, bs.wo))
        weight = share / dr.select(mirrors, probability, 1 - probability)
        active &= (bs.pdf > 0) & (bs.wo.z > 0)
        return bs, mi.Spectrum(dr.select(active, weight, 0))

    def eval(self, ctx, si, wo, active=True):
        active = active & valid_directions(si.wi, wo) & (si.wi.z > 0) & (wo.z > 0)
        return mi.Spectrum(dr.select(active, self._matt(ctx, si, wo) * wo.z / dr.pi, 0))

    def pdf(self, ctx, si, wo, active=True):
        active = active & valid_directions(si.wi, wo) & (si.wi.z > 0) & (wo.z > 0)
        share = 1 - self._probability(ctx, si.wi.z)
        return dr.select(active, share * wo.z / dr.pi, 0)

    def eval_pdf(self, ctx, si, wo, active=True):
        return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

    def to_string(self):
        return "Polished[]"


mi.register_bsdf("polished", Polished)
