"""The same seed gives the same numbers: on any threads, in any chunks, after any variant.

Random numbers follow from what they are for, never from the launch that they are drawn in; only the
order of sums differs. Chunks change no random number, so 1e-5 is left for rounding alone, relative
to the largest coefficient of each sensor.
"""

import itertools

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.case.case import Case
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene as scenes
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport import coefficients
from drcmitsuba.transport.films import answers as film_answers
from drcmitsuba.transport.gather import blocks as gather_blocks
from drcmitsuba.transport.interreflection import interior
from drcmitsuba.transport.light import products
from drcmitsuba.transport.photons import tracer as photons
from drcmitsuba.transport.rays import shadow_rays
from drcmitsuba.transport.rays.straight_suns import straight_suns
from tests import ROOT
from tests.fast import slowly

SAME = 1e-5
PRISM = ROOT / "scenes" / "films" / "prism.xml"
DIRECTIONS = np.array([[0, -0.8, 0.6], [0.48, -0.64, 0.6], [-0.6, -0.48, 0.64], [0, -0.28, 0.96]])
SUNS = Suns(tuple(f"sun_{i}" for i in range(4)), DIRECTIONS)
MATERIALS = {
    "glass": {"type": "glazing", "transmittance": 0.65, "reflectance": 0.12},
    "film": {"type": "bsdf", "file": str(PRISM)},
    "opal": {"type": "diffuser", "transmittance": 0.5, "reflectance": 0.3},
    "silver": {"type": "mirror", "reflectance": 0.95, "roughness": 0.05},
}
DUCT = {
    "type": "duct", "side": "south", "centre": 1.5, "width": 0.8, "height": 0.3, "length": 1.5,
    "mirror": "silver", "bottom": "opal",
}  # fmt: skip
STRIPS = {"open room": ["open"], "film": ["glass", "film"], "diffuser": ["glass", "opal"],
          "component": ["glass"]}  # fmt: skip


def case_of(kind):
    height = 1.8 / len(STRIPS[kind])
    strips = [
        {"bottom": 0.9 + i * height, "top": 0.9 + (i + 1) * height, "material": name}
        for i, name in enumerate(STRIPS[kind])
    ]
    tables = {
        "room": {"size": (3.0, 4.0, 3.0)},
        "facade": {"south": {"segments": 2, "frame": 0.1, "strips": strips}},
        "materials": MATERIALS,
        "sensors": {"corner": (0.4, 0.4, 0.8), "count": (4, 5), "spacing": 0.7},
        "accuracy": {"replicates": 2, "paths": 64, "cell_sky_rays": 64, "sensor_sky_rays": 512,
                     "pane_points": 32, "film_sky_samples": 64, "photons": 64, "seed": 3},
    }  # fmt: skip
    if kind == "component":
        tables["components"] = {"duct": DUCT}
    return Case.model_validate(tables)


def run(kind):
    """All that coefficients hold, of a room made anew."""
    case = case_of(kind)
    world = scenes.load(case, "open")
    points, normals = sensor_points(case)
    C = coefficients.compute(world, points, normals, SUNS, case.accuracy)
    straight = straight_suns(world, points, normals, SUNS, case.accuracy)[0]
    return C.assign(suns_alone=(("sensor", "sun"), straight))


NAMES = ("straight", "direct", "interreflected", "replicates", "suns_alone")


def distances(a, b):
    """Largest distance of each sensor's numbers, relative to the largest of the sensor."""
    for name in NAMES:
        x, y = (np.asarray(d[name].values, float) for d in (a, b))
        assert x.max() > 0
        scale = np.maximum(abs(x).max(axis=-1, keepdims=True), 1e-12)
        yield float((abs(x - y) / scale).max())


@pytest.fixture(scope="module")
def usual():
    """Each kind of room as the program computes it here, once."""
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")
    return {kind: run(kind) for kind in STRIPS}


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


@pytest.mark.parametrize("kind", slowly(STRIPS, "diffuser"))
def test_one_thread_and_two(kind, usual, holds):
    """Threads finish in any order: what is drawn must not depend on it, only rounding may."""
    threads = dr.thread_count()
    results = []
    try:
        for count in (1, 2):
            dr.set_thread_count(count)
            results.append(run(kind))
    finally:
        dr.set_thread_count(threads)
    holds("C on one thread and on two", max(distances(*results)), SAME)
    holds("C on one thread and on all", max(distances(results[0], usual[kind])), SAME)


@pytest.mark.parametrize("kind", slowly(STRIPS, "diffuser"))
def test_one_chunk_and_ten(kind, usual, holds, monkeypatch):
    """Sensors two at a time, rays and photons a few thousand at a time; vertices traced again.

    Another sensor's chunk finds the cells first, cells are numbered in another order, and a chunk
    begins within the photons of one component: none of it may move a random number.
    """
    monkeypatch.setattr(interior, "SENSORS", 2)
    monkeypatch.setattr(products, "SUMMED", 100)
    monkeypatch.setattr(products, "TOGETHER", 1 << 12)
    monkeypatch.setattr(gather_blocks, "KEPT", 1000)
    monkeypatch.setattr(shadow_rays, "SHADOW_RAYS", 1 << 12)
    monkeypatch.setattr(film_answers, "SHADOW_RAYS", 1 << 18)
    monkeypatch.setattr(photons, "PHOTONS", 1 << 12)
    holds("C in one chunk and in ten", max(distances(run(kind), usual[kind])), SAME)


def test_chunks_by_paths(usual, holds, monkeypatch):
    """The paths may limit a chunk, too: one sensor at a time, in any room."""
    kind = "open room"
    monkeypatch.setattr(interior, "PATHS", 1)
    holds("C sensor by sensor", max(distances(run(kind), usual[kind])), SAME)


@pytest.mark.parametrize("kind", slowly(STRIPS, "diffuser", "open room"))
def test_after_a_change_of_variant(kind, usual, holds):
    """There and back: plugins are registered anew, kernels are compiled anew, numbers stay."""
    here = str(mi.variant())
    backend.select(here.replace("mono", "rgb"))
    there = run(kind)
    backend.select(here)
    back = run(kind)
    holds("C in colour", max(distances(there, usual[kind])), SAME)
    holds("C after the change", max(distances(back, usual[kind])), SAME)


def test_seeds_differ(usual, holds):
    """The test of the tests: another seed moves these numbers by far more than what is allowed."""
    case = case_of("film")
    case = case.model_copy(update={"accuracy": case.accuracy.model_copy(update={"seed": 4})})
    points, normals = sensor_points(case)
    other = coefficients.compute(
        scenes.load(case, "open"), points, normals, SUNS, case.accuracy
    ).assign(suns_alone=usual["film"]["suns_alone"])
    assert max(itertools.islice(distances(other, usual["film"]), 4)) > 1000 * SAME
