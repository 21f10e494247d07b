"""Films by our own two routes: G·D against the plugin `coefficient`, plain path tracing.

Rationale: `coefficient` follows paths to sky and suns through the film's BSDF itself. It knows
neither cells of surfaces, nor tables over the film's cells, nor patches of the film.

Method: independent replicates on both sides; the direct part and the sum are tested by `same`,
every sensor and bin and the sum over all. Suns in the plane of a pane are avoided. Panes opposite
each other do not mirror here: mirrored light between façades is not followed (see `plan`).
"""

from __future__ import annotations

from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins.klems_basis import BASES
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute
from tests import ROOT, SHARED, skips

BINS = len(Patches())
SCENES = ROOT / "scenes"
SHARED = SHARED / "data" / "bsdf"
PRISM = SCENES / "films" / "prism.xml"


@pytest.fixture(autouse=True, scope="module")
def _backend():
    backend.select()


def towards(altitude: float, azimuth: float) -> list[float]:
    a, z = np.radians([altitude, azimuth])
    return [np.sin(z) * np.cos(a), np.cos(z) * np.cos(a), np.sin(a)]


SOUTH = np.array([towards(50, 180), towards(30, 203), towards(62, 150), towards(20, 165)])
EAST = np.array([towards(25, 95), towards(12, 80)])
HIGH = np.array([towards(62, 150), towards(50, 180), towards(55, 205), towards(58, 170)])
OPPOSITE = {"name": "opposite", "corner": [-5, -6, 0], "size": [14, 2, 5], "reflectance": 0.4}


def room(file: Path, reflectance: float = 0.1, **film: object) -> Case:
    """A small room: in the south glass up to 1.8 m and the film above."""
    strips = [
        {"bottom": 0.8, "top": 1.8, "material": "glass"},
        {"bottom": 1.8, "top": 2.8, "material": "film"},
    ]
    return Case.model_validate(
        {
            "room": {"size": [4, 5, 3], "floor": 0.2, "ceiling": 0.8, "walls": 0.5},
            "facade": {"south": {"strips": strips}},
            "materials": {
                "glass": {"type": "glazing", "transmittance": 0.7, "reflectance": reflectance},
                "film": {"type": "bsdf", "file": str(file), **film},
            },
            "sensors": {"corner": [0.5, 0.5, 0.8], "count": [2, 3], "spacing": 1.2},
        }
    )


def changed(case: Case, **tables: object) -> Case:
    return Case.model_validate({**case.model_dump(exclude_unset=True), **tables})


ACCURACY = Accuracy(
    replicates=16, paths=512, cell_sky_rays=128, sensor_sky_rays=4096,
    pane_points=128, film_sky_samples=512,
)  # fmt: skip


def agree(case: Case, same, plain_coefficients, directions=SOUTH, quick=False, within=0.004):
    """Both routes give the same: what arrives without diffuse reflection, and all of it."""
    points, normals = sensor_points(case)
    suns = Suns(tuple(f"sun_{i}" for i in range(len(directions))), directions)
    loaded = scene.load(case)
    accuracy = ACCURACY.model_copy(update={"cell_size": 0.3 if quick else 0.15})
    C = compute(loaded, points, normals, suns, accuracy)
    sources = {
        "sky": {"type": "tregenza_sky"},
        "suns": {"type": "sun_disks", "directions": mi.TensorXf(directions.astype(np.float32))},
    }
    shapes = {f"shape{i}": s for i, s in enumerate(loaded.full.shapes())}
    with_sources = mi.load_dict({"type": "scene", **shapes, **sources}, optimize=False)
    spp, within = (1 << 16, 0.005) if quick else (1 << 17, within)
    plain = plain_coefficients(with_sources, points, normals, replicates=16, spp=spp)
    mine, theirs = C["replicates"].values, plain.sum(axis=0)
    for bins in (slice(0, BINS), slice(BINS, None)):
        # The sensors' mean for every bin, then every sensor's sum over the bins.
        same(mine[..., bins].mean(axis=1), other=theirs[..., bins].mean(axis=1), within=within)
        same(mine[..., bins].sum(axis=2), other=theirs[..., bins].sum(axis=2), within=within)


@pytest.mark.slow
def test_prism_film(same, plain_coefficients):
    agree(room(PRISM), same, plain_coefficients, quick=True)


def tree(rng: np.random.Generator, depth: int) -> str:
    """Random tensor tree of rank 4: nodes that end early, dark leaves, values over decades."""

    def node(level: int) -> str:
        if level == depth or (level and rng.random() < 0.6):
            return "{%.6g}" % (0.4 * rng.random() ** 4 * (rng.random() > 0.3))
        return "{" + "".join(node(level + 1) for _ in range(16)) + "}"

    return node(0)


def matrix(rng: np.random.Generator, through: float = 0.0) -> str:
    """Random matrix over Klems' patches, with light straight through."""
    basis = BASES["LBNL/Klems Full"]
    values = 0.25 / np.pi * rng.random((len(basis),) * 2) ** 4
    values += np.diag(through / basis.projected_solid_angle)
    return " ".join(f"{v:.6g}" for v in values.ravel())


DIRECTIONS = {
    "tb": "Transmission Front", "tf": "Transmission Back",
    "rb": "Reflection Front", "rf": "Reflection Back",
}  # fmt: skip


def made(folder: Path, name: str) -> Path:
    """A file that is made here: not reciprocal, without one direction, or with a peak."""
    rng = np.random.default_rng(5)
    kind, basis = "Columns", "LBNL/Klems Full"
    if name == "random tree":
        kind, basis = "TensorTree4", "LBNL/Shirley-Chiu"
        data = {n: tree(rng, 2) for n in DIRECTIONS}
    elif name == "only from outside":
        kind, basis = "TensorTree4", "LBNL/Shirley-Chiu"
        data = {"tb": tree(rng, 2)}
    elif name == "random matrix":
        data = {n: matrix(rng) for n in DIRECTIONS}
    else:
        data = {"tb": matrix(rng, 0.4), "rf": matrix(rng)}
    blocks = "".join(
        "<WavelengthData><Wavelength>Visible</Wavelength><WavelengthDataBlock>"
        f"<WavelengthDataDirection>{DIRECTIONS[n]}</WavelengthDataDirection>"
        f"<ColumnAngleBasis>{basis}</ColumnAngleBasis><RowAngleBasis>{basis}</RowAngleBasis>"
        f"<ScatteringData>{numbers}</ScatteringData></WavelengthDataBlock></WavelengthData>"
        for n, numbers in data.items()
    )
    path = folder / "made.xml"
    path.write_text(
        '<?xml version="1.0"?><WindowElement><Optical><Layer><DataDefinition>'
        f"<IncidentDataStructure>{kind}</IncidentDataStructure></DataDefinition>{blocks}"
        "</Layer></Optical></WindowElement>"
    )
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["random tree", "only from outside", "random matrix", "matrix with a peak"]
)
def test_files_made_here(name, same, plain_coefficients, tmp_path):
    agree(room(made(tmp_path, name)), same, plain_coefficients)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["subramaniam_ven45_klems.xml", "honeybee_tensortree.xml", "subramaniam_blindsT3.xml"],
)
def test_files_of_others(name, same, plain_coefficients):
    agree(room(skips.data(SHARED / name)), same, plain_coefficients)


@pytest.mark.slow
@pytest.mark.parametrize("mounting", [{"flip": True}, {"turn": True}, {"straight_through": "on"}])
def test_mountings(mounting, same, plain_coefficients):
    agree(room(PRISM, **mounting), same, plain_coefficients)


@pytest.mark.slow
def test_building_opposite(same, plain_coefficients):
    """The film's patches do not see the same: each has samples of its own, and they are fewer.

    The suns stand above the roof opposite: of lower ones little more than noise arrives.
    """
    case = changed(room(PRISM), furniture=[OPPOSITE])
    agree(case, same, plain_coefficients, HIGH, within=0.012)


@pytest.mark.slow
def test_second_facade(same, plain_coefficients):
    """Sun and sky shine on the film from the room's side, too."""
    case = room(PRISM, reflectance=0.0)
    window = {"strips": [{"bottom": 0.8, "top": 2.0, "material": "open"}]}
    facade = case.model_dump(exclude_unset=True)["facade"]
    case = changed(case, facade={**facade, "east": window})
    agree(case, same, plain_coefficients, np.concatenate([SOUTH, EAST]))
