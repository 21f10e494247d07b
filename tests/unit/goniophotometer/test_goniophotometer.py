"""The goniophotometer against what can be said of a structure without tracing it."""

import struct
from dataclasses import replace

import numpy as np
import pytest
from drcmitsuba_plugins import bsdf_file
from drcmitsuba_plugins.energy import sum_of_albedos
from drcmitsuba_plugins.tensor import TensorTree, to_direction

from drcmitsuba import InputError
from drcmitsuba import goniophotometer as gonio
from drcmitsuba.bsdf.merge import merge
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.toml import checked
from drcmitsuba.scene.structures.mesh import read_mesh
from drcmitsuba.scene.structures.recipe import Recipe
from drcmitsuba.scene.structures.structure import arc, unit_cell
from tests import ROOT

FILMS = ROOT / "scenes" / "films"
SLAB = {
    "kind": "prism", "n": 1.49, "period": 1.0,
    "polygons": [[[0, 0], [0.5, 0], [0.5, 1], [0, 1]]],
}  # fmt: skip
SAWTOOTH = {
    "kind": "prism", "n": 1.49, "period": 0.5,
    "polygons": [[[0, 0], [0.1, 0], [0.5, 0.2], [0.1, 0.5], [0, 0.5]]],
}  # fmt: skip


@pytest.fixture(autouse=True)
def _variant():
    backend.select()


def recipe(structure, **more):
    return checked(Recipe, {"structure": structure, **more}, "recipe.toml")


def replicates(structure, name, *, seeds=range(4), glass=None, **options):
    """Shares of independent exposures, shape (2 · seeds, incident, outgoing)."""
    r = recipe(structure, **({"glass": glass} if glass else {}))
    parts = [gonio.expose(r, seed=s, **options) for s in seeds]
    names = [name] if isinstance(name, str) else name
    halves = [np.concatenate([p.halves[k] for p in parts]) for k in names]
    return halves[0] if isinstance(name, str) else halves


def cell_means(function, n, points=64):
    """Mean of a function of directions of travel over every incident cell, light from outside."""
    u = (np.arange(points) + 0.5) / points
    cells = np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), -1).reshape(-1, 2)
    s = (cells[:, 0, None, None] + u[:, None]) / n + 0 * u
    t = (cells[:, 1, None, None] + u) / n + 0 * u[:, None]
    return function(to_direction(s, t)).mean(axis=(1, 2))


def slab(direction, n=1.49):
    """Transmittance and reflectance of a clear slab by Fresnel, all reflections summed.

    The two polarisations are averaged at each face, as Mitsuba (and Radiance) do.
    """
    c = direction[..., 2]
    inside = np.sqrt(1 - (1 - c * c) / n**2)
    faces = (c - n * inside) / (c + n * inside), (inside - n * c) / (inside + n * c)
    r = (faces[0] ** 2 + faces[1] ** 2) / 2
    return (1 - r) / (1 + r), 2 * r / (1 + r)


def backward(shares, n):
    """Shares with every path walked the other way: directions of travel turn round."""
    grid = shares.reshape(-1, n, n, n, n)[:, ::-1, ::-1, ::-1, ::-1]
    return grid.transpose(0, 3, 4, 1, 2).reshape(shares.shape)


def test_a_slab_follows_fresnel_and_lets_light_go_straight_on(same):
    tb, rb = replicates(SLAB, ("tb", "rb"), depth=3, samples=8192)
    same(tb.sum(axis=2), exact=cell_means(lambda d: slab(d)[0], 8), within=5e-4)
    same(rb.sum(axis=2), exact=cell_means(lambda d: slab(d)[1], 8), within=2e-3)
    straight = np.trace(tb.mean(axis=0))
    assert straight > (1 - 1e-5) * tb.mean(axis=0).sum()
    mirrored = np.trace(rb.mean(axis=0))  # the direction along the façade stays as it was
    assert mirrored > (1 - 1e-5) * rb.mean(axis=0).sum()


def test_glass_before_a_slab_adds_up_as_layers_do(same):
    glass = {"transmittance": 0.6, "reflectance": 0.1, "exponent": 4.5}

    def layers(d):
        t, r = slab(d)
        x = 1 - d[..., 2]
        tg, rg = 0.6 * (1 - x**4.5), 0.1 + 0.9 * x**5
        return tg * t / (1 - rg * r)

    tb, tf = replicates(SLAB, ("tb", "tf"), depth=3, samples=8192, glass=glass)
    exact = cell_means(layers, 8)
    same(tb.sum(axis=2), exact=exact, within=1e-3)
    same(tf.sum(axis=2), exact=exact, within=1e-3)


def test_a_clear_structure_loses_no_light():
    e = gonio.expose(recipe(SAWTOOTH), depth=3, samples=1024)
    assert e.lost < 1e-5
    for through, back in (("tb", "rb"), ("tf", "rf")):
        total = e.hemispherical(through) + e.hemispherical(back)
        np.testing.assert_allclose(total, 1, atol=2e-3)
        assert abs(total.mean() - 1) < 2 * e.lost + 1e-6


@pytest.mark.slow
def test_a_clear_structure_is_reciprocal(same):
    tb, tf = replicates(SAWTOOTH, ("tb", "tf"), depth=3, samples=4096)
    same(tb, other=backward(tf, 8), within=2e-3)
    for reflected in replicates(SAWTOOTH, ("rb", "rf"), depth=2, samples=16384):
        # The two directions of a pair come from different halves.
        same(reflected[::2], other=backward(reflected[1::2], 4), within=5e-3)


def test_where_the_period_begins_does_not_matter(same):
    moved = SAWTOOTH | {"polygons": [[[z, y + 0.31] for z, y in SAWTOOTH["polygons"][0]]]}
    here = replicates(SAWTOOTH, "tb", depth=2, samples=4096)
    there = replicates(moved, "tb", seeds=range(4, 8), depth=2, samples=4096)
    same(here, other=there, within=2e-3)


def test_black_lamellae_let_pass_what_misses_them(same):
    blades = {"kind": "lamellae", "period": 2.0, "width": 1.5, "reflectance": 0.0}
    tb, rb = replicates(blades, ("tb", "rb"), depth=4, samples=2048)
    exact = cell_means(lambda d: np.maximum(0, 1 - 0.75 * abs(d[..., 1]) / d[..., 2]), 16, 128)
    seen = exact > 0.01  # some cells let pass less than one ray
    same(tb.sum(axis=2)[:, seen], exact=exact[seen], within=1e-3)
    assert rb.sum() == 0


def radiosity(tangent, *, width, reflectance, strips=200):
    """Transmittance of level diffuse lamellae of unit period, light from above, by 2D radiosity.

    `tangent` is that of the profile angle. The plates see each other's strips by crossed strings;
    the weight of a strip is the part of its radiosity that leaves towards the room.
    """
    edge = np.linspace(0, width, strips + 1)
    far = np.hypot(edge[:, None] - edge[None, :], 1)
    crossed = far[:-1, 1:] + far[1:, :-1] - far[:-1, :-1] - far[1:, 1:]
    view = crossed / (2 * width / strips)  # from a strip of one plate to those of the other
    middle = (edge[:-1] + edge[1:]) / 2
    room = (1 - (width - middle) / np.hypot(width - middle, 1)) / 2
    # Both plates are alike, so one set of weights serves: w = ρ (room + F w).
    weight = np.linalg.solve(np.eye(strips) - reflectance * view, reflectance * room)
    total = np.concatenate([[0], np.cumsum(weight)]) * width / strips
    lit = np.minimum(width, 1 / np.maximum(tangent, 1e-9))
    return np.maximum(0, 1 - width * tangent) + tangent * np.interp(lit, edge, total)


def test_diffuse_lamellae_agree_with_radiosity(same):
    blades = {"kind": "lamellae", "period": 1.0, "width": 1.2, "reflectance": 0.7}
    tb, rb, tf = replicates(blades, ("tb", "rb", "tf"), depth=3, samples=8192)
    exact = cell_means(
        lambda d: radiosity(abs(d[..., 1]) / d[..., 2], width=1.2, reflectance=0.7), 8
    )
    same(tb.sum(axis=2), exact=exact, within=1e-3)
    same(tf.sum(axis=2), exact=exact, within=1e-3)
    assert (tb + rb).sum(axis=2).max() < 1
    up_down = tb.reshape(-1, 8, 8, 8, 8)[:, :, ::-1, :, ::-1].reshape(tb.shape)
    same(tb[::2], other=up_down[1::2], within=2e-3)


def test_mirrored_lamellae_keep_the_light_and_turn_it_up_or_leave_it():
    blades = {
        "kind": "lamellae", "period": 1.0, "width": 1.0, "reflectance": 1.0, "specular": 1.0,
    }  # fmt: skip
    e = gonio.expose(recipe(blades), depth=4, samples=256)
    assert e.shares("rb").sum() == 0
    grid = e.shares("tb").reshape(16, 16, 16, 16)
    straight = np.einsum("abab->ab", grid)
    turned = np.einsum("abac,bc->ab", grid, np.eye(16)[::-1])
    np.testing.assert_allclose(straight + turned, 1, atol=0.01)


def test_bent_slats_turn_by_what_was_asked():
    points = np.concatenate([arc(np.zeros(2), np.array([2.0, 0]), 90.0), [[2, 0]]])
    np.testing.assert_allclose(points[:, 1].min(), 1 - np.sqrt(2), atol=1e-4)
    edge = np.diff(points, axis=0)
    angle = np.degrees(np.arctan2(edge[:, 1], edge[:, 0]))
    np.testing.assert_allclose(angle[[0, -1]], [-44.75, 44.75], atol=1e-9)


def test_a_laser_cut_panel_turns_light_up_or_leaves_it():
    panel = {
        "kind": "slots", "n": 1.49, "period": 4.0, "thickness": 6.0, "slot": 0.3, "depth": 6.0,
    }  # fmt: skip
    e = gonio.expose(recipe(panel), depth=4, samples=512)
    grid = e.shares("tb").reshape(16, 16, 16, 16)
    straight = np.einsum("abab->ab", grid)
    turned = np.einsum("abac,bc->ab", grid, np.eye(16)[::-1])
    total = grid.sum(axis=(2, 3))
    np.testing.assert_allclose(straight + turned, total, atol=5e-3)
    assert turned[8, 3] > 0.6 * total[8, 3]  # the sun at 30° to 39°: 6 tan θ' / 3.7 = 0.6 to 0.8
    half_cut = recipe(panel | {"depth": 3.0})
    assert len(unit_cell(half_cut).faces) == 2 * 6


PLATE = "v 0 0 0\nv 1 0 0\nv 1 2 0\nv 0 2 0\nf 1 2 3 4\n"


def test_a_plate_of_a_mesh_is_lambertian_and_mirrors(tmp_path, same):
    (tmp_path / "plate.obj").write_text(PLATE)
    material = {"type": "opaque", "reflectance": 0.6, "specular": 0.25}
    plate = {"kind": "mesh", "file": str(tmp_path / "plate.obj"), "period": [1, 2]}
    tb, rb = replicates(plate | {"material": material}, ("tb", "rb"), depth=2, samples=4096)
    assert tb.sum() == 0
    same(rb, exact=0.45 / 16 + 0.15 * np.eye(16), within=1e-3)


def as_mesh(cell, width):
    """Make an extruded cell one period wide in x and write it as OBJ text."""
    v = cell.vertices * [width / 2, 1, 1]
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in v]
    return "\n".join([*lines, *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in cell.faces)])


def test_a_mesh_gives_what_the_same_cross_section_gives(tmp_path, same):
    (tmp_path / "film.obj").write_text(as_mesh(unit_cell(recipe(SAWTOOTH)), 0.3))
    film = {
        "kind": "mesh", "file": str(tmp_path / "film.obj"), "period": [0.3, 0.5],
        "material": {"type": "dielectric", "n": 1.49},
    }  # fmt: skip
    a = replicates(SAWTOOTH, ("tb", "rf"), depth=2, samples=4096)
    b = replicates(film, ("tb", "rf"), seeds=range(4, 8), depth=2, samples=4096)
    for x, y in zip(a, b, strict=True):
        same(x, other=y, within=5e-3)


def test_rank_three_turns_with_the_light():
    file = gonio.measure(recipe(SLAB), depth=5, rank=3, samples=8192, percent=50)
    tree = file.components["tb"]
    assert (tree.value[~tree.live] == 0).all()
    for azimuth in (10, 100, 250):
        for theta in (5, 35, 55):
            th, az = np.radians(theta), np.radians(azimuth)
            d = np.array([[np.sin(th) * np.cos(az), np.sin(th) * np.sin(az), np.cos(th)]])
            total = file.hemispherical(-d)[0]
            ring = (np.floor(16 * np.sin(th)) + 0.5) / 16  # T is the mean over a ring of 1/16
            mean = slab(np.array([0, 0, np.sqrt(1 - ring**2)]))[0]
            assert total == pytest.approx(mean, abs=0.015)  # four standard errors
            # Straight on is the border of two cells, which share the light.
            assert file.query(-d, d) == pytest.approx(total / 2 / (np.pi / 1024), rel=0.03)
            assert file.query(-d, d * [-1, -1, 1]) < 0.01


def test_the_same_seed_gives_the_same_and_progress_ends_at_one():
    seen = []
    r = recipe(SAWTOOTH)
    a = gonio.expose(r, depth=2, samples=64, seed=3, progress=seen.append)
    b = gonio.expose(r, depth=2, samples=64, seed=3)
    c = gonio.expose(r, depth=2, samples=64, seed=4)
    assert all((a.halves[k] == b.halves[k]).all() for k in a.halves)
    assert (a.halves["tb"] != c.halves["tb"]).any()
    assert seen == sorted(seen)
    assert seen[-1] == 1


def test_halves_scatter_no_more_than_the_standard_errors_say():
    e = gonio.expose(recipe(SAWTOOTH), depth=3, samples=8192)
    half = (e.halves["tb"][0] - e.halves["tb"][1]) / 2
    well_hit = e.shares("tb") > 0.01
    z = half[well_hit] / e.errors("tb")[well_hit]
    assert well_hit.sum() > 200
    assert 0.2 < np.sqrt((z**2).mean()) < 1.1


def peaked(rng, depth=3):
    """Counts of a flat background with one peak, as a full tree of rank 4."""
    n = 1 << depth
    grid = rng.poisson(20.0, (n,) * 4).astype(float)
    grid[1, 2, 5, 5] = 5000
    return TensorTree.of_grid(grid)


def test_merging_keeps_totals_and_what_is_significant():
    tree = peaked(np.random.default_rng(1))
    merged = merge(tree, percent=0, unit=1.0)
    assert len(merged) < 400
    assert merged.value.max() == 5000
    volume = 16.0 ** (merged.depth - merged.level)
    assert volume.sum() == len(tree)
    assert (merged.value * volume).sum() == pytest.approx(tree.value.sum(), rel=1e-12)
    assert (np.diff(merged.start) == volume[:-1]).all()
    kept = merge(tree, percent=0)  # neighbours are never equal here
    assert len(kept) == len(tree)
    assert len(merge(tree, percent=100)) == 1
    half = merge(tree, percent=50)
    assert 0.3 * len(tree) < len(half) < 0.54 * len(tree)


def test_merged_incidences_send_out_no_more_than_all_light():
    prism = recipe(SLAB | {"polygons": [[[0, 0], [0.5, 0], [1, 0.5], [0.5, 1], [0, 1]]]})
    coarse = {"depth": 3, "rank": 4, "samples": 256}
    gone = gonio.expose(prism, **coarse)
    of_side = [merge(gone.tree(name), percent=90, unit=gone.unit) for name in ("tf", "rf")]
    assert sum_of_albedos(of_side).max() > 1.05  # which any case would refuse
    file = gonio.measure(prism, **coarse)
    for side in "fb":
        components = [file.components[f"{kind}{side}"] for kind in "tr"]
        assert sum_of_albedos(components).max() <= 1.02
    assert file.notes[2] == "90 % of the merges would send out more than all light"
    assert "% of the merges" in file.notes[0]
    assert len(gonio.measure(prism, depth=4, rank=4, samples=1024, percent=50).notes) == 2


def test_a_file_reads_back_equal(tmp_path):
    r = recipe(SAWTOOTH, name="a < b & -- c\x0b", manufacturer='"x"')
    for rank in (3, 4):
        file = gonio.measure(r, depth=3, rank=rank, samples=256)
        gonio.save(file, tmp_path / "film.xml", thickness=1e-3)
        back = bsdf_file.read(tmp_path / "film.xml")
        assert (back.name, back.manufacturer) == ("a < b & -- c", '"x"')
        assert back.kind == file.kind == f"TensorTree{rank}"
        assert list(back.components) == ["tf", "rf", "tb", "rb"]
        for name, tree in file.components.items():
            read = back.components[name]
            np.testing.assert_array_equal(read.value, tree.value)
            np.testing.assert_array_equal(read.level, tree.level)
            shift = rank * (tree.depth - read.depth)
            np.testing.assert_array_equal(read.start << shift, tree.start)
    assert [p.name for p in tmp_path.iterdir()] == ["film.xml"]


def test_nothing_is_left_of_a_file_that_cannot_be_written(tmp_path):
    file = gonio.measure(recipe(SLAB), depth=1, samples=64)
    with pytest.raises(InputError, match="folder"):
        gonio.save(file, tmp_path / "no" / "film.xml")
    (tmp_path / "taken").mkdir()
    with pytest.raises(InputError, match="taken"):
        gonio.save(file, tmp_path / "taken")
    assert [p.name for p in tmp_path.iterdir()] == ["taken"]


WRONG = {
    "index": ('kind = "prism"\nn=0.9\nperiod=1\npolygons=[[[0,0],[1,0],[0,1]]]', "n: got 0.9"),
    "kind": ('kind = "prsim"', "kind"),
    "key": ('kind = "slots"\nn=1.5\nperiod=1\nthickness=1\nslot=0.1\ndepht=1', "depht"),
    "slot": ('kind = "slots"\nn=1.5\nperiod=1\nthickness=1\nslot=1.1\ndepth=1', "not below"),
    "depth": ('kind = "slots"\nn=1.5\nperiod=1\nthickness=1\nslot=0.1\ndepth=2', "above the thick"),
    "nan": ('kind = "lamellae"\nperiod=nan\nwidth=1\nreflectance=0.5', "period"),
    "crossing": (
        'kind = "prism"\nn=1.5\nperiod=9\npolygons = [[[0,0],[1,1],[1,0],[0,1]]]', "crosses itself",
    ),
    "overlap": (
        'kind = "prism"\nn=1.5\nperiod=0.5\npolygons = [[[0,0],[1,0.5],[0,1]]]', "its repetition",
    ),
    "huge": ('kind = "prism"\nn=1.5\nperiod=0.001\npolygons=[[[0,0],[1,0],[0,1]]]', "1000 per"),
    "missing": (
        'kind = "mesh"\nfile="no.ply"\nperiod=[1,1]\nmaterial={type="dielectric",n=1.5}', "no.ply",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_recipe_gives_one_line(tmp_path, case):
    text, expected = WRONG[case]
    (tmp_path / "r.toml").write_text(f"[structure]\n{text}\n")
    with pytest.raises(InputError) as error:
        unit_cell(gonio.load_recipe(tmp_path / "r.toml"))
    message = str(error.value)
    assert expected in message
    assert "\n" not in message
    assert str(tmp_path) in message


def test_glass_must_stand_apart_and_keep_energy():
    with pytest.raises(InputError, match=r"glass\.distance"):
        unit_cell(recipe(SLAB, glass={"transmittance": 0.6, "distance": 0.001}))
    with pytest.raises(InputError, match="above 1"):
        recipe(SLAB, glass={"transmittance": 0.6, "reflectance": 0.5})


@pytest.mark.parametrize(
    "options", [{"depth": 9}, {"rank": 2}, {"samples": 0}, {"seed": -1}, {"percent": 101}]
)
def test_wrong_arguments_are_refused(options):
    with pytest.raises(InputError, match=next(iter(options))):
        gonio.measure(recipe(SLAB), **options)


def ply(form):
    """Two triangles as PLY bytes."""
    points = [(0, 0, 0.5), (1, 0, 0), (1, 2, 0), (0, 2, 0)]
    faces = [(0, 1, 2), (0, 2, 3)]
    head = (
        f"ply\nformat {form} 1.0\ncomment made by hand\nelement vertex 4\nproperty float x\n"
        "property double y\nproperty float z\nelement face 2\n"
        "property list uchar int vertex_indices\nend_header\n"
    ).encode()
    if form == "ascii":
        body = "\n".join(" ".join(map(str, p)) for p in [*points, *((3, *f) for f in faces)])
        return head + body.encode()
    order = "<" if form == "binary_little_endian" else ">"
    body = [struct.pack(f"{order}fdf", *p) for p in points]
    return head + b"".join([*body, *(struct.pack(f"{order}B3i", 3, *f) for f in faces)])


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_files_are_read(tmp_path, form):
    (tmp_path / "m.ply").write_bytes(ply(form))
    vertices, faces = read_mesh(tmp_path / "m.ply")
    assert vertices.tolist() == [[0, 0, 0.5], [1, 0, 0], [1, 2, 0], [0, 2, 0]]
    assert faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    cut = ply(form)[:-8]
    (tmp_path / "m.ply").write_bytes(cut)
    with pytest.raises(InputError, match=r"fewer than 2|cut short"):
        read_mesh(tmp_path / "m.ply")


@pytest.mark.parametrize("name", ["m.ply", "m.obj"])
def test_polygons_are_cut_into_triangles(tmp_path, name):
    corners = [(0, 0), (4, 0), (4, 4), (2, 1), (0, 4)]  # concave: a fan from the first is wrong
    rings = [[0, 1, 2, 3, 4], [0, 1, 2, 5], [0, 1, 2]]
    points = [(x, y, 0.0) for x, y in [*corners, (0, 4)]]
    if name == "m.obj":
        lines = [f"v {x} {y} {z}" for x, y, z in points]
        lines += ["f " + " ".join(str(i + 1) for i in ring) for ring in rings]
    else:
        lines = ["ply", "format ascii 1.0", f"element vertex {len(points)}"]
        lines += [f"property double {axis}" for axis in "xyz"] + [f"element face {len(rings)}"]
        lines += ["property list uchar int vertex_indices", "end_header"]
        lines += [" ".join(map(str, p)) for p in points]
        lines += [" ".join(map(str, [len(ring), *ring])) for ring in rings]
    (tmp_path / name).write_text("\n".join(lines) + "\n")
    vertices, faces = read_mesh(tmp_path / name)
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    assert (normals[:, 2] > 0).all()
    assert len(faces) == 3 + 2 + 1
    assert normals[:, 2].sum() / 2 == pytest.approx(10 + 16 + 8)


UNFIT = {
    "a.ply": b"ply\nformat ascii 1.0\nelement vertex 999999999999\nproperty float x\n"
    b"property float y\nproperty float z\nelement face 1\n"
    b"property list uchar int vertex_indices\nend_header\n0 0 0\n",
    "b.ply": b"not a mesh",
    "c.obj": b"v 0 0\nf 1 1 1",
    "d.obj": b"v 0 0 0\nf 1 2 3",
    "e.obj": b"v 0 0 nan\nf 1 1 1",
    "f.obj": b"",
    "g.stl": b"solid",
    "h.obj": b"v a b c",
    "i.ply": ply("ascii").replace(b"3 0 1 2", b"4 0 1 2"),
}


@pytest.mark.parametrize("name", UNFIT)
def test_unfit_meshes_give_one_line(tmp_path, name):
    (tmp_path / name).write_bytes(UNFIT[name])
    with pytest.raises(InputError, match=name) as error:
        read_mesh(tmp_path / name)
    assert "\n" not in str(error.value)


def test_a_clear_mesh_must_be_closed_and_face_outward(tmp_path):
    cell = unit_cell(recipe(SAWTOOTH))
    film = {
        "kind": "mesh", "file": str(tmp_path / "m.obj"), "period": [2, 0.5],
        "material": {"type": "dielectric", "n": 1.49},
    }  # fmt: skip
    (tmp_path / "m.obj").write_text(as_mesh(replace(cell, faces=cell.faces[:, ::-1]), 2))
    with pytest.raises(InputError, match="inward"):
        unit_cell(recipe(film))
    (tmp_path / "m.obj").write_text(as_mesh(replace(cell, faces=cell.faces[:2]), 2))
    with pytest.raises(InputError, match="not closed"):
        unit_cell(recipe(film))


def toward(elevation, azimuth):
    """Direction in which light of the sun travels, by elevation and azimuth from the normal."""
    e, a = np.radians(elevation), np.radians(azimuth)
    return np.array([np.cos(e) * np.sin(a), -np.sin(e), np.cos(e) * np.cos(a)])


def test_the_shipped_film_sends_the_sun_up_and_shows_no_image_of_it():
    tb = bsdf_file.read(FILMS / "prism.xml").components["tb"]
    u = (np.arange(32) + 0.5) / 32
    out = to_direction(*np.meshgrid(u, u, indexing="ij")).reshape(-1, 3)
    for elevation in range(25, 61, 5):
        for azimuth in (-45, -20, 0, 20, 45):
            d = toward(elevation, azimuth)
            share = tb.values(np.broadcast_to(-d, out.shape), out) * np.pi / 1024
            assert share.sum() > 0.45
            assert share[out[:, 1] > 0].sum() > 0.85 * share.sum()
            assert share[out @ d > np.cos(np.radians(8))].sum() < 0.03 * share.sum()


def test_the_shipped_film_is_what_its_recipe_gives():
    r = gonio.load_recipe(FILMS / "prism.toml")
    shipped = bsdf_file.read(FILMS / "prism.xml")
    e = gonio.expose(r, depth=5, samples=512, seed=9)
    assert list(shipped.components) == ["tf", "rf", "tb", "rb"]
    for name, tree in shipped.components.items():
        albedo = tree.albedos()
        measured = e.hemispherical(name).mean(axis=0)
        x, y = (a.ravel() for a in np.meshgrid(*[(np.arange(32) + 0.5) / 32] * 2, indexing="ij"))
        at = tree.hemispherical(-to_direction(x, y))
        assert albedo.mean() == pytest.approx(measured.mean(), abs=2e-3)
        assert np.sqrt(((at - measured) ** 2).mean()) < 0.02
