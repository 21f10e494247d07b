"""Groups of panes in a search: the hard rule as metrics have it, its smooth twin, a simulation."""

import json

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import xarray as xr

import drcmitsuba
from drcmitsuba.case.groups import GroupStates
from drcmitsuba.case.reading import load_case
from drcmitsuba.case.schedule import Schedule
from drcmitsuba.design.facade_groups import MOST_STATES, FacadeGroups
from drcmitsuba.design.layout import Layout
from drcmitsuba.metrics import smooth
from drcmitsuba.metrics.facade_states import ShadeRule, sunlit
from drcmitsuba.metrics.watched_groups import outside_of, watched
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.transport.elements.state_illuminances import Illuminances
from tests.differences import slopes
from tests.system.every_room import BOXES

HOURS, SENSORS = 120, 30
BLINDS = ("open", "half", "closed")


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def tensor(values):
    return mi.TensorXf(np.asarray(values, np.float32))


def rule(groups, scheduled=()):
    states = GroupStates(tuple("abc"[:groups]), (BLINDS,) * groups)
    of_group = {g: np.arange(8760) % 3 for g in scheduled}
    return ShadeRule(states, 1000.0, 0.1, Schedule(of_group, groups))


def facade(given, grid=None, outside=None):
    time = xr.DataArray(np.datetime64("2015-03-01", "h") + np.arange(HOURS), dims="time")
    time = time.astype("M8[ns]").assign_coords(time=time.values.astype("M8[ns]"))
    grid = np.zeros(SENSORS, int) if grid is None else grid
    outside = np.zeros((len(given.groups), SENSORS), bool) if outside is None else outside
    return FacadeGroups.of(given, time, grid, outside, "case")


def year(groups, seed=3):
    """Random illuminances in every state, with sun by way of every group on few sensors."""
    rng = np.random.default_rng(seed)
    count = len(groups.rule.groups)
    by = rng.integers(0, count, (HOURS, SENSORS))
    sun = 3000 * rng.random((HOURS, SENSORS)) * (rng.random((HOURS, SENSORS)) < 0.3)
    sun *= rng.random((HOURS, 1)) < 0.7
    states = [tensor(1000 * rng.random((HOURS, SENSORS))) for _ in groups.indices]
    by_group = tuple(tensor(np.where(by == g, sun, 0)) for g in range(count))
    return Illuminances(*states[:2], tensor(sun), tuple(states[2:]), by_group)


@pytest.mark.parametrize(("scheduled", "own"), [((), []), ((1,), []), ((), ["c"])])
def test_states_are_those_of_the_metrics(scheduled, own):
    """Groups of the space `own` belong to that of the first grid."""
    grid = np.arange(SENSORS) // 15
    rows = [{"name": "0", "groups": own}, {"name": "1"}]
    at = xr.Dataset(coords={"space": ("sensor", grid.astype(str))})
    at = at.assign_attrs(spaces=json.dumps(rows))
    given = rule(3, scheduled)
    groups = facade(given, grid, outside_of(given.groups, at))
    at = at.assign_attrs(given.groups.attributes())
    E = year(groups)
    by = np.argmax([sun.numpy() for sun in E.by_group], axis=0)
    sun = xr.Dataset(
        {"direct_sun": (("time", "sensor"), E.direct.numpy()),
         "sun_group": (("time", "sensor"), by)},
        {"time": groups.time.values, "grid": ("sensor", grid.astype(str))},
    )  # fmt: skip
    sun["sun_group"] = watched(sun["sun_group"], at)
    assert (sun["sun_group"].values < 0).any() == bool(own)
    lit = sunlit(sun, groups.rule)
    taken = groups.rule.indices(groups.rule.closed(lit, np.bincount(grid)), groups.time)
    expected = np.empty((HOURS, SENSORS), np.float32)
    for row, state in zip(groups.indices, E.states, strict=True):
        here = (taken == row).all(axis=1)
        expected[here] = state.numpy()[here]
    np.testing.assert_array_equal(groups.applied(E), expected)
    assert len(np.unique(taken, axis=0)) > 4
    # The twin tends to it, but where some count or value lies near its threshold.
    off = abs(groups.smooth(E, 1e5).numpy() - expected).max(axis=1) > 1
    assert off.mean() < 0.02


@pytest.mark.parametrize("scheduled", [(), (1,)])
def test_some_hours_are_in_the_states_of_all(scheduled):
    groups = facade(rule(2, scheduled))
    E, hours = year(groups), np.arange(1, HOURS, 7)
    some = E._each(lambda values: tensor(values.numpy()[hours]))
    own = groups.at(hours)
    np.testing.assert_array_equal(own.applied(some), groups.applied(E)[hours])
    smooth = groups.smooth(E, 8.0).numpy()[hours]
    np.testing.assert_allclose(own.smooth(some, 8.0).numpy(), smooth, rtol=1e-5)


def test_one_group_is_the_one_shade():
    groups = facade(ShadeRule(GroupStates.of_shade(), 1000.0, 0.1))
    E = year(groups)
    closed = smooth.shade_closed(E.direct, 1000.0, 0.1, sharpness=8.0)
    plain = smooth.applied(E.open, E.shaded, closed).numpy()
    np.testing.assert_allclose(groups.smooth(E, 8.0).numpy(), plain, rtol=1e-5, atol=1e-3)


def test_gradients_by_direct_sun_are_the_differences():
    groups = facade(rule(2, (0,)), np.arange(SENSORS) // 15)
    E = year(groups)

    def value(scale):
        lit = E._replace(direct=E.direct * scale, by_group=tuple(s * scale for s in E.by_group))
        return dr.mean(mi.Float64(groups.smooth(lit, 4.0).array))

    x = mi.Float(1.0)
    dr.enable_grad(x)
    dr.backward(value(x))
    (theirs,) = slopes(lambda at: value(mi.Float(at))[0], [1.0], 0.02)
    assert dr.grad(x)[0] == pytest.approx(theirs, rel=1e-3)
    assert abs(theirs) > 1


def test_too_many_states_are_refused():
    states = GroupStates(tuple("abcdef"), (("open", "shaded"),) * 6)
    with pytest.raises(InputError, match=f"more than {MOST_STATES} states of the façade, by 6"):
        facade(ShadeRule(states))


DESIGN = '[design]\nside = "south"\nfilm = "opal"\nrows = 2\nparameters = "strips"\n'
FINER = "replicates = 2\npaths = 16", "replicates = 6\npaths = 96"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["groups", "facing"])
def test_a_façade_as_drawn_is_its_evaluation(tmp_path, name):
    """E of a search under its own states, beside a simulation of the same façade."""
    text = BOXES["groups" if name == "groups" else "two sides"].replace(*FINER)
    text = text.replace('groups = "together"\n', "") + DESIGN
    (tmp_path / "case.toml").write_text("[metrics]\nsda_threshold = 3000\n" + text)
    layout = Layout.of(load_case(tmp_path / "case.toml"))
    year = layout.year()
    problem = layout.problem(year)
    share = np.array([[name == "glass" for name in year.materials]] * 2, np.float32)
    applied = problem.measure.groups.applied(year.illuminance(tensor(share)))
    result = drcmitsuba.evaluate(layout.case)
    E = result.illuminance[["total", "total_se"]].transpose("time", "sensor")
    assert 0.1 < result.illuminance["shade_closed"].values.mean() < 0.9
    error = E["total_se"].values + 0.01 * E["total"].values
    assert (abs(applied - E["total"].values) > 6 * error).mean() < 0.01
    assert applied.mean() == pytest.approx(E["total"].values.mean(), rel=0.01)
    low, high = (result.metrics["sDA"][end] for end in ("low", "high"))
    assert low <= problem.hard(share).aim <= high
    x = np.full(problem.size, 0.5)
    theirs = slopes(lambda at: problem.evaluate(at, 8.0).smooth.value, x, 0.04)
    assert problem.evaluate(x, 8.0).gradient == pytest.approx(theirs, rel=1e-3)
