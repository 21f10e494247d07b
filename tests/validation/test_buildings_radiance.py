"""Buildings in gbXML, exported and simulated by Radiance, room by room.

Rationale: a building passes through a reader that gives each surface two sides, cuts openings and
closes gaps; both programs get the surfaces that it made, so that its geometry is checked for being
one thing to both, and light for coming into every room by its own openings.

Method: grids of 1.5 m or more in every space; the folder of `export --radiance` runs as it stands,
every sensor twelve times. C of the sky and of four suns is averaged over the sensors of a room.

Expected: the same light in every room within both errors (Šidák over rooms and bins, and in sum).
"""

from pathlib import Path

import numpy as np
import pytest

from drcmitsuba.annual import simulation
from drcmitsuba.case.reading import load_case
from drcmitsuba.export.radiance import save_radiance
from drcmitsuba.export.sources import SUN_RADIANCE
from drcmitsuba.runtime import backend
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.sky.daylight import daylight
from tests import SHARED, skips
from tests.unit.export.radiance_text import matrix
from tests.validation.test_export_radiance import REPEATS, TIMES, simulated

SAMPLES = SHARED / "data" / "gbxml"
pytestmark = [skips.RADIANCE.mark, skips.needs(SAMPLES), pytest.mark.slow]
CASE = """
[model]
files = ["{file}"]
[period]
timestamps = "times.csv"
[sensors]
spaces = ["*"]
spacing = {spacing}
margin = 0.5
[materials.{glass}]
type = "glazing"
transmittance = 0.6
[accuracy]
replicates = 16
paths = 1024
cell_size = 0.3
sensor_sky_rays = 4096
"""


@pytest.mark.parametrize(
    ("name", "spacing", "glass", "of_suns"),
    [
        ("house_2_spaces", 3.0, '"1/8 in Pilkington single glazing"', 0.03),  # small windows
        ("two_spaces_chinese_names", 1.5,
         '"Large double-glazed windows (reflective coating) - industry"', 0.02),
        ("tower_6_spaces_shades", 3.0, '"Low-E triple glazing SC=0.5"', 0.02),
    ],
)  # fmt: skip
def test_every_room_gets_the_same_light(
    name: str, spacing: float, glass: str, of_suns: float, same, tmp_path: Path
):
    backend.select()
    (tmp_path / "times.csv").write_text(TIMES)
    text = CASE.format(file=SAMPLES / f"{name}.xml", spacing=spacing, glass=glass)
    (tmp_path / "case.toml").write_text(text)
    case = load_case(tmp_path / "case.toml")
    folder = tmp_path / "exported"
    save_radiance(case, folder, "open")
    simulated(folder, "-ab 12 -lr -12 -lw 1e-5 -ad 4096")
    light = daylight(case)
    C = simulation.transport(case, "open", light.suns, light.sky.attrs["latitude"])
    mine = C["replicates"].values
    sky, suns = (matrix(folder / f"C_{kind}.mtx")[..., 0] for kind in ("sky", "suns"))
    theirs = np.concatenate([sky, suns / SUN_RADIANCE], axis=1).reshape(REPEATS, mine.shape[1], -1)
    spaces = prepared(case).receivers.coordinates["space"].values
    edge = (C["direct_se"] > 0.02 * C["direct"].max("sensor")).values
    edge[:, : sky.shape[1]] = False

    def by_room(values: np.ndarray) -> np.ndarray:
        lit = np.where(edge, 0, values)
        return np.stack([lit[:, spaces == s].mean(axis=1) for s in np.unique(spaces)], axis=1)

    bins = sky.shape[1]
    same(by_room(mine)[..., :bins], other=by_room(theirs)[..., :bins], within=0.01)
    same(by_room(mine)[..., bins:], other=by_room(theirs)[..., bins:], within=of_suns)
