"""Pictures by plain path tracing, which pictures from light paths are tested against."""

from dataclasses import dataclass, field

import drjit as dr
import mitsuba as mi
import numpy as np
from drcmitsuba_plugins.patches import patch_index

from drcmitsuba.rendering.outside import OutsideLuminances
from drcmitsuba.scene.materials import bsdf
from drcmitsuba.scene.meshes import quad_mesh

LUMINANCES = np.random.default_rng(3).uniform(2000, 9000, 146)


@dataclass(frozen=True)
class Patchwise(OutsideLuminances):
    """Outside whose sky has one luminance for each patch, as the reference has it."""

    sky_scale: np.ndarray = field(default_factory=lambda: LUMINANCES)

    def sky(self, d):
        return dr.gather(mi.Float, mi.Float(self.sky_scale.astype(np.float32)), patch_index(d, 1))


def pictures(surfaces, view, size, sun, spp=512, count=16):
    """Pictures of independent seeds, shape (replicate, row, column, bin); the sun is the last."""
    meshes = {
        f"s{i}": quad_mesh(s.name, s.quads, mi.load_dict(bsdf(s.material, -1)))
        for i, s in enumerate(surfaces)
    }
    suns = {"type": "sun_disks", "directions": mi.TensorXf(sun[None].astype(np.float32))}
    sky = {"type": "tregenza_sky"}
    world = mi.load_dict({"type": "scene", **meshes, "sky": sky, "suns": suns}, optimize=False)
    target = [a + b for a, b in zip(view.position, view.direction, strict=True)]
    look = mi.ScalarTransform4f().look_at(origin=view.position, target=target, up=view.up)
    film = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}}
    film["pixel_format"] = "luminance"
    eye = mi.load_dict(
        {
            "type": "fisheye", "mapping": view.kind, "angle": view.angles[0], "to_world": look,
            "film": film,
        }
    )  # fmt: skip
    integrator = mi.load_dict({"type": "coefficient"})
    return np.stack([integrator.render(world, eye, seed=i, spp=spp).numpy() for i in range(count)])
