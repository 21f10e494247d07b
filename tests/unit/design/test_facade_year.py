"""Compositions of a searched façade, and their year, against simulations of their own."""

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.annual.chosen_facade import light_of_channels
from drcmitsuba.annual.result import evaluate
from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.effects import Effects
from drcmitsuba.design.facade_tiles import TiledLight
from drcmitsuba.design.facade_year import FacadeYear
from drcmitsuba.design.layout import Layout
from drcmitsuba.metrics import accumulate
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.flat_arrays import flat_indices
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.scene.tiled_facades import TiledFacades
from drcmitsuba.schema import LUMINANCE_WEIGHTS
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.transport import coefficients, elements
from drcmitsuba.transport.elements.marked_light import MarkedLight
from drcmitsuba.transport.elements.solved_paths import SolvedReturn
from tests.tiled_room import MATERIALS, MIXED, PLAIN, SIZE, room

HEIGHTS = np.array([0.9, 1.8, 2.7])
FILLS = ("wall", "glass", "fabric")
SOLVED = {
    "paths": (ALL_EFFECTS, MarkedLight),
    "cells": (replace(ALL_EFFECTS, solved_cells=True), SolvedReturn),
}
"""Effects where light between surfaces is followed on paths or solved on cells, and what of it
openings send back."""


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def few(light, count):
    """Some suns of a period."""
    labels = np.array(light.suns.labels, dtype=object)
    return light.suns.only(labels[:: max(1, len(labels) // count)])


def by_tile(
    case, suns, accuracy, *, kept=None, segments=2, fills=FILLS, side="south", effects=ALL_EFFECTS
):  # fmt: skip
    """Light of a case by the tiles of a grid."""

    tiled = TiledFacades.of_grid(case, side, HEIGHTS, segments, fills)
    light = elements.compute(tiled.case, tiled.panes, suns, accuracy, effects, kept=kept)
    return TiledLight.of(tiled, 2 * segments, (light,))


def share_of(*names, fills=(*FILLS, "shade")):
    """Composition of tiles with one material each, from the bottom left."""
    return np.array([[name == fill for fill in fills] for name in names], np.float32)


# --- compositions


def both(tiled, composition, closed, fresh):
    """Replicates of E [lx] under a mean sky, of a composition and of a simulation."""
    ours = tiled.coefficients(composition, int(closed))
    labels = [*Patches(1).labels, *(b for b in fresh["bin"].values if b.startswith("sun_"))]
    L = np.where(np.char.startswith(np.array(labels, str), "sun_"), 1e8, 4e3)
    return [(C["replicates"].sel(bin=labels).values * L).sum(-1) for C in (ours, fresh)]


WEST = {"segments": 2, "strips": PLAIN}


@pytest.mark.parametrize(
    "sides",
    [
        pytest.param({}, id="one side", marks=pytest.mark.slow),
        pytest.param({"west": WEST}, id="two sides", marks=pytest.mark.slow),
    ],
)
def test_compositions_are_what_they_are_alone(sides):
    """E in all and by sensor, of plain and mixed façades, in both states; their standard errors."""
    fills = (*FILLS, "hole")
    mixed = share_of("glass", "wall", "hole", "fabric", fills=(*fills, "shade"))
    plain = share_of("glass", "glass", "fabric", "fabric", fills=(*fills, "shade"))
    light = daylight(room(PLAIN))
    suns = few(light, 12)
    accuracy = Accuracy(paths=512, sensor_sky_rays=2048, replicates=8)
    tables = {"facade": {"south": {"segments": 2, "strips": PLAIN}, **sides}}
    tiled = by_tile(room(PLAIN, **tables), suns, accuracy, fills=fills)
    for strips, composition in ((PLAIN, plain), (MIXED, mixed)):
        case = room(strips, facade={"south": {"segments": 2, "strips": strips}, **sides})
        for state in ("open", "shaded"):
            alone = coefficients.compute(
                scene.load(case, state), *sensor_points(case), suns,
                accuracy.model_copy(update={"seed": 9}),
            )  # fmt: skip
            ours, theirs = both(tiled, composition, state == "shaded", alone)
            n = len(ours)
            z = (ours.mean(0) - theirs.mean(0)) / np.sqrt((ours.var(0) + theirs.var(0)) / (n - 1))
            assert np.abs(z).max() < 6.0  # Šidák over 12 sensors and 8 cases, t of 7 degrees: 0.1 %
            ours, theirs = ours.mean(1), theirs.mean(1)
            error = np.sqrt((ours.var() + theirs.var()) / (n - 1))
            assert abs(ours.mean() - theirs.mean()) < 4 * error
            assert error < 0.02 * theirs.mean()  # or the line above would say little
            recombined = tiled.coefficients(composition, int(state == "shaded"))
            # What fabrics of two sides scatter onto each other is left out, 2 % of direct light.
            for name in ("straight",) if sides else ("straight", "direct"):
                a, b = (C[name].sum().item() for C in (recombined, alone))
                assert a == pytest.approx(b, rel=0.02), name


def test_glass_of_another_side_mirrors_the_suns_of_tiles():
    glass = {"type": "glazing", "transmittance": 0.65, "reflectance": 0.3}
    strips = [{"bottom": 0.9, "top": 2.7, "material": "glass"}]
    case = room(
        PLAIN, facade={side: {"strips": strips} for side in ("south", "east")},
        materials={**MATERIALS, "glass": glass}, shading=None,
        design={"film": "fabric", "side": "south", "rows": 2, "segments": 2},
        period={"months": [11], "hours": [9, 16]},
    )  # fmt: skip
    layout = Layout.of(case)
    tiled, light = layout.light(layout.heights, 1)
    share = share_of("glass", "fabric", "wall", "glass", fills=FILLS)
    E = FacadeYear.of(tiled, light).illuminance(mi.TensorXf(share)).direct.numpy()
    built = layout.composed(tiled, share)
    simulated = evaluate(built).illuminance["direct_sun"].values
    alone = evaluate(built.with_tables(effects=Effects(pane_to_pane="off"))).illuminance
    assert E.mean() == pytest.approx(simulated.mean(), rel=0.003)
    assert simulated.mean() > 1.02 * alone["direct_sun"].values.mean()
    # The side mirrors light by glass and fabric of four tiles, and four tiles of glass its light.
    assert len(tiled.channels[0].pairs) == 4 * 2 + 4


def test_the_shade_stands_before_clear_tiles_only():
    facade = {"south": {"strips": PLAIN}, "west": WEST}
    tiled = by_tile(room(PLAIN, facade=facade), few(daylight(room(PLAIN)), 1), Accuracy(paths=16))
    composition = share_of("glass", "wall", "fabric", "glass")
    before, behind = (tiled.shares(composition, state) for state in (0, 1))
    names = np.array(tiled.names)
    assert (before[names == "shade"] == 0).all()
    assert (behind[names == "glass"] == 0).all()
    assert behind[names == "shade"].tolist() == before[names == "glass"].tolist()
    for name in ("wall", "fabric"):
        assert (behind[names == name] == before[names == name]).all()
    assert before.sum() == behind.sum() == 4 + 2  # a tile of glass and one of fabric in the west


# --- years


@pytest.fixture(scope="module", params=SOLVED)
def grid(request):
    backend.select()
    case = room(PLAIN, facade={"south": {"strips": PLAIN}, "west": WEST})
    light, (effects, kind) = daylight(case), SOLVED[request.param]
    tiled = by_tile(case, light.suns, Accuracy(paths=32), kept=1, effects=effects)
    assert [type(each) for each in tiled.channels[0].returned] == [kind]
    return tiled, light


def dirichlet(seed, tiles, materials):
    share = np.zeros((tiles, materials + 1), np.float32)
    share[:, :materials] = np.random.default_rng(seed).dirichlet(np.ones(materials), tiles)
    return share


def plainly(tiled, composition, name="total", *, closed=False):
    """Coefficients of a single result, as `accumulate` takes them: C = Σ w C_e + G_m Σ w D_e."""
    light, shares = tiled.channels[0], tiled.shares(composition, int(closed))
    some = [(1, light.besides), *zip(shares, light.elements, strict=True)]
    C, D = (np.zeros((len(light.labels), n)) for n in (12, light.besides.blocks.shape[2]))
    for share, element in some:
        C[element.bins] += share * getattr(element, name)[0]
        D[element.bins] += share * element.blocks[0]
    if name == "total":
        C += D @ light.returned[0].weighed(shares).T
    dims, labels = ("replicate", "sensor", "bin"), np.array(light.labels, dtype=object)
    return xr.Dataset({"replicates": (dims, np.array([C.T, C.T]))}, {"bin": labels})


def is_coefficients_times_luminances(tiled, light, share):
    E = FacadeYear.of(tiled, light).illuminance(mi.TensorXf(share))
    for values, closed in ((E.open, False), (E.shaded, True)):
        plain = accumulate.by_source(plainly(tiled, share, closed=closed), light.sky)["total"]
        np.testing.assert_allclose(values.numpy(), plain.values, rtol=2e-4, atol=1e-3)
    direct = accumulate.by_source(plainly(tiled, share, "straight"), light.sky)["sun"].values
    np.testing.assert_allclose(E.direct.numpy(), direct, rtol=2e-4, atol=1e-3)
    return E


def test_a_year_is_coefficients_times_luminances(grid):
    E = is_coefficients_times_luminances(*grid, dirichlet(1, 4, 3))
    assert E.direct.numpy().max() > 1000


def test_some_hours_are_those_of_all(grid):
    """At the same hours the same E and slopes, and hours of the year by the stamps of each."""
    year = FacadeYear.of(*grid)
    hours = np.flatnonzero(np.random.default_rng(5).random(len(year.months)) < 0.2)
    some, share = year.at(hours), dirichlet(3, 4, 3)
    assert some.channels[0][1].shape[0] < year.channels[0][1].shape[0]
    np.testing.assert_array_equal(some.months, year.months[hours])
    assert some.step_hours * len(hours) == pytest.approx(year.step_hours * len(year.months))
    weights = np.random.default_rng(6).random((3, len(hours), 12)).astype(np.float32)
    slopes = []
    for one, at in ((year, hours), (some, np.arange(len(hours)))):
        x, total = mi.TensorXf(share), mi.Float(0)
        dr.enable_grad(x)
        E = one.illuminance(x)
        for values, w in zip((E.open, E.shaded, E.direct), weights, strict=True):
            index = flat_indices(at[:, None] * 12 + np.arange(12))
            total += dr.sum(dr.gather(mi.Float, values.array, index) * mi.Float(w.ravel()))
        dr.backward(total)
        slopes.append(dr.grad(x).numpy())
    np.testing.assert_allclose(*slopes, rtol=1e-4, atol=1e-4 * np.abs(slopes[0]).max())
    whole, part = year.illuminance(mi.TensorXf(share)), some.illuminance(mi.TensorXf(share))
    for a, b in zip((*whole.states, whole.direct), (*part.states, part.direct), strict=True):
        np.testing.assert_allclose(b.numpy(), a.numpy()[hours], rtol=1e-5, atol=1e-2)


@pytest.mark.slow
def test_a_coloured_year_is_that_of_its_luminance():
    """Channels count by their weights in luminance, each as in a simulation of its own."""
    rho = [0.45, 0.2, 0.05]
    case = room(PLAIN, room={"size": SIZE, "floor": rho, "ceiling": 0.8, "walls": 0.6})
    light, weights = daylight(case), LUMINANCE_WEIGHTS.values()
    accuracy = Accuracy(paths=256, replicates=8)

    def by_channel(kept):
        tiled = TiledFacades.of_grid(case, "south", HEIGHTS, 1, FILLS)
        channels = light_of_channels(
            tiled.case, tiled.panes, light.suns, accuracy, ALL_EFFECTS, lambda part: None, kept
        )
        return TiledLight.of(tiled, 2, channels)

    one, share = by_channel(1), share_of("glass", "fabric")
    E = FacadeYear.of(one, light).illuminance(mi.TensorXf(share))
    plain = [
        accumulate.by_source(plainly(replace(one, channels=(each,)), share), light.sky)["total"]
        for each in one.channels
    ]
    total = sum(w * each.values for w, each in zip(weights, plain, strict=True))
    np.testing.assert_allclose(E.open.numpy(), total, rtol=2e-4, atol=1e-3)
    ours = by_channel(None).coefficients(share)["replicates"]
    for channel in range(3):
        world = scene.load(case, "open", channel)
        alone = coefficients.compute(
            world, *sensor_points(case), light.suns, accuracy.model_copy(update={"seed": 9})
        )["replicates"]
        a, b = (C.mean(("sensor", "bin")).values for C in (ours.isel(channel=channel), alone))
        assert abs(a.mean() - b.mean()) < 4 * np.sqrt((a.var() + b.var()) / 7)


@pytest.mark.parametrize("where", SOLVED)
def test_a_year_of_several_results_is_their_mean(where):
    """But for light that tiles send back, of which products of means are taken."""
    case, effects = room(PLAIN), SOLVED[where][0]
    light = daylight(case)
    tiled = by_tile(case, light.suns, Accuracy(paths=256, replicates=6), effects=effects)
    share = dirichlet(1, 4, 3)
    E = FacadeYear.of(tiled, light).illuminance(mi.TensorXf(share)).open.numpy()
    plain = accumulate.by_source(tiled.coefficients(share), light.sky)["total"].values
    np.testing.assert_allclose(E, plain, rtol=0.01)
    assert E.mean() == pytest.approx(plain.mean(), rel=1e-4)
    one = by_tile(case, light.suns, Accuracy(paths=256, replicates=6), kept=1, effects=effects)
    together = FacadeYear.of(one, light).illuminance(mi.TensorXf(share)).open.numpy()
    np.testing.assert_allclose(together, E, rtol=0.05)  # G of a replicate by D of another
    assert together.mean() == pytest.approx(E.mean(), rel=1e-3)


def test_gradients_of_a_year_are_its_differences(grid):
    year = FacadeYear.of(*grid)
    share, step = dirichlet(2, 4, 3), 0.02
    weights = [mi.TensorXf(np.random.default_rng(i).random((len(year.months), 12))) for i in (1, 2)]

    def value(share, glass):
        E = year.illuminance(share, scale={"glass": glass})
        both = E.open * weights[0] + E.shaded * weights[1] + E.direct
        return dr.mean(mi.Float64((both / 1000).array))  # or differences would be of rounding

    x, tau = mi.TensorXf(share), mi.Float(0.9)
    dr.enable_grad(x, tau)
    dr.backward(value(x, tau))
    gradient, of_tau = dr.grad(x).numpy(), dr.grad(tau).numpy()[0]
    assert np.isfinite(gradient).all()

    def at(change, glass=0.9):
        y = value(mi.TensorXf((share + change).astype(np.float32)), mi.Float(glass))
        return float(y.numpy().ravel()[0])

    for tile in range(4):
        for material in range(3):  # the shade stands in no tile of its own
            h = np.zeros_like(share)
            h[tile, material] = step
            slope = (at(h) - at(-h)) / (2 * step)
            scale = float(np.abs(gradient).max())
            assert gradient[tile, material] == pytest.approx(slope, abs=1e-4 * scale)
    assert of_tau == pytest.approx((at(0, 0.92) - at(0, 0.88)) / 0.04, rel=1e-4)
    # Forward: one direction through all of the composition.
    h = np.random.default_rng(3).normal(size=share.shape).astype(np.float32)
    x = mi.TensorXf(share)
    dr.enable_grad(x)
    dr.set_grad(x, mi.TensorXf(h))
    forward = float(dr.forward_to(value(x, mi.Float(0.9))).numpy().ravel()[0])
    assert forward == pytest.approx(float((gradient * h).sum()), rel=1e-3)


def test_all_wall_is_dark_and_finite():
    case = room(PLAIN)
    light = daylight(case)
    year = FacadeYear.of(by_tile(case, light.suns, Accuracy(paths=32), kept=1), light)
    x = mi.TensorXf(share_of(*["wall"] * 4))
    dr.enable_grad(x)
    E = year.illuminance(x)
    assert E.open.numpy().max() == 0
    dr.backward(dr.sum(E.open.array))
    gradient = dr.grad(x).numpy()
    assert np.isfinite(gradient).all()
    assert (gradient[:, 1] > 0).all()


def test_fills_that_send_nothing_back_leave_no_block_of_cells():
    black = {name: {**material, "reflectance": 0.0} for name, material in MATERIALS.items()}
    case = room(PLAIN, materials=black)
    light, fills = daylight(case), ("hole", "glass", "fabric")
    accuracy, (effects, _) = Accuracy(paths=32), SOLVED["cells"]
    tiled = by_tile(case, light.suns, accuracy, kept=1, fills=fills, effects=effects)
    assert tiled.channels[0].besides.blocks.shape[2] == 0
    is_coefficients_times_luminances(tiled, light, dirichlet(1, 4, 3))


def test_the_shade_may_be_a_material_of_the_search():
    """Tiles of fabric have it at all hours, tiles of glass while the shade is closed."""
    case = room(PLAIN, shading={"material": "fabric"})
    light = daylight(case)
    tiled = by_tile(case, light.suns, Accuracy(paths=32), kept=1)
    assert tiled.materials == FILLS
    is_coefficients_times_luminances(tiled, light, dirichlet(4, 4, 3)[:, :3])


@pytest.mark.parametrize(
    ("side", "changes"), [("south", {"sun": {"model": "three_phase"}}), ("north", {})]
)
def test_no_sun_at_all(side, changes):
    """Patches stand for the sun, or the façade never sees it."""
    case = room(PLAIN, side, **changes)
    light = daylight(case)
    tiled = by_tile(case, light.suns, Accuracy(paths=16), kept=1, segments=1, side=side)
    share = share_of("glass", "fabric")
    E = is_coefficients_times_luminances(tiled, light, share)
    assert (E.open.numpy() > 0).all()
    assert (E.direct.numpy().max() == 0) == (side == "north")  # patches are seen straight


def test_a_year_refuses_another_sky(grid):
    with pytest.raises(InputError, match="subdivision of this sky"):
        FacadeYear.of(grid[0], daylight(room(PLAIN, sky={"subdivision": 2})))


def test_a_year_refuses_other_suns(grid):
    other = room(PLAIN, period={"months": [4], "hours": [9, 15]})
    with pytest.raises(InputError, match="compute the light for this sky"):
        FacadeYear.of(grid[0], daylight(other))


def test_a_scale_of_no_material_is_refused(grid):
    with pytest.raises(InputError, match="no material 'gold'"):
        FacadeYear.of(*grid).illuminance(mi.TensorXf(dirichlet(1, 4, 3)), {"gold": mi.Float(1)})
