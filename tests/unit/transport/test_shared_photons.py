"""Photons that states of a façade share: fewer are followed, and no number knows of it."""

import json

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, SHADED
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport import shared_paths as shared_photons
from drcmitsuba.transport.coefficients import compute
from drcmitsuba.transport.mirrors import planar_mirrors
from drcmitsuba.transport.photons.changing_panes import ChangingPanes
from drcmitsuba.transport.photons.light import LitEntries, dense
from drcmitsuba.transport.photons.tracer import PhotonTracer
from drcmitsuba.transport.shared_paths import SharedPaths, SharedPhotons
from tests import ROOT


@pytest.fixture(autouse=True)
def _mirrors_are_left_to_photons(monkeypatch):
    """Take plain mirrors for bodies of many faces, which have no exact images."""
    monkeypatch.setattr(planar_mirrors, "MOST_OF_BODY", 0)


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

    def made(position, glass="glass", channel=-1, **more):
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
                    "shade": {"type": "diffuser", "transmittance": 0.1},
                },
                "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 4], "spacing": 1.0},
                "shading": {"material": "shade"},
            }
            | more
        )
        points = sensor_points(case)
        return [scene.load(case, state, channel, EFFECTS) for state in (OPEN, SHADED)], points

    return made


def tracer(world, points, suns=DIRECTIONS, **accuracy):
    return PhotonTracer.of(
        world, *points, suns, 0.53, 1, ACCURACY.model_copy(update=accuracy)
    )  # fmt: skip


BEHIND, BEFORE, ASIDE = [1.5, 0.8, 1.0], [1.5, -1.5, 1.0], [1.5, -0.6, 2.8]
"""Places of the mirror: light comes to it by the window; goes on by it; some of it does."""


@pytest.mark.parametrize("place", [BEHIND, BEFORE, ASIDE], ids=["behind", "before", "aside"])
@pytest.mark.parametrize(
    "turned",
    [pytest.param(False, marks=pytest.mark.slow), True],
    ids=["open first", "shaded first"],
)
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


@pytest.mark.parametrize(
    "suns",
    [
        pytest.param(DIRECTIONS[[2, 0]], id="suns", marks=pytest.mark.slow),
        pytest.param(DIRECTIONS[:0], id="no suns"),
    ],
)
def test_photons_of_several_components_are_shared(states, tmp_path, suns):
    mesh = {"type": "mesh", "file": str(tmp_path / "mirror.obj"), "material": "silver"}
    places = {"a": BEHIND, "b": BEFORE, "c": ASIDE}
    more = {name: mesh | {"position": place} for name, place in places.items()}
    (first, second), points = states(BEHIND, components=more)
    shared = SharedPhotons()
    shared.traced(tracer(first, points), SEEDS)
    together = shared.traced(tracer(second, points, suns), SEEDS)
    alone = [tracer(second, points, suns).traced(seed) for seed in SEEDS]
    assert {f"{name} sky" for name in places} < together[0].ledgers.keys()
    for one, other in zip(together, alone, strict=True):
        np.testing.assert_allclose(one.cells.numpy(), other.cells.numpy(), rtol=1e-5, atol=1e-9)
        np.testing.assert_allclose(
            one.sensors().numpy(), other.sensors().numpy(), rtol=1e-5, atol=1e-9
        )
        for name, ledger in one.ledgers.items():
            assert ledger.emitted == pytest.approx(other.ledgers[name].emitted, rel=1e-6), name
            assert ledger.landed == pytest.approx(other.ledgers[name].landed, rel=1e-6), name
    assert followed(second) > 0


def followed(world):
    return world.ray_counter.counted()["photon"]


@pytest.mark.parametrize("place", [BEFORE, ASIDE], ids=["before", "aside"])
def test_only_photons_that_met_a_pane_are_followed_again(states, place):
    (open_, shaded), points = states(place)
    shared = SharedPhotons()
    for world in (open_, shaded):
        shared.traced(tracer(world, points), SEEDS)
    assert 0 < followed(shaded) < 0.1 * followed(open_)


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
@pytest.mark.slow
def test_scenes_that_differ_by_more_share_nothing(states, other):
    (open_, _), points = states(ASIDE, glass=other.get("glass", "glass"))
    shared = SharedPhotons()
    shared.traced(tracer(open_, points), SEEDS)
    (_, shaded), _ = states(ASIDE, **other)
    shared.traced(tracer(shaded, points), SEEDS)
    of_shaded = followed(shaded)
    tracer(shaded, points).traced(SEEDS[0])
    assert of_shaded == pytest.approx(2 * (followed(shaded) - of_shaded), rel=0.2)


def follows_all(second, seeds, first, shared=None):
    """Whether a state follows all of its photons after another one."""
    shared = SharedPhotons() if shared is None else shared
    shared.traced(first, SEEDS)
    world = second.ports[0].scene
    before = followed(world)
    shared.traced(second, seeds)
    together = followed(world) - before
    for seed in seeds:
        second.traced(seed)
    return together == followed(world) - before - together


@pytest.mark.slow
def test_other_seeds_suns_samples_and_heights_share_nothing(states):
    (open_, shaded), points = states(BEFORE)
    higher = points[0] + [0, 0, 0.2], points[1]
    twice = np.tile(DIRECTIONS[:1], (2, 1))
    first = tracer(open_, points)
    assert not follows_all(tracer(shaded, points), SEEDS, first)
    assert follows_all(tracer(shaded, points), (11, 13), first)
    assert follows_all(tracer(shaded, points, np.array([[0.6, -0.64, 0.48]])), SEEDS, first)
    assert follows_all(tracer(shaded, points, twice), SEEDS, first)
    assert follows_all(tracer(shaded, points, photons=128), SEEDS, first)
    assert follows_all(tracer(shaded, points, sensor_square=0.1), SEEDS, first)
    assert follows_all(tracer(shaded, higher), SEEDS, first)


def test_states_of_colours_share_nothing(states):
    """They follow one another in each state, and only one is kept."""
    (open_, shaded), points = states(BEFORE, channel=1)
    assert follows_all(tracer(shaded, points), SEEDS, tracer(open_, points))


@pytest.mark.parametrize("most", [1000, 1 << 20], ids=["sums", "light"])
def test_photons_that_take_too_much_memory_are_followed_by_each_state(states, monkeypatch, most):
    (open_, shaded), points = states(BEHIND)
    first = tracer(open_, points)
    if most > 1000:
        most = first.nbytes
        lit = first.traced(SEEDS[0])
        assert sum(one.nbytes for light in lit.lights for part in light for one in part) < most
        monkeypatch.setattr(shared_photons.CommonLight, "nbytes", most + 1)
    monkeypatch.setattr(shared_photons, "KEPT", most)
    assert follows_all(tracer(shaded, points), SEEDS, first)


def test_equal_entries_of_two_matrices_are_added():
    """Light before and after panes: the sums may run side by side."""
    count, bins = 1 << 18, 64
    at = dr.arange(mi.UInt32, count)
    shape = count // bins, bins
    parts = [LitEntries(at, dr.full(mi.Float, value, count), shape) for value in (1.0, 2.0)]
    for _ in range(20):
        assert (dense(parts).numpy() == 3).all()
    rows = dense(parts, slice(3, 5))
    assert rows.shape == (2, bins)


def test_a_mesh_of_the_mirror_is_no_pane(states):
    (open_, shaded), _ = states(ASIDE)
    panes = ChangingPanes.of(open_)
    assert [part.name for part in open_.parts if panes.have(part)] == ["glass south"]
    assert panes.alone_differ(open_, shaded)
    assert len(panes.quads) == 1
