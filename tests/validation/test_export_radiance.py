"""The folder that `export --radiance` writes, simulated by its own script in Radiance.

Rationale: a user who checks a case by `simulate.sh` compares materials, sensors, sources and
options of ours, not only two programs; each of them may be wrong.

Method: the script runs as it stands. Every sensor stands twelve times in `sensors.pts`: repeats in
one process, whose random numbers go on. Options from the environment take fewer samples. Bins are
averaged over the sensors and tested by `same`. Suns that throw the edge of a shadow on a sensor are
left out there, as Radiance takes the disk for a square of its area.

Expected: C of sky and suns agrees within both errors, for open windows, for clear panes by the
engine's own formula, mirrored light included, and for diffusing panes. E is C·L.
"""

from __future__ import annotations

import os
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from drcmitsuba_plugins import bsdf_file

from drcmitsuba.annual import simulation
from drcmitsuba.case.reading import load_case
from drcmitsuba.export.primitives import GLAZING, GLAZING_FILE, polygon, polygons, twin
from drcmitsuba.export.radiance import save_radiance
from drcmitsuba.export.sources import SKY, SUN_RADIANCE, sun_text
from drcmitsuba.model.materials import BsdfMaterial, GlazingMaterial
from drcmitsuba.runtime import backend
from drcmitsuba.scene.surfaces import State
from drcmitsuba.sky.daylight import daylight
from tests import radiance, skips
from tests.unit.export.radiance_text import matrix
from tests.validation.test_films_radiance import SHARP, TO_PANE

pytestmark = skips.RADIANCE.mark

REPEATS = 12
CASE = """
name = "a room; $(touch pwned)"
[period]
timestamps = "times.csv"
[room]
size = [4.0, 5.0, 3.0]
rotation = 20
floor = 0.3
[facade.south]
segments = 2
frame = 0.1
strips = [{ bottom = 0.9, top = 2.7, material = "open" }]
[materials.glass]
type = "glazing"
transmittance = 0.65
reflectance = 0.15
[materials.shade]
type = "diffuser"
transmittance = 0.2
reflectance = 0.4
[[furniture]]
corner = [2.0, 3.0, 0.0]
size = [1.2, 0.6, 0.7]
reflectance = 0.6
[sensors]
corner = [0.5, 0.5, 0.8]
count = [4, 4]
spacing = 0.75
[shading]
material = "shade"
[accuracy]
replicates = 16
paths = 1024
cell_size = 0.15
cell_sky_rays = 256
sensor_sky_rays = 8192
pane_points = 1024
"""
TIMES = "time\n2015-01-12T12:00\n2015-03-20T10:00\n2015-04-15T14:00\n2015-06-15T12:00\n"
SKY_OPTIONS = "-ab 20 -lr -20 -lw 1e-5 -ad 512"
SUN_OPTIONS = "-ab 20 -lr -20 -lw 1e-5 -ad 64 -dt 0 -dc 1 -dj 1"


def simulated(folder: Path, sky_options: str = SKY_OPTIONS) -> None:
    """Run the script with every sensor repeated, in an empty environment but for paths."""
    root = radiance.home()
    assert root is not None
    sensors = folder / "sensors.pts"
    sensors.write_text(REPEATS * sensors.read_text())
    environment = {
        "PATH": os.pathsep.join([str(root / "bin"), os.environ["PATH"]]),
        "RAYPATH": str(root / "lib"), "SKY_OPTIONS": sky_options, "SUN_OPTIONS": SUN_OPTIONS,
    }  # fmt: skip
    command = ["sh", str(folder / "simulate.sh")]
    done = subprocess.run(command, cwd="/", env=environment, capture_output=True, timeout=600)
    assert done.returncode == 0, done.stderr.decode()


@pytest.mark.parametrize(
    ("material", "state"),
    [
        pytest.param("open", "open", marks=pytest.mark.slow),
        pytest.param("glass", "open", marks=pytest.mark.slow),
        pytest.param("glass", "shaded", marks=pytest.mark.slow),
    ],
)
def test_the_script_agrees(material: str, state: State, same, tmp_path):
    backend.select()
    (tmp_path / "times.csv").write_text(TIMES)
    text = CASE.replace('material = "open"', f'material = "{material}"')
    (tmp_path / "case.toml").write_text(text)
    case = load_case(tmp_path / "case.toml")
    folder = tmp_path / "a folder; $(touch pwned)"
    save_radiance(case, folder, state)
    simulated(folder)
    assert not list(tmp_path.rglob("pwned"))
    light = daylight(case)
    C = simulation.transport(case, state, light.suns, light.sky.attrs["latitude"])
    mine = C["replicates"].values
    sky, suns = (matrix(folder / f"C_{name}.mtx")[..., 0] for name in ("sky", "suns"))
    sky, suns = (c.reshape(REPEATS, mine.shape[1], -1) for c in (sky, suns / SUN_RADIANCE))
    bins = sky.shape[2]
    same(mine[..., :bins].mean(axis=1), other=sky.mean(axis=1), within=0.005)
    part = C.isel(bin=slice(bins, None))
    edge = (part["direct_se"] > 0.02 * part["direct"].max("sensor")).values
    assert edge.mean() < 0.2
    by_suns = mine[..., bins:] * ~edge
    same(by_suns.mean(axis=1), other=(suns * ~edge).mean(axis=1), within=0.01)
    E = np.loadtxt(folder / "E.txt").T
    L = [matrix(folder / f"L_{name}.mtx")[..., 0] for name in ("sky", "suns")]
    product = sky.reshape(len(E), -1) @ L[0] + suns.reshape(len(E), -1) @ L[1] * SUN_RADIANCE
    np.testing.assert_allclose(E, product, rtol=1e-5)


QUAD = np.array([[0.0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]])
"""A pane in the south of a room: its front faces north."""


def seen(text: str, viewers: np.ndarray, folder: Path, options: Sequence[str] = ()) -> np.ndarray:
    """Radiance towards viewers, unit vectors (viewer, 3) from the middle of the pane."""
    (folder / GLAZING_FILE).write_text(GLAZING)
    (folder / "pane.rad").write_text(text)
    (folder / "pane.oct").write_bytes(radiance.run(["oconv", "pane.rad"], folder))
    middle = QUAD.mean(axis=0)
    rays = "".join(
        " ".join(f"{v:.9g}" for v in row) + "\n" for row in np.c_[middle + viewers, -viewers]
    )
    command = ["rtrace", "-w", "-h", "-fa", "-ab", "0", "-lr", "8", *options, "pane.oct"]
    answer = radiance.run(command, folder, rays.encode())
    return np.array(answer.split(), float).reshape(-1, 3)[:, 0]


def test_a_clear_pane_transmits_and_mirrors_by_its_formula(tmp_path):
    """A sky of radiance 1 on both sides shows their sum; the outside mirrors nothing."""
    pane = GlazingMaterial(type="glazing", transmittance=0.6, exponent=3.0, reflectance=0.15)
    text = f"{SKY}{twin('pane', pane, QUAD[None]).text}\n{polygon('pane', 'p', QUAD)}\n"
    c = np.array([1.0, 0.9, 0.7, 0.5, 0.3, 0.1])
    viewers = np.stack([np.sqrt(1 - c**2), c, 0 * c], axis=-1)
    tau, rho = 0.6 * (1 - (1 - c) ** 3), 0.15 + 0.85 * (1 - c) ** 5
    np.testing.assert_allclose(seen(text, viewers, tmp_path), tau + rho, rtol=1e-5)
    np.testing.assert_allclose(seen(text, viewers * [1, -1, 1], tmp_path), tau, rtol=1e-5)


@pytest.mark.parametrize("turn", [False, True])
@pytest.mark.parametrize("flip", [False, True])
def test_a_film_is_mounted_as_ours(flip, turn, tmp_path):
    """Single rays against the file's cells, which mounting turns about the pane's axes."""
    case = radiance.reciprocal(load_case("classroom/reference/o2"), tmp_path)
    pane = next(m for m in case.materials.values() if isinstance(m, BsdfMaterial))
    film = pane.model_copy(update={"flip": flip, "turn": turn, "straight_through": "off"})
    sun = np.array([0.3, -0.7, 0.65])
    sun /= np.linalg.norm(sun)
    suns = radiance.numbered(sun[None], 0.1)
    shape = polygons("pane", film, QUAD[None])[0]
    text = f"{sun_text(suns)}{twin('pane', film, QUAD[None], film.file).text}\n{shape}\n"
    viewers = np.random.default_rng(0).normal(size=(2000, 3))
    viewers[:, 1] = abs(viewers[:, 1])
    viewers /= np.linalg.norm(viewers, axis=1, keepdims=True)
    theirs = seen(text, viewers, tmp_path, SHARP) / SUN_RADIANCE
    signs = np.array([(-1) ** (flip + turn), (-1) ** turn, (-1) ** flip])
    incident = np.broadcast_to(signs * (TO_PANE @ sun), viewers.shape)
    f = bsdf_file.read(film.file).query(incident, signs * (viewers @ TO_PANE.T))
    ours = f * abs(sun[1]) * 2 * np.pi * (1 - np.cos(np.radians(0.05)))
    assert ours.max() > 100 * np.median(ours)
    off = abs(theirs - ours) > 2e-3 * ours + 1e-6 * ours.max()
    # Rays on the edge of two cells may be read from either.
    assert off.mean() < 5e-3
