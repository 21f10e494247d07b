"""Façade basis: tiles, what paths remember, and compositions against simulations of their own."""

from dataclasses import replace

import drjit as dr
import numpy as np
import pytest
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.shipped import shipped_folder
from drcmitsuba.metrics import accumulate
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import checked
from drcmitsuba.scene import scene
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.scene.surfaces import surfaces_of
from drcmitsuba.scene.tiled_facades import FRAME
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.transport import coefficients, facade_basis
from drcmitsuba.transport.cells.cells import CellGrid
from drcmitsuba.transport.facade_basis import facade, simulate
from drcmitsuba.transport.facade_basis.basis import Returned
from drcmitsuba.transport.facade_basis.tiling import material_at, wall_around
from drcmitsuba.transport.gather.paths import gather

SIZE = [4.0, 5.0, 3.0]
MATERIALS = {
    "glass": {"type": "glazing", "transmittance": 0.65, "reflectance": 0.15},
    "fabric": {"type": "diffuser", "transmittance": 0.3, "reflectance": 0.5},
    "shade": {"type": "diffuser", "transmittance": 0.1, "reflectance": 0.4},
}
PLAIN = [
    {"bottom": 0.9, "top": 1.8, "material": "glass"},
    {"bottom": 1.8, "top": 2.7, "material": "fabric"},
]
MIXED = [
    {"bottom": 0.9, "top": 1.8, "material": "glass", "segments": [0]},
    {"bottom": 0.9, "top": 1.8, "material": "wall", "segments": [1]},
    {"bottom": 1.8, "top": 2.7, "material": "fabric", "segments": [1]},
    {"bottom": 1.8, "top": 2.7, "material": "open", "segments": [0]},
]


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def room(strips, side="south", frame=0.0, **changes):
    tables = {
        "room": {"size": SIZE, "floor": 0.3, "ceiling": 0.8, "walls": 0.6},
        "materials": MATERIALS,
        "facade": {side: {"segments": 2, "frame": frame, "strips": strips}},
        "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 4], "spacing": 1.0},
        "shading": {"material": "shade"},
        "period": {"months": [3], "hours": [9, 15]},
        "accuracy": {"paths": 64, "sensor_sky_rays": 512},
    }
    return checked(Case, tables | changes, "room.toml")


def few(light, count):
    """Some suns of a period."""
    labels = np.array(light.suns.labels, dtype=object)
    return light.suns.only(labels[:: max(1, len(labels) // count)])


# --- tiles


def test_tiles_of_variants_are_what_they_have_in_common():
    cases = [room(PLAIN), room(MIXED)]
    wall, tiles, palette, shares = facade_basis.of_variants(cases)
    assert wall.side == "south"
    assert wall.size == (4.0, 3.0)
    assert palette.names[-1] == "shade"
    assert tiles.area.sum() == pytest.approx(4.0 * 1.8)
    assert len(tiles) == 4
    for case, share in zip(cases, shares, strict=True):
        assert (share.sum(axis=1) == 1).all()
        for name in ("glass", "fabric"):
            parts = [s.quads for s in surfaces_of(case) if s.name.startswith(name)]
            quads = np.concatenate(parts)
            area = tiles.area @ share[:, palette.names.index(name)]
            n = np.cross(quads[:, 1] - quads[:, 0], quads[:, 3] - quads[:, 0])
            assert area == pytest.approx(np.linalg.norm(n, axis=1).sum())


def test_equal_tiles_of_all_segments_are_one():
    _, tiles, _, _ = facade_basis.of_variants([room(PLAIN)])
    assert len(tiles) == 2
    assert tiles.area == pytest.approx([3.6, 3.6])
    assert sorted(map(tuple, tiles.bounds)) == [(0, 4, 0.9, 1.8), (0, 4, 1.8, 2.7)]


@pytest.mark.parametrize("side", ["south", "east", "north", "west"])
@pytest.mark.parametrize("frame", [0.0, 0.1])
def test_tiles_and_the_wall_around_them_are_the_wall(side, frame):
    case = room(PLAIN, side, frame)
    wall, tiles, palette, (share,) = facade_basis.of_variants([case])
    around = wall_around(wall, tiles)
    n = np.cross(around[:, 1] - around[:, 0], around[:, 3] - around[:, 0])
    length, height = wall.size
    assert np.linalg.norm(n, axis=1).sum() + tiles.area.sum() == pytest.approx(length * height)
    for name, word in ((FRAME, "frame"), ("glass", "glass")):
        if name not in palette.names:
            assert frame == 0
            continue
        quads = [s.quads for s in surfaces_of(case) if s.name.startswith(word)]
        m = [np.linalg.norm(np.cross(q[:, 1] - q[:, 0], q[:, 3] - q[:, 0]), axis=1) for q in quads]
        area = tiles.area @ share[:, palette.names.index(name)]
        assert area == pytest.approx(np.concatenate(m).sum())


def test_material_at_points():
    case = room(MIXED, frame=0.1)
    x, z = np.array([1.0, 3.0, 1.0, 3.0, 0.02, 1.0]), np.array([1.2, 1.2, 2.0, 2.0, 1.2, 0.4])
    names = material_at(case.facade["south"], 4.0, x, z)
    assert list(names) == ["glass", "wall", "open", "fabric", FRAME, "wall"]


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"room": {"size": [4.0, 6.0, 3.0]}}, "room"),
        ({"sensors": {"corner": [0.5, 0.5, 0.7], "count": [3, 4], "spacing": 1.0}}, "sensors"),
        ({"materials": MATERIALS | {"glass": {"type": "glazing", "transmittance": 0.5}}}, "glass"),
    ],
)
def test_variants_that_differ_in_more_are_refused(change, field):
    with pytest.raises(InputError, match=field):
        facade_basis.of_variants([room(PLAIN), room(MIXED, **change)])


def test_variants_of_one_name_and_two_materials_are_refused():
    """Also where the first case knows no such material."""
    other = MATERIALS | {"fabric": {"type": "diffuser", "transmittance": 0.9}}
    clear = [{"bottom": 0.9, "top": 1.8, "material": "glass"}]
    first = room(clear, materials={k: m for k, m in MATERIALS.items() if k != "fabric"})
    with pytest.raises(InputError, match="another material of this name"):
        facade_basis.of_variants([first, room(PLAIN), room(PLAIN, materials=other)])


def test_coloured_variants_are_refused():
    facade = {"south": {"strips": PLAIN, "frame": 0.1, "frame_reflectance": [0.5, 0.4, 0.3]}}
    with pytest.raises(InputError, match="make it grey"):
        facade_basis.of_variants([room(PLAIN[:1]), room(PLAIN, facade=facade)])


def test_frames_are_those_of_the_side_with_windows():
    facade = {
        "north": {"frame_reflectance": 0.0},
        "south": {"strips": PLAIN, "frame": 0.1, "frame_reflectance": 0.9},
    }
    _, _, palette, _ = facade_basis.of_variants([room(PLAIN, facade=facade)])
    assert palette.materials[FRAME].reflectance == 0.9


def test_windows_in_two_sides_are_refused():
    with pytest.raises(InputError, match="windows in east, south"):
        facade_basis.of_variants([room(PLAIN), room(PLAIN, "east")])


def test_windows_in_a_side_that_the_basis_does_not_hold_are_refused():
    case = room(PLAIN, facade={side: {"strips": PLAIN} for side in ("south", "west")})
    wall = facade_basis.Wall(case, "south")
    tiles, palette = facade_basis.of_grid(wall, [0.9, 2.7], 1, ("wall", "glass"))
    with pytest.raises(InputError, match="windows in west too"):
        facade_basis.compute(wall, tiles, palette, daylight(case).suns, case.accuracy)


def test_surfaces_outside_are_refused():
    outside = [{"corner": [0, -2, 0], "size": [4, 1, 3]}]
    case = room(PLAIN, furniture=outside)
    wall, tiles, palette, _ = facade_basis.of_variants([case])
    with pytest.raises(InputError, match="outside of the room"):
        facade_basis.compute(wall, tiles, palette, daylight(case).suns, case.accuracy)


def test_too_many_elements_are_refused():
    case = room(PLAIN)
    wall = facade_basis.Wall(case, "south")
    with pytest.raises(InputError, match="take fewer tiles"):
        facade_basis.of_grid(wall, np.linspace(0.5, 2.5, 200), 2, ("wall", "glass", "fabric"))


# --- what paths remember


def test_marks_of_three_meetings():
    import mitsuba as mi

    mark = mi.UInt32(0)
    for element in (5, 1000, 17):
        mark = (mark << facade.BITS) | (element + 1)
    assert [int(e[0]) for e in facade.elements(mark)] == [18, 1001, 6]


def test_paths_are_weighed_once_at_each_meeting():
    """Half the share is half the weight at each meeting; meetings follow a geometric series."""
    strips = [{"bottom": 0.0, "top": 3.0, "material": "fabric"}]
    case = room(strips)
    wall, tiles, palette, (share,) = facade_basis.of_variants([case])
    light = daylight(case)
    basis = facade_basis.compute(
        wall, tiles, palette, few(light, 2), Accuracy(paths=64), groups=1, subdivision=1
    )
    whole, half = basis.returned.weighed(share), basis.returned.weighed(0.5 * share)
    meetings = sum(((basis.returned.mark >> (10 * i)) & 1023) > 0 for i in range(3))
    assert meetings.max() == 3
    np.testing.assert_allclose(half, whole * 0.5**meetings, rtol=1e-6)
    one = whole[meetings == 1].sum()
    assert whole.sum() == pytest.approx(one / (1 - whole[meetings == 2].sum() / one), rel=0.02)


@pytest.mark.parametrize("material", ["film", "fabric", "glass"])
def test_marked_paths_weigh_what_paths_of_the_facade_itself_do(material):
    """All that reaches the sensors by diffuse surfaces, per radiosity, in rooms of one material."""
    film = {"type": "bsdf", "file": str(shipped_folder() / "films/prism.xml")}
    materials = {"materials": MATERIALS | {"film": film}}
    strips = [{"bottom": 0.5, "top": 2.7, "material": material}]
    case = room(strips, **materials)
    wall, tiles, palette, _ = facade_basis.of_variants(
        [room([strips[0] | {"material": m}], **materials) for m in ("film", "fabric", "glass")]
    )
    built, walls = simulate._room(wall, tiles, palette)
    meetings = facade.Meetings(tiles, palette)
    world = replace(walls, full=built.scene(meetings.mesh))
    share = np.zeros((len(tiles), len(palette.names)), np.float32)
    share[:, palette.names.index(material)] = 1
    points, normals = sensor_points(case)
    means = []
    for seed, (of, marks) in enumerate([(world, meetings), (scene.load(case), None)]):
        grid = CellGrid.of(of, 0.45)
        v = gather(
            of, points, normals, replicates=8, paths=1 << 13, grid=grid, seed=seed, marks=marks
        )
        weight = v.weight.numpy()
        if marks is not None:
            mark = v.mark.numpy()
            weight = Returned(mark, mark, mark, weight).weighed(share)
            assert 0.005 < weight[mark > 0].sum() / weight.sum() < 0.3
        each = np.bincount(v.row.numpy() // len(points), weight, 8)
        means.append((each.mean(), each.std(ddof=1) / np.sqrt(8)))
    (a, e), (b, f) = means
    assert abs(a - b) < 4.5 * np.hypot(e, f)
    assert np.hypot(e, f) < 0.002 * b


# --- compositions


def both(share, basis, fresh, light):
    """Mean replicates of E [lx] under the mean sky, of a basis and of a simulation."""
    ours = basis.coefficients(share)
    labels = [*Patches(1).labels, *(b for b in fresh["bin"].values if b.startswith("sun_"))]
    L = np.where(np.char.startswith(np.array(labels, str), "sun_"), 1e8, 4e3)
    return [(C["replicates"].sel(bin=labels).values * L).sum(-1) for C in (ours, fresh)]


@pytest.mark.parametrize("state", ["open", "shaded"])
def test_compositions_are_what_they_are_alone(state):
    """E in all and by sensor, of plain and mixed façades with frames; standard errors of both."""
    cases = [room(PLAIN, frame=0.08), room(MIXED, frame=0.08)]
    wall, tiles, palette, shares = facade_basis.of_variants(cases)
    light = daylight(cases[0])
    suns = few(light, 12)
    accuracy = Accuracy(paths=512, sensor_sky_rays=2048)
    basis = facade_basis.compute(wall, tiles, palette, suns, accuracy)
    for case, share in zip(cases, shares, strict=True):
        alone = coefficients.compute(
            scene.load(case, state), *sensor_points(case), suns,
            accuracy.model_copy(update={"seed": 9}),
        )  # fmt: skip
        of_state = share @ palette.closing if state == "shaded" else share
        ours, theirs = both(of_state, basis, alone, light)
        n = len(ours)
        z = (ours.mean(0) - theirs.mean(0)) / np.sqrt((ours.var(0) + theirs.var(0)) / (n - 1))
        assert np.abs(z).max() < 5.4  # Šidák over 12 sensors and 4 cases, t of 7 degrees: 0.1 %
        ours, theirs = ours.mean(1), theirs.mean(1)
        error = np.sqrt((ours.var() + theirs.var()) / (n - 1))
        assert abs(ours.mean() - theirs.mean()) < 4 * error
        assert error < 0.02 * theirs.mean()  # or the line above would say little
        for name in ("straight", "direct"):
            a, b = (C[name].sum().item() for C in (basis.coefficients(of_state), alone))
            assert a == pytest.approx(b, rel=0.02), name


def test_shade_stands_before_clear_tiles_only():
    case = room(PLAIN)
    _, _, palette, (share,) = facade_basis.of_variants([case])
    behind = share @ palette.closing
    names = palette.names
    assert (behind[:, names.index("glass")] == 0).all()
    assert (behind[:, names.index("shade")] == share[:, names.index("glass")]).all()
    assert (behind[:, names.index("fabric")] == share[:, names.index("fabric")]).all()


@pytest.fixture(scope="module")
def grid():
    backend.select()
    case = room(PLAIN)
    light = daylight(case)
    wall = facade_basis.Wall(case, "south")
    tiles, palette = facade_basis.of_grid(wall, [0.9, 1.8, 2.7], 2, ("wall", "glass", "fabric"))
    return facade_basis.compute(
        wall, tiles, palette, light.suns, Accuracy(paths=32), groups=1
    ), light


def dirichlet(seed, tiles, materials):
    share = np.zeros((tiles, materials + 1), np.float32)
    share[:, :materials] = np.random.default_rng(seed).dirichlet(np.ones(materials), tiles)
    return share


def plainly(basis, values):
    """Coefficients (group, bin, sensor) as `accumulate` takes them; unseen suns are 0."""
    labels = [*basis.labels, *(set(basis.suns) - set(basis.labels))]
    whole = np.zeros((2, values.shape[2], len(labels)), np.float32)
    whole[..., : values.shape[1]] = values[0].T
    dims = ("replicate", "sensor", "bin")
    return xr.Dataset({"replicates": (dims, whole)}, {"bin": np.array(labels, dtype=object)})


def test_a_year_is_coefficients_times_luminances(grid):
    import mitsuba as mi

    basis, light = grid
    year = facade_basis.BasisYear.of(basis, light)
    share = dirichlet(1, 4, 3)
    E = year.illuminance(mi.TensorXf(share))
    for values, of in ((E.open, share), (E.shaded, share @ basis.palette.closing)):
        plain = accumulate.by_source(plainly(basis, basis.totals(of)), light.sky)["total"].values
        np.testing.assert_allclose(values.numpy(), plain, rtol=2e-4, atol=1e-3)
    straight = np.einsum("e,egbs->gbs", share.ravel()[basis.straight_elements], basis.straight)
    direct = accumulate.by_source(plainly(basis, straight), light.sky)["sun"].values
    np.testing.assert_allclose(E.direct.numpy(), direct, rtol=2e-4, atol=1e-3)
    assert direct.max() > 1000


def test_gradients_of_a_year_are_its_differences(grid):
    import mitsuba as mi

    basis, light = grid
    year = facade_basis.BasisYear.of(basis, light)
    share, step = dirichlet(2, 4, 3), 0.02
    weights = [mi.TensorXf(np.random.default_rng(i).random((len(year.months), 12))) for i in (1, 2)]

    def value(share, glass):
        E = year.illuminance(share, scale={"glass": glass})
        both = E.open * weights[0] + E.shaded * weights[1] + E.direct
        return dr.mean((both / 1000).array)

    x, tau = mi.TensorXf(share), mi.Float(0.9)
    dr.enable_grad(x, tau)
    dr.backward(value(x, tau))
    gradient, of_tau = dr.grad(x).numpy(), dr.grad(tau).numpy()[0]
    assert np.isfinite(gradient).all()

    def at(change, glass=0.9):
        y = value(mi.TensorXf((share + change).astype(np.float32)), mi.Float(glass))
        return float(y.numpy().ravel()[0])

    for tile in range(4):
        for material in range(4):
            h = np.zeros_like(share)
            h[tile, material] = step
            slope = (at(h) - at(-h)) / (2 * step)
            scale = float(np.abs(gradient).max())
            assert gradient[tile, material] == pytest.approx(slope, rel=0.02, abs=2e-3 * scale)
    assert of_tau == pytest.approx((at(0, 0.92) - at(0, 0.88)) / 0.04, rel=0.02)
    # Forward: one direction through all of the composition.
    h = np.random.default_rng(3).normal(size=share.shape).astype(np.float32)
    x = mi.TensorXf(share)
    dr.enable_grad(x)
    dr.set_grad(x, mi.TensorXf(h))
    forward = float(dr.forward_to(value(x, mi.Float(0.9))).numpy().ravel()[0])
    assert forward == pytest.approx(float((gradient * h).sum()), rel=1e-3)


def test_all_wall_is_dark_and_finite(grid):
    import mitsuba as mi

    basis, light = grid
    year = facade_basis.BasisYear.of(basis, light)
    share = np.zeros((4, 4), np.float32)
    share[:, 0] = 1
    x = mi.TensorXf(share)
    dr.enable_grad(x)
    E = year.illuminance(x)
    assert E.open.numpy().max() == 0
    dr.backward(dr.sum(E.open.array))
    gradient = dr.grad(x).numpy()
    assert np.isfinite(gradient).all()
    assert (gradient[:, 1] > 0).all()


def test_a_year_refuses_another_sky(grid):
    basis, _ = grid
    with pytest.raises(InputError, match="subdivision of this sky"):
        facade_basis.BasisYear.of(basis, daylight(room(PLAIN, sky={"subdivision": 2})))


@pytest.mark.parametrize("changes", [{"sun": {"model": "three_phase"}}, {"side": "north"}])
def test_no_sun_at_all(changes):
    """Patches stand for the sun, or the façade never sees it."""
    import mitsuba as mi

    case = room(PLAIN, **changes)
    light = daylight(case)
    wall, tiles, palette, (share,) = facade_basis.of_variants([case])
    basis = facade_basis.compute(wall, tiles, palette, light.suns, Accuracy(paths=16))
    E = facade_basis.BasisYear.of(basis, light).illuminance(mi.TensorXf(share))
    assert (E.open.numpy() > 0).all()
    assert (E.direct.numpy().max() == 0) == ("side" in changes)  # patches are seen straight
    plain = accumulate.by_source(basis.coefficients(share), light.sky)["total"].values
    np.testing.assert_allclose(E.open.numpy(), plain, rtol=0.02)  # mean of products, and product


def test_a_year_refuses_other_suns(grid):
    basis, _ = grid
    other = room(PLAIN, period={"months": [4], "hours": [9, 15]})
    with pytest.raises(InputError, match="compute the basis for this sky"):
        facade_basis.BasisYear.of(basis, daylight(other))
