"""All plugins: registered in every variant, and wrong parameters named."""

import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.runtime import backend
from tests.unit.plugins.small_scenes import (
    DIFFUSER,
    ORIGIN,
    UP,
    load,
    lossless,
    plate,
    suns,
    tensor,
)


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


# Variants, and parameters that make no sense


def test_plugins_come_back_after_every_change_of_variant():
    present = {"llvm": bool(backend.llvm_version()), "cuda": backend.cuda_available()}
    jit = [v for v in mi.variants() if present.get(v[:4]) and not v.endswith("polarized")]
    for name in [*jit, "scalar_rgb", jit[0]]:
        mi.set_variant(name)
        if name.startswith("scalar"):
            continue  # a plugin in Python needs a vectorised variant
        scene = load(sky={"type": "tregenza_sky"}, suns=suns(), pane=plate(1, lossless("glazing")),
                     shade=plate(2, DIFFUSER))  # fmt: skip
        integrator = mi.load_dict({"type": "coefficient"})
        c = integrator.sensors(scene, [ORIGIN], [UP], 256).numpy()
        assert c.shape == (2, 1, 150)
        assert c.sum() > 0.5
    backend.select(jit[0])


BAD = [
    ("tregenza_sky", "radiance", {"radiance": [1, 2, 3, 4]}),
    ("tregenza_sky", "radiance", {"radiance": [np.nan] * 146}),
    ("tregenza_sky", "radiance", {"radiance": [-1.0] * 146}),
    ("tregenza_sky", "subdivision", {"subdivision": 7}),
    ("tregenza_sky", "subdivision", {"subdivision": 0}),
    ("tregenza_sky", "subdivison", {"subdivison": 2}),
    ("sun_disks", "directions", {}),
    ("sun_disks", "directions", {"directions": [[0, 1]]}),
    ("sun_disks", "directions", {"directions": np.zeros((0, 3))}),
    ("sun_disks", "directions", {"directions": [[0, 0, 0]]}),
    ("sun_disks", "radiance", {"directions": [[0, 0, 1]], "radiance": [1, 2, 3, 4]}),
    ("sun_disks", "radiance", {"directions": [[0, 0, 1]], "radiance": [np.inf]}),
    ("sun_disks", "diameter", {"directions": [[0, 0, 1]], "diameter": -1.0}),
    ("glazing", "transmittance", {}),
    ("glazing", "transmittance", {"transmittance": 1.5}),
    ("glazing", "transmittance", {"transmittance": float("nan")}),
    ("glazing", "transmittance", {"transmittance": "clear"}),
    ("glazing", "exponent", {"transmittance": 0.5, "exponent": -1.0}),
    ("glazing", "reflectance_front", {"transmittance": 0.5, "reflectance_front": [[0.1] * 4] * 2}),
    ("glazing", "reflectance_back", {"transmittance": 0.5, "reflectance_back": -0.5}),
    ("diffuser", "transmittance", {}),
    ("diffuser", "transmittance", {"transmittance": -0.1}),
    ("diffuser", "reflectance_back", {"transmittance": 0.1, "reflectance_back": 1.1}),
    ("coefficient", "max_depth", {"max_depth": "deep"}),
    ("coefficient", "suns_per_vertex", {"suns_per_vertex": 0}),
]


@pytest.mark.parametrize(("plugin", "field", "parameters"), BAD)
def test_bad_parameters_raise_and_are_named(plugin, field, parameters):
    arrays = {
        k: v if isinstance(v, (int, float, str)) else tensor(v) for k, v in parameters.items()
    }
    with pytest.raises(Exception, match=rf"(?s){plugin}.*{field}"):
        mi.load_dict({"type": plugin, **arrays})
