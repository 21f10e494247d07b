"""Models of others, read here and by Radiance from the same files.

Method: the case is exported for Radiance; in place of the exported surfaces stand the files of the
model themselves, moved to the case's origin and turned to the north. So reader, geometry,
materials and simulation are compared at once. C of sky and suns, mean over the sensors, by `same`.
"""

from __future__ import annotations

import shutil

import pytest

from drcmitsuba.annual import simulation
from drcmitsuba.case.case import Case, load_case
from drcmitsuba.export.radiance import save_radiance
from drcmitsuba.export.sources import SUN_RADIANCE
from drcmitsuba.runtime import backend
from drcmitsuba.scene.geometry import origin
from drcmitsuba.sky.daylight import daylight
from tests import SHARED, radiance
from tests.unit.export.radiance_text import matrix
from tests.validation.test_export_radiance import REPEATS, TIMES, simulated

pytestmark = pytest.mark.skipif(radiance.home() is None, reason="pyradiance is not installed")

ROOM = SHARED / "data" / "scenes" / "subramaniam_room"
FILES = ("materials", "Floor", "Ceiling", "InteriorWall", "ExteriorWalls", "Glazing", "Ground")
ACCURACY = """
[accuracy]
replicates = 16
paths = 1024
cell_size = 0.2
cell_sky_rays = 256
sensor_sky_rays = 8192
"""
OF_THE_ROOM = f"""
[period]
timestamps = "times.csv"
[model]
files = {[f"{name}.rad" for name in FILES]}
north = 30.0
context = ["ExteriorWalls", "Ground"]
[sensors]
floors = ["Floor"]
spacing = 1.6
{ACCURACY}
"""


def agree(case: Case, files, folder, same, *, within):
    """C of sky and suns, mean over sensors, from the case and from Radiance on the same files."""
    backend.select()
    exported = folder / "radiance"
    save_radiance(case, exported, "open")
    start = " ".join(f"{-v:g}" for v in origin(case))
    for file in files:
        shutil.copy(file, exported)
    # What lies clockwise of y by the north comes to y: the model turns the other way.
    move = f"-t {start} -rz {case.building.north:g}"
    text = "".join(f"!xform {move} {file.name}\n" for file in files[1:])
    (exported / "scene.rad").write_text(text)
    shutil.copy(files[0], exported / "materials.rad")
    simulated(exported, "-ab 20 -lr -20 -lw 1e-5 -ad 1024")
    light = daylight(case)
    C = simulation.transport(case, "open", light.suns, light.sky.attrs["latitude"])
    mine = C["replicates"].values
    sky, suns = (matrix(exported / f"C_{name}.mtx")[..., 0] for name in ("sky", "suns"))
    sky, suns = (c.reshape(REPEATS, mine.shape[1], -1) for c in (sky, suns / SUN_RADIANCE))
    bins = sky.shape[2]
    same(mine[..., :bins].mean(axis=1), other=sky.mean(axis=1), within=within)
    same(mine[..., bins:].mean(axis=1), other=suns.mean(axis=1), within=2 * within)


@pytest.mark.slow
@pytest.mark.xfail(reason="the sky differs by 0.8 %, not understood: path tracing agrees with ours")
@pytest.mark.skipif(not ROOM.is_dir(), reason="the Radiance scene is not beside the repository")
def test_a_room_of_others(same, tmp_path):
    for name in FILES:
        shutil.copy(ROOM / f"{name}.rad", tmp_path)
        (tmp_path / f"{name}.rad").chmod(0o600)
    (tmp_path / "times.csv").write_text(TIMES)
    (tmp_path / "case.toml").write_text(OF_THE_ROOM)
    case = load_case(tmp_path / "case.toml")
    agree(case, [tmp_path / f"{name}.rad" for name in FILES], tmp_path, same, within=0.01)
