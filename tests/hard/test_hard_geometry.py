"""Geometry that rounding, units or slips of the pen spoil: it is right, or refused in one line."""

import json

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.annual import simulation
from drcmitsuba.case.case import Case
from drcmitsuba.case.reading import load_case
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene import scene
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.rays.bsdf_lookup import number

SUNS = Suns(("sun_a", "sun_b"), np.array([[0, -0.6, 0.8], [0.6, 0, 0.8]]))
FEW = {"replicates": 2, "paths": 32, "sensor_sky_rays": 256, "photons": 256, "cell_sky_rays": 16}
UTM = (500_000.0, 4_649_776.0, 0.0)


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


@pytest.fixture
def refused(tmp_path):
    """Text of a case, and what its one line has to say."""

    def refused(text, *words):
        file = tmp_path / "case.toml"
        file.write_text(text, encoding="utf-8")
        with pytest.raises(InputError) as caught:
            scene.load(load_case(file))
        line = str(caught.value)
        assert "\n" not in line
        assert line.startswith(str(tmp_path)), line
        for word in words:
            assert word in line, line

    return refused


def coefficients(case, sensors=None):
    return simulation.transport(case, "open", SUNS, 45.0)


def difference(a, b):
    """Largest difference of two sets of replicates over their largest entry."""
    a, b = (x["replicates"].values.astype(float) for x in (a, b))
    return abs(a - b).max() / a.max()


# --- coordinates of a map


def street(start=(0.0, 0.0, 0.0), **changes):
    """Sensors in the open beside a house and a bench."""
    x, y, z = start
    house = {"name": "house", "corner": [x - 2, y + 6, z], "size": [8, 3, 5.5], "reflectance": 0.6}
    bench = {"name": "bench", "corner": [x + 0.5, y + 0.5, z + 0.2], "size": [1.6, 0.8, 0.04]}
    return Case.model_validate(
        {
            "sensors": {"corner": [x + 0.3, y + 0.2, z + 0.5], "count": [3, 3], "spacing": 1.0},
            "furniture": [house, bench],
            "accuracy": FEW,
            **changes,
        }
    )


@pytest.mark.parametrize(
    "start", [UTM, (500_000.0, 4_649_776.0, 1609.0), (-20_037_508.0, 9_999_999.0, -430.0)]
)
def test_scene_on_a_map(holds, start):
    """Float32 has steps of half a metre there, and Mitsuba starts rays 400 m off a surface."""
    here, there = coefficients(street()), coefficients(street(start))
    holds("C = C at the origin, over its largest entry", difference(here, there), 1e-5)
    names = ("x", "y", "z")
    moved = [there[k].values - here[k].values - start[i] for i, k in enumerate(names)]
    holds("places of the sensors [m]", abs(np.array(moved)), 1e-8)


def write_obj(path, vertices, faces):
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.asarray(vertices, float).tolist()]
    lines += ["f " + " ".join(str(i + 1) for i in face) for face in np.asarray(faces).tolist()]
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def cube(low, size):
    """Vertices and outward triangles of a cube."""
    corners = np.array([[i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1)]) * size + low
    sides = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return corners, np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))])


def with_mesh(file, material="silver", room=True, **changes):
    """A mesh in a room with an open side, or under the free sky."""
    opening = {"strips": [{"bottom": 0.5, "top": 2.5, "material": "open"}]}
    tables = {"room": {"size": [4, 4, 3]}, "facade": {"south": opening}} if room else {}
    return Case.model_validate(
        {
            **tables,
            "materials": {
                "silver": {"type": "mirror", "reflectance": 0.9},
                "glass": {"type": "dielectric", "ior": 1.5},
            },
            "components": {"thing": {"type": "mesh", "file": str(file), "material": material}},
            "sensors": {"corner": [0.3, 0.2, 0.5], "count": [3, 3], "spacing": 1.1},
            "accuracy": FEW,
            **changes,
        }
    )


def moved(case, **changes):
    thing = case.components["thing"].model_copy(update=changes)
    return case.with_tables(components={"thing": thing})


@pytest.mark.parametrize("turn", [0.0, 90.0])
def test_mesh_of_a_map_in_a_room(holds, tmp_path, turn):
    """`position` brings vertices of a map back: the sum is one of doubles."""
    low = np.array([1.3, 1.2, 1.4])
    near = write_obj(tmp_path / "near.obj", *cube(low, 0.5))
    far = write_obj(tmp_path / "far.obj", *cube(low + UTM, 0.5))
    x, y, z = -np.array(UTM)
    back = (x, y, z) if turn == 0 else (y, -x, z)  # clockwise, about the file's origin
    home = (0.0, 0.0, 0.0) if turn == 0 else (0.0, 3.0, 0.0)
    here = moved(with_mesh(near), rotation=turn, position=home)
    there = moved(with_mesh(far), rotation=turn, position=tuple(np.add(back, home).tolist()))
    a, b = coefficients(here), coefficients(there)
    assert a["replicates"].max() > 0
    holds("C = C of the mesh at the origin, over its largest entry", difference(a, b), 1e-5)


def test_mesh_and_sensors_on_a_map(holds, tmp_path):
    """Ports around a mesh stand 1 mm off it: nothing at these coordinates but in doubles."""
    low = np.array([0.8, 0.9, 0.9])
    near = write_obj(tmp_path / "near.obj", *cube(low, 0.5))
    far = write_obj(tmp_path / "far.obj", *cube(low + UTM, 0.5))
    sensors = {"count": [3, 3], "spacing": 1.1}
    here = with_mesh(near, room=False, sensors={"corner": [0.25, 0.25, 0.5], **sensors})
    corner = [UTM[0] + 0.25, UTM[1] + 0.25, 0.5]
    there = with_mesh(far, room=False, sensors={"corner": corner, **sensors})
    a, b = coefficients(here), coefficients(there)
    assert json_emitted(a) > 0
    holds("C = C at the origin, over its largest entry", difference(a, b), 1e-5)


def json_emitted(data):
    return sum(ledger["emitted"] for ledger in json.loads(data.attrs["photons"]).values())


ROOM = "[room]\nsize = [4.0, 5.0, 3.0]\n[sensors]\ncorner = [1.0, 1.0, 0.8]\ncount = [2, 2]\n"
MESH = (
    "[materials.silver]\ntype = 'mirror'\nreflectance = 0.9\n[components.thing]\ntype = 'mesh'\n"
    "material = 'silver'\nfile = '{}'\n"
)


def test_mesh_on_a_map_in_a_room_is_far_away(refused, tmp_path):
    file = write_obj(tmp_path / "far.obj", *cube(np.array(UTM), 0.5))
    refused(ROOM + MESH.format(file), "components.thing.position: it lies 4650 km", "one origin")
    refused(ROOM + "[[furniture]]\ncorner = [500000, 4649776, 0]\nsize = [1.0, 1.0, 1.0]\n",
            "furniture.0: it lies 4650 km from the room's corner")  # fmt: skip


def test_mesh_that_its_file_has_rounded(refused, tmp_path):
    """Half a metre is lost before anybody reads the file: no arithmetic brings it back."""
    vertices, faces = cube(np.array(UTM), 0.5)
    file = tmp_path / "far.ply"
    head = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 8\nproperty float x\n"
        "property float y\nproperty float z\nelement face 12\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    rows = np.zeros(12, [("n", "u1"), ("i", "<i4", (3,))])
    rows["n"], rows["i"] = 3, faces
    file.write_bytes(head.encode() + vertices.astype("<f4").tobytes() + rows.tobytes())
    position = "position = [-500000.0, -4649776.0, 0.0]\n"
    message = "its floats are rounded to 0.5 at 4649776; write doubles"
    refused(ROOM + MESH.format(file) + position, str(file), message)


# --- millimetres


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (ROOM.replace("4.0, 5.0, 3.0", "8800, 9050, 3630"),
         ("room.size: 8800 × 9050 × 3630 m looks like millimetres; divide all", 'unit = "m"')),
        (ROOM.replace("4.0, 5.0, 3.0", "12000.0, 9050.0, 3630.0"), ("looks like millimetres",)),
        (ROOM.replace("4.0, 5.0, 3.0", "1900, 1900, 1900"), ("looks like millimetres",)),
        (ROOM.replace("4.0, 5.0, 3.0", "880, 905, 363"), ("looks like centimetres", "by 100")),
        (ROOM.replace("4.0, 5.0, 3.0", "8800, 9050, 3.63"), ("looks like millimetres",)),
        (ROOM + "[[furniture]]\ncorner = [1200, 1200, 700]\nsize = [1600, 800, 40]\n",
         ("furniture.0: 1600 × 800 × 40 m at 1200 × 1200 × 700 m looks like", 'unit = "m"')),
        (ROOM + "[[furniture]]\ncorner = [500, 500, 900]\nsize = [800, 600, 0]\n",
         ("furniture.0", "looks like millimetres")),
        ("[sensors]\ncorner = [0, 0, 0]\ncount = [4, 4]\nspacing = 300\n",
         ("sensors.spacing: 300 m looks like millimetres",)),
    ],
)  # fmt: skip
def test_millimetres_given_as_metres_are_asked_about(refused, tmp_path, text, words):
    refused(text, *words)
    file = tmp_path / "insists.toml"
    file.write_text('unit = "m"\n' + text, encoding="utf-8")
    assert load_case(file).unit == "m"


@pytest.mark.parametrize(
    "text",
    [
        ROOM.replace("4.0, 5.0, 3.0", "700.0, 1000.0, 110.0"),  # larger than any hall
        ROOM.replace("4.0, 5.0, 3.0", "0.3, 0.2, 0.1").replace("0.8]", "0.05]"),  # a model
        ROOM + "[[furniture]]\ncorner = [-500, -900, -0.1]\nsize = [1000, 2000, 0]\n",  # ground
        ROOM + "[[furniture]]\ncorner = [-9000, -8000, 0]\nsize = [9000, 500, 300]\n",  # a hill
        ROOM + "[[furniture]]\ncorner = [20, 30, 0]\nsize = [60, 20, 25]\n",  # a house
    ],
)
def test_large_things_that_there_are_pass_unasked(tmp_path, text):
    file = tmp_path / "case.toml"
    file.write_text(text, encoding="utf-8")
    assert load_case(file).unit is None


def test_mesh_in_millimetres_is_asked_about(refused, tmp_path):
    file = write_obj(tmp_path / "mm.obj", *cube(np.array([1000.0, 1000.0, 1000.0]), 700.0))
    text = ROOM + MESH.format(file)
    refused(text, "components.thing.scale: the mesh is 700 × 700 × 700 m", "give scale = 0.001")
    file = tmp_path / "case.toml"
    file.write_text(text + "scale = 0.001\n", encoding="utf-8")
    assert len(scene.load(load_case(file)).ports) == 6


# --- surfaces that share a plane


def hits(case, origin, towards):
    """Names of the surfaces that rays from a point meet first."""
    world = scene.load(case)
    d = towards - np.asarray(origin, float)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    ray = mi.Ray3f(mi.Point3f(*map(float, origin)), mi.Vector3f(*d.T.astype(np.float32)))
    hit = np.array(number(world.full.ray_intersect(ray).bsdf()))
    numbers = [int(number(mi.BSDFPtr(part.bsdf))[0]) for part in world.parts]
    assert dr.width(ray.d) == len(hit)
    return hit, {part.material: n for part, n in zip(world.parts, numbers, strict=True)}


FACADE = {"strips": [{"bottom": 0.9, "top": 2.0, "material": "glass"}]}
GLASS = {"glass": {"type": "glazing", "transmittance": 0.7, "reflectance": 0.1}}


def house(*furniture, **changes):
    return Case.model_validate(
        {
            "room": {"size": [4, 5, 3], "floor": 0.2, "walls": 0.5, "ceiling": 0.8},
            "facade": {"south": FACADE},
            "materials": GLASS,
            "furniture": [{"name": f"piece {i}", **f} for i, f in enumerate(furniture)],
            "sensors": {"corner": [0.5, 0.5, 0.8], "count": [2, 2], "spacing": 1.2},
            "accuracy": FEW,
            **changes,
        }
    )


@pytest.mark.parametrize(
    ("piece", "axis", "at"),
    [
        ({"corner": [-1, -1.5, 2.2], "size": [6, 1.5, 0.2]}, 1, 0.0),  # a roof over the window
        ({"corner": [0.5, -0.7, 0.5], "size": [3, 0.7, 1.2]}, 1, 0.0),  # a box before the glass
        ({"corner": [4, 1, 0.5], "size": [1, 2, 2]}, 0, 4.0),  # a chimney on the east side
        ({"corner": [-20, -20, -0.5], "size": [50, 50, 0.5]}, 2, 0.0),  # a terrace
        ({"corner": [-20, -20, 0], "size": [50, 50, 0]}, 2, 0.0),  # a ground without depth
        ({"corner": [1, 1, 3], "size": [1, 1, 1]}, 2, 3.0),  # a plant on the roof
        ({"corner": [-1, -1, 3], "size": [6, 7, 0]}, 2, 3.0),  # a roof without depth
    ],
)
def test_what_stands_against_the_room_is_not_seen_in_its_walls(holds, piece, axis, at):
    """Wall and balcony in one plane: which of the two a ray met was a matter of rounding."""
    case = house({**piece, "reflectance": 1.0})
    rng, size = np.random.default_rng(1), np.array([4, 5, 3])
    points = rng.uniform(0.01, 0.99, (4000, 3)) * size
    points[:, axis] = at
    hit, materials = hits(case, size / 2, points)
    outside = [n for m, n in materials.items() if getattr(m, "reflectance", None) == 1.0]
    assert len(outside) == 1
    holds("rays that meet it in the plane of the wall", (hit == outside[0]).mean(), 0)


def test_panes_before_a_box_are_met_first_and_the_box_is_met_behind_them(holds):
    """The face behind the glass moves into its body, which stays opaque."""
    case = house({"corner": [-0.5, -0.7, 0.5], "size": [5, 0.7, 1.8], "reflectance": 0.0})
    C = coefficients(case)
    holds("light through a window that is built up: C", C["replicates"].max(), 0)


def test_cupboard_flush_with_wall_and_floor(same, holds):
    """Its faces share planes with theirs and look the other way: as good as sunk into them."""
    flush = {"corner": [0, 3, 0], "size": [1, 2, 3], "reflectance": 0.9}
    sunk = {"corner": [-0.1, 3, -0.1], "size": [1.1, 2.1, 3.2], "reflectance": 0.9}
    fine = FEW | {"replicates": 12, "paths": 256, "cell_size": 0.3, "cell_sky_rays": 256}
    a, b = (coefficients(house(piece, accuracy=fine)) for piece in (flush, sunk))
    a, b = (x["replicates"].values.sum(axis=-1, dtype=float) for x in (a, b))
    same(a, other=b, within=0.01)
    a, b = a.mean(axis=1), b.mean(axis=1)
    error = np.hypot(a.std(ddof=1), b.std(ddof=1)) / 12**0.5
    holds("ΣC = ΣC of one that is sunk in, in standard errors", abs(a.mean() - b.mean()) / error, 4)


@pytest.mark.parametrize(
    ("furniture", "words"),
    [
        ("[[furniture]]\nname = 'carpet'\ncorner = [1, 1, 0]\nsize = [2, 2, 0]\n",
         ("furniture.0: 'carpet' lies in the plane of the floor; move it 1 mm",)),
        ("[[furniture]]\nname = 'sail'\ncorner = [1, 1, 3]\nsize = [2, 2, 0]\n",
         ("'sail' lies in the plane of the ceiling",)),
        ("[[furniture]]\nname = 'desk'\ncorner = [1, 1, 0.7]\nsize = [2, 1, 0.04]\n"
         "[[furniture]]\nname = 'paper'\ncorner = [1.2, 1.2, 0.74]\nsize = [0.3, 0.2, 0]\n"
         "reflectance = 0.9\n",
         ("furniture.1: 'paper' and 'desk' share the plane z = 0.74 m",)),
        ("[[furniture]]\nname = 'desk'\ncorner = [1, 1, 0.7]\nsize = [2, 1, 0.04]\n"
         "[[furniture]]\nname = 'leg'\ncorner = [1, 1, 0]\nsize = [0.1, 0.1, 0.74]\n"
         "reflectance = 0.9\n", ("share the plane",)),
    ],
)  # fmt: skip
def test_what_would_be_seen_in_two_ways_is_refused(refused, furniture, words):
    refused(ROOM + furniture, *words)


@pytest.mark.parametrize("z", [0.001, 0.0011])
def test_carpet_of_a_millimetre(z):
    """As the line above says: 1 mm is enough, at the corner and 10 m from it."""
    plate = {"corner": [9, 9, z], "size": [1, 1, 0], "reflectance": 1.0}
    case = house(plate, room={"size": [12, 12, 3]}, facade={})
    target = np.random.default_rng(0).uniform([9.01, 9.01, z], [9.99, 9.99, z], (2000, 3))
    hit, materials = hits(case, [0.5, 0.5, 2.9], target)
    plates = [n for m, n in materials.items() if getattr(m, "reflectance", None) == 1.0]
    assert (hit == plates[0]).all()


def test_mesh_in_the_plane_of_a_pane(refused, tmp_path):
    square = np.array([[1.0, 0, 1], [2, 0, 1], [2, 0, 2], [1, 0, 2]])
    file = write_obj(tmp_path / "plate.obj", square, [[0, 1, 2], [0, 2, 3]])
    facade = "[facade.south]\nstrips = [{ bottom = 0.9, top = 2.5, material = 'open' }]\n"
    refused(ROOM + facade + MESH.format(file), "lie in the plane of the south wall", "5 mm off")
    on_floor = write_obj(tmp_path / "cube.obj", *cube(np.array([1.0, 1, 0]), 0.5))
    case = with_mesh(on_floor)
    assert scene.load(case).ports  # a mirror may stand on the floor
    with pytest.raises(InputError, match="in the plane of the floor"):
        scene.load(with_mesh(on_floor, "glass"))  # nothing parts its underside from the floor


# --- sensors and desks


DESK = {"corner": [0.4, 0.4, 0.7], "size": [1.6, 1.4, 0.04], "reflectance": 0.9}


@pytest.mark.parametrize("above", [-0.04, -0.02, 0.0, 0.0009])
def test_sensors_on_and_in_desks_are_refused(above):
    sensors = {"corner": [0.5, 0.5, 0.74 + above], "count": [2, 2], "spacing": 0.5}
    with pytest.raises(InputError, match="lies in or on 'piece 0'"):
        sensor_points(house(DESK, sensors=sensors))


def test_a_millimetre_above_a_desk_is_one_in_any_decimals():
    """0.7 + 0.04 + 0.001 is 0.741 in some sums of binary fractions and not in others."""
    for z in np.arange(300, 1300) / 1000:
        desk = {**DESK, "corner": [0.4, 0.4, float(z)]}
        top = round(float(z) + 0.04 + 0.001, 6)
        sensors = {"corner": [0.5, 0.5, top], "count": [1, 1], "spacing": 0.5}
        sensor_points(house(desk, sensors=sensors))


def test_sensor_1_mm_above_a_desk_does_not_see_it(holds):
    """A desk 1.1 mm below a sensor that looks up: under the free sky it might as well not be."""
    sensors = {"corner": [0.5, 0.5, 0.7411], "count": [2, 2], "spacing": 0.5}
    opposite = {"corner": [-3, 4, 0], "size": [9, 2, 6], "reflectance": 0.5}
    far = {"room": None, "facade": {}, "sensors": sensors}
    bare, with_desk = (coefficients(house(*f, **far)) for f in ([opposite], [opposite, DESK]))
    straight = abs(bare["direct"].values - with_desk["direct"].values)
    holds("D = D without the desk, over its largest entry", straight / bare["direct"].values.max(),
          1e-6)  # fmt: skip


def test_sensor_1_mm_above_a_desk_reads_the_limit(same, holds):
    """In a room the desk is part of it: 1.1 and 0.001 + 1 mm above it E is the same."""
    fine = FEW | {"replicates": 12, "paths": 256, "sensor_sky_rays": 1024}
    sums = []
    for above in (0.001, 0.0011):
        sensors = {"corner": [0.5, 0.5, 0.74 + above], "count": [2, 2], "spacing": 0.5}
        C = coefficients(house(DESK, sensors=sensors, accuracy=fine))
        sums.append(C["replicates"].values.sum(axis=-1, dtype=float))
    same(sums[0], other=sums[1], within=0.01)
    # The same random numbers: what is left is 0.1 mm of height, 10⁻⁴ of what is about.
    holds("ΣC at 1.1 mm = ΣC at 1 mm", abs(sums[0].mean() / sums[1].mean() - 1), 1e-3)


# --- meshes with faults


def test_triangles_without_area_change_nothing(holds, tmp_path):
    vertices, faces = cube(np.array([1.3, 1.2, 1.4]), 0.5)
    middle = vertices[[0, 1]].mean(axis=0)
    more = np.vstack([vertices, middle, vertices[0], vertices[0]])
    bad = [[0, 1, 8], [2, 2, 3], [4, 4, 4], [0, 9, 10]]  # on a line, twice one, a point, repeated
    good = coefficients(with_mesh(write_obj(tmp_path / "good.obj", vertices, faces)))
    worse = coefficients(with_mesh(write_obj(tmp_path / "bad.obj", more, np.vstack([faces, bad]))))
    assert json_emitted(good) > 0
    holds("C = C without them, over its largest entry", difference(good, worse), 1e-5)


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        ([[0, 0, 0], [1, 0, 0], [0, float("nan"), 0]], [[0, 1, 2]], "that is no number"),
        ([[0, 0, 0], [1, 0, 0], [0, float("inf"), 0]], [[0, 1, 2]], "that is no number"),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], "its triangles have no area"),
        ([[1, 1, 1], [1, 1, 1], [1, 1, 1]], [[0, 1, 2]], "its triangles have no area"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 3]], "a corner that is none of the 3 vertices"),
    ],
)  # fmt: skip
def test_unfit_meshes_are_refused(tmp_path, vertices, faces, message):
    file = write_obj(tmp_path / "bad.obj", vertices, faces)
    with pytest.raises(InputError, match=message) as caught:
        scene.load(with_mesh(file))
    assert str(file) in str(caught.value)


def test_flipped_normals_of_a_mirror_change_nothing(holds, tmp_path):
    """Which side is out follows from the volume; sensors and cells within are none either way."""
    vertices, faces = cube(np.array([1.3, 1.2, 1.4]), 0.5)
    out = coefficients(with_mesh(write_obj(tmp_path / "out.obj", vertices, faces)))
    inward = coefficients(with_mesh(write_obj(tmp_path / "in.obj", vertices, faces[:, ::-1])))
    holds("C = C with outward normals, over its largest entry", difference(out, inward), 1e-5)


def test_flipped_normals_of_a_clear_solid_and_ports_are_refused(tmp_path):
    vertices, faces = cube(np.array([1.3, 1.2, 1.4]), 0.5)
    with pytest.raises(InputError, match="the normals point inward; turn the faces over"):
        scene.load(with_mesh(write_obj(tmp_path / "in.obj", vertices, faces[:, ::-1]), "glass"))
    some = np.vstack([faces[:5], faces[5:, ::-1]])
    with pytest.raises(InputError, match="disagree on which side is out"):
        scene.load(with_mesh(write_obj(tmp_path / "some.obj", vertices, some), "glass"))
    port = ((1.3, 1.1, 1.4), (1.8, 1.1, 1.4), (1.8, 1.1, 1.9), (1.3, 1.1, 1.9))
    case = with_mesh(write_obj(tmp_path / "out.obj", vertices, faces))
    with pytest.raises(InputError, match="leads away from the mesh; give its corners in the other"):
        scene.load(moved(case, ports=(port,)))
    assert scene.load(moved(case, ports=(port[::-1],))).ports
