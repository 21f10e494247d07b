"""Light that panes send to each other across a room, against plain path tracing.

Without it the room gets the light of each façade as if the other were black to what is scattered or
mirrored there. Suns are 30° wide, so that plain path tracing finds them through films and mirrors.
Photons are many enough to put some tens of the ground's on every square in a replicate: with one or
none of them, eight replicates are not normal.
"""

import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.case.case import Case
from drcmitsuba.case.shipped import shipped_folder
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport import coefficients

FILM = {"type": "bsdf", "file": str(shipped_folder() / "films" / "prism.xml")}
MIRRORING = {"type": "glazing", "transmittance": 0.5, "reflectance": 0.35}
DIFFUSER = {"type": "diffuser", "transmittance": 0.4, "reflectance": 0.5}
ELEVATIONS, DIAMETER = (20.0, 50.0), 30.0
SUNS = np.array([[0, -np.cos(h), np.sin(h)] for h in np.radians(ELEVATIONS)])


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


def room(south, north):
    strip = {"bottom": 0.3, "top": 2.7}
    return Case.model_validate(
        {
            "room": {"size": [3.0, 3.0, 3.0], "floor": 0.3, "ceiling": 0.6, "walls": 0.4},
            "facade": {
                side: {"strips": [{**strip, "material": material}]}
                for side, material in (("south", south), ("north", north))
            },
            "materials": {"film": FILM, "glass": MIRRORING, "opal": DIFFUSER},
            "sensors": {"corner": [0.3, 0.3, 0.8], "count": [2, 2], "spacing": 1.2},
            "accuracy": {
                "paths": 512, "photons": 1 << 16, "cell_size": 0.2, "sensor_sky_rays": 8192,
                "cell_sky_rays": 256, "sensor_sun_samples": 64, "pane_points": 256,
                "film_sky_samples": 1024, "sensor_square": 0.2,
            },
        }
    )  # fmt: skip


def by_path_tracing(case, plain_coefficients, seed=0):
    shapes = {f"shape{i}": s for i, s in enumerate(scene.load(case).full.shapes())}
    sources = {
        "sky": {"type": "tregenza_sky"},
        "suns": {
            "type": "sun_disks",
            "directions": mi.TensorXf(SUNS.astype(np.float32)),
            "diameter": DIAMETER,
        },
    }
    world = mi.load_dict({"type": "scene", **shapes, **sources}, optimize=False)
    return plain_coefficients(world, *sensor_points(case), spp=1 << 13, seed=seed).sum(axis=0)


def by_parts(case, *, pane_to_pane):
    suns = Suns(tuple(f"sun_{h:g}" for h in ELEVATIONS), SUNS, DIAMETER)
    world = scene.load(case, effects=EnabledEffects(pane_to_pane=pane_to_pane))
    C = coefficients.compute(world, *sensor_points(case), suns, case.accuracy)
    return C["replicates"].values


@pytest.mark.slow
@pytest.mark.parametrize(
    ("south", "north"),
    [("open", "glass"), ("film", "film"), ("film", "opal")],
)
def test_what_panes_send_to_each_other_is_counted_once(south, north, same, plain_coefficients):
    case = room(south, north)
    here = by_parts(case, pane_to_pane=True)
    there = by_path_tracing(case, plain_coefficients)
    same(here[..., :146], other=there[..., :146], within=0.02)
    same(here[..., 146:], other=there[..., 146:], within=0.05)
    without = by_parts(case, pane_to_pane=False)
    lost = 1 - without[..., 146:].mean() / here[..., 146:].mean()
    print(f"{south} and {north}: {100 * lost:.1f} % of the suns' light is sent from pane to pane")
    assert lost > 0.002
