"""E as a function of the reflectances where groups of panes close, and where components stand."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba import evaluate
from drcmitsuba.design import surface_kinds
from drcmitsuba.design.reflectances import Interior, with_reflectances
from drcmitsuba.runtime import backend
from drcmitsuba.scene.surfaces import surfaces_of
from drcmitsuba.sky import daylight
from tests.differences import slopes
from tests.unit.design.test_design_reflectances import ELSEWHERE, at, case_of, fresh

SILVER = {"type": "mirror", "reflectance": 0.95}
WINDOW = {"bottom": 1.2, "top": 1.8, "material": "glass"}
PIPE = {
    "type": "lightpipe", "centre": (2.0, 3.5), "width": 0.6, "height": 1.0, "mirror": "silver",
}  # fmt: skip
SHELF = """[structure]
kind = "lamellae"
period = 200
width = 150
tilt = 20
reflectance = 0.9
specular = 1
"""


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


def with_component(kind, folder, seed=0, replicates=2):
    """A room whose light comes by a pipe alone, or by a window with lamellae above it."""
    strips, component = [], {"pipe": PIPE}
    if kind == "lamellae":
        (folder / "recipe.toml").write_text(SHELF)
        strips = [WINDOW, {"bottom": 1.9, "top": 2.7, "material": "lamellae"}]
        component = {"lamellae": {"type": "structure", "recipe": str(folder / "recipe.toml")}}
    glass = {"type": "glazing", "transmittance": 0.65}
    return case_of(
        facade={"south": {"strips": strips}}, components=component, shading=None,
        materials={"glass": glass, "silver": SILVER},
        period={"months": [3], "hours": (12, 13), "days_per_week": 1},
        accuracy={"seed": seed, "replicates": replicates, "paths": 128, "cell_size": 0.3,
                  "cell_sky_rays": 64, "sensor_sky_rays": 512,
                  "photons": 128 if kind == "pipe" else 2048,
                  "sensor_square": 0.5},
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["pipe", "lamellae"])
def test_light_by_components_equals_a_fresh_simulation(tmp_path, same, kind):
    year = daylight.daylight(with_component(kind, tmp_path))
    interiors = [Interior.of(with_component(kind, tmp_path, seed), year) for seed in range(4)]
    theirs = fresh(with_reflectances(with_component(kind, tmp_path, 100, 8), ELSEWHERE), year)
    E = np.stack([at(interior, ELSEWHERE)[0] for interior in interiors])
    same(E, other=theirs, within=0.02 if kind == "pipe" else 0.04)


def test_the_ring_around_a_round_pipe_is_of_the_ceiling(tmp_path, monkeypatch):
    case, build = with_component("pipe", tmp_path), surface_kinds.scene.build
    round_pipe = case.components["pipe"].model_copy(update={"sides": 8})
    case = case.with_tables(components={"pipe": round_pipe})
    names = {surface.name for surface in surfaces_of(case, "open")}
    assert "pipe ring" in names
    built = []
    monkeypatch.setattr(
        surface_kinds.scene, "build", lambda s, *a, **o: built.append(s) or build(s, *a, **o)
    )
    surface_kinds.marked(case, "open", surface_kinds.reflectances(case))
    unmarked = {surface.name for surface in built[0]}
    assert names - unmarked >= {"pipe ring", "ceiling", "floor"}


def with_groups(kind, folder, seed=0, hours=(8, 18)):
    """A room with windows to the south and to the west, hours of a March.

    Its blinds close façade by façade, or those to the west follow a schedule.
    """
    names = np.array(["open", "veil", "shade"])[np.arange(8760) // 2 % 3]
    (folder / "west.csv").write_text("\n".join(["west", *names]) + "\n")
    west = {"panes": ["glass"], "facing": "west", "states": ["veil", "shade"]}
    west["schedule"] = str(folder / "west.csv")
    groups = {"south": {"panes": ["glass"], "facing": "south"}, "west": west}
    glazed = {"strips": [{"bottom": 0.9, "top": 2.4, "material": "glass"}]}
    materials = {
        "glass": {"type": "glazing", "transmittance": 0.65},
        "veil": {"type": "diffuser", "transmittance": 0.3, "reflectance": 0.3},
        "shade": {"type": "diffuser", "transmittance": 0.1, "reflectance": 0.4},
    }
    return case_of(
        facade={"south": glazed, "west": glazed}, groups={} if kind == "facing" else groups,
        materials=materials, period={"months": [3], "hours": hours, "days_per_week": 1},
        accuracy={"seed": seed, "replicates": 6, "paths": 96, "cell_sky_rays": 64,
                  "sensor_sky_rays": 256},
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["facing", "groups"])
def test_states_of_groups_equal_an_evaluation(tmp_path, kind):
    """E as the groups close, of other paints, beside an evaluation of its own with other paths."""
    case = with_groups(kind, tmp_path)
    interior = Interior.of(case, daylight.daylight(case))
    E = interior.illuminance({key: mi.Float(value) for key, value in ELSEWHERE.items()})
    assert len(E.states) == len(interior.groups.states) == (4 if kind == "facing" else 6)
    others = [
        evaluate(with_reflectances(with_groups(kind, tmp_path, seed), ELSEWHERE)).illuminance
        for seed in (100, 101)
    ]
    assert len(np.unique(others[0]["facade_state"].values, axis=0)) >= 4
    applied = interior.groups.applied(E)
    for other in others:
        theirs, error = other["total"].values, 1.5 * other["total_se"].values
        assert (abs(applied - theirs) > 4 * error + 0.01 * theirs).mean() < 0.02
    theirs = np.mean([other["total"].values for other in others], axis=0)
    assert np.median(applied / theirs) == pytest.approx(1, abs=0.01)


def test_gradients_through_the_groups_are_the_differences(tmp_path):
    case = with_groups("facing", tmp_path, hours=(12, 15))
    interior = Interior.of(case, daylight.daylight(case))

    def mean(walls):
        E = interior.groups.smooth(interior.illuminance({"walls": walls}), 8.0)
        return dr.mean(mi.Float64(E.array))

    walls = mi.Float(0.5)
    dr.enable_grad(walls)
    dr.backward(mean(walls))
    (theirs,) = slopes(lambda at: mean(mi.Float(at))[0], [0.5], 0.04)
    assert walls.grad[0] == pytest.approx(theirs, rel=1e-3)
    assert theirs > 1
