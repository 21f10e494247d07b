"""Rooms behind Radiance's `trans` and a fabric against `rtrace`: gloss, roughness, cut-off angle.

Rationale: a pane of `trans` sends light straight on, into a lobe and everywhere; which of these a
sensor gets differs by the sun's angle.

Method: E of nine points under a uniform sky, and of the sun alone at three heights; four seeds
here, eight runs of `rtrace`. Expected: the means agree within both errors and `WITHIN`. A smooth
pane with gloss is not compared at a sun of 77°: it scatters a third more of it, since Radiance's
scattered light lessens at grazing incidence, by (1 − F) of the sun's angle, and ours does not.
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
void plastic floor 0 0 5 .2 .2 .2 0 0
void plastic wall 0 0 5 .5 .5 .5 0 0
void plastic ceil 0 0 5 .8 .8 .8 0 0
floor polygon f 0 0 12 0 0 0  4 0 0  4 5 0  0 5 0
ceil polygon c 0 0 12 0 0 3  0 5 3  4 5 3  4 0 3
wall polygon n 0 0 12 0 5 0  4 5 0  4 5 3  0 5 3
wall polygon e 0 0 12 4 0 0  4 0 3  4 5 3  4 5 0
wall polygon w 0 0 12 0 0 0  0 5 0  0 5 3  0 0 3
wall polygon s 0 0 30 0 0 0  0 0 3  4 0 3  4 0 0  0 0 0
    0.5 0 0.9  3.5 0 0.9  3.5 0 2.5  0.5 0 2.5  0.5 0 0.9
pane polygon p 0 0 12 0.5 0 0.9  0.5 0 2.5  3.5 0 2.5  3.5 0 0.9
"""
PANES = {
    "straight": "void trans pane 0 0 7 .8 .8 .8 0 0 .7 .5",
    "gloss": "void trans pane 0 0 7 .8 .8 .8 .07 0 .7 .5",
    "rough": "void trans pane 0 0 7 .8 .8 .8 0 .1 .7 .5",
    "rough and gloss": "void trans pane 0 0 7 .8 .8 .8 .05 .2 .7 .7",
    "fabric": "void BRTDfunc pane 10 0 0 0 t t t 0 0 0 f.cal 0 9 .1 .1 .1 .1 .1 .1 .02 .02 .02",
}
WITHIN = {"gloss": 0.01, "rough and gloss": 0.03}
"""Deviation that is stated for panes whose mirrored light counts as scattered; 0.5 % of others."""
FABRIC = "t = if(abs(Rdot)-cos(75*PI/180), .3*(abs(Rdot)-cos(75*PI/180)), 0);"
SKY = "void glow g 0 0 4 1 1 1 0\ng source s 0 0 4 0 0 1 180\n"
TIMES = ("2015-03-21T12:30", "2015-06-21T12:30", "2015-12-21T12:30")


def by_rtrace(folder, pane, light, runs, options):
    """Mean E of the places, shape (run,)."""
    (folder / "lit.rad").write_text(f"{pane}\n{ROOM}{light}")
    (folder / "lit.oct").write_bytes(radiance.run(["oconv", "lit.rad"], folder))
    rays = "".join(f"{x} {y} {z} 0 0 1\n" for x, y, z in PLACES) * runs
    command = ["rtrace", "-h", "-I", "-ov", "-aa", "0", "-as", "0", *options.split(" "), "lit.oct"]
    out = radiance.run(command, folder, rays.encode())
    return np.array(out.split(), float).reshape(runs, len(PLACES), 3)[..., 0].mean(axis=1)


def agree(mine, theirs, within):
    error = np.hypot(*(np.std(x, ddof=1) / np.sqrt(len(x)) for x in (mine, theirs)))
    assert error < 0.02 * theirs.mean()
    assert abs(np.mean(mine) - theirs.mean()) < 2 * error + within * theirs.mean()


@pytest.mark.parametrize("name", PANES)
def test_a_room_behind_a_translucent_pane(name, tmp_path):
    backend.select()
    (tmp_path / "f.cal").write_text(FABRIC)
    (tmp_path / "room.rad").write_text(f"{PANES[name]}\n{ROOM}")
    (tmp_path / "times.csv").write_text("\n".join(("time", *TIMES)) + "\n")
    (tmp_path / "case.toml").write_text(
        f'[model]\nfiles = ["room.rad"]\n[sensors]\npoints = {[list(p) for p in PLACES]}\n'
        '[period]\ntimestamps = "times.csv"\n'
    )
    case, mine = load_case(tmp_path / "case.toml"), []
    light = daylight(case)
    for seed in range(4):
        accuracy = case.accuracy.model_copy(update={"seed": seed})
        one = case.model_copy(update={"accuracy": accuracy})
        C = simulation.transport(one, "open", light.suns, light.sky.attrs["latitude"])
        mine.append(C["replicates"].values.mean(axis=1))  # (replicate, bin)
    every = np.concatenate(mine)
    options = "-ab 8 -ad 2000 -lr -10 -lw 1e-5 -ss 16 -st 0"
    sky = by_rtrace(tmp_path, PANES[name], SKY, 8, options)
    agree(every[:, 1:146].sum(axis=1), sky, WITHIN.get(name, 0.005))
    directions = np.asarray(light.suns.directions)
    for k, d in enumerate(directions):
        if name == "gloss" and d[2] > 0.9:
            continue
        sun = f"void light l 0 0 3 1 1 1\nl source s 0 0 4 {d[0]} {d[1]} {d[2]} 0.5\n"
        options = "-ab 6 -ad 1000 -lr -10 -lw 1e-5 -ss 16 -st 0 -dj 0.7 -dc 1 -dt 0 -ds .02"
        theirs = by_rtrace(tmp_path, PANES[name], sun, 8, options)
        agree(every[:, 146 + k], theirs, WITHIN.get(name, 0.005))
