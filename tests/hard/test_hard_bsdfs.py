"""BSDFs at their limits: a single cell, nothing at all, too much, one way only, grazing light."""

import json

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import xarray as xr
from drcmitsuba_plugins import bsdf_file
from drcmitsuba_plugins.bsdf_file import Swapped
from drcmitsuba_plugins.klems_basis import BASES
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.tensor import to_direction, to_disk, to_square

from drcmitsuba import InputError
from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.materials import BsdfMaterial
from drcmitsuba.plan import notes
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.materials import film
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute
from tests.hard.mutations import toml
from tests.unit.plugins.test_measured import (
    IMPORTANCE,
    RADIANCE,
    as_vector,
    draw,
    interaction,
    write,
    xml,
)

MODES = pytest.mark.parametrize("mode", [RADIANCE, IMPORTANCE], ids=["radiance", "importance"])
BINS = len(Patches())
FLOAT = 1e-5
"""Float32 and the 5 to 7 digits of a file's text."""


@pytest.fixture(autouse=True, scope="module")
def _backend():
    backend.select()


def load(path, **parameters):
    kind = "klems" if bsdf_file.read(path).kind == "Klems" else "tensor_tree"
    return mi.load_dict({"type": kind, "filename": str(path), **parameters})


def values(bsdf, mode, wi, wo):
    """F·|cos| and density for pairs of directions (n, 3)."""
    found = bsdf.eval_pdf(mi.BSDFContext(mode), interaction(wi, len(wi)), as_vector(wo))
    return found[0][0].numpy(), found[1].numpy()


ROOM = {
    "room": {"size": [4.0, 5.0, 3.0], "floor": 0.0, "ceiling": 0.0, "walls": 0.0},
    "facade": {"south": {"strips": [{"bottom": 0.2, "top": 2.8, "material": "film"}]}},
    "sensors": {"corner": [1.0, 1.0, 0.6], "count": [2, 2], "spacing": 0.5},
}
TINY = {
    "replicates": 4, "paths": 32, "cell_size": 0.6, "cell_sky_rays": 16, "sensor_sky_rays": 64,
    "pane_points": 64, "film_sky_samples": 64,
}  # fmt: skip
NORTH, UP = np.array([0.0, 1, 0]), np.array([0.0, 0, 1])
PANE = np.stack([np.cross(UP, NORTH), UP, NORTH])
"""Axes of a pane in the south: x to the west, y up, z into the room."""


def room(path, **tables):
    return Case.model_validate(
        ROOM | {"materials": {"film": {"type": "bsdf", "file": str(path)}}} | tables
    )


def coefficients(case, directions, diameter=0.5, **accuracy):
    """Replicates of C by `compute`, shape (replicate, sensor, bin)."""
    points, normals = sensor_points(case)
    suns = Suns(tuple(f"sun_{i}" for i in range(len(directions))), np.array(directions), diameter)
    return compute(scene.load(case), points, normals, suns, Accuracy(**TINY | accuracy))


def towards(altitude, azimuth):
    a, z = np.radians([altitude, azimuth])
    return [np.sin(z) * np.cos(a), np.cos(z) * np.cos(a), np.sin(a)]


SUNS = [towards(50, 180), towards(30, 203)]


# One cell of 2⁻⁷: the rest of 4¹⁴ pairs of cells is dark

DEPTH, SIDE = 7, 1 << 7
SHARE = 0.7
CELL = np.pi / 4**DEPTH
"""Its projected solid angle [sr]: 0.8° across."""


def direction(cell, side, incident=False, uv=(0.5, 0.5)):
    """Directions (…, 3) in a cell of the square."""
    x, y = to_disk(*((c + u) / SIDE for c, u in zip(cell, uv, strict=True)))
    sign = -1 if incident else 1
    return np.stack([sign * x, sign * y, side * np.sqrt(1 - x * x - y * y)], axis=-1)


def one_cell(incident, outgoing, value):
    """Text of a tree whose only light leaf is the finest cell of two directions."""
    whole = (*incident, *outgoing)

    def node(level):
        if level == DEPTH:
            return f"{{{value:.9g}}}"
        bits = [(c >> (DEPTH - 1 - level)) & 1 for c in whole]
        lit = sum(b << i for i, b in enumerate(bits))
        return "{" + "".join(node(level + 1) if i == lit else "{0}" for i in range(16)) + "}"

    return node(0)


def cell_of(direction, incident=False):
    """Cell that holds a direction."""
    x, y = (-direction[:2]) if incident else direction[:2]
    return tuple(int(c * SIDE) for c in to_square(x, y))


IN = np.array([-0.15, 0.55, -0.82])  # from outside, above and beside
OUT = {"tb": np.array([0.1, -0.6, 0.79]), "rb": np.array([0.1, -0.6, -0.79])}


@MODES
@pytest.mark.parametrize("name", ["tb", "rb"])
def test_a_single_cell(name, mode, tmp_path, holds):
    """1 of 16,384 directions sees anything, with f = 3651/sr: neither is it missed, nor blurred."""
    given, found = cell_of(IN, True), cell_of(OUT[name])
    side = np.sign(OUT[name][2])
    path = tmp_path / "cell.xml"
    path.write_text(xml("TensorTree4", {name: one_cell(given, found, SHARE / CELL)}))
    bsdf = load(path)
    assert not bsdf.has_view
    ways = {"given": direction(given, -1, True), "found": direction(found, side)}
    wi = ways["given" if mode == IMPORTANCE else "found"]
    bs, weight = draw(bsdf, wi, mode, 20_000)
    wo, weight, pdf = np.array(bs.wo).T, weight[0].numpy(), bs.pdf.numpy()
    kept = weight > 0  # light that leaves along -z may also come by a reversed transmission
    assert kept.all()
    incident = mode == RADIANCE
    wanted = given if incident else found
    s, t = to_square(*(-wo[:, :2] if incident else wo[:, :2]).T)
    off = np.abs(np.stack([s, t]) * SIDE - np.array(wanted)[:, None] - 0.5).max()
    holds("samples lie in the cell: off its middle, in cells", off, 0.5 + 1e-3)
    holds("the weight is the albedo", abs(weight / SHARE - 1).max(), FLOAT)
    exact = abs(wo[:, 2]) / CELL
    holds("density = cos / cell", abs(pdf / exact - 1).max(), 1e-4)  # cos from float32 x, y
    # Points in the middle of a cell, where rounding carries none across its border.
    uv = np.random.default_rng(1).uniform(0.01, 0.99, (2, 5000))
    wo = direction(wanted, -1 if incident else side, incident, uv)
    f, density = values(bsdf, mode, np.broadcast_to(wi, wo.shape), wo)
    holds("f is the file's", abs(f / (SHARE / CELL * abs(wo[:, 2])) - 1).max(), FLOAT)
    integral = (f / abs(wo[:, 2])).mean(dtype=float) * CELL
    holds("energy = 0.7", abs(integral / SHARE - 1), FLOAT)
    holds("weight = f cos / density", abs(f / density / SHARE - 1).max(), FLOAT)
    for step in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        beside = direction(np.add(wanted, step), -1 if incident else side, incident, uv)
        f, density = values(bsdf, mode, np.broadcast_to(wi, wo.shape), beside)
        holds("nothing beside it", f.max() + density.max(), 0)
    beside = direction(np.add(found if incident else given, (1, 0)), wi[2], not incident)
    bs, weight = draw(bsdf, beside * [1, 1, np.sign(wi[2]) * np.sign(beside[2])], mode, 1000)
    holds("nothing to those that look beside it", weight[0].numpy().max() + bs.pdf.numpy().max(), 0)


def test_a_single_cell_straight_through(tmp_path, holds):
    """On the diagonal the cell is a view of 0.8°, and all of it is taken out of the BSDF."""
    cell = cell_of(IN, True)
    path = tmp_path / "cell.xml"
    path.write_text(xml("TensorTree4", {"tb": one_cell(cell, cell, SHARE / CELL)}))
    bsdf = load(path)
    assert bsdf.has_view
    for beside, expected in (((0, 0), SHARE), ((1, 0), 0.0), ((0, -1), 0.0)):
        wi = -direction(np.add(cell, beside), -1, True)
        through = bsdf.eval_null_transmission(interaction(wi, 1))[0].numpy()
        holds(f"view at {beside}: {expected:g}", abs(through - expected).max(), FLOAT)
    assert film(path).share_through == pytest.approx(1)


def test_a_room_behind_a_single_cell(tmp_path, same, holds):
    """A beam of 0.8° is all that comes in: C is f·Ω·cosθ·∫cell, and 0 for a sun 1.6° beside."""
    given, found = cell_of(IN, True), cell_of(OUT["tb"])
    path = tmp_path / "cell.xml"
    path.write_text(xml("TensorTree4", {"tb": one_cell(given, found, SHARE / CELL)}))
    there = [direction(np.add(given, step), -1, True) for step in ((0, 0), (2, 0))]
    diameter = 0.2
    C = coefficients(
        room(path), [d @ PANE for d in there], diameter, replicates=16, pane_points=1 << 14
    )["replicates"].values
    uv = (np.indices((64, 64)).reshape(2, -1) + 0.5) / 64
    leaving = direction(found, 1, uv=uv)
    solid_angle = 4 * np.pi * np.sin(np.radians(diameter) / 4) ** 2
    arrives = solid_angle * -there[0][2]
    exact = SHARE / CELL * arrives * CELL * (-leaving[:, 1] / leaving[:, 2]).mean()
    same(C[..., BINS], exact=np.full(C.shape[1], exact), within=0.1)
    holds("a sun beside the cell", C[..., BINS + 1].max(), 0)


# Nothing at all


def dark(folder, kind):
    """A file of zeros."""
    path = folder / "dark.xml"
    if kind == "Klems":
        basis = "LBNL/Klems Full"
        zeros = "0 " * len(BASES[basis]) ** 2
        path.write_text(xml("Columns", dict.fromkeys(("tb", "tf", "rf"), zeros), basis))
    else:
        path.write_text(xml(kind, dict.fromkeys(("tb", "rf"), "{0}")))
    return path


KINDS = ("TensorTree4", "TensorTree3", "Klems")


@MODES
@pytest.mark.parametrize("kind", [*KINDS, "redirecting_film"])
def test_a_bsdf_of_zeros(kind, mode, tmp_path, holds):
    """Albedos of 0 are what probabilities are divided by."""
    if kind == "redirecting_film":
        bsdf = mi.load_dict({"type": kind, "transmittance": 0.0})
    else:
        bsdf = load(dark(tmp_path, kind))
    rng = np.random.default_rng(2)
    wi, wo = (to_direction(*rng.random((2, 5000)), side=s) for s in (1, -1))
    for a in (wi, wo):
        bs, weight = draw(bsdf, a[0], mode, 5000)
        assert np.isfinite(np.array(bs.wo)).all()
        holds("weight", abs(weight[0].numpy()).max(), 0)
        f, density = values(bsdf, mode, a, wo)
        holds("f", abs(f).max(), 0)
        assert np.isfinite(density).all()


@pytest.mark.parametrize("kind", KINDS)
def test_a_room_behind_nothing(kind, tmp_path, holds):
    """Exactly 0, standard errors too, with a film of zeros as the only pane and as the shade."""
    lit = {"size": [4.0, 5.0, 3.0]}
    case = room(dark(tmp_path, kind), room=lit, shading={"material": "film"})
    C = coefficients(case, SUNS)
    for name, values_of in C.data_vars.items():
        holds(f"C, {name}", abs(values_of.values).max(), 0)


def test_a_room_behind_a_redirecting_film_of_zeros(tmp_path, plain_coefficients, holds):
    case = room(dark(tmp_path, "TensorTree4"))
    world = scene.load(case)
    nothing = mi.load_dict({"type": "redirecting_film", "transmittance": 0.0})
    is_film = [type(p.material) is BsdfMaterial for p in world.parts]
    assert any(is_film)
    meshes = [
        scene.quad_mesh(f"part{i}", part.quads, nothing if its_film else part.bsdf)
        for i, (part, its_film) in enumerate(zip(world.parts, is_film, strict=True))
    ]
    shapes = {f"shape{i}": m for i, m in enumerate(meshes)}
    suns = mi.TensorXf(np.array(SUNS, np.float32))
    sources = {"sky": {"type": "tregenza_sky"}, "suns": {"type": "sun_disks", "directions": suns}}
    lit = mi.load_dict({"type": "scene", **shapes, **sources}, optimize=False)
    points, normals = sensor_points(case)
    C = plain_coefficients(lit, points, normals, replicates=2, spp=4096)
    holds("C", abs(C).max(), 0)


def test_a_film_of_zeros_is_shown_and_evaluated(tmp_path, command, holds):
    """Logarithmic scales of pictures, peaks, widths and reciprocity of nothing."""
    path = dark(tmp_path, "TensorTree4")
    answer = command("bsdf", path.name, "-o", "pictures", folder=tmp_path)
    assert answer.line == ""
    case = ROOM | {
        "materials": {"film": {"type": "bsdf", "file": path.name}},
        "period": {"timestamps": "stamps.csv"},
        "accuracy": TINY,
        "shading": {"material": "film"},
    }
    (tmp_path / "case.toml").write_text(toml(case))
    (tmp_path / "stamps.csv").write_text("time\n2015-03-21T10:00\n2015-06-21T12:30\n")
    assert command("evaluate", "case.toml", "-o", "results", folder=tmp_path).line == ""
    with xr.open_dataset(tmp_path / "results" / "illuminance.nc", engine="h5netcdf") as E:
        for name, values_of in E.data_vars.items():
            holds(f"E, {name}", abs(values_of.values).max(), 0)
    numbers = json.loads((tmp_path / "results" / "metrics.json").read_text(encoding="utf-8"))
    assert numbers["sDA"] == {"value": 0, "low": 0, "high": 0}


# Too much


def lambertian(path, *, t, r=0.0):
    """File of an evenly scattering pane, the same on both sides."""
    parts = {"tb": t, "tf": t, "rb": r, "rf": r}
    path.write_text(xml("TensorTree4", {n: "{%.9g}" % (v / np.pi) for n, v in parts.items()}))
    return path


def test_a_film_that_sends_out_8751_per_cent(tmp_path, command):
    """`bsdf` shows what is wrong; nothing is simulated with it."""
    path = lambertian(tmp_path / "hot.xml", t=40.0, r=47.51)
    with pytest.raises(RuntimeError, match="sends out 8751 % of the light"):
        load(path)
    with pytest.raises(InputError, match="8751 %"):
        film(path)
    case = ROOM | {"materials": {"film": {"type": "bsdf", "file": "hot.xml"}}}
    (tmp_path / "case.toml").write_text(toml(case))
    line = command("evaluate", "case.toml", "-o", "out", folder=tmp_path).line
    assert line.startswith(f"{path.name}: energy: sends out 8751 % of the light from")
    assert line.endswith("correct the data; see `drcmitsuba bsdf hot.xml`")
    assert not (tmp_path / "out").exists()
    shown = command("bsdf", "hot.xml", "--json", folder=tmp_path)
    assert shown.line == ""
    assert json.loads(shown.out)["verdict"] != "ok"
    assert "8751" in command("bsdf", "hot.xml", folder=tmp_path).out


def test_a_film_of_energy_1_02_is_scaled_to_1(tmp_path, holds):
    """Noted, exactly 1 afterwards where it was above, and untouched where it was not."""
    even = "".join("{%.9g}" % (1.02 / np.pi if i & 1 else 0.5 / np.pi) for i in range(16))
    path = tmp_path / "warm.xml"
    path.write_text(xml("TensorTree4", {"tb": "{" + even + "}", "tf": "{" + even + "}"}))
    found = film(path)
    holds("energy that came: 1.02", abs(found.largest_albedo - 1.02), 1e-6)
    rng = np.random.default_rng(3)
    incident = to_direction(*rng.random((2, 5000)), side=-1)
    total = np.sum(found.file.hemispherical(incident), axis=0)
    before = np.sum(bsdf_file.read(path).hemispherical(incident), axis=0)
    assert {*np.round(before, 6)} == {0.5, 1.02}
    holds("scaled energy: 1", abs(total[before > 1] - 1).max(), 1e-9)
    holds("untouched energy: 0.5", abs(total[before < 1] - 0.5).max(), 1e-6)
    bsdf = load(path)
    for d, t in zip(incident[:10], total[:10], strict=True):
        _, weight = draw(bsdf, d, IMPORTANCE, 500)
        holds("weight = energy", abs(weight[0].numpy() / t - 1).max(), FLOAT)
    (told,) = notes(room(path))
    assert "sends out up to 102.0 % of the light; scaled down to 100 % there" in told


def test_a_room_behind_energy_1_02_is_that_behind_1(tmp_path, holds):
    """The same samples: the scaled file is the one that was right from the beginning."""
    lit = {"size": [4.0, 5.0, 3.0]}
    came = lambertian(tmp_path / "a.xml", t=0.918, r=0.102)
    right = lambertian(tmp_path / "b.xml", t=0.9, r=0.1)
    a, b = (coefficients(room(f, room=lit), SUNS)["replicates"].values for f in (came, right))
    holds("C, relative to the largest", abs(a - b).max() / b.max(), FLOAT)
    assert b.max() > 0


# One way only


@MODES
def test_light_that_passes_one_way_only(mode, tmp_path, holds):
    """All from outside to inside, nothing back; and down-going light only ever goes up."""
    one_way = {"tb": "{%.9g}" % (0.8 / np.pi), "tf": "{0}"}
    path = tmp_path / "one_way.xml"
    path.write_text(xml("TensorTree4", one_way))
    bsdf = load(path)
    rng = np.random.default_rng(4)
    inside, outside = (to_direction(*rng.random((2, 3000)), side=s) for s in (1, -1))
    # In Radiance mode light enters along wo and leaves along wi.
    enters = (outside, inside) if mode == IMPORTANCE else (inside, outside)
    f, density = values(bsdf, mode, *enters)
    exact = 0.8 / np.pi * abs(enters[1][:, 2])
    holds("what enters, relative", abs(f / exact - 1).max(), FLOAT)
    holds("its density, relative", abs(density * np.pi / abs(enters[1][:, 2]) - 1).max(), FLOAT)
    f, density = values(bsdf, mode, enters[1], enters[0])
    holds("what leaves", f.max() + density.max(), 0)
    _, weight = draw(bsdf, enters[1][0], mode, 1000)
    holds("weight of what leaves", weight[0].numpy().max(), 0)


def test_a_room_asks_only_for_what_enters(tmp_path, same, plain_coefficients, holds):
    """C does not change with what the file says of light that leaves, nor does a path tracer's."""
    lit = {"size": [4.0, 5.0, 3.0]}
    rng = np.random.default_rng(5)
    through = "{" + " ".join(f"{v:.6g}" for v in 0.5 / np.pi * rng.random(16)) + "}"
    found = []
    for name, back in (("none", "{0}"), ("much", "{0.3}")):
        path = tmp_path / f"{name}.xml"
        path.write_text(xml("TensorTree4", {"tb": through, "tf": back}))
        case = room(path, room=lit)
        found.append(coefficients(case, SUNS, replicates=16)["replicates"].values)
    holds("C, the other way open or closed", abs(found[0] - found[1]).max(), 0)
    black = room(path)
    world, (points, normals) = scene.load(black), sensor_points(black)
    shapes = {f"shape{i}": s for i, s in enumerate(world.full.shapes())}
    suns = mi.TensorXf(np.array(SUNS, np.float32))
    sources = {"sky": {"type": "tregenza_sky"}, "suns": {"type": "sun_disks", "directions": suns}}
    lit_world = mi.load_dict({"type": "scene", **shapes, **sources}, optimize=False)
    plain = plain_coefficients(lit_world, points, normals, replicates=16, spp=1 << 13)
    ours = coefficients(black, SUNS, replicates=16, pane_points=256, film_sky_samples=256)
    for part in (slice(0, BINS), slice(BINS, None)):
        mine, theirs = ours["replicates"].values[..., part], plain.sum(axis=0)[..., part]
        same(mine.sum(axis=2), other=theirs.sum(axis=2), within=0.03)
    turned = {"film": {"type": "bsdf", "file": str(tmp_path / "none.xml"), "flip": True}}
    dark_room = coefficients(room(path, room=lit, materials=turned), SUNS)
    holds("C, mounted the wrong way round", dark_room["replicates"].values.max(), 0)


# Grazing light

ANGLES = np.array([80.0, 89.0, 89.9, 89.99, 89.999])


def most(file, mode, w):
    """Albedo bound of directions (n, 3) of the file's frame: of light in, or of light out."""
    if mode == IMPORTANCE:
        return np.sum(file.hemispherical(w), axis=0)
    total = np.zeros(len(w))
    for name, from_side, to_side in (("tf", 1, -1), ("tb", -1, 1), ("rf", 1, 1), ("rb", -1, -1)):
        mine = w[:, 2] * to_side > 0
        component = file.component(name)
        if not mine.any() or component is None:
            continue
        assert from_side
        if isinstance(component, Swapped):
            total[mine] += component.tree.hemispherical(w[mine])
        elif hasattr(component, "rank"):
            total[mine] += Swapped(component).hemispherical(w[mine])
        else:
            total[mine] += component.reversed().hemispherical(w[mine])
    return total


@MODES
@pytest.mark.parametrize("side", [1, -1], ids=["room", "outside"])
@pytest.mark.parametrize("kind", ["TensorTree4", "TensorTree3", "LBNL/Klems Full"])
def test_grazing_incidence(kind, side, mode, tmp_path, holds):
    """cos θ of 1.7e-5: a weight is f cos / density, and both go to 0."""
    path = write(tmp_path, kind)
    bsdf, file = load(path, straight_through="off"), bsdf_file.read(path)
    # Between two cells' borders, which all directions near the horizon would fall upon.
    phi = np.radians([10.0, 280.0])
    theta, phi = (a.ravel() for a in np.meshgrid(np.radians(ANGLES), phi))
    wi = np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), side * np.cos(theta)], -1
    )
    # Isotropic trees' columns vary within a cell: weights between 0 and 2 of the middle one's.
    slack = 2.0 if kind == "TensorTree3" and mode == RADIANCE else 1.0
    bound = most(file, mode, wi)
    assert bound.max() > 0
    for d, albedo in zip(wi, bound, strict=True):
        bs, weight = draw(bsdf, d, mode, 4000)
        wo, weight, pdf = np.array(bs.wo).T, weight[0].numpy(), bs.pdf.numpy()
        assert np.isfinite(wo).all()
        assert (weight >= 0).all()
        assert (pdf >= 0).all()
        near = 1e-2 if slack > 1 else 1e-4
        holds("weight beyond the albedo", max(0, weight.max() - slack * albedo * (1 + near)), FLOAT)
        f, density = values(bsdf, mode, np.broadcast_to(d, wo.shape), wo)
        kept = weight > 0
        # The direction is rounded on its way to the local frame and back: it may change its cell.
        off = abs(density[kept] / pdf[kept] - 1) > 1e-3
        holds("samples whose density is another one", off.mean() if kept.any() else 0, 0.02)
        rest = ~off
        again = f[kept][rest] / pdf[kept][rest]
        if rest.any():
            holds("eval / pdf = weight", abs(again / weight[kept][rest] - 1).max(), 2e-3)
        grazing = d * [-1, -1, 1]
        for other in (grazing, -grazing):
            f, density = values(bsdf, mode, d[None], other[None])
            assert np.isfinite([f, density]).all()
            assert f >= 0
            assert density >= 0


@MODES
@pytest.mark.parametrize("tilt", [0.0, 30.0])
def test_a_redirecting_film_at_grazing_incidence(tilt, mode, holds):
    """Its radiance grows as 1/cos θ there by definition: the flux, weight times cos θ, does not."""
    T, R = 0.6, 0.2
    film = mi.load_dict({
        "type": "redirecting_film", "transmittance": T, "redirected": 0.7, "tilt": tilt,
        "spread": 5.0, "reflectance_front": R,
    })  # fmt: skip
    for angle in np.radians(ANGLES):
        for phi in np.radians([10.0, 90.0, 200.0, 270.0]):
            for side in (1, -1):
                c, s = np.cos(angle), np.sin(angle)
                d = np.array([s * np.cos(phi), s * np.sin(phi), side * c])
                bs, weight = draw(film, d, mode, 4000)
                weight = weight[0].numpy()
                assert np.isfinite(np.array(bs.wo)).all()
                assert (weight >= 0).all()
                if mode == IMPORTANCE:
                    albedo = T + (R if side > 0 else 0)
                    holds("weight beyond the albedo", max(0, weight.max() - albedo), 1e-4)
                else:
                    holds("flux beyond that of two lobes", max(0, (weight * c).max() - 2), FLOAT)
                wo = np.array(bs.wo).T
                f, density = values(film, mode, np.broadcast_to(d, wo.shape), wo)
                kept = weight > 1e-6 * weight.max()
                again = f[kept] / density[kept]
                holds("eval / pdf = weight", abs(again / weight[kept] - 1).max(), 1e-2)


def form_factor(corners, point, normal):
    """∫ cos dω over a polygon above the horizon of a point [sr] (Lambert's formula)."""
    w = corners - point
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    total = 0.0
    for a, b in zip(w, np.roll(w, -1, axis=0), strict=True):
        edge = np.cross(a, b)
        total += np.arccos(np.clip(a @ b, -1, 1)) * (edge @ normal) / np.linalg.norm(edge)
    return abs(total) / 2


def before_the_plane(above, half):
    """∫ cos dω over the part of a small disk before a plane that its centre lies `above` [rad]."""
    y = np.linspace(max(-above, -half), half, 20_001)
    return np.trapezoid((above + y) * 2 * np.sqrt(np.maximum(half**2 - y**2, 0)), y)


@pytest.mark.parametrize(("above", "within"), [(1.0, 0.03), (0.26, 0.05), (0.05, 0.1)])
def test_a_film_seen_at_a_grazing_angle_under_a_grazing_sun(above, within, tmp_path, same):
    """Sensors 5 mm from the pane, its foot in their plane; suns 1° to 0.05° before its plane.

    Under an even sky C sums to T times the form factor. Of the last disk 40 % lie behind the plane;
    cos θ varies over the disks by as much as it is, which is what limits these samples.
    """
    T = 0.4
    path = lambertian(tmp_path / "even.xml", t=T)
    case = room(
        path, facade={"south": {"strips": [{"bottom": 0.6, "top": 2.8, "material": "film"}]}},
        sensors={"corner": [0.5, 0.0, 0.6], "count": [3, 1], "spacing": 0.01},
    )  # fmt: skip
    a = np.radians(above)
    along = np.linspace(0.2, 1.2, 8)
    suns = np.stack(
        [np.cos(a) * np.cos(along), 0 * along - np.sin(a), np.cos(a) * np.sin(along)], 1
    )
    C = coefficients(case, suns, replicates=64, pane_points=1 << 10, film_sky_samples=512)
    C = C["replicates"].values
    corners = np.array([[0, 0, 0.6], [0, 0, 2.8], [4, 0, 2.8], [4, 0, 0.6]], float)
    points, normals = sensor_points(case)
    seen = np.array([form_factor(corners, p, n) for p, n in zip(points, normals, strict=True)])
    same(C[..., :BINS].sum(axis=2), exact=T * seen, within=0.01)
    arrives = before_the_plane(a, np.radians(0.25))
    exact = np.repeat(T / np.pi * arrives * seen[:, None], len(suns), axis=1)
    same(C[..., BINS:], exact=exact, within=within)


def test_lanes_that_are_left_out_stay_out(tmp_path, holds):
    """Directions in the plane of the pane, and masked ones, give 0 and no NaN."""
    wi = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])
    for kind in ("TensorTree4", "TensorTree3", "LBNL/Klems Full"):
        bsdf = load(write(tmp_path, kind))
        for mode in (RADIANCE, IMPORTANCE):
            f, density = values(bsdf, mode, wi[:2], wi[[2, 2]])
            holds("f and density in the plane", f.max() + density.max(), 0)
            bs, weight = bsdf.sample(
                mi.BSDFContext(mode), interaction(wi, 3), mi.Float(0.5), mi.Point2f(0.5, 0.5),
                mi.Bool(False),
            )  # fmt: skip
            dr.eval(bs, weight)
            holds("weight where masked", weight[0].numpy().max(), 0)
