"""Small scenes, plates and samples that the tests of the plugins share."""

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import Patches

from tests import ROOT

PRISM = ROOT / "scenes" / "films" / "prism.xml"
UP = [0.0, 0.0, 1.0]
ORIGIN = [0.0, 0.0, 0.0]
SUNS = np.array([[0, 0, 1], [0.6, 0, 0.8], [0, 0.96, 0.28], [-0.8, 0.6, 0]])
"""The last one is cut in half by a horizontal sensor's horizon."""
DIFFUSER = {"type": "diffuser", "transmittance": 0.3, "reflectance_front": 0.5}


def tensor(values):
    return mi.TensorXf(np.asarray(values, np.float32))


def grey(value):
    return {"type": "uniform", "value": value}


def matt(reflectance):
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": grey(reflectance)}}


def suns(directions=SUNS, **parameters):
    return {"type": "sun_disks", "directions": tensor(directions), **parameters}


def load(**parts):
    return mi.load_dict({"type": "scene", **parts}, optimize=False)


def plate(z, bsdf, half=0.5, at=(0.0, 0.0), tilt=0.0):
    """Square of `half` width at height z, front upward, tilted about the x axis [deg]."""
    T = mi.ScalarTransform4f
    place = T().translate([*at, z]).rotate([1, 0, 0], tilt).scale([half, half, 1])
    return {"type": "rectangle", "to_world": place, "bsdf": bsdf}


def furnished(reflectance=0.5):
    """A few things in the way of light: a screen, a ball and a bench, none of them convex alone."""
    return {
        "screen": plate(1.0, matt(reflectance), half=0.8, at=(0.5, 0.4), tilt=60),
        "ball": {"type": "sphere", "radius": 0.4, "center": [-0.8, 0.2, 0.5]}
        | {"bsdf": matt(reflectance)},
        "bench": plate(-0.2, matt(reflectance), half=2.0),
    }


def lossless(kind):
    if kind == "glazing":  # τ₀ (1 − (1−c)⁵) + ρ₀ + (1−ρ₀)(1−c)⁵ = 1 where τ₀ + ρ₀ = 1
        return {"type": "glazing", "transmittance": 0.7, "exponent": 5.0, "reflectance_front": 0.3}
    return {"type": "diffuser", "transmittance": 0.4, "reflectance_front": 0.6}


def white_sky_camera(**parts):
    """Two pixels that look straight down on the origin."""
    camera = {
        "type": "perspective",
        "fov": 2.0,
        "to_world": mi.ScalarTransform4f().look_at(origin=[0, 0, 3], target=ORIGIN, up=[0, 1, 0]),
        "film": {"type": "hdrfilm", "width": 2, "height": 2, "rfilter": {"type": "box"}},
    }
    return load(camera=camera, **parts)


def chi2(adapter, sample_dim, seed=1):
    # Densities jump between patches: 24² nodes a cell integrate what straddles a border.
    test = mi.chi2.ChiSquareTest(
        mi.chi2.SphericalDomain(), *adapter, sample_dim, 400_000, res=31, ires=24, seed=seed
    )
    passed = test.run(significance_level=1e-3, quiet=True)
    return passed, test.messages


def meter(**parts):
    """A small irradiancemeter at the origin, looking up, in a furnished scene."""
    shape = plate(-1e-3, matt(0.0), half=1e-3) | {"sensor": {
        "type": "irradiancemeter",
        "film": {"type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}},
    }}  # fmt: skip
    return load(integrator={"type": "path", "max_depth": -1}, meter=shape, **furnished(), **parts)


def renders(scene, integrator, spp=1 << 15, replicates=16):
    return np.stack(
        [
            np.array(mi.render(scene, integrator=integrator, spp=spp, seed=i))[..., :1]
            for i in range(replicates)
        ]
    )


def view(**parts):
    look = mi.ScalarTransform4f().look_at(origin=[3, -2, 1.5], target=[0, 0, 0.3], up=UP)
    film = {"type": "hdrfilm", "width": 8, "height": 6, "rfilter": {"type": "box"}}
    camera = {"type": "perspective", "fov": 50.0, "to_world": look, "film": film}
    pane = plate(0.5, lossless("glazing"), half=0.5, at=(1.0, -0.6), tilt=70)
    return load(camera=camera, pane=pane, **furnished(), **parts)


def local(cos_theta, count=1, phi=0.4):
    c = mi.Float(np.broadcast_to(np.asarray(cos_theta, np.float32), count))
    s = dr.safe_sqrt(1 - c * c)
    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(c))
    si.wi = mi.Vector3f(s * np.cos(phi), s * np.sin(phi), c)
    return si


def varied_sky(**parameters):
    n = len(Patches(parameters.get("subdivision", 1)))
    radiance = np.random.default_rng(7).uniform(0.2, 5, n)
    return {"type": "tregenza_sky", "radiance": tensor(radiance), **parameters}


def turned():
    return mi.ScalarTransform4f().rotate([0, 0, 1], 37.0)


def tipped():
    return mi.ScalarTransform4f().rotate([0.48, 0.6, 0.64], 50.0)
