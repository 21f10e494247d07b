"""Light pipes, ducts and meshes: what is closed, where they stand, their ports and holes."""

import numpy as np
import pytest

from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene import components, scene
from drcmitsuba.scene.components.duct import concentrator
from drcmitsuba.scene.components.lightpipe import polygon
from drcmitsuba.scene.components.placed_component import ray_offset, recess
from drcmitsuba.scene.geometry import normals, rotation
from drcmitsuba.scene.sensors import placed_sensors
from drcmitsuba.scene.structures.solid import volume
from drcmitsuba.scene.surfaces import surfaces_of
from tests.unit.scene.component_cases import (
    CUBE,
    DUCT,
    PIPE,
    SIZE,
    area,
    case,
    only,
    part,
    surface_of,
    with_mesh,
)


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


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
    filled = ceiling_area(surfaces, "ceiling", "ring")
    assert filled == pytest.approx(SIZE[0] * SIZE[1] - cross_section, rel=1e-9)
    for s in surfaces:
        if s.name.endswith(("ceiling", "ring")):
            directions = normals(s.quads[:, [0, 1, 2, 2]])
            np.testing.assert_allclose(directions, [[0, 0, -1]] * len(directions), atol=1e-9)


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


def test_panes_of_the_pipes_of_a_hall_lie_in_few_planes():
    """Beyond 13 m each had a plane of its own, in which all photons looked for it."""
    places = np.linspace(1, 100, 50)
    depths = [recess(np.array([[x, x, 3.0]])) for x in places]
    offsets = [ray_offset(np.array([[x, x, 3.0]])) for x in places]
    assert len(set(depths)) == 5
    assert (np.array(depths) >= 4 * np.array(offsets)).all()


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
    ("make", "message"),
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
def test_unfit_meshes_and_ports_are_refused(tmp_path, make, message):
    with pytest.raises(InputError, match=message):
        components.place(make(tmp_path))


@pytest.mark.parametrize("material", ["acrylic", "silver"])
def test_points_of_a_grid_in_a_closed_mesh_are_left_out(tmp_path, material):
    room = with_mesh(tmp_path, position=[1.6, 1.6, 0.5], scale=0.9, material=material)
    placed = placed_sensors(room)
    [note] = placed.notes
    assert "in component 'cube'" in note
    assert len(placed.points) == int(np.prod(room.sensors.count)) - int(note.split()[1])


def slats(folder, start, low, high):
    """Mesh of a slat from the south wall's inner face on, x from `low` to `high` [m]."""
    (folder / "slat.obj").write_text(
        f"v {low} 0 0\nv {high} 0 0\nv {high} 0.1 1.5\nv {low} 0.1 1.5\nf 1 2 3\nf 1 3 4\n"
    )
    slat = {"type": "mesh", "file": str(folder / "slat.obj"), "material": "silver"}
    strips = [{"bottom": 1.0, "top": 2.0, "material": "open"}]
    return case(
        components={"slat": slat | {"position": [0.0, start, 0.8]}},
        facade={"south": {"strips": strips, "segments": 2, "frame": 0.2}},
    )


@pytest.mark.parametrize("ends", [(0.5, 3.5), (0.0, 4.0)], ids=["beside the wall", "full width"])
@pytest.mark.parametrize("start", [0.0, 5e-4, 1e-3])
def test_a_mesh_at_a_wall_has_ports_in_the_openings_that_it_covers(tmp_path, start, ends):
    """Its box reaches over the frame and the post between both panes."""
    placed = only(components.place(slats(tmp_path, start, *ends)))
    at_wall = [p.quad for p in placed.ports if np.ptp(p.quad[:, 1]) == 0 and p.quad[0, 1] < 1e-6]
    low, high = max(ends[0] - 1e-3, 0.1), min(ends[1] + 1e-3, 3.9)
    bounds = sorted((*q.min(axis=0)[[0, 2]], *q.max(axis=0)[[0, 2]]) for q in at_wall)
    expected = [(low, 1.1, 1.9, 1.9), (2.1, 1.1, high, 1.9)]
    np.testing.assert_allclose(bounds, expected, atol=1e-9)
    np.testing.assert_allclose(normals(np.array(at_wall)), [[0, 1, 0]] * 2, atol=1e-12)


def test_ports_of_a_mesh_that_stands_half_outside_are_kept(tmp_path):
    """The part of a face that a wall covers is dark by itself; the rest lets light in."""
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
