"""Structures in strips of a façade: where layers lie, what is closed, how light leaves."""

from collections import Counter

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba import plan
from drcmitsuba.case.reading import load_case
from drcmitsuba.case.shipped import shipped_cases, shipped_folder, shipped_recipes
from drcmitsuba.goniophotometer.trace import follow, prepare
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene import components, scene
from drcmitsuba.scene.components.placed_component import ray_offset
from drcmitsuba.scene.geometry import normals
from drcmitsuba.scene.materials import bsdf
from drcmitsuba.scene.mitsuba_scenes import mitsuba_scene
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.scene.structures import unit_cell
from drcmitsuba.scene.structures.recipe import load_recipe
from drcmitsuba.scene.structures.solid import check_solid
from drcmitsuba.sky.daylight import daylight
from tests.unit.scene.component_cases import (
    PRISM,
    SLATS,
    area,
    only,
    part,
    surface_of,
    with_strip,
)


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def test_as_many_slats_as_fit_are_centred_in_their_pane(tmp_path):
    panel = with_strip(tmp_path, SLATS)
    placed = only(components.place(panel))
    slats = part(placed, "structure").quads
    facets = 60  # 30° in steps of half a degree
    z = slats.reshape(2, -1, facets, 4, 3)[..., 2]  # segment, slat
    assert z.shape[1] == 22  # 0.9 m by 40 mm
    middles = (z.min(axis=(2, 3)) + z.max(axis=(2, 3))) / 2
    np.testing.assert_allclose(np.diff(middles), 0.04, atol=1e-9)
    np.testing.assert_allclose(middles.mean(axis=1), 1.5, atol=1e-9)
    x = slats.reshape(2, -1, 3)[..., 0]
    np.testing.assert_allclose(x.min(axis=1), [0.05, 2.05], atol=1e-9)
    np.testing.assert_allclose(x.max(axis=1), [1.95, 3.95], atol=1e-9)


def test_slats_that_reach_beyond_their_period_stay_in_the_pane(tmp_path):
    steep = with_strip(tmp_path, SLATS, tilt=80.0, strip=(1.0, 1.9))
    slats = part(only(components.place(steep)), "structure").quads[..., 2]
    assert slats.min() >= 1.05 - 1e-9
    assert slats.max() <= 1.85 + 1e-9


@pytest.mark.parametrize("tilt", [-20.0, 0.0, 35.0])
def test_tilt_lifts_the_edge_at_the_room(tmp_path, tilt):
    placed = only(components.place(with_strip(tmp_path, SLATS, tilt=tilt)))
    slat = part(placed, "structure").quads[:60].reshape(-1, 3)  # south: y grows into the room
    outer, inner = slat[slat[:, 1].argmin()], slat[slat[:, 1].argmax()]
    angle = np.degrees(np.arctan2(inner[2] - outer[2], inner[1] - outer[1]))
    # The arc's ends are its extremes as long as it turns less than the tilt leaves to 90°.
    assert angle == pytest.approx(tilt, abs=1e-6)


@pytest.mark.parametrize("side", ["south", "east", "north", "west"])
@pytest.mark.parametrize("text", [SLATS, PRISM])
def test_layers_lie_in_order_outside_of_the_facade(tmp_path, side, text):
    panel = with_strip(tmp_path, text, side=side, inner="glass", outer="glass", gap=0.006)
    placed = only(components.place(panel))
    out = {"south": [0, -1, 0], "north": [0, 1, 0], "east": [1, 0, 0], "west": [-1, 0, 0]}[side]
    from_plane = {"north": 5.0, "east": 4.0}.get(side, 0.0)
    depth = {
        key: np.unique((part(placed, key).quads @ np.array(out, float) - from_plane).round(9))
        for key in ("inner", "structure", "outer", "casing")
    }
    np.testing.assert_allclose(depth["inner"], [0.006], atol=1e-9)
    clear = text == PRISM
    assert depth["structure"].min() == pytest.approx(0.018 if clear else 0.012)
    np.testing.assert_allclose(depth["outer"], depth["structure"].max() + 0.006, atol=1e-9)
    assert depth["casing"].max() == pytest.approx(depth["outer"][0] + 0.006)
    towards_room = -np.array(out, float)
    for key in ("inner", "outer"):
        np.testing.assert_allclose(normals(part(placed, key).quads) @ towards_room, 1)
    first, second = placed.ports[:2]
    np.testing.assert_allclose(normals(first.quad[None])[0], towards_room, atol=1e-12)
    np.testing.assert_allclose(normals(second.quad[None])[0], out, atol=1e-12)
    assert (first.quad @ out - from_plane).max() == pytest.approx(depth["casing"].max())
    np.testing.assert_allclose(second.quad @ out - from_plane, 0, atol=1e-12)


def test_a_casing_closes_a_component_from_mouth_to_mouth(tmp_path):
    """Casing and both ports are a closed box; with blanks and frame they fill the façade."""
    panel = with_strip(tmp_path, SLATS)
    placed = only(components.place(panel))
    outer, inner = (np.array([p.quad for p in placed.ports])[i::2] for i in (0, 1))
    casing = part(placed, "casing").quads
    depth = abs(normals(casing)[:, 1])  # blanks lie in the façade plane
    tubes, blanks = casing[depth < 0.5], casing[depth > 0.5]
    for i in range(2):
        box = np.concatenate([tubes[4 * i : 4 * i + 4], outer[i][None], inner[i][None]])
        _, faces = surface_of(box)
        edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2))
        assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    assert area(blanks) + area(inner) == pytest.approx(2 * 1.9 * 0.9)


def test_no_straight_light_slips_past_a_clear_block(tmp_path):
    """Seen from outside in a line, the ledge covers the slit between the block and its casing."""
    placed = only(components.place(with_strip(tmp_path, PRISM, inner="glass")))
    ledge = part(placed, "casing").quads
    at_ledge = np.isclose(ledge[..., 1], -0.010).all(axis=1)
    block_quads = part(placed, "structure").quads
    mouth = placed.ports[0].quad
    rng = np.random.default_rng(1)
    low, high = mouth.min(axis=0), mouth.max(axis=0)
    p = rng.uniform(low, high, (4000, 3))[:, [0, 2]]
    first = block_quads.reshape(-1, 3)[block_quads.reshape(-1, 3)[:, 0] < 2]
    covered = ((p > first.min(axis=0)[[0, 2]]) & (p < first.max(axis=0)[[0, 2]])).all(axis=1)
    for q in ledge[at_ledge]:
        a, b = q.min(axis=0)[[0, 2]], q.max(axis=0)[[0, 2]]
        covered |= ((p > a) & (p < b)).all(axis=1)
    assert covered.all()


def test_a_recipes_own_glass_is_the_outer_pane(tmp_path):
    glass = "[glass]\ntransmittance = 0.7\nreflectance = 0.1\ndistance = 8\n"
    placed = only(components.place(with_strip(tmp_path, PRISM + glass)))
    outer = part(placed, "outer")
    assert (outer.material.transmittance, outer.material.reflectance) == (0.7, 0.1)
    gap = part(placed, "structure").quads[..., 1].min() - outer.quads[..., 1].max()
    assert gap == pytest.approx(0.008)


def test_layers_are_farther_apart_than_rays_are_moved(tmp_path):
    """Mitsuba's own offset, measured on a surface as far away as the room reaches."""
    plane = mi.load_dict({"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(100)})
    world = mi.load_dict({"type": "scene", "shape": plane})
    for x in (0.0, 4.0, 40.0):
        si = world.ray_intersect(mi.Ray3f([x, 0, 1], [0, 0, -1]))
        moved = float(si.spawn_ray(mi.Vector3f(0, 0, 1)).o.z[0])
        assert moved == pytest.approx(ray_offset(np.array([[x, 0, 0]])), rel=1e-3)


SHIPPED = {
    "lamella/lamella": {"lamellae": 2 * 6},
    "prism/prism": {"panel": 2},
    "prism/as_bsdf": {},
    "lightpipe/lightpipe": {"pipe": 2},
    "duct/duct": {"duct": 2},
}


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes_have_the_ports_of_their_components(name):
    assert name in shipped_cases()
    shipped = load_case(name)
    world = scene.load(shipped)
    counts = Counter(port.component for port in world.ports)
    assert counts == SHIPPED[name]
    assert {part.component for part in world.parts} == {"", *counts}
    assert plan.plan(shipped, daylight(shipped)).effects["components"].on == bool(counts)
    sensor_points(shipped)


def test_recipes_are_no_cases():
    assert {"films/prism", "lamella/recipe", "prism/recipe"} == set(shipped_recipes())
    assert not set(shipped_recipes()) & set(shipped_cases())


def test_the_prism_panel_fills_its_strip():
    panel = only(components.place(load_case("prism/prism")))
    vertices, faces = surface_of(part(panel, "structure").quads)
    check_solid("panel", vertices, faces)
    assert np.ptp(vertices, axis=0)[2] == pytest.approx(55 * 0.020)
    assert len(part(panel, "casing").quads) == 8  # four sides, four ledges, no blank


@dr.syntax
def leaving(world, p, d, sampler, offset, most):
    """Directions and weights of light that has passed all surfaces in its way."""
    ctx = mi.BSDFContext(mi.TransportMode.Importance)
    p, d, weight = mi.Point3f(p), mi.Vector3f(d), mi.Float(1)
    active, step = mi.Bool(True), mi.UInt32(0)
    while dr.hint(active, exclude=[world, ctx]):
        si = world.ray_intersect(mi.Ray3f(p, d), active)
        met = active & si.is_valid()
        bs, w = si.bsdf().sample(ctx, si, sampler.next_1d(met), sampler.next_2d(met), met)
        onward = si.to_world(bs.wo)
        off = si.p + si.n * dr.copysign(offset, dr.dot(si.n, onward))
        weight = dr.select(met, weight * w[0], weight)
        p, d = dr.select(met, off, p), dr.select(met, onward, d)
        step += 1
        active = met & (weight > 0) & (step < most)
    return d, weight


@pytest.mark.parametrize("name", ["prism/prism", "lamella/lamella"])
@pytest.mark.parametrize("elevation", [20.0, 50.0])
def test_a_beam_leaves_the_component_as_it_leaves_the_endless_structure(name, elevation):
    """A beam of eight periods in the middle of a pane against the goniophotometer."""
    count = 1 << 17
    placed = only(components.place(load_case(name)))
    shapes = {
        s.name: scene.quad_mesh(s.name, s.quads, mi.load_dict(bsdf(s.material)))
        for s in placed.surfaces
        if s.name.endswith((" structure", " casing"))
    }
    world = mitsuba_scene(shapes)  # one kernel traces both
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(1, 2 * count)
    recipe = load_recipe(shipped_folder() / f"{name.split('/')[0]}/recipe.toml")
    corner, across = placed.ports[0].quad[0], np.ptp(placed.ports[0].quad, axis=0)
    u, v = sampler.next_2d()
    x = float(corner[0]) + float(across[0]) * (0.3 + 0.4 * u)
    z = float(corner[2] + 0.4 * across[2]) + 8e-3 * recipe.structure.period * v
    start = mi.Point3f(x, float(corner[1]), z)
    a = np.radians(elevation)
    down = mi.Vector3f(0, float(np.cos(a)), float(-np.sin(a)))
    d, weight = leaving(world, start, down, sampler, dr.opaque(mi.Float, 1e-5), 1000)
    cell = prepare(unit_cell(recipe.model_copy(update={"glass": None})))
    inside = cell.corner[1] + cell.period[1] * sampler.next_1d()
    begin = mi.Point3f(0, inside, dr.opaque(mi.Float, cell.bounds[0]))
    towards = mi.Vector3f(0, float(-np.sin(a)), float(np.cos(a)))
    e, exact, _ = follow(cell, sampler, begin, towards)
    for here, there in ((d.y > 0, e.z > 0), ((d.y > 0) & (d.z > 0), (e.z > 0) & (e.y > 0))):
        x, y = (np.array(dr.select(m, w, 0)) for m, w in ((here, weight), (there, exact)))
        error = np.hypot(x.std(), y.std()) / np.sqrt(2 * count)
        # 10 µm off the surfaces of a 20 mm prism: a two-thousandth at each of some ten of them.
        assert abs(x.mean() - y.mean()) < 4 * error + 1e-3


def test_a_structure_that_no_strip_names_stands_nowhere(tmp_path):
    unused = with_strip(tmp_path, SLATS).model_copy(update={"facade": {}})
    assert components.place(unused) == ()
    assert unused.standing == ()


def test_panes_together_may_not_have_too_many_triangles(tmp_path, monkeypatch):
    placed = only(components.place(with_strip(tmp_path, SLATS)))
    half = 2 * len(part(placed, "structure").quads) // 2  # triangles of one of two panes
    monkeypatch.setattr("drcmitsuba.scene.components.structure.MOST_TRIANGLES", half)
    with pytest.raises(InputError, match=r"panel\.recipe: more than \d+ triangles in all panes"):
        components.place(with_strip(tmp_path, SLATS))
