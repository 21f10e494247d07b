"""Pairs of elements, of which one mirrors the other's light: exact geometry, and other routes."""

from dataclasses import replace

import numpy as np
import pytest
from drcmitsuba_plugins.sampling import disk_solid_angle
from scipy.sparse import csr_matrix

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.model.materials import Lambertian
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene as scenes
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS
from drcmitsuba.scene.fills import openings_of
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.panes_in_state import GroupedPanes
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport import coefficients, elements
from drcmitsuba.transport.elements import mirrored_pairs, simulate
from drcmitsuba.transport.elements.mirrored_pairs import MirroredPairs
from drcmitsuba.transport.elements.trace import ElementTrace
from tests.fast import slowly
from tests.unit.transport.exact_scenes import CLOTH, GLASS, SUNS, diffuser, glazing, quad
from tests.unit.transport.test_light_by_element import ACCURACY, case, in_state

IN_PANES = replace(ALL_EFFECTS, pane_to_pane=True)
R, TAU = 0.12, 0.65
MIRRORING, PLAIN = glazing(TAU, reflectance=R), glazing(TAU)
SIZE = np.array([3.0, 4.0, 3.0])
TALL = {"strips": [{"bottom": 0.1, "top": 2.9, "material": "glass"}]}
BLACK = {"size": SIZE.tolist(), "floor": 0.0, "walls": 0.0, "ceiling": 0.0}
TWO_SIDES = {
    "facade": {"south": TALL, "east": TALL},
    "groups": {
        side: {"panes": ["glass"], "facing": side, "states": ["cloth"]}
        for side in ("south", "east")
    },
    "materials": {"glass": GLASS, "cloth": CLOTH},
}

LOOKING = {**ACCURACY, "sensor_sky_rays": 1 << 16, "paths": 1}


@pytest.fixture(autouse=True, scope="module")
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


def light_of(one, suns=SUNS):
    return elements.compute(one, PaneGroups.of(one), suns, one.accuracy, IN_PANES)


def pane(group, side, *materials):
    """Pane in the middle of a side of the unit cube, its front to the inside."""
    made = {
        "south": quad([0.9, 0, 0.1], [-0.8, 0, 0], [0, 0, 0.8]),
        "north": quad([0.1, 1, 0.1], [0.8, 0, 0], [0, 0, 0.8]),
        "west": quad([0, 0.1, 0.1], [0, 0.8, 0], [0, 0, 0.8]),
        "roof": quad([0.1, 0.1, 1], [0, 0.8, 0], [0.8, 0, 0]),
    }
    return GroupedPanes(group, made[side][None], materials, side)


def test_glass_mirrors_what_comes_in_by_other_sides():
    """Fills 0 and 1 of the south, 2 and 3 of the west, 4 and 5 of the roof."""
    panes = [
        pane(0, "south", MIRRORING, PLAIN),
        pane(1, "west", PLAIN, Lambertian(0.5)),
        pane(2, "roof", diffuser(0.4), None),
    ]
    pairs = MirroredPairs.of(panes, (0, 2, 4, 6))
    assert (pairs.mirrors, pairs.passed) == ((0, 0, 0), (2, 4, 5))


def test_panes_of_one_side_do_not_mirror_to_each_other():
    assert not len(MirroredPairs.of([pane(k, "south", MIRRORING) for k in (0, 1)], (0, 1, 2)))


def test_an_opening_of_two_sides_mirrors_its_own_light():
    """It has one fill at a time."""
    panes = [pane(0, side, MIRRORING, PLAIN) for side in ("south", "north")]
    assert MirroredPairs.of(panes, (0, 2)) == MirroredPairs((0,), (0,))


def test_the_pairs_of_the_largest_and_nearest_panes_are_kept(monkeypatch):
    monkeypatch.setattr(mirrored_pairs, "MOST_PAIRS", 2)
    small = pane(2, "roof", MIRRORING)
    panes = [pane(0, "south", MIRRORING), pane(1, "west", MIRRORING),
             replace(small, quads=small.quads * [0.1, 0.1, 1.0])]  # fmt: skip
    assert MirroredPairs.of(panes, (0, 1, 2, 3)) == MirroredPairs((0, 1), (1, 0), 4)
    monkeypatch.setattr(mirrored_pairs, "MOST_PAIRS", 1)  # both or none of equal ones
    assert MirroredPairs.of(panes, (0, 1, 2, 3)) == MirroredPairs((), (), 6)
    panes[2] = replace(panes[0], group=2, quads=panes[0].quads + [0, -9.0, 0])  # a further room
    monkeypatch.setattr(mirrored_pairs, "MOST_PAIRS", 2)
    assert MirroredPairs.of(panes, (0, 1, 2, 3)) == MirroredPairs((0, 1), (1, 0), 2)


def test_pairs_of_the_largest_panes_stay_where_memory_holds_no_more():
    pairs = MirroredPairs((0, 0, 1), (1, 2, 2), 3, sizes=(1.0, 0.5, 2.0))
    assert pairs.at(pairs.largest(2)) == MirroredPairs((0, 1), (1, 2), 4)
    assert pairs.at(pairs.largest(5)) == pairs
    assert pairs.at(pairs.largest(0)) == MirroredPairs((), (), 6)


def test_shares_of_pairs_are_products():
    shares = np.array([[0.3, 0.7, 0.5], [1, 0, 1]])
    joined = MirroredPairs((0, 2), (2, 1)).joined(shares)
    np.testing.assert_allclose(joined[:, 3:], [[0.15, 0.35], [1, 0]])
    assert MirroredPairs().joined(shares) is shares


def test_a_mirrored_sun_is_that_of_exact_geometry():
    """Glass in the east mirrors the sun of the south to a black room, by Schlick's reflectance."""
    d = np.array([[-0.5, -0.7, 0.4], [0.3, -0.8, 0.5], [0.6, -0.6, 0.3]])
    suns = Suns(("a", "b", "c"), d / np.linalg.norm(d, axis=1, keepdims=True))
    sensors = {"corner": [0.4, 0.5, 0.5], "count": [5, 6], "spacing": 0.5}
    one = case(**TWO_SIDES, room=BLACK, sensors=sensors)
    light = light_of(one, suns)
    east_glass, south_glass = 2, 0
    every = [*zip(light.pairs.mirrors, light.pairs.passed, strict=True)]
    C = light.mirrored[every.index((east_glass, south_glass))].straight.mean(axis=0)[
        light.sky_bins :
    ]
    p, lit = light.positions, 0
    for k, sun in enumerate(suns.directions):
        seen = sun * [-1, 1, 1]  # the image stands east of the glass
        t = (SIZE[0] - p[:, 0]) / seen[0]
        at = p + t[:, None] * seen
        through = at - (at[:, 1] / sun[1])[:, None] * sun  # at y = 0
        edges = [at[:, 1], SIZE[1] - at[:, 1], through[:, 0], SIZE[0] - through[:, 0]]
        edges += [x[:, 2] - 0.1 for x in (at, through)] + [2.9 - x[:, 2] for x in (at, through)]
        least = np.min(edges, axis=0) if seen[0] > 0 else np.full(len(p), -1.0)
        expected = (R + (1 - R) * (1 - seen[0]) ** 5) * TAU * disk_solid_angle(0.5) * sun[2]
        np.testing.assert_allclose(C[k, least > 0.02], expected, rtol=0.02)
        assert not C[k, least < -0.02].any()
        lit += (least > 0.02).sum()
    assert lit > 5


@pytest.mark.parametrize(
    "state", slowly(["open/open", "cloth/open", "open/cloth"], "open/open", "cloth/open")
)
def test_any_state_has_the_light_that_its_glass_mirrors(same, state):
    """Light of the sky, of the suns, and what cells send on of both is that of a simulation."""
    one = case(**TWO_SIDES)
    again = Accuracy(**{**ACCURACY, "seed": 77})
    theirs = coefficients.compute(
        scenes.load(one, state, effects=IN_PANES), *sensor_points(one), SUNS, again
    )
    ours = in_state(light_of(one), state)
    for part in (slice(0, 146), slice(146, None)):
        first, second = (C["replicates"].values[..., part].sum(axis=-1) for C in (ours, theirs))
        same(first, other=second, within=0.01)


def test_cloth_is_seen_in_glass_as_its_image_is():
    """In a black room, an image of the cloth behind the glass, R of the incidence times as bright.

    The sensors look east: to the glass, above which the wall is black.
    """
    places = [[1.0, 1.0, 1.5, 1, 0, 0], [2.0, 2.0, 1.0, 1, 0, 0]]
    one = case(**TWO_SIDES, room=BLACK, sensors={"points": places}, accuracy=LOOKING)
    light = light_of(one)
    south, _ = light.openings.names
    assert south == "south"
    east_glass, south_cloth = 2, 1
    k = [*zip(light.pairs.mirrors, light.pairs.passed, strict=True)].index(
        (east_glass, south_cloth)
    )
    ours = light.mirrored[k].total[..., : light.sky_bins].sum(axis=1)  # (replicate, sensor)
    # The radiance of the cloth, from what a sensor close to it gets of it.
    near = case(**TWO_SIDES, room=BLACK, sensors={"points": [[1.5, 0.002, 1.5, 0, -1, 0]]})
    C = light_of(near).elements[south_cloth].total[..., : light.sky_bins].sum(axis=1)
    L = C.mean() / np.pi
    x, z = (np.arange(600) + 0.5) / 600 * 3.0, 0.1 + (np.arange(560) + 0.5) / 560 * 2.8
    image = np.stack([2 * SIZE[0] - x[:, None] + 0 * z, 0 * x[:, None] + 0 * z, 0 * x[:, None] + z])
    dA, expected = (3.0 / 600) * (2.8 / 560), []
    for place in np.array(places)[:, :3]:
        d = image - place[:, None, None]
        r = np.sqrt((d**2).sum(axis=0))
        t = (SIZE[0] - place[0]) / d[0]
        y, height = (place[i] + t * d[i] for i in (1, 2))
        shown = (y > 0) & (y < SIZE[1]) & (height > 0.1) & (height < 2.9)
        incidence, at_cloth = d[0] / r, np.abs(d[1]) / r
        rho = R + (1 - R) * (1 - incidence) ** 5
        expected.append((L * rho * incidence * at_cloth / r**2 * shown).sum() * dA)
    error = ours.std(axis=0, ddof=1) / len(ours) ** 0.5
    assert (error < 0.02 * np.array(expected)).all()
    assert (np.abs(ours.mean(axis=0) - expected) < 4 * error + 0.01 * np.array(expected)).all()


def test_a_hole_is_seen_in_glass():
    """It shows the suns as clear glass does, but for the transmittance of the glass."""
    one = case(**TWO_SIDES, room=BLACK)
    panes = openings_of(one, ["hole"])
    light = elements.compute(one, panes, SUNS, one.accuracy, IN_PANES)
    fills = panes.states.states
    assert fills == (("open", "cloth", "hole"),) * 2
    pairs = [*zip(light.pairs.mirrors, light.pairs.passed, strict=True)]
    glass, hole = (
        light.mirrored[pairs.index((3, fill))].straight[:, light.sky_bins :].mean(axis=0)
        for fill in (0, 2)
    )
    bright = glass > 0.02 * glass.max()
    assert bright.any()
    assert (hole[bright] * GLASS["transmittance"] >= 0.9 * glass[bright]).all()


def test_a_year_without_coefficients_has_the_same_pairs():
    """Light that is summed before it is gathered, for the suns that each state needs."""
    one = case(**TWO_SIDES)
    light, rng = light_of(one), np.random.default_rng(4)
    indices = rng.integers(0, 2, (20, 2))
    L = rng.random((20, len(light.labels))).astype(np.float32)
    L[:, light.sky_bins :] *= rng.random((20, len(SUNS.labels))) < 0.3
    year = elements.Year.of(csr_matrix(L), light.shares(indices), light.sky_bins)
    ours = elements.illuminance(one, PaneGroups.of(one), SUNS, one.accuracy, IN_PANES, year)
    for E, other in zip(ours, light.illuminance(csr_matrix(L), light.shares(indices)), strict=True):
        np.testing.assert_allclose(E, other, rtol=2e-5)


def test_pairs_are_left_out_where_memory_does_not_hold_them():
    one = case(**TWO_SIDES)
    how = one, PaneGroups.of(one), SUNS, one.accuracy, IN_PANES
    trace, kept = ElementTrace.of(*how), one.accuracy.replicates
    most = sum(simulate._sizes(trace, kept)) - 1
    light = elements.compute(*how, most_bytes=most)
    assert light.mirrored == ()
    assert light.pairs == MirroredPairs(left_out=len(trace.pairs))
    without = in_state(elements.compute(*how[:-1], ALL_EFFECTS), "open")
    np.testing.assert_array_equal(in_state(light, "open")["replicates"], without["replicates"])


def test_a_factor_of_an_element_is_that_of_light_that_passes_it():
    light = light_of(case(**TWO_SIDES))
    factors = np.array([2.0, 1.0, 3.0, 1.0])
    for e, before, after in zip(
        light.pairs.passed, light.mirrored, light.scaled(factors).mirrored, strict=True
    ):
        assert before.total.any()
        np.testing.assert_allclose(after.total, factors[e] * before.total, rtol=1e-6)
