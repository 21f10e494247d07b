"""Photons that states of a façade share: fewer are followed, and no number knows of it."""

import json

import numpy as np
import pytest

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, SHADED
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport import shared_photons
from drcmitsuba.transport.changing_panes import ChangingPanes
from drcmitsuba.transport.coefficients import compute
from drcmitsuba.transport.photons import PhotonTracer
from drcmitsuba.transport.shared_paths import SharedPaths
from drcmitsuba.transport.shared_photons import SharedPhotons
from tests import ROOT

EFFECTS = EnabledEffects(solved_cells=True)
ACCURACY = Accuracy(
    replicates=2, paths=32, cell_sky_rays=16, sensor_sky_rays=64, pane_points=16, photons=256
)
DIRECTIONS = np.array([[0.0, -0.8, 0.6], [0.6, -0.48, 0.64], [0.28, -0.576, 0.768]])
SUNS = Suns(("a", "b", "c"), DIRECTIONS, 0.53)
SEEDS = (11, 12)


@pytest.fixture
def states(tmp_path):
    """Make the scenes, open and shaded, of a room with a mirror behind its window or beside it."""
    (tmp_path / "mirror.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 1 0.5 0.5\nv 0 0.5 0.5\nf 1 2 3\nf 1 3 4\n"
    )

    def made(position, glass="glass", shade=None, **more):
        shelf = {"type": "mesh", "file": str(tmp_path / "mirror.obj"), "material": "silver"}
        case = Case.model_validate(
            {
                "room": {"size": [4.0, 5.0, 3.0]},
                "facade": {"south": {"strips": [{"bottom": 0.9, "top": 2.6, "material": glass}]}},
                "components": {"shelf": {**shelf, "position": position}},
                "materials": {
                    "silver": {"type": "mirror", "reflectance": 0.9},
                    "glass": {"type": "glazing", "transmittance": 0.65, "reflectance": 0.2},
                    "film": {"type": "bsdf", "file": str(ROOT / "scenes" / "films" / "prism.xml")},
                    "shade": {"type": "diffuser", "transmittance": 0.1, **(shade or {})},
                },
                "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 4], "spacing": 1.0},
                "shading": {"material": "shade"},
            }
            | more
        )
        points = sensor_points(case)
        return [scene.load(case, state, effects=EFFECTS) for state in (OPEN, SHADED)], points

    return made


def tracer(world, points, suns=DIRECTIONS, **accuracy):
    return PhotonTracer.of(
        world, *points, suns, 0.53, 1, ACCURACY.model_copy(update=accuracy)
    )  # fmt: skip


BEHIND, BEFORE, ASIDE = [1.5, 0.8, 1.0], [1.5, -1.5, 1.0], [1.5, -0.6, 2.8]
"""Places of the mirror: light comes to it by the window; goes on by it; some of it does."""


@pytest.mark.parametrize("place", [BEHIND, BEFORE, ASIDE], ids=["behind", "before", "aside"])
@pytest.mark.parametrize("turned", [False, True], ids=["open first", "shaded first"])
def test_light_of_the_second_state_is_that_of_the_state_alone(states, place, turned):
    (open_, shaded), points = states(place)
    first, second = (shaded, open_) if turned else (open_, shaded)
    shared = SharedPhotons()
    shared.traced(tracer(first, points), SEEDS)
    some = DIRECTIONS[[2, 0]]
    together = shared.traced(tracer(second, points, some), SEEDS)
    alone = [tracer(second, points, some).traced(seed) for seed in SEEDS]
    for one, other in zip(together, alone, strict=True):
        for a, b in zip(one.cells, other.cells, strict=True):
            np.testing.assert_allclose(a.numpy(), b.numpy(), rtol=1e-5, atol=1e-9)
        for name in ("sensors", "mirrored"):
            a, b = (getattr(landed, name)().numpy() for landed in (one, other))
            np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-9)
        np.testing.assert_allclose(one.smear, other.smear, rtol=1e-3, atol=1e-7)
        assert one.ledgers.keys() == other.ledgers.keys()
        for name, ledger in one.ledgers.items():
            of = {key: pytest.approx(v, rel=1e-6) for key, v in vars(other.ledgers[name]).items()}
            assert vars(ledger) == of, name
    assert sum(one.cells.numpy().sum() for one in alone) > 0


def followed(world):
    return world.ray_counter.counted()["photon"]


@pytest.mark.parametrize("place", [BEFORE, ASIDE], ids=["before", "aside"])
def test_only_photons_that_met_a_pane_are_followed_again(states, place):
    (open_, shaded), points = states(place)
    shared = SharedPhotons()
    for world in (open_, shaded):
        shared.traced(tracer(world, points), SEEDS)
    assert 0 < followed(shaded) < 0.05 * followed(open_)


def test_coefficients_share_photons_and_stay_the_same(states):
    worlds, points = states(ASIDE)
    shared = SharedPaths()
    for world in worlds:
        once = compute(world, *points, SUNS, ACCURACY, shared=shared)
        anew = compute(world, *points, SUNS, ACCURACY)
        for name, values in once.data_vars.items():
            np.testing.assert_allclose(values, anew[name], rtol=2e-5, atol=1e-8, err_msg=name)
        ledgers = (json.loads(C.attrs["photons"]) for C in (once, anew))
        for a, b in zip(*(ledger.values() for ledger in ledgers), strict=True):
            assert a == {key: pytest.approx(value, rel=1e-6) for key, value in b.items()}
        smear = once.attrs["photons_smear"]
        assert smear == pytest.approx(anew.attrs["photons_smear"], rel=1e-3, abs=1e-6)


@pytest.mark.parametrize(
    "other",
    [
        {"furniture": [{"corner": [1.0, 1.0, 0.7], "size": [1.0, 0.6, 0.0]}]},
        {"room": {"size": [4.0, 5.0, 3.0], "walls": 0.6}},
        {"room": {"size": [4.0, 5.0, 3.0], "rotation": 20.0}},
        {"glass": "open"},
    ],
    ids=["furniture", "paint", "turned", "a hole that a shade closes"],
)
def test_scenes_that_differ_by_more_share_nothing(states, other):
    (open_, _), points = states(ASIDE, glass=other.get("glass", "glass"))
    shared = SharedPhotons()
    shared.traced(tracer(open_, points), SEEDS)
    (_, shaded), _ = states(ASIDE, **other)
    shared.traced(tracer(shaded, points), SEEDS)
    of_shaded = followed(shaded)
    tracer(shaded, points).traced(SEEDS[0])
    assert of_shaded == pytest.approx(2 * (followed(shaded) - of_shaded), rel=0.2)


def test_other_seeds_suns_and_samples_share_nothing(states):
    (open_, shaded), points = states(BEFORE)
    for seeds, changes in [
        ((11, 13), {}),
        (SEEDS, {"suns": np.array([[0.6, -0.64, 0.48]])}),
        (SEEDS, {"photons": 128}),
        (SEEDS, {"sensor_square": 0.1}),
    ]:
        shared = SharedPhotons()
        first = tracer(open_, points)
        shared.traced(first, SEEDS)
        again = shared.traced(tracer(shaded, points, **changes), seeds)
        assert all(one.common is not None for one in again)  # all of them were followed


def test_photons_that_take_too_much_memory_are_followed_by_each_state(states, monkeypatch):
    (open_, shaded), points = states(BEFORE)
    monkeypatch.setattr(shared_photons, "KEPT", 1000)
    shared = SharedPhotons()
    for world in (open_, shaded):
        assert all(one.common is None for one in shared.traced(tracer(world, points), SEEDS))


def test_a_mesh_of_the_mirror_is_no_pane(states):
    (open_, shaded), _ = states(ASIDE)
    panes = ChangingPanes.of(open_)
    assert [part.name for part in open_.parts if panes.have(part)] == ["glass south"]
    assert panes.alone_differ(open_, shaded)
    assert len(panes.quads) == 1
