"""`redirecting_film`: a daylight redirecting film of five numbers, all of them differentiable."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
from drcmitsuba_plugins.checks import checked, required
from drcmitsuba_plugins.redirection import (
    concentration,
    folded,
    redirected,
    redirected_from,
    von_mises_fisher,
)
from drcmitsuba_plugins.sampling import (
    directions_of,
    pane_axes,
    pane_to_local,
    to_pane,
    valid_directions,
)

LEAST_SPREAD = 0.25
"""Least spread σ [deg]: float32 does not resolve narrower lobes."""

RANGES = {
    "transmittance": (0.0, 1.0),
    "redirected": (0.0, 1.0),
    "tilt": (-90.0, 90.0),
    "spread": (LEAST_SPREAD, 90.0),
    "reflectance_front": (0.0, 1.0),
}
"""Least and largest value of every parameter, in its unit."""


def _mirrored(w):
    """Direction with |z| in place of z."""
    return mi.Vector3f(w.x, w.y, dr.abs(w.z))


class RedirectingFilm(mi.BSDF):
    r"""Thin pane that transmits a fraction of the light in a lobe about the redirected direction.

    =====================  ========  ===============================================================
    parameter              type      meaning
    =====================  ========  ===============================================================
    `transmittance`        float     T of light from either side, 0 … 1
    `redirected`           float     share r of it in the lobe, 0 … 1, default 1; the rest leaves
                                     evenly (Lambertian)
    `tilt`                 float     lobe above the redirected direction, −90 … 90 deg, default 0
    `spread`               float     σ of the lobe, 0.25 … 90 deg, default 5
    `reflectance_front`    float     diffuse reflectance seen from the room (+z), default 0; the
                                     back reflects nothing
    `up`                   vector    world direction of the pane's y axis, default +z; it is
                                     projected on the pane (+y for a horizontal one)
    =====================  ========  ===============================================================

    The shading normal points into the room. A perfect redirector sends light that travels downward
    upward at the same angle, as a horizontal mirror within the pane does (and light from the ground
    downward). With :math:`\mu` this direction, turned up by the tilt about the pane's x axis, and
    :math:`o` the one in which light leaves,

    .. math:: f \cos\theta_o = T \, [r \, (v(o, \mu) + v(o', \mu)) + (1 - r) \cos\theta_o / \pi],

    where v is the density of von Mises and Fisher with :math:`\kappa = 1/\sigma^2`, for small σ a
    Gaussian of standard deviation σ in each plane [1]_, and o' is o with its z reversed: light
    behind the pane is folded back into the room. So exactly T of the light leaves for every
    direction, tilt and spread.

    The five numbers are exposed through `traverse` and differentiable, at the ends of their ranges
    too. `eval`, `pdf` and `sample` are closed forms. In `TransportMode.Radiance` light enters along
    `wo`, in `Importance` along `wi`; in `Importance` the weight of a sample is the albedo.

    Limits: T + `reflectance_front` ≤ 1 is checked at loading only; later the caller keeps it. A
    tilted film is not reciprocal, and its radiance at grazing directions grows as 1/cos θ: flux is
    conserved, étendue only where the lobe is narrow and not tilted. A share of exactly 0 is never
    drawn, so gradients by `sample` miss it; those of `eval` do not. One value for all channels.

    References
    ----------
    .. [1] W. Jakob, "Numerically stable sampling of the von Mises Fisher distribution on S²", 2012.
    """

    def __init__(self, props: mi.Properties):
        super().__init__(props)
        values = {
            "transmittance": required(
                "redirecting_film", props, "transmittance", "a number from 0 to 1"
            ),
            "redirected": props.get("redirected", 1.0),
            "tilt": props.get("tilt", 0.0),
            "spread": props.get("spread", 5.0),
            "reflectance_front": props.get("reflectance_front", 0.0),
        }
        for name, value in values.items():
            setattr(self, name, mi.Float(checked("redirecting_film", name, value, *RANGES[name])))
        total = float(values["transmittance"]) + float(values["reflectance_front"])
        checked("redirecting_film", "transmittance + reflectance_front", total, 0, 1 + 1e-6)
        self.up, self.level = directions_of("redirecting_film", props)
        both = mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
        self.m_components = [
            mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide,
            mi.BSDFFlags.GlossyTransmission | both | mi.BSDFFlags.Anisotropic,
            mi.BSDFFlags.DiffuseTransmission | both,
        ]
        self.m_flags = self.m_components[0] | self.m_components[1] | self.m_components[2]

    def traverse(self, cb):
        for name in RANGES:
            cb.put(name, getattr(self, name), mi.ParamFlags.Differentiable)

    def parameters_changed(self, keys=()):
        pass

    def _axes(self, si):
        """Axes x and y of the pane in the local frame."""
        try:
            return pane_axes(si, self.up, self.level)
        except ValueError as error:
            raise ValueError(f"redirecting_film: {error}") from None

    def _albedos(self, ctx, wi):
        """Albedos of reflection, lobe and even transmission."""
        front = dr.select(wi.z > 0, self.reflectance_front, 0)
        lobe = self.transmittance * self.redirected
        return (
            front * ctx.is_enabled(mi.BSDFFlags.DiffuseReflection, 0),
            lobe * ctx.is_enabled(mi.BSDFFlags.GlossyTransmission, 1),
            (self.transmittance - lobe) * ctx.is_enabled(mi.BSDFFlags.DiffuseTransmission, 2),
        )

    def _probabilities(self, ctx, wi):
        """Probabilities of drawing reflection, lobe and even transmission."""
        albedos = [dr.detach(a) for a in self._albedos(ctx, wi)]
        total = albedos[0] + albedos[1] + albedos[2]
        return [dr.select(total > 0, a / dr.select(total > 0, total, 1), 0) for a in albedos]

    def _centres(self, mode, wi):
        """Centres of the two lobes that `wo` (z ≥ 0) is drawn from, and the share of the first."""
        tilt, known = dr.detach(self.tilt), _mirrored(wi)
        if mode == mi.TransportMode.Importance:
            centre = redirected(known, tilt)
            return centre, centre, mi.Float(1)
        centres = redirected_from(known, tilt), redirected_from(folded(known), tilt)
        # Fraction of each lobe before the pane, where it is not folded.
        width = dr.sqrt(0.5 * concentration(dr.detach(self.spread)))
        before, second = (1e-3 + 0.5 + 0.5 * dr.erf(c.z * width) for c in centres)
        return *centres, before / (before + second)

    def _lobe_density(self, mode, wi, wo):
        """Density [1/sr] of the directions of `_draw`."""
        first, second, share = self._centres(mode, wi)
        kappa, wo = concentration(dr.detach(self.spread)), _mirrored(wo)
        a, b = (
            von_mises_fisher(kappa, c, wo) + von_mises_fisher(kappa, c, folded(wo))
            for c in (first, second)
        )
        return dr.lerp(b, a, share)

    def _draw(self, mode, wi, u, uv):
        """Direction drawn from the lobe, z ≥ 0."""
        first, second, share = self._centres(mode, wi)
        kappa = concentration(dr.detach(self.spread))
        centre = dr.select(u < share, first, second)
        # 1 − cos θ, not cos θ, is drawn: it keeps its digits in narrow lobes [1].
        q = -dr.log(dr.maximum(1 - uv.x * (1 - dr.exp(-2 * kappa)), 1e-30)) / kappa
        q = dr.minimum(q, 2)
        s, c = dr.sincos(dr.two_pi * uv.y)
        r = dr.safe_sqrt(q * (2 - q))
        return _mirrored(mi.Frame3f(centre).to_world(mi.Vector3f(r * c, r * s, 1 - q)))

    def _value(self, ctx, wi, wo):
        """BSDF times |cos θ| for directions in the pane's frame."""
        reflection, lobe, even = self._albedos(ctx, wi)
        light, leaving = (wo, wi) if ctx.mode == mi.TransportMode.Radiance else (wi, wo)
        centre = redirected(_mirrored(light), self.tilt)
        kappa, leaving = concentration(self.spread), _mirrored(leaving)
        density = von_mises_fisher(kappa, centre, leaving)
        density += von_mises_fisher(kappa, centre, folded(leaving))
        cosine = dr.abs(wo.z)
        if ctx.mode == mi.TransportMode.Radiance:
            density *= cosine / dr.select(leaving.z > 0, leaving.z, 1)
        through = lobe * density + even * cosine * dr.inv_pi
        return dr.select(wi.z * wo.z > 0, reflection * cosine * dr.inv_pi, through)

    def _pdf(self, ctx, wi, wo):
        """Density of `wo` [1/sr]."""
        reflection, lobe, even = self._probabilities(ctx, wi)
        cosine = dr.abs(wo.z) * dr.inv_pi
        through = lobe * self._lobe_density(ctx.mode, wi, wo) + even * cosine
        return dr.detach(dr.select(wi.z * wo.z > 0, reflection * cosine, through))

    def sample(self, ctx, si, sample1, sample2, active=True):
        axes = self._axes(si)
        wi = to_pane(si.wi, axes)
        reflection, lobe, _ = self._probabilities(ctx, wi)
        reflected, in_lobe = sample1 < reflection, sample1 >= 1 - lobe
        u = dr.select(in_lobe, (sample1 - (1 - lobe)) / dr.maximum(lobe, 1e-30), 0)
        wo = mi.warp.square_to_cosine_hemisphere(sample2)
        wo = dr.select(in_lobe, self._draw(ctx.mode, wi, u, sample2), wo)
        wo.z = dr.select(reflected == (wi.z > 0), wo.z, -wo.z)
        bs = dr.zeros(mi.BSDFSample3f)
        bs.wo = pane_to_local(wo, axes)
        bs.pdf = self._pdf(ctx, wi, wo)
        bs.eta = 1.0
        kinds = ("DiffuseReflection", "GlossyTransmission", "DiffuseTransmission")
        flags = [mi.UInt32(+getattr(mi.BSDFFlags, kind)) for kind in kinds]
        chosen = dr.select(reflected, mi.UInt32(0), dr.select(in_lobe, mi.UInt32(1), 2))
        bs.sampled_component = chosen
        bs.sampled_type = dr.select(reflected, flags[0], dr.select(in_lobe, flags[1], flags[2]))
        active = active & valid_directions(wi, wo) & (bs.pdf > 0)
        weight = self._value(ctx, wi, wo) / dr.select(active, bs.pdf, 1)
        return bs, mi.Spectrum(dr.select(active, weight, 0))

    def eval(self, ctx, si, wo, active=True):
        return self.eval_pdf(ctx, si, wo, active)[0]

    def pdf(self, ctx, si, wo, active=True):
        return self.eval_pdf(ctx, si, wo, active)[1]

    def eval_pdf(self, ctx, si, wo, active=True):
        axes = self._axes(si)
        wi, wo = to_pane(si.wi, axes), to_pane(wo, axes)
        active = active & valid_directions(wi, wo)
        value, pdf = self._value(ctx, wi, wo), self._pdf(ctx, wi, wo)
        return mi.Spectrum(dr.select(active, value, 0)), dr.select(active, pdf, 0)

    def to_string(self):
        return "RedirectingFilm[]"


mi.register_bsdf("redirecting_film", RedirectingFilm)
