"""E of a year by sums against simulations of each state; states have surfaces of their own."""

import numpy as np
import pytest
import xarray as xr

from drcmitsuba import elements, evaluate
from drcmitsuba.annual import simulation
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.summed_year import luminances_of, years_of_states
from drcmitsuba.annual.variants import SharedElements, joined_effects
from drcmitsuba.case.groups import Group
from drcmitsuba.case.reading import load_case
from drcmitsuba.case.shading import Shading
from drcmitsuba.case.weather import PeriodTable
from drcmitsuba.model.materials import DiffuserMaterial, GlazingMaterial
from drcmitsuba.plan import plan
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.shared_facades import SharedFacades
from drcmitsuba.sky.daylight import daylight
from tests.unit.model import box_room as box
from tests.unit.scene.test_groups_of_models import TREE, case

STATES = np.array([[0, 0], [1, 1], [0, 1], [1, 1], [0, 0], [0, 1]])
"""States of the window with its shelf and of the tree, at six time stamps."""


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def deviations(a, b):
    """Deviation of means over replicates (…, replicate) in standard errors."""
    error = np.sqrt(sum(E.var(axis=-1, ddof=1) / E.shape[-1] for E in (a, b)))
    return (a.mean(axis=-1) - b.mean(axis=-1)) / error


def case_by_the_hour(tmp_path, *days, **tree):
    """Window with a shelf, and a tree, of which both have two states, at six time stamps."""
    days = days or ("03-21", "06-21")
    hours = [f"2015-{day}T{hour}:30" for day in days for hour in ("09", "12", "15")]
    (tmp_path / "times.csv").write_text("\n".join(["time", *hours, ""]))
    one = case(
        tmp_path, f"[groups.south]\n{TREE}[accuracy]\nreplicates = 8\nsensor_sky_rays = 2048\n",
        **tree,
    )  # fmt: skip
    return one.with_tables(period=PeriodTable(timestamps=tmp_path / "times.csv"))


def simulated(one, light, run):
    """E (time, sensor, replicate) [lx] of the year of `STATES`, each state simulated by itself."""
    E = np.empty((len(STATES), 4, 8))
    for states in np.unique(STATES, axis=0):
        label = prepared(one).groups.states.label(states)
        C = simulation.transport(one, label, light.suns, 40.0, run=run)
        L = luminances_of(light, C["bin"].values).toarray()
        mine = np.flatnonzero((states == STATES).all(axis=1))
        E[mine] = np.einsum("rsb,tb->tsr", C["replicates"].values, L[mine])
    return E


@pytest.mark.slow
def test_surfaces_that_come_and_go_are_those_of_each_hour(tmp_path):
    one = case_by_the_hour(tmp_path)
    light = daylight(one)
    run = Run.of(one, plan(one, light).scope)
    ((_, year),) = years_of_states(one, light, STATES, run)
    summed = year["illuminance"].transpose("time", "sensor", "replicate").values
    whole = simulated(one, light, run)
    assert abs(deviations(summed, whole)).max() < 5
    for states in np.unique(STATES, axis=0):
        mine = (states == STATES).all(axis=1)
        both = (E[mine].sum(axis=(0, 1)) for E in (summed, whole))
        assert abs(deviations(*both)) < 4, states
    dark, bare = summed[[1, 3]].mean(), summed[[2, 5]].mean()
    assert dark < 0.3 * bare  # the pane, and what follows from it


def test_elements_know_the_light_of_every_set_of_surfaces(tmp_path, monkeypatch):
    one = case_by_the_hour(tmp_path)
    known = elements(one)
    assert known.fills == {"south": ("clear", "dark"), "tree": ("open", "winter")}
    whole = simulated(one, known.daylight, known.run)
    (light,) = known.channels
    assert [*light.known] == [(0, 0)]  # the others when they are asked for
    E = known.in_states(STATES)
    assert {*light.known} == {(0, 0), (0, 1), (1, 1)}
    error = np.hypot(E["total_se"].values, whole.std(axis=-1, ddof=1) / np.sqrt(8))
    assert (abs(E["total"].values - whole.mean(axis=-1)) / error).max() < 5
    np.testing.assert_allclose(E["total"].mean(), whole.mean(), rtol=0.02)
    time = {"time": known.daylight.sky["time"].values}
    by_hour = {
        name: xr.DataArray(np.array(known.fills[name], object)[STATES[:, g]], time, "time")
        for g, name in enumerate(known.openings)
    }
    chosen = known.evaluate(by_hour).illuminance
    np.testing.assert_allclose(chosen["total"], E["total"], rtol=1e-4)
    bare = known.evaluate({"south": "clear", "tree": "winter"}).illuminance
    np.testing.assert_allclose(bare["total"][[2, 5]], E["total"][[2, 5]], rtol=1e-4)
    with pytest.raises(InputError, match=r"case\.toml: tree: shares of fills .* name one at"):
        known.evaluate({"tree": {"open": 0.5, "winter": 0.5}})
    reversed_, by_share = np.eye(2)[STATES[:, 1]], {"dims": ("time", "fill"), "coords": time}
    told = [
        known.evaluate({"tree": xr.DataArray(reversed_, **by_share).assign_coords(fill=fills)})
        for fills in (["open", "winter"], ["winter", "open"])
    ]
    assert len({each.metrics["settings"]["choice"] for each in told}) == 2
    assert (1, 0) not in light.known
    monkeypatch.setattr("drcmitsuba.transport.elements.light_of_surfaces.MOST_SETS", 2)
    known.illuminance({"south": "dark"})
    assert {*light.known} == {(0, 0), (1, 0)}  # the others make room
    with pytest.raises(InputError, match=r"case\.toml: groups: more than 2 sets of the surfaces"):
        known.in_states(STATES)


def test_a_rule_that_closes_nothing_needs_one_set(tmp_path):
    known = elements(case_by_the_hour(tmp_path).with_tables(groups={"south": Group()}))
    known.evaluate()
    assert [*known.channels[0].known] == [(0,)]  # the tree hides the sun


def test_variants_have_the_surfaces_of_each_hour(tmp_path):
    one = case_by_the_hour(tmp_path, "06-21", "09-23", tree=("winter", "summer"))
    half = GlazingMaterial(type="glazing", transmittance=0.4)
    still = {"south": one.groups["south"]}
    pair = [one, one.with_tables(materials={**one.materials, "clear": half}, groups=still)]
    shared, means = SharedElements.of(pair), []
    (light,) = shared.channels
    assert [*light.known] == [(0, 0)]
    for number, each in enumerate(pair):
        ours, theirs = shared.evaluate(number).illuminance, evaluate(each).illuminance
        np.testing.assert_array_equal(ours["facade_state"], theirs["facade_state"])
        error = np.hypot(ours["total_se"], theirs["total_se"])
        assert (abs(ours["total"] - theirs["total"]) / error).max() < 5
        np.testing.assert_allclose(ours["total"].mean(), theirs["total"].mean(), rtol=0.05)
        means.append(ours["total"].mean("sensor").values)
    assert {(0, 0), (0, 1)} <= {*light.known}
    assert (means[0][3:] < 0.5 * means[0][:3]).all()  # the tree has leaves in autumn
    assert (means[1][3:] > 0.6 * means[1][:3]).all()  # and none in the other variant


def test_a_variant_may_close_by_the_shade_alone_beside_one_with_such_groups(tmp_path):
    one = case_by_the_hour(tmp_path, "06-21", "09-23", tree=("winter", "summer"))
    dim = DiffuserMaterial(type="diffuser", transmittance=0.1)
    shaded = {"shading": Shading(material="dim"), "materials": {**one.materials, "dim": dim}}
    pair = [one.with_tables(groups={}, **shaded), one.with_tables(**shaded)]
    for cases in (pair, pair[::-1]):
        shared = SharedElements.of(cases)
        tree = [bool(shared.evaluate(k).illuminance.attrs.get("groups")) for k in (0, 1)]
        assert tree == [bool(case.groups) for case in cases]


def test_a_group_with_states_of_its_own_leaves_the_model_its_first_surfaces_or_is_refused(tmp_path):
    """An awning hangs there in the first state; what takes its place the case cannot tell."""
    room = box.room()
    corners = [[1, -1, 2.5], [3, -1, 2.5], [3, -0.1, 2.5], [1, -0.1, 2.5]]
    awning = {
        "type": "StateGeometry", "identifier": "awning", "modifier": "matt",
        "geometry": {"type": "Face3D", "boundary": corners},
    }  # fmt: skip
    states = [{"modifier": "clear", "shades": [awning]}, {"modifier": "clear"}]
    room["faces"][1]["apertures"][0]["properties"]["radiance"] = {
        "dynamic_group_identifier": "south", "states": states,
    }  # fmt: skip
    glass = {"type": "Glass", "identifier": "clear"}
    glass |= {f"{c}_transmissivity": 0.9 for c in "rgb"}
    modifiers = {"modifiers": [glass, box.plastic("matt", 0.2, 0.2, 0.2)]}
    box.written(tmp_path, box.model(room, radiance=modifiers))
    (tmp_path / "case.toml").write_text(
        '[model]\nfiles = ["box.hbjson"]\n[groups.south]\n'
        "[sensors]\ncorner = [1, 1, 0.8]\ncount = [2, 2]\nspacing = 1.0\n"
    )
    one = load_case(tmp_path / "case.toml")
    dim = DiffuserMaterial(type="diffuser", transmittance=0.1)
    own = {"south": Group(states=("dim",))}
    other = one.with_tables(materials={**one.materials, "dim": dim}, groups=own)
    assert SharedFacades.of([one, one]).bringing
    with pytest.raises(InputError, match=r"groups\.south\.states: states of its own, and surfaces"):
        SharedFacades.of([one, other])


def test_façades_share_what_any_of_them_calls_for():
    """Whichever comes first: glass in two sides mirrors light from pane to pane."""
    one, two = EnabledEffects(), EnabledEffects(pane_to_pane=True)
    assert joined_effects([one, two]).pane_to_pane
    assert joined_effects([two, one]).pane_to_pane
    assert not joined_effects([one, one]).pane_to_pane
