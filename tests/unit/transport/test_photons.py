"""Photons against exact answers, and with every other kind of light against plain path tracing."""

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins.patches import Patches, patch_index
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import (
    DielectricMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Lambertian,
    MirrorMaterial,
)
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene import scene as scenes
from drcmitsuba.scene.geometry import Port, Surface
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.scene.surfaces import surfaces_of
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.cells.cells import CellGrid
from drcmitsuba.transport.coefficients import compute
from drcmitsuba.transport.mirrors import planar_mirrors
from drcmitsuba.transport.photons.light import Landed
from drcmitsuba.transport.photons.ports import of_sky
from drcmitsuba.transport.photons.receivers import CellAreas, Squares
from drcmitsuba.transport.photons.tracer import PhotonTracer, of_patch
from tests import ROOT


@pytest.fixture(autouse=True)
def _mirrors_are_left_to_photons(monkeypatch):
    """Take plain mirrors for bodies of many faces, which have no exact images."""
    monkeypatch.setattr(planar_mirrors, "MOST_OF_BODY", 0)


FILM = ROOT / "scenes" / "films" / "prism.xml"
OPAL = DiffuserMaterial(type="diffuser", transmittance=0.4)
X, Y, Z = np.eye(3)
DIRECTIONS = np.array([[0, -0.8, 0.6], [0.48, -0.64, 0.6], [0, -0.28, 0.96], [0, 0.8, 0.6]])
WIDE = Suns(tuple(f"sun_{i}" for i in range(4)), DIRECTIONS, 30.0)
"""Suns that a path tracer without emitter sampling finds."""


def quad(corner, u, v):
    """Quadrilateral with its front towards u × v."""
    c, u, v = (np.asarray(a, float) for a in (corner, u, v))
    return np.array([c, c + u, c + u + v, c + v])


def box(low, high, fronts=1):
    """Six faces, fronts outward, or inward with −1."""
    low, (x, y, z) = np.asarray(low, float), np.diag(np.subtract(high, low))
    faces = [quad(low, y, x), quad(low, x, z), quad(low, z, y)]
    faces += [quad(low + z, x, y), quad(low + y, z, x), quad(low + x, y, z)]
    return np.array(faces)[:, ::fronts]


def mirror(reflectance, **more):
    return MirrorMaterial(type="mirror", reflectance=reflectance, **more)


def box_ports(name, low, high):
    """Ports on all sides of a box, 1 mm off."""
    low, high = np.subtract(low, 1e-3), np.add(high, 1e-3)
    return tuple(Port(name, face) for face in box(low, high, -1))


ROOM = {
    "room": {"size": [4.0, 4.0, 3.0], "floor": 0.3, "walls": 0.5, "ceiling": 0.7},
    "facade": {
        "south": {
            "segments": 4,
            "strips": [
                {"bottom": 0.9, "top": 1.5, "material": "glass"},
                {"bottom": 1.6, "top": 2.1, "material": "film"},
                {"bottom": 2.3, "top": 2.8, "material": "open", "segments": [1]},
            ],
        }
    },
    "materials": {
        "glass": {"type": "glazing", "transmittance": 0.7, "reflectance": 0.1},
        "film": {"type": "bsdf", "file": str(FILM)},
    },
    "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 3], "spacing": 1.0},
}


def mirror_duct():
    """A mirror tube of 1.2 m behind the hole in the façade."""
    low, high = [1.0, 0.0, 2.3], [2.0, 1.2, 2.8]
    x, y, z = np.diag(np.subtract(high, low))
    faces = [
        quad(low, x, y), quad(low + z, x, y), quad(low, y, z), quad(low + x, y, z),
    ]  # fmt: skip
    return Surface("duct", mirror(0.9), np.array(faces), "duct"), box_ports("duct", low, high)


def sources(scene, directions, diameter):
    """The surfaces of a scene under sky and suns, for `coefficient`."""
    world = {f"s{i}": shape for i, shape in enumerate(scene.full.shapes())}
    suns = mi.TensorXf(directions.astype(np.float32))
    world["suns"] = {"type": "sun_disks", "directions": suns, "diameter": diameter}
    return mi.load_dict({"type": "scene", **world, "sky": {"type": "tregenza_sky"}}, optimize=False)


@pytest.mark.slow
def test_glass_film_and_mirror_duct_are_counted_once(same, plain_coefficients):
    case = Case.model_validate(ROOM)
    duct, ports = mirror_duct()
    scene = scenes.build([*surfaces_of(case), duct], ports=ports)
    points, normals = sensor_points(case)
    accuracy = Accuracy(
        replicates=16, paths=512, cell_size=0.3, sensor_sky_rays=4096, photons=1 << 11,
        sensor_square=0.15, sensor_sun_samples=64, pane_points=128,
    )  # fmt: skip
    here = compute(scene, points, normals, WIDE, accuracy)
    there = plain_coefficients(
        sources(scene, DIRECTIONS, WIDE.diameter), points, normals, spp=1 << 12
    ).sum(axis=0)
    C = here["replicates"].values
    # Light by each of the three, and not in their place: none is small.
    same(C[..., :146], other=there[..., :146], within=0.025)
    same(C[..., 146:], other=there[..., 146:], within=0.04)


# ---- receivers --------------------------------------------------------------------------------


@pytest.mark.parametrize("subdivision", [1, 2, 3, 6])
def test_parts_of_the_ground_and_patches_are_drawn_within_their_bins(subdivision):
    sources, patches = of_sky(subdivision), Patches(subdivision)
    count, each = len(sources.bins), 256
    assert len(np.unique(sources.numbers)) == count
    whole = np.bincount(sources.bins, sources.solid_angle, len(patches))
    np.testing.assert_allclose(whole, patches.solid_angles, rtol=1e-9)
    source = np.repeat(np.arange(count), each)
    uv = np.random.default_rng(4).random((2, len(source))) * (1 - 2e-4) + 1e-4
    d = sources.draw(mi.UInt32(source), mi.Point2f(uv))
    np.testing.assert_array_equal(patch_index(d, subdivision).numpy(), sources.bins[source])
    cosine = (d.numpy() * sources.centre[source].T).sum(axis=0)
    assert (np.arccos(np.clip(cosine, -1, 1)) <= sources.radius[source] + 1e-3).all()
    ground = d.numpy()[:, sources.bins[source] == 0]
    np.testing.assert_allclose(ground.mean(axis=1), [0, 0, -0.5], atol=0.02)


def test_areas_of_cells_are_those_of_what_light_can_reach():
    room, body = box([0, 0, 0], [4, 3, 2], -1), box([1, 1, 0.5], [2, 2, 1.0])
    surfaces = [
        Surface("room", Lambertian(0.5), room),
        Surface("body", Lambertian(0.5), body, closed=True),
    ]
    scene = scenes.build(surfaces)
    areas = CellAreas.of(scene, CellGrid.of(scene, 0.3), seed=1)
    # Both sides of the room's surfaces, which might be seen from outside, and the body's outside.
    assert dr.sum(areas.area)[0] == pytest.approx(2 * 52 + 4, rel=1e-4)
    top = areas.grid.key(mi.Point3f(1.5, 1.5, 1.0), mi.Normal3f(0, 0, 1))
    under = areas.grid.key(mi.Point3f(1.5, 1.5, 1.0), mi.Normal3f(0, 0, -1))
    assert areas.at(top)[1][0]
    assert not areas.at(under)[1][0]


def test_area_of_a_whole_face_of_a_cell():
    scene = scenes.build([Surface("floor", Lambertian(0.5), quad([0, 0, 0], 9 * X, 9 * Y)[None])])
    areas = CellAreas.of(scene, CellGrid.of(scene, 1.0), seed=2)
    middle = areas.grid.key(mi.Point3f(4.6, 4.6, 0), mi.Normal3f(0, 0, 1))
    assert areas.area[areas.at(middle)[0][0]] == pytest.approx(1.0, rel=0.005)


def test_squares_reach_neither_beyond_walls_nor_to_a_neighbours_centre():
    case = Case.model_validate({**ROOM, "materials": {}, "facade": {}})
    points = np.array([[0.05, 2, 0.8], [1, 1, 0.8], [1.2, 1, 0.8], [3, 3, 0.8], [3, 3, 1.2]])
    squares = Squares.of(scenes.load(case), points, np.tile(Z, (5, 1)), 0.3)
    np.testing.assert_allclose(squares.edge, [0.1, 0.2, 0.2, 0.3, 0.3], rtol=1e-6)
    assert len(squares.planes) == 2


def test_squares_round_one_place_keep_their_size():
    """Sensors of one place with other normals are no neighbours, nor is a sensor named twice."""
    case = Case.model_validate({**ROOM, "materials": {}, "facade": {}})
    points = np.tile([2.0, 2.0, 1.2], (5, 1))
    normals = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, 0, 1], [0, 0, 1]])
    squares = Squares.of(scenes.load(case), points, normals, 0.3)
    np.testing.assert_allclose(squares.edge, 0.3, atol=1e-9)
    assert sorted(len(plane.sensors) for plane in squares.planes) == [1, 1, 1, 2]


# ---- photons ----------------------------------------------------------------------------------

STEEP = np.array([[0.0, 0.0, 1.0]])


def traced(surfaces, ports, suns=STEEP, *, count=1 << 16, surfaces_followed=256, sensors=None,
           diameter=0.5, subdivision=None, square=0.3):  # fmt: skip
    """One replicate of photons, and the flux that landed on cells by bin (sky, sun)."""
    scene = scenes.build(surfaces, ports=ports)
    points = np.zeros((1, 3)) + 50 if sensors is None else np.asarray(sensors, float)
    accuracy = Accuracy(
        photons=count, cell_size=1.0, sensor_square=square, photon_surfaces=surfaces_followed
    )
    photons = PhotonTracer.of(
        scene, points, np.tile(Z, (len(points), 1)), suns, diameter, subdivision, accuracy
    )
    landed = photons.traced(1)
    area = landed.areas.area.numpy()[:, None]
    return landed, landed.cells.sun.numpy() * area, landed.cells.sky.numpy() * area


FLOOR = Surface("floor", Lambertian(0.5), quad([-20, -20, -1], 40 * X, 40 * Y)[None])


def tilted(z, angle, half=0.5):
    """Square mirror about (0, 0, z), turned by `angle` [deg] about x."""
    s, c = np.sin(np.radians(angle)), np.cos(np.radians(angle))
    v = 2 * half * np.array([0, c, s])
    return quad(np.array([-half, 0, z]) - v / 2, 2 * half * X, v)


def glass_block(absorption=0.0, ior=1.5, size=1.0, thickness=0.2, roughness=0.0):
    solid = DielectricMaterial(
        type="dielectric", ior=ior, absorption=absorption, roughness=roughness
    )
    low, high = [-size / 2, -size / 2, 0], [size / 2, size / 2, thickness]
    return Surface("block", solid, box(low, high), "block"), box_ports("block", low, high)


CHAINS = {
    "absorbing block": lambda: glass_block(absorption=3.0),
    "rough block": lambda: glass_block(roughness=0.2),
    "rough mirror": lambda: (
        Surface("m", mirror(0.8, roughness=0.3), tilted(1, 30)[None], "m"),
        box_ports("m", [-0.5, -0.5, 0.7], [0.5, 0.5, 1.3])),
    "mirror that is matt in part": lambda: (
        Surface("m", mirror(0.8, specular=0.6), tilted(1, 30)[None], "m"),
        box_ports("m", [-0.5, -0.5, 0.7], [0.5, 0.5, 1.3])),
    "coated mirror": lambda: (
        Surface("m", mirror(0.8, coating=1.5), tilted(1, 30)[None], "m"),
        box_ports("m", [-0.5, -0.5, 0.7], [0.5, 0.5, 1.3])),
}  # fmt: skip


@pytest.mark.parametrize("name", CHAINS)
def test_all_flux_is_accounted_for(name):
    component, ports = CHAINS[name]()
    landed, _, _ = traced([component, FLOOR], ports, subdivision=1, count=1 << 12)
    assert len(landed.ledgers) == 2
    for ledger in landed.ledgers.values():
        fates = ledger.landed + ledger.absorbed + ledger.escaped + ledger.others + ledger.lost
        assert ledger.emitted > 0
        assert fates == pytest.approx(ledger.emitted + ledger.roulette, rel=1e-6)
        assert fates == pytest.approx(ledger.emitted, rel=2e-3 if "rough" in name else 1e-3)


def test_photons_fly_together_as_each_component_alone():
    """One launch has the photons of all components, each of which has its own seed."""
    block = box([-0.5, -0.5, 0], [0.5, 0.5, 0.2])
    slope = tilted(1, 30)
    leaf = slope[None, [0, 1, 2, 2]]
    glass = DielectricMaterial(type="dielectric", ior=1.5)
    parts = [
        Surface("leaf", mirror(0.8, roughness=0.3), leaf + [3, 0, 0], "leaf"),
        Surface("slope", mirror(0.9), slope[None] - [3, 0, 0], "slope"),
        Surface("block", glass, block, "block"), FLOOR,
    ]  # fmt: skip
    ports = (
        Port("leaf", slope[[2, 1, 0, 0]] + [3, 0, 0.01]),
        *box_ports("slope", [-3.5, -0.5, 0.7], [-2.5, 0.5, 1.3]),
        *box_ports("block", [-0.5, -0.5, 0], [0.5, 0.5, 0.2]),
    )
    scene = scenes.build(parts, ports=ports)
    sensors = np.array([[3.0, 0, 0], [-3, 0, 0], [0, 0, -0.5]])
    up = np.tile(Z, (3, 1))
    together = PhotonTracer.of(
        scene, sensors, up, STEEP, 0.5, 1, Accuracy(photons=256, cell_size=1.0), imaged=True
    )
    assert len(together.ports) == 3
    every = together.traced(5)
    alone = [
        replace(together, ports=(one,)).traced(5 + PhotonTracer.APART * i)
        for i, one in enumerate(together.ports)
    ]
    for kind in ("sky", "sun"):
        for light in (Landed.sensors, lambda landed: landed.cells):
            whole = getattr(light(every), kind).numpy()
            parts_of = sum(getattr(light(one), kind).numpy().astype(float) for one in alone)
            assert whole.sum() > 0
            np.testing.assert_allclose(whole, parts_of, rtol=1e-5, atol=1e-9)
        for one, ports_of in zip(alone, together.ports, strict=True):
            name = f"{ports_of.name} {kind}"
            assert one.ledgers[name].emitted > 0
            assert every.ledgers[name] == one.ledgers[name]


def test_patches_of_finer_skies_share_photons():
    """Pictures with MF 4 took thirteen times the photons of MF 1."""
    assert [of_patch(1024, mf) for mf in (1, 2, 4, 6)] == [4096, 1024, 256, 256]
    usual, finer = (len(of_sky(mf).bins) * of_patch(1024, mf) for mf in (1, 4))
    assert finer == pytest.approx(usual, rel=0.01)


def test_light_under_way_after_the_last_surface_counts_as_lost():
    walls = [quad([0, 0, 0], X, 40 * Z), quad([0, 1, 0], X, 40 * Z),
             quad([0, 0, 0], Y, 40 * Z), quad([1, 0, 0], Y, 40 * Z)]  # fmt: skip
    pipe = Surface("pipe", mirror(0.99), np.array(walls), "pipe")
    port = Port("pipe", quad([0, 0, 40], Y, X))
    sun = np.array([[np.sin(np.radians(60)), 0, np.cos(np.radians(60))]])
    shares = []
    for limit in (8, 256):
        landed, _, _ = traced([pipe, FLOOR], (port,), sun, surfaces_followed=limit, count=1 << 12)
        ledger = landed.ledgers["pipe sun"]
        shares.append(ledger.lost / ledger.emitted)
    # 40 tan 60° = 69.3 reflections: eight of them leave 0.99⁸ of the light on its way.
    assert shares[0] == pytest.approx(0.99**8, rel=1e-3)
    assert shares[1] == 0


def test_light_that_two_components_deviate_is_counted_once():
    # A mirror sends the sun to a second one, which sends it down to the floor.
    first, second = tilted(2, 45), tilted(2, 45) - [0, 3.0, 0]
    down = np.array([[0.0, 0.0, 1.0]])
    parts = [
        Surface("a", mirror(0.9), first[None], "a"),
        Surface("b", mirror(0.8), second[None], "b"),
    ]
    boxes = [(f.reshape(-1, 3).min(axis=0), f.reshape(-1, 3).max(axis=0)) for f in (first, second)]
    ports = (*box_ports("a", *boxes[0]), *box_ports("b", *boxes[1]))
    _, apart, _ = traced([*parts, FLOOR], ports, down)
    low, high = np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)
    joined = [Surface(s.name, s.material, s.quads, "both") for s in parts]
    _, together, _ = traced([*joined, FLOOR], box_ports("both", low, high), down)
    assert apart.sum() > 0
    assert apart.sum() == pytest.approx(together.sum(), rel=5e-3)


def test_a_sun_in_a_mirror_counts_as_straight_and_sunlight_by_a_rough_one_is_not():
    sensors = [[0, 1.5, 0.0]]
    sun = np.array([[0, -np.cos(np.radians(70)), np.sin(np.radians(70))]])
    towards = np.array([0, 1.5, -1.0])
    towards /= np.linalg.norm(towards)
    half = sun[0] + towards
    angle = np.degrees(np.arctan2(half[2], half[1]))
    component = tilted(1.0, angle - 90)
    deposits = []
    for roughness in (0.0, 0.1):
        material = mirror(0.9, roughness=roughness)
        low, high = component.min(axis=0), component.max(axis=0)
        landed, _, _ = traced(
            [Surface("m", material, component[None], "m"), FLOOR],
            box_ports("m", low - 0.01, high + 0.01), sun, sensors=sensors, count=1 << 18,
        )  # fmt: skip
        deposits.append([one.sun.numpy()[0, 0] for one in (landed.sensors(), landed.mirrored())])
    omega = disk_solid_angle(0.5)
    assert deposits[0][1] == deposits[0][0]
    assert deposits[0][0] == pytest.approx(0.9 * omega * -towards[2], rel=0.02)
    assert deposits[1][0] > 0
    assert deposits[1][1] == 0


@pytest.mark.slow
def test_stored_photons_of_the_plugin_agree(same):
    """The second route: photons of `photon_map`, followed through all diffuse reflections."""
    duct, _ = mirror_duct()
    hole = {"bottom": 2.3, "top": 2.8, "material": "open", "segments": [1]}
    facade = {"south": {"segments": 4, "strips": [hole]}}
    case = Case.model_validate({**ROOM, "materials": {}, "facade": facade})
    inlet = Port("duct", quad([1.0, 0, 2.3], 0.5 * Z, X))
    scene = scenes.build([*surfaces_of(case), duct], ports=(inlet,))
    points, normals = sensor_points(case)
    accuracy = Accuracy(
        replicates=12, paths=1024, cell_size=0.3, sensor_sky_rays=4096, photons=1 << 12,
        sensor_square=0.26, sensor_sun_samples=64,
    )  # fmt: skip
    here = compute(scene, points, normals, WIDE, accuracy)["replicates"].values
    plugin = mi.load_dict(
        {
            "type": "photon_map",
            "radius": 0.26 / np.sqrt(np.pi),  # as much area as the squares
            "kernel": "constant",
            "ports": mi.TensorXf(inlet.quad[None].astype(np.float32)),
        }
    )
    world = sources(scene, DIRECTIONS, WIDE.diameter)
    there = [plugin.sensors(world, points, normals, 1 << 20, seed).numpy() for seed in range(8)]
    there = np.sum(there, axis=1)
    same(here[..., :146], other=there[..., :146], within=0.02)
    same(here[..., 146:], other=there[..., 146:], within=0.02)


# ---- in rooms ---------------------------------------------------------------------------------

OPEN = {
    **ROOM,
    "facade": {"south": {"strips": [{"bottom": 0.9, "top": 2.5, "material": "open"}]}},
    "materials": {},
}
ACCURACY = Accuracy(
    replicates=8, paths=1024, photons=1 << 12, sensor_sky_rays=4096, cell_size=0.15,
    sensor_sun_samples=64,
)  # fmt: skip


LOW, HIGH = [0.05, 3.5, 0.1], [3.95, 3.9, 2.8]


def beside(material, component="part"):
    """Sensors of a room with a block before its back wall, and the scene."""
    case = Case.model_validate(OPEN)
    part = Surface("part", material, box(LOW, HIGH), component, closed=True)
    ports = box_ports("part", LOW, HIGH) if component else ()
    return scenes.build([*surfaces_of(case), part], ports=ports), sensor_points(case)


@pytest.mark.slow
def test_a_block_that_mirrors_a_part(same, plain_coefficients):
    scene, sensors = beside(mirror(0.9, specular=0.5))
    here = compute(scene, *sensors, WIDE, ACCURACY)["replicates"].values
    world = sources(scene, DIRECTIONS, WIDE.diameter)
    there = plain_coefficients(world, *sensors, spp=1 << 12).sum(axis=0)
    same(here[..., :146], other=there[..., :146], within=0.02)
    same(here[..., 146:], other=there[..., 146:], within=0.02)


def test_a_block_that_swallows_what_enters_it():
    """It reflects next to nothing, and exp(−30 · 0.4) of the light gets through: it looks black."""
    clear = DielectricMaterial(type="dielectric", ior=1.05, absorption=30.0)
    totals = []
    for scene, sensors in (beside(clear), beside(Lambertian(0.0), component="")):
        C = compute(scene, *sensors, WIDE, ACCURACY)["replicates"].values
        totals.append([C[..., part].sum() for part in (np.s_[:146], np.s_[146:])])
    assert totals[0] == pytest.approx(totals[1], rel=0.02)


def test_light_that_passes_two_ports_of_a_component_is_counted_once():
    """Two panes of mirrors, one behind the other: as one component, and as two."""
    low = [([-0.5, 0, 0], [0.5, 0.1, 1]), ([-0.5, 2, 0], [0.5, 2.1, 1])]
    slats = [
        np.array([quad([-0.5, y, z], X, 0.1 * Y + 0.05 * Z) for z in np.arange(0, 0.95, 0.1)])
        for y in (0.0, 2.0)
    ]
    sun = np.array([[0.02, -1, 0.1]]) / np.linalg.norm([0.02, -1, 0.1])
    sums = []
    for names in (("a", "b"), ("a", "a")):
        parts = [Surface(n, mirror(0.9), quads, n) for n, quads in zip(names, slats, strict=True)]
        ports = tuple(
            Port(n, quad(corners[0], Z, X)) for n, corners in zip(names, low, strict=True)
        )
        _, flux, _ = traced([*parts, FLOOR], ports, sun, count=1 << 17)
        sums.append(flux.sum())
    assert sums[0] > 0
    assert sums[1] == pytest.approx(sums[0], rel=0.01)


def test_a_plate_that_shares_its_name_with_a_box_is_no_body():
    pieces = [
        {"corner": [0, 0, 0.7], "size": [1.0, 1.0, 0.0]},
        {"corner": [2.0, 2.0, 0.0], "size": [1.0, 1.0, 0.5]},
    ]
    case = Case.model_validate({**OPEN, "furniture": pieces})
    assert [s.closed for s in surfaces_of(case) if s.name == "furniture"] == [False, True]


def test_squares_stop_at_furniture():
    cabinet = {"corner": [1.03, 0.5, 0.0], "size": [1.0, 1.0, 1.2]}
    case = Case.model_validate({**OPEN, "furniture": [cabinet]})
    points = np.array([[1.0, 1.0, 0.8], [0.5, 1.0, 0.8]])
    squares = Squares.of(scenes.load(case), points, np.tile(Z, (2, 1)), 0.3)
    np.testing.assert_allclose(squares.edge, [0.06, 0.3], atol=1e-4)


def test_a_component_behind_a_closed_shade(tmp_path):
    (tmp_path / "shelf.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 1 0.5 0.5\nv 0 0.5 0.5\nf 1 2 3\nf 1 3 4\n"
    )
    shelf = {"type": "mesh", "file": str(tmp_path / "shelf.obj"), "material": "silver"}
    case = Case.model_validate(
        {
            **OPEN,
            "components": {"shelf": {**shelf, "position": [1.0, 1.0, 2.0]}},
            "materials": {
                "silver": {"type": "mirror", "reflectance": 0.9},
                "cloth": {"type": "diffuser", "transmittance": 0.1},
            },
            "shading": {"material": "cloth"},
        }
    )
    points, normals = sensor_points(case)
    rough = ACCURACY.model_copy(update={"replicates": 2, "photons": 256, "paths": 64})
    is_open, shaded = (
        compute(scenes.load(case, state), points, normals, WIDE, rough)["replicates"].values
        for state in ("open", "shaded")
    )
    assert 0 < shaded.sum() < is_open.sum()


def test_a_component_that_no_light_gets_to_is_refused():
    boxed = Surface("box", Lambertian(0.5), box([-1, -1, 0], [1, 1, 2]))
    part = Surface("part", mirror(0.9), tilted(1, 30)[None], "part")
    ports = box_ports("part", [-0.5, -0.5, 0.7], [0.5, 0.5, 1.3])
    with pytest.raises(InputError, match=r"components\.part: neither sky nor ground"):
        traced([boxed, part], ports)


def test_photons_without_sensors_light_cells():
    part = Surface("part", mirror(0.9), tilted(1, 60)[None], "part")
    ports = box_ports("part", [-0.5, -0.5, 0.7], [0.5, 0.5, 1.3])
    landed, by_sun, _ = traced([part, FLOOR], ports, sensors=np.zeros((0, 3)), count=1 << 10)
    assert by_sun.sum() > 0
    assert landed.sensors().sun.shape == (0, 1)
    assert landed.smear.shape == (2, 0)


def test_what_mirrors_send_to_a_diffusing_pane_counts_there(monkeypatch):
    """Photons of pictures count the sky in mirrors, not what it sends on by a shade behind them."""
    monkeypatch.undo()  # mirrors have exact images
    backend.select()
    wall = Surface("m", mirror(0.9), quad([-2, -1, 0], 3 * Z, 8 * X)[None], "m")
    floor = Surface("floor", Lambertian(0.5), quad([0, 0.1, 0], 4 * X, 4 * Y)[None])
    room = Surface(
        "room", Lambertian(0.0), box([-3, 0, -1], [7, 5, 4], fronts=-1)[[0, *range(2, 6)]]
    )
    ports = (Port("m", quad([-2, -0.99, 0], 8 * X, 3 * Z)),)
    window = quad([-3, 0, -1], 10 * X, 5 * Z)[None]
    light = []
    for pane in (GlazingMaterial(type="glazing", transmittance=0.7), OPAL):
        scene = scenes.build([wall, floor, room, Surface("pane", pane, window)], ports=ports)
        none, accuracy = np.zeros((0, 3)), Accuracy(photons=1 << 12)
        tracer = PhotonTracer.of(scene, none, none, none, 0.5, 1, accuracy, imaged=True)
        light.append(tracer.traced(3).cells.sky.numpy().sum())
    assert light[0] > 1
    assert light[1] < 1e-3 * light[0]  # of two mirrors in turn


def test_a_mirror_alone_lets_everything_escape():
    part = Surface("part", mirror(1.0), tilted(1, 30)[None], "part")
    ports = box_ports("part", [-0.5, -0.5, 0.7], [0.5, 0.5, 1.3])
    landed, _, _ = traced([part], ports, subdivision=1, count=64)
    assert landed.ledgers
    for ledger in landed.ledgers.values():
        assert ledger.escaped == pytest.approx(ledger.emitted, rel=1e-6)
