"""A mirror for references: paths are mirrored, and shadow rays pass it to suns behind it.

Suns that stand behind it, where the images of suns in it are, so light a room as the suns that it
mirrors do, and what the room sends to the mirror comes back as by the mirror itself. Plain paths
find mirrored suns by chance alone.
"""

from __future__ import annotations

import mitsuba as mi


def image_mirror(reflectance: float) -> mi.BSDF:
    """Make the mirror; its reflectance [–] is its transmittance for shadow rays, too."""

    class ImageMirror(mi.BSDF):
        def __init__(self, props: mi.Properties) -> None:
            super().__init__(props)
            self.reflectance = float(props.get("reflectance", 1.0))
            both = mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
            kinds = mi.BSDFFlags.DeltaReflection | both, mi.BSDFFlags.Null | both
            self.m_components = [+kind for kind in kinds]
            self.m_flags = kinds[0] | kinds[1]

        def sample(self, ctx, si, sample1, sample2, active=True):
            bs = mi.BSDFSample3f()
            bs.wo, bs.pdf, bs.eta = mi.reflect(si.wi), mi.Float(1), mi.Float(1)
            bs.sampled_component = mi.UInt32(0)
            bs.sampled_type = mi.UInt32(+mi.BSDFFlags.DeltaReflection)
            return bs, mi.Spectrum(self.reflectance) & active

        def eval(self, ctx, si, wo, active=True):
            return mi.Spectrum(0)

        def pdf(self, ctx, si, wo, active=True):
            return mi.Float(0)

        def eval_pdf(self, ctx, si, wo, active=True):
            return mi.Spectrum(0), mi.Float(0)

        def eval_null_transmission(self, si, active=True):
            return mi.Spectrum(self.reflectance)

    mi.register_bsdf("image_mirror", ImageMirror)
    return mi.load_dict({"type": "image_mirror", "reflectance": reflectance})
