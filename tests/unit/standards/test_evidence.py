"""Verdicts on coloured cases, on façades of many states, and on draws that an evaluation made."""

import json
from dataclasses import replace

import numpy as np
import xarray as xr

from drcmitsuba import standards
from drcmitsuba.case.groups import GroupStates
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.intervals.sun import draw_sun
from drcmitsuba.schema import LUMINANCE_WEIGHTS
from tests.unit.standards.made_year import WORKING, evidence, median_reached


def near_the_threshold(error=0.05, **more):
    around = np.exp(np.random.default_rng(2).normal(0, 0.1, 64))
    return evidence(around * 300 / median_reached(WORKING), error, times=WORKING, **more)


def test_a_coloured_case_is_judged_by_its_luminance():
    grey = near_the_threshold()
    channel = xr.DataArray(np.array(list(LUMINANCE_WEIGHTS), object), dims="channel")
    factor = xr.DataArray([0.5, 1.0, 2.0], dims="channel", coords={"channel": channel})
    factor = factor / (factor * list(LUMINANCE_WEIGHTS.values())).sum()
    E = xr.Dataset(
        {n: v * factor for n, v in grey.illuminance.items()}, attrs=grey.illuminance.attrs
    )
    C = grey.coefficients.open
    C = xr.Dataset({n: (v * factor).transpose("channel", ...) for n, v in C.items()}, attrs=C.attrs)
    coloured = replace(grey, illuminance=E.astype(np.float32), coefficients=Coefficients(C))
    for name in ("lm-83-12", "well-l01"):
        ours, theirs = (standards.verdict(name, e) for e in (grey, coloured))
        assert ours.level == theirs.level
        for a, b in zip(ours.levels, theirs.levels, strict=True):
            assert abs(a.probability - b.probability) < 0.02  # rounding in single precision


def test_many_states_that_c_does_not_hold_leave_the_probability_unknown():
    E = near_the_threshold()
    rng = np.random.default_rng(1)
    shape = E.illuminance["total"].shape
    names = [f"window {i}" for i in range(5)]
    groups = GroupStates(tuple(names), (("open", "shut"),) * 5)
    shade = {"has_shade": 1, "shade_threshold": 1000.0, "shade_area": 0.02, **groups.attributes()}
    sun = np.where(rng.random(shape) < 0.1, 5000, 0).astype(np.float32)
    lit = E.illuminance.assign(
        direct_sun=(("time", "sensor"), sun),
        sun_group=(("time", "sensor"), rng.integers(0, 5, shape).astype(np.float32)),
    )
    lit.attrs |= shade
    C = Coefficients(E.coefficients.open.assign_attrs(shade))
    verdict = standards.verdict("lm-83-12", replace(E, illuminance=lit, coefficients=C))
    assert verdict.level is None or verdict.probability is None
    assert verdict.levels[0].probability is None
    assert any("does not hold all states" in note for note in verdict.notes)
    assert verdict.quantities["sDA"].low < verdict.quantities["sDA"].high


def test_some_hours_of_the_sun_keep_their_draws():
    rng = np.random.default_rng(3)
    mean = np.where(rng.random((40, 9)) < 0.3, rng.uniform(200, 3000, (40, 9)), 0)
    sun = draw_sun(mean, mean / 3, (1000.0, 1000.0), 32, 0)
    kept = np.arange(0, 40, 3)
    some = sun.at(kept)
    rows = np.isin(sun.time, kept)
    np.testing.assert_array_equal(kept[some.time], sun.time[rows])
    np.testing.assert_array_equal(some.exposed, sun.exposed[rows])
    np.testing.assert_array_equal(some.closing, sun.closing[rows])


def test_verdicts_are_plain_json():
    verdicts = standards.verdicts(near_the_threshold())
    assert len(verdicts) == len(standards.names())
    for verdict in verdicts:
        told = json.loads(json.dumps(verdict.to_dict(), allow_nan=False))
        assert told["standard"] in standards.names()
