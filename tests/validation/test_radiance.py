"""Ours against Radiance, on the paper's classroom: coefficients, a glass pane, and the Perez sky.

Rationale: Radiance shares no code with this package, and its sampling goes another way: nested
hemispheres without any cells, against paths that share a deposit. What both agree on is neither's
mistake.

Method: independent replicates on both sides. Bins are averaged over the sensors, every bin and the
sum are tested by `same` (Welch's z with both standard errors, Šidák's correction); the whole run
raises a false alarm once in 10 000. `within` is the standard error of the sum that both must have
reached together. Radiance takes its seed from the clock.

Expected: agreement within both errors, for the sky by `rcontrib` and by `rfluxmtx`, and for exact
suns of 0.5°. Left out are the few pairs of sensor and sun on the edge of a shadow: Radiance takes
the disk for a square of its area.
"""

from __future__ import annotations

import mitsuba as mi
import numpy as np
import pytest
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba import sky
from drcmitsuba.annual.bench.room import opened
from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.reading import load_case
from drcmitsuba.model.materials import GlazingMaterial
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.scene.surfaces import surfaces_of
from drcmitsuba.sky import weather
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute
from tests import radiance, skips

pytestmark = skips.RADIANCE.mark

BINS = len(Patches())
# Neither a cap on bounces nor a threshold that cuts: light below `-lw` plays Russian roulette.
UNBIASED = ["-ab", "20", "-lr", "-20", "-lw", "1e-5"]
SUN = ["-dt", "0", "-dc", "1", "-dj", "1"]


def suns(count: int) -> Suns:
    """Suns over the south, from the horizon up, none in line with another."""
    k = np.arange(count)
    altitude = np.radians(4 + 60 * (k + 0.5) / count)
    azimuth = np.radians(100 + (k * 0.618034 % 1) * 160)
    flat = np.cos(altitude)
    directions = np.stack(
        [flat * np.sin(azimuth), flat * np.cos(azimuth), np.sin(altitude)], axis=-1
    )
    return Suns(tuple(f"sun_{i}" for i in k), directions, 0.5)


@pytest.fixture(scope="module")
def case() -> Case:
    backend.select()
    return opened(load_case("classroom/reference/existing"))


def every(case: Case, step: int) -> tuple[np.ndarray, np.ndarray]:
    """Every `step`-th sensor of the grid in both directions, beginning at half a step."""
    points, normals = sensor_points(case)
    columns, rows = case.sensors.count
    kept = np.arange(columns * rows).reshape(rows, columns)[step // 2 :: step, step // 2 :: step]
    return points[kept.ravel()], normals[kept.ravel()]


FEW = Accuracy(
    replicates=16, paths=1024, cell_size=0.15, cell_sky_rays=256, sensor_sky_rays=8192
)  # fmt: skip


@pytest.fixture(scope="module")
def few(case):
    """36 sensors: our coefficients of sky and 24 suns, and the room as Radiance is given it."""
    points, normals = every(case, 4)
    C = compute(scene.load(case), points, normals, suns(24), FEW)
    assert C.bin.values.tolist() == Patches().labels + list(suns(24).labels)
    return C, radiance.scene_text(surfaces_of(case)), points, normals


@pytest.mark.parametrize("program", ["rcontrib", pytest.param("rfluxmtx", marks=pytest.mark.slow)])
def test_sky(few, program, same, tmp_path):
    """Every second of the sensors."""
    C, text, points, normals = few
    C = C.isel(sensor=slice(None, None, 2))
    room = radiance.Room(text, points[::2], normals[::2], tmp_path)
    trace = {"rcontrib": room.sky, "rfluxmtx": room.sky_by_rfluxmtx}[program]
    theirs = trace([*UNBIASED, "-ad", "2048"], repeats=12)
    mine = C["replicates"].values[..., :BINS]
    same(mine.mean(axis=1), other=theirs.mean(axis=1), within=0.002)


@pytest.mark.slow
def test_suns(few, same, tmp_path):
    C, *room = few
    room = radiance.Room(*room, tmp_path)
    theirs = room.suns(suns(24).directions, 0.5, [*UNBIASED, *SUN, "-ad", "256"], repeats=12)
    part = C.isel(bin=slice(BINS, None))
    edge = (part["direct_se"] > 0.02 * part["direct"].max("sensor")).values
    assert edge.mean() < 0.02
    mine = part["replicates"].values
    same((mine * ~edge).mean(axis=1), other=(theirs * ~edge).mean(axis=1), within=0.002)


def glazed(case: Case, transmissivity: float) -> scene.Scene:
    """The case with panes that transmit and mirror as Radiance's `glass` does."""
    loaded = scene.load(case)
    quads = [s.quads for s in surfaces_of(case) if isinstance(s.material, GlazingMaterial)]
    tau, rho = radiance.glass(np.linspace(0, 1, 2049), transmissivity)
    bsdf = {"type": "glazing", "transmittance": mi.TensorXf(tau.astype(np.float32))}
    for side in ("front", "back"):
        bsdf[f"reflectance_{side}"] = mi.TensorXf(rho.astype(np.float32))
    pane = scene.quad_mesh("pane", np.concatenate(quads), mi.load_dict(bsdf))
    walls = {f"wall{i}": shape for i, shape in enumerate(loaded.opaque.shapes())}
    return loaded.searched(
        full=mi.load_dict({"type": "scene", "pane": pane, **walls}, optimize=False),
        clear=mi.load_dict({"type": "scene", "pane": pane}, optimize=False),
    )


@pytest.mark.slow
def test_glass(same, tmp_path):
    """Radiance's `glass`, mirrored light back into the room included."""
    case = load_case("classroom/reference/existing")
    points, normals = every(case, 6)
    C = compute(glazed(case, 0.96), points, normals, suns(0), FEW)
    text = radiance.scene_text(surfaces_of(case), transmissivity=0.96)
    room = radiance.Room(text, points, normals, tmp_path)
    theirs = room.sky([*UNBIASED, "-ad", "2048"], repeats=6)
    same(C["replicates"].values.mean(axis=1), other=theirs.mean(axis=1), within=0.003)


def test_perez_sky(tmp_path):
    """Patch centres, as `gendaymtx` takes them, for hours of the default year with its own sun.

    It prints the sun's direction with six digits; where the sky is steep that is the error.
    """
    year = weather.default()
    hours = year.data.isel(time=(year.data.dni > 50) & (year.data.ghi > 50))
    hours = hours.isel(time=slice(0, None, 61))
    dni, dhi = hours.dni.values, hours.dhi.values
    theirs, direction = radiance.perez(hours.time.values, dni, dhi, year.site, tmp_path)
    east, north, up = direction.T
    sun = xr.Dataset(
        {
            "solar_zenith": ("time", np.degrees(np.arccos(up))),
            "solar_azimuth": ("time", np.degrees(np.arctan2(east, north)) % 360),
            "direction": (("time", "axis"), direction),
        },
        coords={"time": hours.time, "axis": ["x", "y", "z"]},
    )
    dew_point = ("time", np.full(len(dni), 11.0))  # gendaymtx's where a WEA file has none
    L = sky.radiance(hours.assign(dew_point=dew_point), sun, model=sky.Perez(sky.PatchCentres()))
    assert len(dni) > 40
    np.testing.assert_allclose(L.sky.values / 179, theirs, rtol=2e-5)


@pytest.mark.slow
def test_every_sensor(case, same, tmp_path):
    """All 576 sensors in 64 groups of 3 × 3, each with 146 sky bins and 24 suns of its own."""
    points, normals = sensor_points(case)
    columns, rows = case.sensors.count
    C = compute(scene.load(case), points, normals, suns(24), FEW)
    room = radiance.Room(radiance.scene_text(surfaces_of(case)), points, normals, tmp_path)
    by_sky = room.sky([*UNBIASED, "-ad", "2048"], repeats=12)
    by_suns = room.suns(suns(24).directions, 0.5, [*UNBIASED, *SUN, "-ad", "256"], repeats=12)
    mine = C["replicates"].values
    edge = (C["direct_se"] > 0.02 * C["direct"].max("sensor")).values[:, BINS:]

    def grouped(a: np.ndarray) -> np.ndarray:
        cut = a.reshape(len(a), rows // 3, 3, columns // 3, 3, -1)
        return cut.mean(axis=(2, 4))

    same(grouped(mine[..., :BINS]), other=grouped(by_sky), within=0.001)
    same(grouped(mine[..., BINS:] * ~edge), other=grouped(by_suns * ~edge), within=0.001)
