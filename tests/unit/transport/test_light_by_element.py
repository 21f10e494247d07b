"""Light by element against simulations of single façades."""

import numpy as np
import pytest
from scipy.sparse import csr_matrix

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.random_streams import Draw, Stream
from drcmitsuba.scene import scene as scenes
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS, EnabledEffects
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.transport import coefficients, elements
from drcmitsuba.transport.deposit import TO_PANES
from drcmitsuba.transport.elements import simulate
from drcmitsuba.transport.elements.scenes import Element
from drcmitsuba.transport.elements.trace import ElementTrace
from drcmitsuba.transport.elements.weights import BESIDES
from tests.unit.transport.exact_scenes import CLOTH, GLASS, OPAL, OPPOSITE, SUNS

ROOM = {
    "room": {"size": [3.0, 4.0, 3.0], "floor": 0.3, "walls": 0.6, "ceiling": 0.8},
    "facade": {
        "south": {"strips": [{"bottom": 0.9, "top": 2.7, "material": "glass"}]},
        "east": {
            "strips": [
                {"bottom": 0.9, "top": 1.9, "material": "glass"},
                {"bottom": 1.9, "top": 2.7, "material": "opal"},
            ]
        },
    },
    "materials": {"glass": GLASS, "opal": OPAL, "cloth": CLOTH},
    "groups": {
        "south": {"panes": ["glass"], "facing": "south", "states": ["opal", "cloth"]},
        "east": {"panes": ["glass"], "facing": "east", "states": ["cloth"]},
    },
    "sensors": {"corner": [0.5, 0.6, 0.8], "count": [3, 3], "spacing": 0.9},
}
ACCURACY = {"replicates": 12, "paths": 256, "cell_size": 0.3, "sensor_sky_rays": 1024,
            "cell_sky_rays": 64, "pane_points": 64}  # fmt: skip


def case(**tables):
    return Case.model_validate({**ROOM, "accuracy": ACCURACY, **tables})


def light_of(case):
    return elements.compute(case, PaneGroups.of(case), SUNS, case.accuracy, ALL_EFFECTS)


def in_state(light, state):
    """Coefficients of a state of the façade."""
    return light.coefficients(light.shares(light.openings.indices(state)))


def direct(case, state):
    """Replicates of C by a simulation of one state, with other random numbers."""
    accuracy = Accuracy(**{**ACCURACY, "seed": 77})
    return coefficients.compute(scenes.load(case, state), *sensor_points(case), SUNS, accuracy)[
        "replicates"
    ].values


@pytest.fixture(scope="module")
def with_house():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")
    one = case(furniture=[OPPOSITE])
    return one, light_of(one)


@pytest.mark.parametrize("state", ["open", "cloth/open/open", "opal/cloth/open", "open/cloth/open"])
def test_any_state_has_its_coefficients(with_house, same, state):
    """Glass mirrors, cloth and milk glass throw light back, and a house stands opposite."""
    one, light = with_house
    ours = in_state(light, state)["replicates"].values
    same(ours, other=direct(one, state), within=0.01)


def test_a_year_is_the_sum_of_its_hours(with_house):
    """E hour by hour is C of the hour's state times L: two ways through the same paths."""
    _, light = with_house
    rng = np.random.default_rng(4)
    indices = rng.integers(0, [3, 2, 1], (30, 3))
    L = csr_matrix(rng.random((30, len(light.labels))).astype(np.float32))
    expected = np.empty((light.replicates, 30, len(light.positions)))
    for t, of_groups in enumerate(indices):
        C = light.coefficients(light.shares(of_groups))["replicates"].values
        expected[:, t] = C @ L[[t]].toarray()[0]
    for r, E in enumerate(light.illuminance(L, light.shares(indices))):
        np.testing.assert_allclose(E, expected[r], rtol=2e-5)


def test_a_year_without_coefficients_has_the_same_paths(with_house):
    """Light that is summed before it is gathered, for the suns that each state needs."""
    one, light = with_house
    rng = np.random.default_rng(4)
    indices = rng.integers(0, [3, 2, 1], (20, 3))
    indices[:, 1] = 0  # the cloth of the east is never asked for
    L = rng.random((20, len(light.labels))).astype(np.float32)
    L[:, light.sky_bins :] *= rng.random((20, len(SUNS.labels))) < 0.3
    year = elements.Year.of(csr_matrix(L), light.shares(indices), light.sky_bins)
    expected = light.illuminance(csr_matrix(L), light.shares(indices))
    ours = elements.illuminance(one, PaneGroups.of(one), SUNS, one.accuracy, ALL_EFFECTS, year)
    for E, other in zip(ours, expected, strict=True):
        np.testing.assert_allclose(E, other, rtol=2e-5)


def test_black_rooms_have_straight_light_only(same):
    """Without reflection the sum of the groups is the whole: of the sky the rays are the same."""
    black = {"size": [3.0, 4.0, 3.0], "floor": 0.0, "walls": 0.0, "ceiling": 0.0}
    clear = {"type": "glazing", "transmittance": 0.65}
    one = case(room=black, materials={"glass": clear, "opal": clear, "cloth": clear})
    light = light_of(one)
    whole = coefficients.compute(scenes.load(one), *sensor_points(one), SUNS, one.accuracy)[
        "replicates"
    ].values
    ours = in_state(light, "open")["replicates"].values
    np.testing.assert_allclose(ours[..., :146], whole[..., :146], rtol=1e-5, atol=1e-9)
    same(ours[..., 146:], other=whole[..., 146:], within=0.02)
    assert not any(back.nbytes for back in light.returned)


def test_blocked_groups_let_nothing_in():
    one = case()
    blocked = scenes.load(one, "(blocked)/(blocked)/(blocked)")
    C = coefficients.compute(blocked, *sensor_points(one), SUNS, one.accuracy)
    assert not C["replicates"].values.any()
    light = light_of(one)
    assert not light.besides.total.any()
    assert not light.besides.blocks.any()


@pytest.mark.parametrize(
    ("draws", "together"), [(1, 1), (1, 4), (3, 2), (3, 3), (3, 7), (6, 4), (6, 100), (2, 5)]
)
def test_launches_hold_whole_results_or_parts_of_one(draws, together):
    launches = list(simulate._launches(6, draws, together))
    assert [r for some in launches for r in some] == list(range(6))
    for some in launches:
        assert len(some) <= together
        whole = some.start % draws == 0 and some.stop % draws == 0
        assert whole or some.start // draws == (some.stop - 1) // draws


@pytest.mark.parametrize("kept", [1, 3])
def test_results_are_means_however_they_are_launched(monkeypatch, kept):
    one = case(accuracy={**ACCURACY, "replicates": 6, "paths": 16})

    def coefficients_of():
        light = elements.compute(
            one, PaneGroups.of(one), SUNS, one.accuracy, ALL_EFFECTS, kept=kept
        )
        assert light.replicates == kept
        return [element.total for element in light.elements]

    together = coefficients_of()
    monkeypatch.setattr(simulate, "TOGETHER", 1)
    for a, b in zip(together, coefficients_of(), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-7)


def deposits_of(one):
    """Deposits by number of the element, and the first number of every opening."""
    openings = PaneGroups.of(one)
    trace = ElementTrace.of(one, openings, SUNS, one.accuracy, ALL_EFFECTS)
    every = {e.number: e.deposit for e in (trace.besides, *trace.elements) if e.deposit}
    return every, openings.states.starts


@pytest.mark.parametrize("draw", list(Draw))
def test_openings_have_points_on_panes_of_their_own_and_all_else_in_common(draw):
    """Else tiles of one shape would share a pattern, and light besides openings would not cancel.

    Fills of one opening keep their points, so that differences between them have less noise.
    """
    deposits, (south, east, _, _) = deposits_of(case())
    seeds = {number: d.seed((Stream.SENSORS,), draw) for number, d in deposits.items()}
    assert seeds[south] == seeds[south + 1] == seeds[south + 2]
    assert (seeds[south] == seeds[east] == seeds[BESIDES]) == (draw not in TO_PANES)


def test_many_tiles_are_lit_by_some_of_the_draws():
    """Of six draws, a third of a façade takes all and a hundredth part two."""

    def draws(of, part, photons=None):
        element = Element(0, np.arange(3), part=part, photons=photons)
        return simulate.draws_of_light(of, element)

    assert [draws(6, part) for part in (1.0, 1 / 3, 1 / 8, 0.1, 1 / 16, 0.01)] == [6, 6, 6, 5, 3, 2]
    assert draws(1, 0.01) == 1
    assert draws(6, 0.01, photons=object()) == 6


@pytest.mark.parametrize("together", [1 << 26, 1])
def test_fewer_draws_light_openings_alike(monkeypatch, together):
    """Means over 2 of 12 draws differ by their noise alone, light besides openings included."""
    one = case()
    every = elements.compute(one, PaneGroups.of(one), SUNS, one.accuracy, ALL_EFFECTS, kept=1)
    monkeypatch.setattr(simulate, "TILES", 0)
    monkeypatch.setattr(simulate, "TOGETHER", together)
    some = elements.compute(one, PaneGroups.of(one), SUNS, one.accuracy, ALL_EFFECTS, kept=1)
    for state in ("open", "cloth/cloth/open"):
        shares, bins = every.shares(every.openings.indices(state)), np.arange(len(every.labels))
        ours, theirs = (x.total(shares, bins) for x in (some, every))
        assert not np.array_equal(ours, theirs)
        assert ours.sum() == pytest.approx(theirs.sum(), rel=0.02)
        np.testing.assert_allclose(ours.sum(axis=1), theirs.sum(axis=1), rtol=0.08)


def test_light_by_element_needs_openings():
    with pytest.raises(InputError, match="groups: there is none"):
        light_of(case(groups={}))


def test_more_elements_than_memory_holds_are_refused():
    one = case()
    words = r"elements: 0\.\d+ GiB for 6 openings with one fill each; 3 of them fit: take fewer"
    whole = elements.memory(PaneGroups.of(one).states, SUNS, one.accuracy, 9, 1)
    with pytest.raises(InputError, match=words):
        elements.compute(
            one, PaneGroups.of(one), SUNS, one.accuracy, ALL_EFFECTS, most_bytes=whole // 3
        )


def test_panes_that_send_nothing_back_leave_no_block_of_cells():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")
    strips = [{"bottom": 0.9, "top": 2.7, "material": "opal"}]
    black = {"type": "diffuser", "transmittance": 0.5, "reflectance": 0.0}
    one = case(
        facade={"south": {"strips": strips}},
        materials={"opal": black, "cloth": {**black, "transmittance": 0.1}},
        groups={"south": {"panes": ["opal"], "states": ["cloth"]}},
    )
    effects = EnabledEffects(solved_cells=True)
    light = elements.compute(one, PaneGroups.of(one), SUNS, one.accuracy, effects)
    assert light.rows.blocks.shape[2] == 0
    C = in_state(light, "open")["replicates"].values
    ours, other = C.sum(axis=(1, 2)), direct(one, "open").sum(axis=(1, 2))
    error = np.hypot(*(each.std(ddof=1) / np.sqrt(len(each)) for each in (ours, other)))
    assert abs(ours.mean() - other.mean()) < 4 * error + 1e-4 * other.mean()
