"""Bands against Radiance's spectral `rcontrib`, in a coloured room behind coloured glass.

Rationale: Radiance carries all wavelengths along each path, we simulate band by band with amounts
that we have read, named and scaled. What both agree on is neither's mistake.

Method: spectra are straight lines over the wavelength, so that the mean over one of Radiance's
intervals is the value at its centre (Radiance rounds reflectances up by up to `OWN`). Bins are
averaged over the sensors; every band and bin, and their sum, are tested by `same` (Welch's z with
both standard errors, Šidák's correction).
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from drcmitsuba.annual.run import Run
from drcmitsuba.annual.simulation import of_points
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN
from drcmitsuba.case.reading import case_from
from drcmitsuba.colour.bands import Bands
from drcmitsuba.colour.tints import Tints
from drcmitsuba.export.primitives import GLAZING, GLAZING_FILE, twin
from drcmitsuba.export.sources import SKY
from drcmitsuba.model.materials import Lambertian
from drcmitsuba.runtime import backend
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.scene import EnabledEffects
from drcmitsuba.scene.surfaces import surfaces_of
from drcmitsuba.sky.sun_models import Suns
from tests import radiance, skips

pytestmark = skips.RADIANCE.mark

LOW, HIGH, COUNT = 400.0, 700.0, 6
CENTRES = HIGH - (HIGH - LOW) / COUNT * (np.arange(COUNT) + 0.5)
BANDS = Bands(tuple(CENTRES[::-1].tolist()))
OWN = 5e-4
"""Difference between Radiance's mean over an interval and the value at its centre [–]."""
LINES = {"floor": (0.1, 0.5), "walls": (0.3, 0.7), "ceiling": (0.8, 0.6), "glass": (0.4, 0.8)}
"""Values at 380 and 780 nm."""


def line(name: str, wavelength: np.ndarray) -> np.ndarray:
    low, high = LINES[name]
    return low + (high - low) * (wavelength - 380) / 400


@pytest.fixture(scope="module")
def case(tmp_path_factory) -> Case:
    backend.select()
    folder, photopic = tmp_path_factory.mktemp("spectra"), BANDS.weights("Y")
    stated = {name: float(photopic @ line(name, CENTRES[::-1])) for name in LINES}
    for name, (low, high) in LINES.items():
        (folder / f"{name}.csv").write_text(f"380,{low}\n780,{high}\n", encoding="utf-8")
    tables = {
        "room": {"size": [4, 5, 3], **{n: stated[n] for n in ("floor", "walls", "ceiling")}},
        "facade": {"south": {"strips": [{"bottom": 0.9, "top": 2.7, "material": "glass"}],
                             "frame_reflectance": stated["walls"]}},
        "materials": {"glass": {"type": "glazing", "transmittance": stated["glass"]}},
        "sensors": {"corner": [0, 0, 0.8], "count": [4, 5], "spacing": 1.0},
        "accuracy": {"replicates": 12, "paths": 512, "cell_size": 0.2, "cell_sky_rays": 256,
                     "sensor_sky_rays": 4096},
        "colour": {"bands": 9, "spectra": {"frame": "walls.csv", **{n: f"{n}.csv" for n in LINES}}},
    }  # fmt: skip
    return case_from(tables, folder / "case.toml")


def text_for_radiance(case: Case) -> str:
    """Materials with spectra, as samples of Radiance's primitive `spectrum`, and polygons."""
    wavelengths, lines = np.linspace(780, 380, 41), []
    for i, surface in enumerate(surfaces_of(case)):
        name = surface.name.split()[0].replace("wall", "walls").replace("frame", "walls")
        values = line(name, wavelengths)
        numbers = " ".join(f"{v:.8f}" for v in values)
        lines.append(f"void spectrum s{i} 0 0 {2 + len(values)} 780 380 {numbers}")
        if isinstance(surface.material, Lambertian):
            lines.append(f"s{i} plastic m{i} 0 0 5 1 1 1 0 0")
        else:
            # Patterns do not tint BRTDfunc: light passes the pane once, so `by_rcontrib` does.
            clear = surface.material.model_copy(update={"transmittance": 1.0})
            lines.append(twin(f"m{i}", clear, surface.quads, "").text)
        for k, quad in enumerate(surface.quads):
            corners = " ".join(f"{v:.9g}" for v in quad.ravel())
            lines.append(f"m{i} polygon p{i}.{k} 0 0 12 {corners}")
    return "\n".join(lines) + "\n"


def by_rcontrib(case: Case, folder: Path, repeats: int) -> np.ndarray:
    """Coefficients of ground and patches [sr], (repeat, band, sensor, bin), bands rising."""
    points, normals = prepared(case).receivers.at()
    (folder / GLAZING_FILE).write_text(GLAZING)
    (folder / "room.rad").write_text(text_for_radiance(case) + SKY)
    (folder / "room.oct").write_bytes(radiance.run(["oconv", "room.rad"], folder))
    rows = np.concatenate([points, normals], axis=1)
    rays = "".join(" ".join(f"{v:.9g}" for v in row) + "\n" for row in rows) * repeats
    command = [
        "rcontrib", "-h", "-faf", "-I+", "-cs", str(COUNT), "-cw", f"{HIGH:g}", f"{LOW:g}",
        "-ab", "12", "-ad", "1500", "-lr", "-12", "-lw", "1e-4", "-e", "MF:1",
        "-f", "reinhart.cal", "-b", "rbin", "-bn", "Nrbins", "-m", "skyglow", "room.oct",
    ]  # fmt: skip
    values = np.frombuffer(radiance.run(command, folder, rays.encode()), np.float32)
    every = values.reshape(repeats, len(points), -1, COUNT).astype(float)
    tau = line("glass", CENTRES[::-1])
    return np.moveaxis(every, -1, 1)[:, ::-1] * tau[:, None, None]


@pytest.mark.slow
def test_a_coloured_room_behind_coloured_glass(case, same, tmp_path):
    theirs = by_rcontrib(case, tmp_path, 8).mean(axis=2)
    points, normals = prepared(case).receivers.at()
    tints = Tints(case, BANDS)
    nothing = Suns((), np.zeros((0, 3)), 0.5)
    ours = [
        of_points(
            case, OPEN, nothing, 0.0, points, normals,
            run=Run.of(case, EnabledEffects(channels=False)), tint=partial(tints.of, band),
        )["replicates"].values.mean(axis=1)
        for band in range(COUNT)
    ]  # fmt: skip
    ours = np.stack(ours, axis=1)
    same(ours, other=theirs, within=0.01)
    for band in range(COUNT):
        same(ours[:, band], other=theirs[:, band], within=0.01)


def test_radiance_takes_the_value_at_the_centre_of_an_interval(tmp_path):
    values = " ".join(f"{v:.8f}" for v in line("floor", np.linspace(780, 380, 41)))
    text = f"void spectrum s 0 0 43 780 380 {values}\ns plastic m 0 0 5 1 1 1 0 0\n"
    text += "m polygon p 0 0 12 -50 -50 0 50 -50 0 50 50 0 -50 50 0\n" + SKY
    (tmp_path / "plate.rad").write_text(text)
    (tmp_path / "plate.oct").write_bytes(radiance.run(["oconv", "plate.rad"], tmp_path))
    command = [
        "rcontrib", "-h", "-faf", "-I+", "-cs", str(COUNT), "-cw", f"{HIGH:g}", f"{LOW:g}",
        "-ab", "2", "-ad", "65536", "-lw", "1e-6", "-m", "skyglow", "plate.oct",
    ]  # fmt: skip
    values = np.frombuffer(radiance.run(command, tmp_path, b"0 0 1 0 0 -1\n"), np.float32)
    theirs, expected = values.reshape(-1, COUNT)[0] / np.pi, line("floor", CENTRES)
    common = theirs.sum() / expected.sum()  # all bands have the same rays, whose number is drawn
    assert common == pytest.approx(1, abs=0.005)
    assert theirs / common == pytest.approx(expected, abs=OWN)
