"""C by window and number of bounces: its sum is C, and each part has a route of its own."""

from dataclasses import replace

import numpy as np
import pytest

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene import scene as scenes
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.panes_in_state import grouped_panes
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.scene.surfaces import surfaces_of
from drcmitsuba.transport.coefficients import compute
from drcmitsuba.transport.windows import light_paths
from drcmitsuba.transport.windows.deposit import WindowPanes
from drcmitsuba.transport.windows.light_paths import BETWEEN_PANES, ELSEWHERE, by_window_and_bounce
from tests import ROOT
from tests.fast import slowly
from tests.unit.transport.exact_scenes import (
    BENCH,
    CLOTH,
    GLASS,
    OPAL,
    OPPOSITE,
    PATCHES,
    SUNS,
    polygon_factor,
    room,
)  # fmt: skip
from tests.unit.transport.test_coefficients_small_room import with_sources

ROUGH = Accuracy(replicates=4, paths=128, cell_size=0.4, sensor_sky_rays=1024, cell_sky_rays=32)
FILM = {"type": "bsdf", "file": str(ROOT / "scenes" / "films" / "prism.xml")}
TWO = [(0.6, 1.6, "glass"), (1.7, 2.7, "opal")]


def with_north_window(case):
    tables = case.model_dump(exclude_none=True)
    tables["facade"]["north"] = {"strips": [{"bottom": 1.0, "top": 2.0, "material": "open"}]}
    return Case.model_validate(tables)


CASES = {
    "two sides, glass and opal": (
        with_north_window(room(TWO, {"glass": GLASS, "opal": OPAL}, furniture=[OPPOSITE, BENCH])),
        "open",
    ),
    "film and a shade": (
        room(
            [(0.6, 1.6, "glass"), (1.7, 2.7, "film")],
            {"glass": GLASS, "film": FILM, "cloth": CLOTH}, shading={"material": "cloth"},
        ),
        "shaded",
    ),
}  # fmt: skip


def windows_of(case):
    groups = PaneGroups.of_windows(case)
    panes = grouped_panes(case, groups=groups)
    return [
        WindowPanes(name, np.concatenate([each.quads for each in panes if each.group == g]))
        for g, name in enumerate(groups.states.names)
    ]


def split(case, state, accuracy=ROUGH, effects=scenes.ALL_EFFECTS, suns=SUNS):
    world, (points, normals) = scenes.load(case, state, effects=effects), sensor_points(case)
    few = points[:3], normals[:3]
    return (
        by_window_and_bounce(world, *few, suns, accuracy, windows_of(case)),
        compute(world, *few, suns, accuracy),
    )


@pytest.mark.parametrize(
    ("name", "by_photons"),
    [
        pytest.param(name, by_photons, marks=[pytest.mark.slow] * by_photons)
        for name, by_photons in zip(CASES, (True, False), strict=True)
    ],
)
def test_windows_and_bounces_add_up_to_the_coefficients(name, by_photons):
    case, state = CASES[name]
    effects = replace(scenes.ALL_EFFECTS, pane_to_pane=by_photons)
    accuracy = ROUGH.model_copy(update={"photons": 256})
    parts, whole = split(case, state, accuracy, effects)
    C = whole["replicates"].mean("replicate")
    assert parts["by_window"].sum(["window", "bounces"]).values == pytest.approx(
        C.values, rel=3e-6, abs=1e-8
    )
    direct = parts["by_window"].sel(bounces=0).sum("window")
    assert direct.values == pytest.approx(whole["direct"].values, rel=3e-6, abs=1e-8)
    by = parts["by_window"].sum(["bounces", "sensor", "bin"]).to_series()
    assert by[ELSEWHERE] == 0
    assert (by.drop([ELSEWHERE, BETWEEN_PANES], errors="ignore") > 0).all()
    assert len(by) == len(windows_of(case)) + 1  # images tell what glass mirrors by its window


def test_light_straight_through_a_window_fills_its_form_factor(same):
    case, _ = CASES["two sides, glass and opal"]
    case = case.with_tables(furniture=(), materials={})
    tables = case.model_dump(exclude_none=True)
    tables["facade"]["south"]["strips"] = [{"bottom": 1.0, "top": 2.5, "material": "open"}]
    tables["facade"]["south"]["frame"] = 0.0
    case = Case.model_validate(tables)
    parts, _ = split(case, "open", ROUGH.model_copy(update={"sensor_sky_rays": 1 << 16}))
    points = sensor_points(case)[0][:3]
    for name, y in (("open (south)", 0.0), ("open (north)", 4.0)):
        low, high = (1.0, 2.5) if y == 0 else (1.0, 2.0)
        corner = np.array([[0, y, low], [3, y, low], [3, y, high], [0, y, high]])
        exact = [np.pi * polygon_factor(point, corner) for point in points]
        C = parts["by_window"].sel(window=name, bounces=0).isel(bin=slice(0, len(PATCHES)))
        assert C.sum("bin").values == pytest.approx(exact, rel=0.01)


@pytest.mark.parametrize("name", slowly(CASES, "two sides, glass and opal"))
def test_direct_light_of_a_window_is_that_of_a_room_without_the_others(name):
    case, state = CASES[name]
    finer = ROUGH.model_copy(update={"replicates": 24})
    several, _ = split(case, state, finer)
    tables = case.model_dump(exclude_none=True)
    tables["facade"].pop("north", None)
    tables["facade"]["south"]["strips"] = tables["facade"]["south"]["strips"][1:]
    alone = Case.model_validate(tables)
    window = windows_of(alone)[0].name
    _, whole = split(alone, "open", finer.model_copy(update={"seed": 5}))
    here = several.sel(window=window, bounces=0)
    difference = here["by_window"] - whole["direct"].drop_vars("bin")
    error = np.hypot(here["by_window_se"], whole["direct_se"].values)
    ours, theirs = (float(x.sum()) for x in (here["by_window"], whole["direct"]))
    assert ours == pytest.approx(theirs, rel=0.02)
    sure = error.values > 0
    z = difference.values[sure] / error.values[sure]
    assert abs(z).max() < 6  # Student's t of 23 and 23 degrees of freedom, some 400 entries


@pytest.mark.slow
def test_every_bounce_agrees_with_the_plain_path_tracer_of_limited_depth(same, plain_coefficients):
    case = room([(0.9, 2.7, "open")])
    points, normals = (a[:2] for a in sensor_points(case))
    accuracy = Accuracy(
        replicates=16, paths=2048, cell_size=0.1, sensor_sky_rays=4096, cell_sky_rays=64
    )
    here = [
        by_window_and_bounce(
            scenes.load(case), points, normals, SUNS,
            accuracy.model_copy(update={"seed": seed, "replicates": 2}), windows_of(case),
        )["by_window"].sum("window").values
        for seed in range(10)
    ]  # fmt: skip
    scene, up_to = with_sources(surfaces_of(case)), []
    for depth in range(4):  # with the same random numbers shorter paths cancel exactly
        kind = {"spp": 1 << 11, "replicates": 16, "seed": 1, "max_depth": depth}
        up_to.append(plain_coefficients(scene, points, normals, **kind).sum(axis=0))
    for bounces, other in enumerate([up_to[0], *np.diff(np.stack(up_to), axis=0)]):
        same(np.stack(here)[:, bounces], other=other, within=0.03)


def test_too_many_points_for_memory_are_refused(monkeypatch):
    monkeypatch.setattr(light_paths, "MOST_BYTES", 1 << 12)
    with pytest.raises(InputError, match="take fewer points"):
        split(*CASES["film and a shade"])
