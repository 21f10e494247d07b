"""A room of smooth plastic against `rtrace`: most of what grazing incidence adds goes deep.

Rationale: Radiance mirrors m + (1 − m) F(θ) at smooth surfaces of a specularity of 1.8 % and more.
A room whose surfaces mirror no more at grazing incidence than straight on is 1 % too dark, and one
that scatters what F adds is 0.6 % too bright.

Method: E of nine points under a uniform sky, the sums of C of the sky; eight seeds here, twelve
runs of `rtrace`. Expected: agreement within both errors (some 0.15 %).
"""

from __future__ import annotations

import numpy as np
import pytest

from drcmitsuba.annual import simulation
from drcmitsuba.case.reading import load_case
from drcmitsuba.runtime import backend
from drcmitsuba.sky.daylight import daylight
from tests import radiance

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(radiance.home() is None, reason="pyradiance is not installed"),
]
PLACES = [(x, y, 0.8) for x in (1, 2, 3) for y in (1, 2.5, 4)]
ROOM = """
void plastic floor 0 0 5 .2 .2 .2 .03 0
void plastic wall 0 0 5 .5 .5 .5 .03 0
void plastic ceil 0 0 5 .8 .8 .8 .03 0
void glass pane 0 0 3 .96 .96 .96
floor polygon f 0 0 12 0 0 0  4 0 0  4 5 0  0 5 0
ceil polygon c 0 0 12 0 0 3  0 5 3  4 5 3  4 0 3
wall polygon n 0 0 12 0 5 0  4 5 0  4 5 3  0 5 3
wall polygon e 0 0 12 4 0 0  4 0 3  4 5 3  4 5 0
wall polygon w 0 0 12 0 0 0  0 5 0  0 5 3  0 0 3
wall polygon s 0 0 30 0 0 0  0 0 3  4 0 3  4 0 0  0 0 0
    0.5 0 0.9  3.5 0 0.9  3.5 0 2.5  0.5 0 2.5  0.5 0 0.9
pane polygon p 0 0 12 0.5 0 0.9  0.5 0 2.5  3.5 0 2.5  3.5 0 0.9
"""
SKY = "void glow g 0 0 4 1 1 1 0\ng source s 0 0 4 0 0 1 180\n"


def by_rtrace(folder, runs):
    """Mean E of the places, shape (run,)."""
    (folder / "lit.rad").write_text(ROOM + SKY)
    (folder / "lit.oct").write_bytes(radiance.run(["oconv", "lit.rad"], folder))
    options = "-h -I -ov -ab 12 -ad 3000 -as 0 -aa 0 -lr -14 -lw 2e-6"
    # One process, as its random numbers follow from the number of the ray.
    rays = "".join(f"{x} {y} {z} 0 0 1\n" for x, y, z in PLACES) * runs
    out = radiance.run(["rtrace", *options.split(" "), "lit.oct"], folder, rays.encode())
    return np.array(out.split(), float).reshape(runs, len(PLACES), 3)[..., 0].mean(axis=1)


def test_a_room_of_smooth_plastic(tmp_path):
    backend.select()
    (tmp_path / "room.rad").write_text(ROOM)
    (tmp_path / "times.csv").write_text("time\n2015-06-21T12:30\n")
    (tmp_path / "case.toml").write_text(
        f'[model]\nfiles = ["room.rad"]\n[sensors]\npoints = {[list(p) for p in PLACES]}\n'
        '[period]\ntimestamps = "times.csv"\n'
    )
    case, mine = load_case(tmp_path / "case.toml"), []
    light = daylight(case)
    for seed in range(8):
        accuracy = case.accuracy.model_copy(update={"seed": seed})
        one = case.model_copy(update={"accuracy": accuracy})
        C = simulation.transport(one, "open", light.suns, light.sky.attrs["latitude"])
        sky = C["replicates"].values[..., 1:146].sum(axis=-1)  # (replicate, sensor)
        mine += sky.mean(axis=1).tolist()
    theirs = by_rtrace(tmp_path, 12)
    error = np.hypot(*(np.std(x, ddof=1) / np.sqrt(len(x)) for x in (mine, theirs)))
    assert error < 2.5e-3 * theirs.mean()
    assert abs(np.mean(mine) - theirs.mean()) < 3 * error
