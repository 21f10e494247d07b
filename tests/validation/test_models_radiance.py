"""Models of others, read here and by Radiance from the same files.

Rationale: reader, geometry, materials and simulation may each be wrong; all of them are compared at
once.

Method: the case is exported for Radiance; in place of the exported surfaces stand the files of the
model themselves, moved to the case's origin and turned to the north. For a Honeybee model, a writer
of a few lines stands for them that shares nothing with the reader. C of sky and suns, mean over the
sensors, by `same`.

Expected: agreement within both errors. Radiance's glass mirrors no sun to a surface, which only its
`mirror` does; so the suns are compared without those that the outside of panes mirrors to sills.
They add 5 % to the suns' interreflected light where a steep sun grazes the glass, and are tested
against Fresnel's formulas.
"""

from __future__ import annotations

import json
import shlex
import shutil
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.annual import simulation
from drcmitsuba.case.case import Case
from drcmitsuba.case.reading import load_case
from drcmitsuba.export.radiance import save_radiance
from drcmitsuba.export.sources import SUN_RADIANCE
from drcmitsuba.model.radiance import read
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.geometry import origin
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.transport.mirrors.image_suns import ImageSuns
from tests import SHARED, skips
from tests.unit.export.radiance_text import matrix
from tests.validation.test_export_radiance import REPEATS, TIMES, simulated

pytestmark = [
    pytest.mark.slow,
    skips.RADIANCE.mark,
]

ROOM = SHARED / "data" / "scenes" / "subramaniam_room"
RENDERS = SHARED / "data" / "scenes" / "radiance_renders"
HONEYBEE = SHARED / "data" / "hbjson" / "model_radiance_grid_views.hbjson"
FILES = ("materials", "Floor", "Ceiling", "InteriorWall", "ExteriorWalls", "Glazing", "Ground")
ACCURACY = """
[period]
timestamps = "times.csv"
[accuracy]
replicates = 16
paths = 1024
cell_size = 0.2
cell_sky_rays = 256
sensor_sky_rays = 8192
"""


@pytest.fixture(autouse=True)
def _without_mirrored_suns(monkeypatch):
    def none(glass, points, normals, *, suns, **_):
        return dr.zeros(mi.TensorXf, (dr.width(points) // 3, len(suns)))

    backend.select()
    monkeypatch.setattr(ImageSuns, "suns", none)


def case_of(folder: Path, tables: str) -> Case:
    """Case of a file with some tables."""
    (folder / "times.csv").write_text(TIMES)
    (folder / "case.toml").write_text(tables + ACCURACY)
    return load_case(folder / "case.toml")


def copied(folder: Path, *files: Path) -> None:
    """Copy files, which may be read-only, into a folder."""
    for file in files:
        shutil.copyfile(file, folder / file.name)


def agree(case: Case, folder: Path, scene: str, same, *, within: float, by_suns: bool = True):
    """C of sky and suns, mean over sensors, from the case and from Radiance.

    `materials.rad` and all files of the folder that the scene names serve both.
    """
    exported = folder / "radiance"
    save_radiance(case, exported, "open")
    copied(exported, *(file for file in folder.iterdir() if file.is_file()))
    # What lies clockwise of y by the north comes to y: the model turns the other way.
    start = " ".join(f"{-v:g}" for v in origin(case))
    (exported / "own.rad").write_text(scene)
    move = f"!xform -t {start} -rz {case.building.north:g} own.rad\n"
    (exported / "scene.rad").write_text(move)
    simulated(exported, "-ab 20 -lr -20 -lw 1e-5 -ad 1024")
    light = daylight(case)
    C = simulation.transport(case, "open", light.suns, light.sky.attrs["latitude"])
    mine = C["replicates"].values
    mine = mine if mine.ndim == 3 else mine[0]  # red
    sky, suns = (matrix(exported / f"C_{name}.mtx")[..., 0] for name in ("sky", "suns"))
    sky, suns = (c.reshape(REPEATS, mine.shape[1], -1) for c in (sky, suns / SUN_RADIANCE))
    bins = sky.shape[2]
    same(mine[..., :bins].mean(axis=1), other=sky.mean(axis=1), within=within)
    if by_suns:
        same(mine[..., bins:].mean(axis=1), other=suns.mean(axis=1), within=2 * within)


@skips.needs(ROOM)
def test_a_room_of_others(same, tmp_path):
    """Without the outside of the glass, which mirrors the sky to the sill, 0.8 % of it lacked."""
    copied(tmp_path, *(ROOM / f"{name}.rad" for name in FILES))
    tables = f"""
[model]
files = {json.dumps([f"{name}.rad" for name in FILES])}
north = 30.0
context = ["ExteriorWalls", "Ground"]
[sensors]
floors = ["Floor"]
spacing = 1.6
"""
    scene = "".join(f"!xform {name}.rad\n" for name in FILES[1:])
    agree(case_of(tmp_path, tables), tmp_path, scene, same, within=0.01)


OWN = """
void mirror silver 0 0 3 .8 .8 .8
void dielectric clear 0 0 5 1 1 1 1.5 0
void glass grey 0 0 3 .8 .8 .8
"""
SHELL = "!xform diorama_walls.rad rect_opening.rad front_cap.rad\n"
SCENES = {
    "glass": ("!xform -m grey glass_pane.rad\n", True),
    "mirror": ("!xform -m grey glass_pane.rad\n!xform -m silver mirror.rad\n", True),
    "solid pane": ("!xform -m clear dielectric_pane.rad\n", False),
}
"""Pieces in the room of the render tests; Radiance lets no sun through solids."""


@skips.needs(RENDERS)
@pytest.mark.parametrize("name", SCENES)
def test_rooms_of_radiances_render_tests(name, same, tmp_path):
    inside, by_suns = SCENES[name]
    copied(tmp_path, *RENDERS.glob("*.rad"))
    (tmp_path / "materials.rad").write_text((RENDERS / "basic.mat").read_text() + OWN)
    (tmp_path / "scene.rad").write_text(SHELL + inside)
    tables = """
[model]
files = ["materials.rad", "scene.rad"]
north = 90.0
[sensors]
floors = ["floor_mat"]
spacing = 1.2
margin = 0.5
"""
    case = case_of(tmp_path, tables)
    agree(case, tmp_path, SHELL + inside, same, within=0.015, by_suns=by_suns)


def refusal(path: Path, means: bool) -> str:
    """Message by which a scene is refused; empty where it is read."""
    try:
        read([path], means=means)
    except InputError as error:
        return str(error)
    return ""


def files_of(rif: Path) -> list[str]:
    """Scene files and commands of a file for `rad`."""
    lines = rif.read_text().replace("\\\n", " ").splitlines()
    pairs = (line.partition("=")[::2] for line in lines if not line.startswith("#"))
    wanted = ("material", "materials", "scene")
    return [word for name, text in pairs if name.strip() in wanted for word in shlex.split(text)]


@skips.needs(RENDERS)
@pytest.mark.parametrize("means", [False, True])
def test_every_render_test_is_read_or_refused_in_one_line(means, tmp_path, monkeypatch):
    monkeypatch.chdir(RENDERS)
    scenes = {rif.stem: files_of(rif) for rif in sorted(RENDERS.glob("*.rif"))}
    scenes |= {file.stem: ["basic.mat", file.name] for file in sorted(RENDERS.glob("*.rad"))}
    are_read = set()
    for name, words in scenes.items():
        path = tmp_path / f"the_{name}.rad"
        path.write_text("".join(f"{w}\n" if w[0] == "!" else f"!cat {w}\n" for w in words))
        message = refusal(path, means)
        if message:
            assert "\n" not in message, name
            assert ": line " in message, name
        else:
            are_read.add(name)
    expected = {"glass", "patterns", "torus"} if means else set()
    assert are_read >= expected | {"dielectric_pane", "mirror", "glass_pane", "rect_opening"}


def transmissivity(tau: float) -> float:
    """Share of light left after one pass of glass, by the formula of Radiance's manual page."""
    return float(
        (np.sqrt(0.8402528435 + 0.0072522239 * tau**2) - 0.9166530661) / 0.0036261119 / tau
    )


def polygon(modifier: str, name: str, corners, holes=()) -> str:
    """Polygon with seams to its holes."""
    ring = np.array(corners, float)
    front = np.cross(ring[1] - ring[0], ring[2] - ring[1])
    for hole in (np.array(hole, float) for hole in holes):
        if np.cross(hole[1] - hole[0], hole[2] - hole[1]) @ front > 0:
            hole = hole[::-1]
        gaps = np.linalg.norm(ring[:, None] - hole[None], axis=2)
        i, j = np.unravel_index(gaps.argmin(), gaps.shape)
        hole = np.roll(hole, -j, axis=0)
        ring = np.concatenate([ring[: i + 1], hole, hole[:1], ring[i:]])
    numbers = " ".join(f"{v:.9g}" for v in ring.ravel())
    return f"{modifier} polygon {name} 0 0 {ring.size} {numbers}\n"


RHO = {"Wall": 0.5, "Floor": 0.2, "RoofCeiling": 0.8, "in": 0.5, "out": 0.35}
"""Reflectances that Honeybee gives to faces and shades without a modifier."""


@skips.needs(HONEYBEE)
def test_a_honeybee_model(same, tmp_path):
    model = json.loads(HONEYBEE.read_text())
    materials = f"void glass pane 0 0 3 {' '.join(3 * [f'{transmissivity(0.64):.9g}'])}\n"
    materials += "".join(f"void plastic {n} 0 0 5 {v} {v} {v} 0 0\n" for n, v in RHO.items())
    scene = ""
    for face in (face for room in model["rooms"] for face in room["faces"]):
        panes = face.get("apertures") or []
        windows = [pane["geometry"]["boundary"] for pane in panes]
        corners = face["geometry"]["boundary"]
        scene += polygon(face["face_type"], face["identifier"], corners, windows)
        for pane, corners in zip(panes, windows, strict=True):
            scene += polygon("pane", pane["identifier"], corners)
            for key, modifier in (("outdoor_shades", "out"), ("indoor_shades", "in")):
                for shade in pane.get(key) or []:
                    scene += polygon(modifier, shade["identifier"], shade["geometry"]["boundary"])
    copied(tmp_path, HONEYBEE)
    (tmp_path / "materials.rad").write_text(materials)
    sensors = [s for g in model["properties"]["radiance"]["sensor_grids"] for s in g["sensors"]]
    rows = (" ".join(f"{v:g}" for v in (*s["pos"], *s["dir"])) for s in sensors[3::13])
    (tmp_path / "some.pts").write_text("\n".join(rows) + "\n")
    tables = f"""
[model]
files = ["{HONEYBEE.name}"]
north = -20.0
[sensors]
points = "some.pts"
"""
    agree(case_of(tmp_path, tables), tmp_path, scene, same, within=0.01)
