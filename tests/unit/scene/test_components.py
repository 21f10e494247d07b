"""Components as geometry: what is closed, where it stands, what is a port, what is refused."""

from collections import Counter

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba import plan
from drcmitsuba.annual import simulation
from drcmitsuba.annual.season import season
from drcmitsuba.annual.tradeoff import tradeoff
from drcmitsuba.annual.variants import evaluate_variants
from drcmitsuba.case.case import Case, load_case
from drcmitsuba.case.shipped import shipped_cases, shipped_folder, shipped_recipes
from drcmitsuba.design.film_year import FilmYear
from drcmitsuba.design.layout import Layout
from drcmitsuba.design.reflectances import Interior
from drcmitsuba.goniophotometer.trace import follow, prepare
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene import components, scene
from drcmitsuba.scene.components.duct import concentrator
from drcmitsuba.scene.components.lightpipe import polygon
from drcmitsuba.scene.components.placed_component import ray_offset
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS
from drcmitsuba.scene.geometry import normals, rotation
from drcmitsuba.scene.materials import bsdf
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.scene.structures import unit_cell
from drcmitsuba.scene.structures.block import block
from drcmitsuba.scene.structures.polygon import triangles
from drcmitsuba.scene.structures.recipe import load_recipe
from drcmitsuba.scene.structures.solid import check_solid, volume, welded, winding
from drcmitsuba.scene.surfaces import surfaces_of
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.transport import facade_basis
from drcmitsuba.transport.facade_basis import compute

SIZE = np.array([4.0, 5.0, 3.0])
MATERIALS = {
    "glass": {"type": "glazing", "transmittance": 0.8},
    "opal": {"type": "diffuser", "transmittance": 0.6},
    "shade": {"type": "diffuser", "transmittance": 0.1},
    "silver": {"type": "mirror", "reflectance": 0.95},
    "acrylic": {"type": "dielectric", "ior": 1.49},
}
SLATS = """[structure]
kind = "lamellae"
period = 40
width = 40
tilt = 10
turn = -30
reflectance = 0.9
specular = 1
"""
PRISM = """[structure]
kind = "prism"
n = 1.49
period = 20
polygons = [[[0, 0], [4, 0], [14, 4, 10], [4, 20], [0, 20]]]
"""
PIPE = {"type": "lightpipe", "centre": [2.0, 2.5], "width": 0.5, "height": 1.0, "mirror": "silver"}
DUCT = {
    "type": "duct", "centre": 2.0, "width": 0.8, "height": 0.3, "length": 2.5, "mirror": "silver",
}  # fmt: skip


def surface_of(*parts):
    """Welded triangles of quads (quad, 4, 3)."""
    quads = np.concatenate(parts)
    corners = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return welded(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def area(quads):
    a = np.cross(quads[:, 1] - quads[:, 0], quads[:, 2] - quads[:, 0])
    b = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 0])
    return (np.linalg.norm(a, axis=1) + np.linalg.norm(b, axis=1)).sum() / 2


def case(**changes):
    tables = {
        "room": {"size": list(SIZE)},
        "materials": MATERIALS,
        "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 4], "spacing": 1.0},
    }
    return Case.model_validate(tables | changes)


def with_strip(folder, text, side="south", frame=0.1, strip=(1.0, 2.0), **changes):
    recipe = folder / "recipe.toml"
    recipe.write_text(text, encoding="utf-8")
    table = {"type": "structure", "recipe": str(recipe)}
    strips = [{"bottom": strip[0], "top": strip[1], "material": "panel"}]
    facade = {side: {"segments": 2, "frame": frame, "strips": strips}}
    return case(components={"panel": table | changes}, facade=facade)


def only(placed):
    (one,) = placed
    return one


def part(placed, word):
    return next(s for s in placed.surfaces if s.name.endswith(word))


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


# --- polygons and solids


@pytest.mark.parametrize("seed", range(5))
def test_triangles_of_a_polygon_have_its_area_and_all_turn_the_same_way(seed):
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 40))
    radius = rng.uniform(0.2, 1, 40)  # star-shaped, with many corners that bend inward
    points = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    faces = triangles(points)
    a, b, c = (points[faces[:, i]] for i in range(3))
    u, v = b - a, c - a
    areas = (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2
    x, y = points.T
    whole = (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2
    assert len(faces) == 38
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(whole, rel=1e-12)


def tetrahedron():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    return vertices, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def test_a_solid_is_known_by_its_volume_and_what_it_surrounds():
    vertices, faces = tetrahedron()
    check_solid("file", vertices, faces)
    assert volume(vertices, faces) == pytest.approx(1 / 6)
    points = np.array([[0.2, 0.2, 0.2], [0.5, 0.5, 0.5], [-0.1, 0.2, 0.2]])
    np.testing.assert_allclose(winding(vertices, faces, points), [1, 0, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda f: f[:, ::-1], "normals point inward"),
        (lambda f: f[1:], "not closed: 3 open edges"),
        (lambda f: np.concatenate([f[:1, ::-1], f[1:]]), "disagree on which side is out"),
    ],
)
def test_what_is_no_solid_is_refused(change, told):
    vertices, faces = tetrahedron()
    with pytest.raises(InputError, match=told):
        check_solid("file", vertices, change(faces))


# --- structures


def recipe(folder, text):
    file = folder / "recipe.toml"
    file.write_text(text, encoding="utf-8")
    return load_recipe(file)


def test_a_block_of_prisms_is_a_closed_solid_of_whole_periods(tmp_path):
    made = block(recipe(tmp_path, PRISM), 0.7, 0.333)
    assert made.periods == 16
    np.testing.assert_allclose(made.size, [0.7, 0.32, 0.014], atol=1e-6)
    vertices, faces = surface_of(made.quads)
    check_solid("block", vertices, faces)
    # the polygon's area, its arc's segment of 10° included, times all periods and the width
    chord, turn = np.hypot(10, 16), np.radians(10)
    radius = chord / 2 / np.sin(turn / 2)
    period = 4 * 20 + 20 * 10 / 2 + radius**2 * (turn - np.sin(turn)) / 2
    assert volume(vertices, faces) == pytest.approx(period * 1e-6 * 16 * 0.7, rel=1e-4)
    np.testing.assert_allclose(made.quads.min(axis=(0, 1))[:2], [-0.35, -0.16], atol=1e-9)
    assert made.quads[..., 2].max() == 0


def test_a_panel_cut_through_becomes_closed_pieces(tmp_path):
    text = """[structure]
kind = "slots"
n = 1.49
period = 20
thickness = 12
slot = 2
depth = 12
"""
    made = block(recipe(tmp_path, text), 0.5, 0.2)
    vertices, faces = surface_of(made.quads)
    check_solid("block", vertices, faces)
    assert volume(vertices, faces) == pytest.approx(made.periods * 0.018 * 0.012 * 0.5, rel=1e-6)


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
    found = np.degrees(np.arctan2(inner[2] - outer[2], inner[1] - outer[1]))
    # The arc's ends are its extremes as long as it turns less than the tilt leaves to 90°.
    assert found == pytest.approx(tilt, abs=1e-6)


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


# --- pipes and ducts


def ceiling_area(world, *names):
    return sum(area(s.quads) for s in world if s.name.endswith(names))


@pytest.mark.parametrize("sides", [4, 8, 12, 24])
def test_the_ceiling_and_the_ring_fill_everything_but_the_pipe(sides):
    room = case(components={"pipe": PIPE | {"sides": sides}})
    surfaces = surfaces_of(room)
    corners = polygon((0, 0), 0.5, sides)
    x, y = corners.T
    cross_section = (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2
    assert cross_section == pytest.approx(sides * 0.25**2 * np.tan(np.pi / sides))
    found = ceiling_area(surfaces, "ceiling", "ring")
    assert found == pytest.approx(SIZE[0] * SIZE[1] - cross_section, rel=1e-9)
    for s in surfaces:
        if s.name.endswith(("ceiling", "ring")):
            found = normals(s.quads[:, [0, 1, 2, 2]])
            np.testing.assert_allclose(found, [[0, 0, -1]] * len(found), atol=1e-9)


def closed_but_for(surfaces, ports):
    """Whether surfaces and ports together are a closed solid, whatever way they face."""
    _, faces = surface_of(*surfaces, *(p.quad[None] for p in ports))
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2))
    return (np.unique(edges, axis=0, return_counts=True)[1] % 2 == 0).all()


@pytest.mark.parametrize("sides", [4, 24])
def test_a_pipe_is_closed_but_for_its_ports(sides):
    pipe = only(components.place(case(components={"pipe": PIPE | {"sides": sides}})))
    surfaces = [s.quads for s in pipe.surfaces]
    if sides > 4:  # rings touch the squares with no corner of theirs
        inner = next(s.quads for s in pipe.surfaces if s.name.endswith("wall"))[4:-4]
        z = np.unique(inner[..., 2].round(9))
        np.testing.assert_allclose(z, [3.01, 3.99])
        p = inner - [2.0, 2.5, 0]
        assert (np.einsum("qi,qi->q", normals(inner), -p.mean(axis=1) * [1, 1, 0]) > 0).all()
        assert area(inner) == pytest.approx(24 * 0.5 * np.tan(np.pi / 24) * 0.98)
    else:
        assert closed_but_for(surfaces, pipe.ports)
    top, bottom = pipe.ports
    np.testing.assert_allclose(normals(top.quad[None]), [[0, 0, -1]], atol=1e-12)
    np.testing.assert_allclose(normals(bottom.quad[None]), [[0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose([top.quad[:, 2], bottom.quad[:, 2]], [[4.0] * 4, [3.0] * 4])


def test_panes_of_a_pipe_face_the_room_behind_their_mouths():
    pipe = only(
        components.place(case(components={"pipe": PIPE | {"top": "glass", "bottom": "opal"}}))
    )
    for name, z in (("glass", 3.995), ("opal", 3.005)):
        pane = part(pipe, name)
        np.testing.assert_allclose(pane.quads[..., 2], z)
        np.testing.assert_allclose(normals(pane.quads), [[0, 0, -1]], atol=1e-12)


@pytest.mark.parametrize("acceptance", [None, 30.0, 45.0])
@pytest.mark.parametrize("side", ["south", "east", "north", "west"])
def test_a_duct_is_closed_but_for_its_ports_and_faces_inward(side, acceptance):
    table = DUCT | {"side": side} | ({} if acceptance is None else {"acceptance": acceptance})
    duct = only(components.place(case(components={"duct": table})))
    walls = duct.surfaces[0].quads
    assert closed_but_for([walls], duct.ports)
    # Turned inside out, walls and ports are the surface of the solid that the light goes through.
    vertices, faces = surface_of(walls, *(p.quad[None] for p in duct.ports))
    assert volume(vertices, faces[:, ::-1]) > 0
    entry, outlet = (p.quad for p in duct.ports)
    inward = {"south": [0, 1, 0], "north": [0, -1, 0], "east": [-1, 0, 0], "west": [1, 0, 0]}[side]
    np.testing.assert_allclose(normals(entry[None])[0], inward, atol=1e-12)
    np.testing.assert_allclose(normals(outlet[None])[0], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(area(outlet[None]), 0.8 * 0.3)
    height = 0.3 / (1 if acceptance is None else np.sin(np.radians(acceptance)))
    np.testing.assert_allclose(area(entry[None]), 0.8 * height)


@pytest.mark.parametrize("acceptance", [20.0, 35.0, 60.0])
def test_the_concentrator_sends_the_edge_ray_to_the_edge(acceptance):
    """Light at the angle of acceptance is focused on the rim of the channel: that defines it."""
    depth, half = concentrator(0.3, acceptance)
    theta = np.radians(acceptance)
    assert half[0] == pytest.approx(0.15 / np.sin(theta))
    assert half[-1] == pytest.approx(0.15)
    assert depth[-1] == pytest.approx((0.15 + half[0]) / np.tan(theta))
    p = np.stack([depth, half], axis=1)
    tangent = np.gradient(p, axis=0)[1:-1]
    n = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    d = np.array([np.cos(theta), np.sin(theta)])  # rising towards the upper profile
    out = d - 2 * (n @ d)[:, None] * n
    to_edge = [depth[-1], -0.15] - p[1:-1]
    to_edge /= np.linalg.norm(to_edge, axis=1, keepdims=True)
    miss = np.degrees(np.arccos(np.clip((out * to_edge).sum(axis=1), -1, 1)))
    assert miss.max() < 1.0  # facets of 1° turn by half a degree from their middle


def test_holes_are_openings_of_the_room_unless_something_scatters():
    clear = scene.load(case(components={"pipe": PIPE | {"bottom": "glass"}})).enclosure.openings
    np.testing.assert_allclose(clear[0].min(axis=0), [1.75, 2.25, 3])
    np.testing.assert_allclose(normals(clear)[0], [0, 0, -1], atol=1e-12)
    opal = scene.load(case(components={"pipe": PIPE | {"bottom": "opal"}})).enclosure.openings
    assert len(opal) == 0


def test_a_turned_room_turns_components_and_ports(tmp_path):
    straight = case(components={"pipe": PIPE, "duct": DUCT | {"length": 1.5}})
    turned = case(room={"size": list(SIZE), "rotation": 30.0}, components=straight.components)
    turn = rotation(turned)
    for a, b in zip(surfaces_of(straight), surfaces_of(turned), strict=True):
        assert (a.name, a.component) == (b.name, b.component)
        np.testing.assert_allclose(a.quads @ turn.T, b.quads, atol=1e-12)
    a, b = scene.load(straight), scene.load(turned)
    for p, q in zip(a.ports, b.ports, strict=True):
        np.testing.assert_allclose(p.quad @ turn.T, q.quad, atol=1e-12)
    assert {p.component for p in b.parts} == {"", "pipe", "duct"}


# --- meshes

CUBE = """v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
f 4 3 2 1
f 5 6 7 8
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
"""


def with_mesh(folder, text=CUBE, **changes):
    file = folder / "mesh.obj"
    file.write_text(text, encoding="utf-8")
    table = {"type": "mesh", "file": str(file), "material": "acrylic", "position": [1, 2, 1]}
    facade = {"south": {"strips": [{"bottom": 1, "top": 2, "material": "glass"}]}}
    return case(components={"cube": table | changes}, facade=facade)


def test_a_mesh_stands_where_it_is_placed_with_ports_that_see_the_window(tmp_path):
    cube = only(components.place(with_mesh(tmp_path, scale=0.5, rotation=90.0)))
    low, high = cube.bounds
    np.testing.assert_allclose([low, high], [[1, 1.5, 1], [1.5, 2, 1.5]], atol=1e-12)
    normal = np.array([normals(port.quad[None])[0] for port in cube.ports])
    # Not from the north, nor from below: the window is in the south and begins at 1 m.
    wanted = {(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, 0, -1)}
    assert {tuple(n) for n in normal.round(9) + 0.0} == wanted
    middle = (low + high) / 2
    for port in cube.ports:
        inward = normals(port.quad[None])[0] @ (middle - port.quad.mean(axis=0))
        assert inward == pytest.approx(0.251)
        assert area(port.quad[None]) == pytest.approx(0.502**2)


def test_ports_can_be_named(tmp_path):
    quad = [[1, 1.9, 1], [1, 1.9, 2], [2, 1.9, 2], [2, 1.9, 1]]  # to the north
    assert len(only(components.place(with_mesh(tmp_path, ports=[quad]))).ports) == 1


def flipped(text):
    lines = [
        " ".join(["f", *reversed(line.split()[1:])]) if line.startswith("f") else line
        for line in text.splitlines()
    ]
    return "\n".join(lines)


def moved_port(**to):
    port = np.array([[1, 1.9, 1], [1, 1.9, 2], [2, 1.9, 2], [2, 1.9, 1.0]])
    for axis, by in to.items():
        port[:, "xyz".index(axis)] += by
    return port.tolist()


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda f: with_mesh(f, flipped(CUBE)), "mesh.obj: mesh: the normals point inward"),
        (lambda f: with_mesh(f, CUBE.replace("f 4 1 5 8\n", "")), "not closed: 4 open edges"),
        (
            lambda f: with_mesh(f, ports=[moved_port()[::-1]]),
            "ports.0: it leads away from the mesh",
        ),
        (lambda f: with_mesh(f, ports=[moved_port(z=1.5)]), "ports.0: it goes through a wall"),
        (lambda f: with_mesh(f, ports=[moved_port(y=0.5)]), "ports.0: it lies inside of cube"),
        (lambda f: with_mesh(f, ports=[moved_port(y=-1.9, z=-0.5)]), "ports.0: it lies in a wall"),
        (
            lambda f: with_mesh(f, ports=[moved_port(y=1.2)[::-1]]),
            "ports.0: it turns its back on every opening",
        ),
        (
            lambda f: with_mesh(f, ports=[[*moved_port()[:3], [2, 1.9, 1.2]]]),
            "ports.0: no rectangle",
        ),
    ],
)
def test_unfit_meshes_and_ports_are_refused(tmp_path, make, told):
    with pytest.raises(InputError, match=told):
        components.place(make(tmp_path))


@pytest.mark.parametrize("material", ["acrylic", "silver"])
def test_sensors_in_a_closed_mesh_are_refused(tmp_path, material):
    with pytest.raises(InputError, match=r"sensors: sensor 4 .* lies in component 'cube'"):
        sensor_points(with_mesh(tmp_path, position=[1.6, 1.6, 0.5], scale=0.9, material=material))


# --- shipped scenes

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
    found = Counter(port.component for port in world.ports)
    assert found == SHIPPED[name]
    assert {part.component for part in world.parts} == {"", *found}
    assert plan.plan(shipped, daylight(shipped)).effects["components"].on == bool(found)
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
    world = mi.load_dict({"type": "scene", **shapes}, optimize=False)
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


# --- what is refused


@pytest.mark.parametrize(
    ("tables", "told"),
    [
        ({"components": {"pipe": PIPE | {"mirror": "glass"}}},
         "components.pipe.mirror: \"glass\" is no mirror"),
        ({"components": {"pipe": PIPE | {"bottom": "silver"}}},
         "pipe.bottom: \"silver\" is no glazing or diffuser"),
        ({"components": {"pipe": PIPE | {"sides": 6}}}, "sides"),
        ({"components": {"glass": PIPE}}, "components.glass: the name is taken"),
        ({"components": {"pipe": PIPE}, "room": None}, "components.pipe: there is no room"),
        ({"components": {"pipe": PIPE},
          "facade": {"south": {"strips": [{"bottom": 1, "top": 2, "material": "pipe"}]}}},
         "no pane is made of \"pipe\""),
        ({"facade": {"south": {"strips": [{"bottom": 1, "top": 2, "material": "silver"}]}}},
         "no pane is made of \"silver\""),
        ({"materials": MATERIALS | {"silver": MATERIALS["silver"]
                                    | {"coating": 1.5, "roughness": 0.1}}},
         "coating: with a roughness of 0.1"),
    ],
)  # fmt: skip
def test_tables_that_do_not_fit_are_refused(tables, told):
    with pytest.raises(ValueError, match=told):
        case(**tables)


@pytest.mark.parametrize(
    ("tables", "told"),
    [
        (
            {"pipe": PIPE | {"centre": [0.2, 2.0]}},
            "pipe: its hole, -0.05 to 0.45 .* leaves the ceil",
        ),
        ({"duct": DUCT | {"length": 5.2}}, "duct: its hole, .* leaves the ceiling"),
        ({"duct": DUCT | {"length": 0.3}}, "duct.length: 0.3 m, but entry and bend take"),
        ({"duct": DUCT | {"above": 0.001}}, "duct.above: 0.001 m; give at least"),
        ({"pipe": PIPE | {"height": 0.01}}, "pipe.height: 0.01 m; give at least 0.04 m"),
        ({"a": PIPE, "b": PIPE | {"centre": [2.3, 2.5]}}, "components.b: it runs into a"),
        ({"a": PIPE | {"centre": [2.0, 1.0]}, "b": DUCT}, "components.b: it runs into a"),
    ],
)
def test_holes_that_do_not_fit_are_refused(tables, told):
    with pytest.raises(InputError, match=told):
        components.place(case(components=tables))


def test_a_port_in_furniture_is_refused():
    box = {"name": "cupboard", "corner": [1, 1, 2], "size": [2, 3, 1.5]}
    with pytest.raises(InputError, match=r"pipe.ports.1: it lies in 'cupboard'"):
        components.place(case(components={"pipe": PIPE}, furniture=[box]))


@pytest.mark.parametrize(
    ("text", "changes", "told"),
    [
        (PRISM, {"tilt": 10.0}, "panel.tilt: the recipe is of kind prism"),
        (PRISM + "[glass]\ntransmittance = 0.9\ndistance = 8\n", {"outer": "glass"},
         "panel.outer: the recipe has its own"),
        (SLATS, {"gap": 0.0005}, "panel.gap: rays would skip 0.5 mm of air"),
        (SLATS.replace("40", "2"), {}, "a period of 2 mm is too fine"),
        (SLATS.replace("40", "1400"), {}, "structure.period: a period takes 1400 mm"),
    ],
)  # fmt: skip
def test_structures_that_do_not_fit_are_refused(tmp_path, text, changes, told):
    with pytest.raises(InputError, match=told):
        components.place(with_strip(tmp_path, text, **changes))


def test_a_structure_that_no_strip_names_stands_nowhere(tmp_path):
    unused = with_strip(tmp_path, SLATS).model_copy(update={"facade": {}})
    assert components.place(unused) == ()
    assert unused.standing == ()


TASKS = {
    "season": season,
    "variants": lambda room: list(evaluate_variants([room])),
    "optimise": Layout.of,
    "film": FilmYear.of,
    "interior": lambda room: Interior.of(room, None),
    "tradeoff": tradeoff,
    "basis": lambda room: compute(*of_grid(room), None, room.accuracy),
}


def of_grid(room):
    wall = facade_basis.Wall(room, "south")
    return wall, *facade_basis.of_grid(wall, [1.0, 2.0], 1, ("wall", "glass"))


@pytest.mark.parametrize("task", TASKS)
def test_what_counts_no_photons_refuses_components(task):
    room = case(
        components={"pipe": PIPE},
        facade={"south": {"strips": [{"bottom": 1, "top": 2, "material": "glass"}]}},
        design={"film": "opal"},
    )
    with pytest.raises(InputError, match='counts no light by way of "pipe"'):
        TASKS[task](room)


@pytest.mark.parametrize("task", TASKS)
def test_what_follows_no_choice_of_effects_refuses_one(task):
    room = case(
        facade={"south": {"strips": [{"bottom": 1, "top": 2, "material": "glass"}]}},
        design={"film": "opal"},
        effects={"suns": "all", "pictures": "off"},
    )
    with pytest.raises(InputError, match=r"effects\.suns: .*; leave it"):
        TASKS[task](room)


def test_the_fingerprint_follows_recipes_and_meshes(tmp_path):
    slats, cube = with_strip(tmp_path, SLATS), with_mesh(tmp_path)
    before = simulation.fingerprint(slats, ALL_EFFECTS), simulation.fingerprint(cube, ALL_EFFECTS)
    (tmp_path / "recipe.toml").write_text(SLATS.replace("0.9", "0.8"), encoding="utf-8")
    (tmp_path / "mesh.obj").write_text(CUBE.replace("v 0 0 0", "v 0 0 0.1"), encoding="utf-8")
    after = simulation.fingerprint(slats, ALL_EFFECTS), simulation.fingerprint(cube, ALL_EFFECTS)
    assert not set(before) & set(after)
    assert simulation.fingerprint(with_strip(tmp_path, SLATS, tilt=11.0), ALL_EFFECTS) != before[0]


def test_panes_together_may_not_have_too_many_triangles(tmp_path, monkeypatch):
    placed = only(components.place(with_strip(tmp_path, SLATS)))
    half = 2 * len(part(placed, "structure").quads) // 2  # triangles of one of two panes
    monkeypatch.setattr("drcmitsuba.scene.components.structure.MOST_TRIANGLES", half)
    with pytest.raises(InputError, match=r"panel\.recipe: more than \d+ triangles in all panes"):
        components.place(with_strip(tmp_path, SLATS))


def test_ports_of_a_mesh_that_stands_half_outside_are_kept(tmp_path):
    """What a wall covers of a face is dark by itself; the rest lets light in."""
    (tmp_path / "shelf.obj").write_text(
        "v 0 0 0\nv 2 0 0\nv 2 1 0.2\nv 0 1 0.2\nf 1 2 3\nf 1 3 4\n"
    )
    shelf = {"type": "mesh", "file": str(tmp_path / "shelf.obj"), "material": "silver"}
    strips = [{"bottom": 1.0, "top": 2.0, "material": "open"}]
    placed = only(
        components.place(
            case(
                components={"shelf": shelf | {"position": [1.0, -0.5, 1.5]}},
                facade={"south": {"strips": strips}},
            )
        )
    )
    assert len(placed.ports) == 5  # all but the one that turns its back on the opening
