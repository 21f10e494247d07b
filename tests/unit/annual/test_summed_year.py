"""E of a year by sums against simulations of each state; states have surfaces of their own."""

import numpy as np
import pytest

from drcmitsuba.annual import simulation
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.summed_year import luminances_of, years_of_states
from drcmitsuba.case.weather import PeriodTable
from drcmitsuba.plan import plan
from drcmitsuba.runtime import backend
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.sky.daylight import daylight
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


def test_surfaces_that_come_and_go_are_those_of_each_hour(tmp_path):
    hours = [f"2015-{day}T{hour}:30" for day in ("03-21", "06-21") for hour in ("09", "12", "15")]
    (tmp_path / "times.csv").write_text("\n".join(["time", *hours, ""]))
    one = case(
        tmp_path, f"[groups.south]\n{TREE}[accuracy]\nreplicates = 8\nsensor_sky_rays = 2048\n"
    )
    one = one.with_tables(period=PeriodTable(timestamps=tmp_path / "times.csv"))
    light = daylight(one)
    run = Run.of(one, plan(one, light).scope)
    ((_, year),) = years_of_states(one, light, STATES, run)
    summed, groups = year["illuminance"].transpose("time", "sensor", "replicate").values, []
    for states in np.unique(STATES, axis=0):
        groups.append(prepared(one).groups.states.label(states))
        C = simulation.transport(one, groups[-1], light.suns, 40.0, run=run)
        L = luminances_of(light, C["bin"].values).toarray()
        mine = np.flatnonzero((states == STATES).all(axis=1))
        whole = np.einsum("rsb,tb->tsr", C["replicates"].values, L[mine])
        assert abs(deviations(summed[mine], whole)).max() < 5, groups[-1]
        assert abs(deviations(*(E.sum(axis=(0, 1)) for E in (summed[mine], whole)))) < 4
    assert groups == ["open", "open/winter", "dark/winter"]
    dark, bare = summed[[1, 3]].mean(), summed[[2, 5]].mean()
    assert dark < 0.3 * bare  # the pane, and what follows from it
