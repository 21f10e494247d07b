"""Rooms of any shape, as models give them, against plain path tracing.

Windows lie in several planes, one triangular, one with four slopes; the glass mirrors, a partition
of glass divides the room. Suns are 20° wide, so that plain path tracing finds them in the glass.
"""

import json

import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.annual.simulation import transport
from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.reading import load_case
from drcmitsuba.case.shipped import shipped_folder
from drcmitsuba.export.radiance import save_radiance
from drcmitsuba.model.materials import (
    BsdfMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Lambertian,
    PorousMaterial,
)
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.scene.surfaces import surfaces_of
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport import coefficients
from drcmitsuba.transport.deposit import Deposit
from tests.model_rooms import case_of, l_room, layer, prism, shell

DIAMETER = 20.0
SUNS = np.array([[0.3, -0.7, 0.5], [0.8, -0.2, 0.4], [-0.1, 0.2, 0.95]])
SUNS /= np.linalg.norm(SUNS, axis=1, keepdims=True)
ACCURACY = {
    "paths": 512, "photons": 1 << 15, "cell_size": 0.25, "sensor_sky_rays": 8192,
    "cell_sky_rays": 256, "sensor_sun_samples": 64, "pane_points": 256, "film_sky_samples": 1024,
    "sensor_square": 0.2,
}  # fmt: skip


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def agree(case, same, plain_coefficients, *, pane_to_pane, within):
    """Sensors' means for every bin, then every sensor's sums, are those of plain path tracing."""
    world = scene.load(case, effects=EnabledEffects(pane_to_pane=pane_to_pane))
    suns = Suns(tuple(f"sun_{i}" for i in range(len(SUNS))), SUNS, DIAMETER)
    here = coefficients.compute(world, *sensor_points(case), suns, case.accuracy)
    sources = {
        "sky": {"type": "tregenza_sky"},
        "suns": {
            "type": "sun_disks",
            "directions": mi.TensorXf(SUNS.astype(np.float32)),
            "diameter": DIAMETER,
        },
    }
    shapes = {f"shape{i}": s for i, s in enumerate(world.full.shapes())}
    with_sources = mi.load_dict({"type": "scene", **shapes, **sources}, optimize=False)
    plain = plain_coefficients(with_sources, *sensor_points(case), replicates=16, spp=1 << 13)
    mine, theirs = here["replicates"].values, plain.sum(axis=0)
    for bins in (slice(0, 146), slice(146, None)):
        same(mine[..., bins].mean(axis=1), other=theirs[..., bins].mean(axis=1), within=within)
        same(mine[..., bins].sum(axis=2), other=theirs[..., bins].sum(axis=2), within=within)


@pytest.mark.slow
def test_a_room_with_windows_of_any_shape_in_any_plane(same, plain_coefficients):
    agree(l_room(accuracy=ACCURACY), same, plain_coefficients, pane_to_pane=True, within=0.03)


def attic(pane):
    """Room under a roof of one slope, with a triangular and a sloped pane of one material."""
    floor, _, walls = prism([(0, 0), (4, 0), (4, 5), (0, 5)], 2.0)
    high = [(0, 0, 2), (4, 0, 2), (4, 5, 4), (0, 5, 4)]
    sloped = np.array([[1, 1, 2.4], [3, 1, 2.4], [3, 4, 3.6], [1, 4, 3.6]])
    gable = np.array([[4, 0, 2], [4, 5, 2], [4, 5, 4]], float)
    back = [(0, 5, 2), (4, 5, 2), (4, 5, 4), (0, 5, 4)]
    return case_of(
        layer("floor", Lambertian(0.3), floor),
        layer("walls", Lambertian(0.5), *walls, back, [(0, 5, 2), (0, 0, 2), (0, 5, 4)]),
        layer("roof", Lambertian(0.7), high[::-1], holes=[sloped]),
        layer("pane", pane, sloped[::-1], gable[::-1]),
        sensors={"floors": ["floor"], "spacing": 2.0, "margin": 0.5},
        accuracy=ACCURACY,
        north=25.0,
    )


PRISM = str(shipped_folder() / "films" / "prism.xml")


@pytest.mark.parametrize(
    "pane",
    [
        pytest.param(
            DiffuserMaterial(type="diffuser", transmittance=0.4, reflectance=0.3), id="diffuser"
        ),
        pytest.param(
            BsdfMaterial(type="bsdf", file=PRISM, straight_through="off"),
            id="film",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_sloped_and_triangular_panes_that_scatter(pane, same, plain_coefficients):
    # Light from film to film is followed by photons; diffusing panes exchange light among them.
    is_film = isinstance(pane, BsdfMaterial)
    agree(attic(pane), same, plain_coefficients, pane_to_pane=is_film, within=0.025)


def partitioned(**tables):
    """Room with a window to the south, and a white partition that lets light through before it."""
    window = np.array([[0.5, 0, 0.9], [3.5, 0, 0.9], [3.5, 0, 2.7], [0.5, 0, 2.7]])
    white = DiffuserMaterial(
        type="diffuser", transmittance=0.4, reflectance=0.4, outer_reflectance=0.4
    )
    return case_of(
        *shell(4, 5, window),
        layer("glass", GlazingMaterial(type="glazing", transmittance=0.7), window),
        layer("partition", white, [(0, 2, 0), (0, 2, 3), (4, 2, 3), (4, 2, 0)]),
        **tables,
    )


@pytest.mark.slow
def test_behind_a_partition_that_scatters(same, plain_coefficients):
    points = [[x, 2.0 + d, z] for d in (0.25, 0.5) for x in (0.5, 2.0) for z in (0.5, 1.5)]
    accuracy = {**ACCURACY, "cell_size": 0.45, "replicates": 16}
    case = partitioned(sensors={"points": points}, accuracy=accuracy)
    agree(case, same, plain_coefficients, pane_to_pane=False, within=0.03)


def test_panes_within_rooms_are_cut_finer_than_their_walls_are():
    world = scene.load(partitioned(sensors={"floors": ["floor"], "spacing": 1.0}))
    patches = Deposit.of(world, SUNS, DIAMETER, 1, Accuracy(cell_size=0.5)).patches
    assert len(patches) == 12 * 9
    assert [part.name for part in world.parts if part.indoors] == ["partition"]


BOXES = {
    "room": {"size": [4.0, 5.0, 3.0], "floor": 0.3, "walls": 0.6},
    "facade": {
        "south": {
            "segments": 2, "frame": 0.1,
            "strips": [
                {"bottom": 0.8, "top": 1.8, "material": "glass"},
                {"bottom": 1.8, "top": 2.6, "material": "opal"},
            ],
        }
    },
    "materials": {
        "glass": {"type": "glazing", "transmittance": 0.65, "exponent": 4.0, "reflectance": 0.12},
        "opal": {"type": "diffuser", "transmittance": 0.4, "reflectance": 0.2},
    },
    "furniture": [
        {"name": "desk", "corner": [1, 2, 0.7], "size": [1.6, 0.8, 0.04], "reflectance": 0.4},
        {"name": "tower", "corner": [-5, -9, 0], "size": [9, 3, 7], "reflectance": 0.5},
    ],
    "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 4], "spacing": 1.0},
    "accuracy": {
        "replicates": 16, "paths": 512, "cell_sky_rays": 128, "sensor_sky_rays": 4096,
        "sensor_sun_samples": 16,
    },
}  # fmt: skip


def as_radiance(case, folder):
    """Files of the case as `export --radiance` writes them."""
    save_radiance(case, folder / "exported", "open")
    return {"files": [f"exported/{name}.rad" for name in ("materials", "scene")]}, {}


def as_obj(case, folder):
    """One OBJ file in centimetres, whose materials the case names."""
    surfaces, lines, count = surfaces_of(case), [], 0
    for surface in surfaces:
        lines.append(f"usemtl {surface.name.replace(' ', '_')}")
        for quad in surface.quads:
            lines += ["v " + " ".join(f"{100 * x:.9g}" for x in corner) for corner in quad]
            lines.append("f " + " ".join(str(count + i) for i in (1, 2, 3, 4)))
            count += 4
    (folder / "room.obj").write_text("\n".join(lines) + "\n")
    names = {s.name.replace(" ", "_"): s.material for s in surfaces}
    matt = {n: m.reflectance for n, m in names.items() if isinstance(m, Lambertian)}
    others = {n: m.model_dump() for n, m in names.items() if not isinstance(m, Lambertian)}
    table = {"files": ["room.obj"], "unit": "cm", "reflectances": matt}
    return table, {"materials": others}


def inline(value):
    """Write a value as TOML in one line."""
    if isinstance(value, dict):
        pairs = (f"{json.dumps(k)} = {inline(v)}" for k, v in value.items() if v is not None)
        return f"{{{', '.join(pairs)}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(inline, value))}]"
    return json.dumps(value)


@pytest.mark.parametrize("write", [as_radiance, pytest.param(as_obj, marks=pytest.mark.slow)])
def test_a_room_of_boxes_and_its_export_are_one(write, same, tmp_path):
    case = Case.model_validate(BOXES)
    table, more = write(case, tmp_path)
    tables = {k: BOXES[k] for k in ("sensors", "accuracy")} | {"model": table} | more
    text = "\n".join(f"{name} = {inline(table)}" for name, table in tables.items())
    (tmp_path / "case.toml").write_text(text)
    again = load_case(tmp_path / "case.toml")
    suns = Suns(("sun_0", "sun_1", "sun_2"), SUNS, DIAMETER)
    here, there = (transport(c, "open", suns, 50.0)["replicates"].values for c in (case, again))
    same(here[..., :146].mean(axis=1), other=there[..., :146].mean(axis=1), within=0.005)
    same(here[..., 146:].mean(axis=1), other=there[..., 146:].mean(axis=1), within=0.04)


def garden(porosity, reflectance, **tables):
    """Room with windows to the south and east; a porous crown, a fence and a wall stand outside."""
    floor, ceiling, walls = prism([(0, 0), (4, 0), (4, 5), (0, 5)], 3.0)
    south = np.array([[0.5, 0, 0.8], [3.5, 0, 0.8], [3.5, 0, 2.6], [0.5, 0, 2.6]], float)
    east = np.array([[4, 1, 0.8], [4, 3, 0.8], [4, 3, 2.4], [4, 1, 2.4]], float)
    low, top, sides = prism([(0, -4), (3, -4), (3, -2), (0, -2)], 3.0)
    crown = [np.add(polygon, [0, 0, 0.8]) for polygon in (low, top, *sides)]
    leaves = PorousMaterial(type="porous", porosity=porosity, reflectance=reflectance)
    fence = [(6, 0, 0), (6, 5, 0), (6, 5, 2.5), (6, 0, 2.5)]
    behind = [(-2, -7, 0), (6, -7, 0), (6, -7, 4), (-2, -7, 4)]
    ground = [(-20, -20, -0.01), (20, -20, -0.01), (20, 20, -0.01), (-20, 20, -0.01)]
    glass = GlazingMaterial(type="glazing", transmittance=0.65, ior=1.52)
    return case_of(
        layer("floor", Lambertian(0.3), floor),
        layer("ceiling", Lambertian(0.8), ceiling),
        layer("walls", Lambertian(0.6), walls[0], holes=[south]),
        layer("walls east", Lambertian(0.6), walls[1], *walls[2:], holes=[east]),
        layer("glass", glass, south, east[::-1]),
        layer("leaves", leaves, *crown),
        layer("fence", leaves, fence),
        layer("wall", Lambertian(0.5), behind, role="context"),
        layer("ground", Lambertian(0.2), ground, role="context"),
        **{"sensors": {"floors": ["floor"], "spacing": 1.5}, "accuracy": ACCURACY, **tables},
    )


@pytest.mark.slow
@pytest.mark.parametrize(("porosity", "reflectance"), [(0.6, 0.5), (0.2, 0.9)])
def test_porous_bodies_outside(porosity, reflectance, same, plain_coefficients):
    case = garden(porosity, reflectance)
    agree(case, same, plain_coefficients, pane_to_pane=False, within=0.02)
