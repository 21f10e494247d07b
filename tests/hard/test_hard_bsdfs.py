"""BSDFs at their limits: a single cell, nothing at all, too much, one way only."""

import json

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import xarray as xr
from drcmitsuba_plugins import bsdf_file
from drcmitsuba_plugins.klems_basis import BASES
from drcmitsuba_plugins.tensor import to_direction, to_disk, to_square

from drcmitsuba import InputError
from drcmitsuba.model.materials import BsdfMaterial
from drcmitsuba.plan import notes
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.materials import film
from drcmitsuba.scene.sensors import sensor_points
from tests.hard.bsdf_cases import (
    BINS,
    FLOAT,
    MODES,
    PANE,
    ROOM,
    SUNS,
    TINY,
    coefficients,
    lambertian,
    load,
    room,
    values,
)
from tests.hard.mutations import toml
from tests.unit.plugins.test_measured import (
    IMPORTANCE,
    RADIANCE,
    draw,
    interaction,
    write,
    xml,
)


@pytest.fixture(autouse=True, scope="module")
def _backend():
    backend.select()


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
    given, sent = cell_of(IN, True), cell_of(OUT[name])
    side = np.sign(OUT[name][2])
    path = tmp_path / "cell.xml"
    path.write_text(xml("TensorTree4", {name: one_cell(given, sent, SHARE / CELL)}))
    bsdf = load(path)
    assert not bsdf.has_view
    ways = {"given": direction(given, -1, True), "sent": direction(sent, side)}
    wi = ways["given" if mode == IMPORTANCE else "sent"]
    bs, weight = draw(bsdf, wi, mode, 20_000)
    wo, weight, pdf = np.array(bs.wo).T, weight[0].numpy(), bs.pdf.numpy()
    kept = weight > 0  # light that leaves along -z may also come by a reversed transmission
    assert kept.all()
    incident = mode == RADIANCE
    wanted = given if incident else sent
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
    beside = direction(np.add(sent if incident else given, (1, 0)), wi[2], not incident)
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
    given, sent = cell_of(IN, True), cell_of(OUT["tb"])
    path = tmp_path / "cell.xml"
    path.write_text(xml("TensorTree4", {"tb": one_cell(given, sent, SHARE / CELL)}))
    there = [direction(np.add(given, step), -1, True) for step in ((0, 0), (2, 0))]
    diameter = 0.2
    C = coefficients(
        room(path), [d @ PANE for d in there], diameter, replicates=16, pane_points=1 << 14
    )["replicates"].values
    uv = (np.indices((64, 64)).reshape(2, -1) + 0.5) / 64
    leaving = direction(sent, 1, uv=uv)
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
    material = film(path)
    holds("energy that came: 1.02", abs(material.largest_albedo - 1.02), 1e-6)
    rng = np.random.default_rng(3)
    incident = to_direction(*rng.random((2, 5000)), side=-1)
    total = np.sum(material.file.hemispherical(incident), axis=0)
    before = np.sum(bsdf_file.read(path).hemispherical(incident), axis=0)
    assert {*np.round(before, 6)} == {0.5, 1.02}
    holds("scaled energy: 1", abs(total[before > 1] - 1).max(), 1e-9)
    holds("untouched energy: 0.5", abs(total[before < 1] - 0.5).max(), 1e-6)
    bsdf = load(path)
    for d, t in zip(incident[:10], total[:10], strict=True):
        _, weight = draw(bsdf, d, IMPORTANCE, 500)
        holds("weight = energy", abs(weight[0].numpy() / t - 1).max(), FLOAT)
    told = "sends out up to 102.0 % of the light; scaled down to 100 % there"
    assert sum(told in note for note in notes(room(path))) == 1


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


@pytest.mark.slow
def test_a_room_asks_only_for_what_enters(tmp_path, same, plain_coefficients, holds):
    """C does not change with what the file says of light that leaves, nor does a path tracer's."""
    lit = {"size": [4.0, 5.0, 3.0]}
    rng = np.random.default_rng(5)
    through = "{" + " ".join(f"{v:.6g}" for v in 0.5 / np.pi * rng.random(16)) + "}"
    by_back = []
    for name, back in (("none", "{0}"), ("much", "{0.3}")):
        path = tmp_path / f"{name}.xml"
        path.write_text(xml("TensorTree4", {"tb": through, "tf": back}))
        case = room(path, room=lit)
        by_back.append(coefficients(case, SUNS, replicates=16)["replicates"].values)
    holds("C, the other way open or closed", abs(by_back[0] - by_back[1]).max(), 0)
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
