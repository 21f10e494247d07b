"""Rooms behind Radiance's `trans` and a fabric against `rtrace`: gloss, roughness, cut-off angle.

Rationale: a pane of `trans` sends light straight on, into a lobe and everywhere; which of these a
sensor gets differs by the sun's angle.

Method: E of nine points under a uniform sky, and of the sun alone at three heights; seeds here and
runs of `rtrace` until there is little noise. Expected: the means agree but for it and `within`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from tests import skips
from tests.validation.lit_room import SKY, assert_agrees, by_rtrace, room, simulated, sun

pytestmark = [
    pytest.mark.slow,
    skips.RADIANCE.mark,
]
CELLS = "cell_size = 0.225"
"""Half of the default: suns that light a strip of the floor have less noise."""


class Pane(NamedTuple):
    """A pane, the samples that it needs, and the deviations that are stated for it."""

    text: str
    within: float = 0.005
    """Deviation [–]."""
    grazing: float = 0.005
    """Deviation at the sun of an incidence of 77° [–]."""
    seeds: int = 3
    accuracy: str = CELLS
    divisions: int = 1000
    """Samples of a hemisphere of `rtrace` for suns."""
    noise: float = 3e-3
    """Largest standard error of a difference [–]."""


ROUGH = {
    "seeds": 7, "accuracy": f"{CELLS}\npane_points = 4096", "divisions": 4000, "noise": 4e-3,
}  # fmt: skip
"""Lobes take more samples: some points lie on the edge of what they light."""
PANES = {
    "straight": Pane("void trans pane 0 0 7 .8 .8 .8 0 0 .7 .5"),
    # Mirrored light counts as scattered. Of the scattered light of a sun, all that points get at
    # 77°, Radiance takes off another 5.4 %, the mean of F; see `radiance_materials.at_grazing`.
    "gloss": Pane("void trans pane 0 0 7 .8 .8 .8 .07 0 .7 .5", 0.01, 0.054),
    # Lobes are cut into cells: with cells of half the width, points get 0.4 % more of a sun at 54°.
    "rough": Pane("void trans pane 0 0 7 .8 .8 .8 0 .1 .7 .5", 0.02, 0.02, **ROUGH),
    "rough and gloss": Pane("void trans pane 0 0 7 .8 .8 .8 .05 .2 .7 .7", 0.03, 0.03, **ROUGH),
    "fabric": Pane(
        "void BRTDfunc pane 10 0 0 0 t t t 0 0 0 f.cal 0 9 .1 .1 .1 .1 .1 .1 .02 .02 .02"
    ),
}
RUNS = 20
"""Number of runs of `rtrace`."""
FABRIC = "t = if(abs(Rdot)-cos(75*PI/180), .3*(abs(Rdot)-cos(75*PI/180)), 0);"
TIMES = ("2015-03-21T12:30", "2015-06-21T12:30", "2015-12-21T12:30")
OF_SKY = "-ab 8 -ad 2000 -lr -10 -lw 1e-5 -ss 16 -st 0"
OF_SUN = "-ab 10 -lr -12 -lw 5e-6 -ss 16 -st 0 -dj 0.7 -dc 1 -dt 0 -ds .02 -ad"


@pytest.mark.parametrize("name", PANES)
def test_a_room_behind_a_translucent_pane(name, tmp_path):
    (tmp_path / "f.cal").write_text(FABRIC)
    pane = PANES[name]
    scene, bound = room(pane.text), {"among": len(PANES) * (1 + len(TIMES)), "noise": pane.noise}
    mine = simulated(tmp_path, scene, TIMES, pane.seeds, pane.accuracy)
    theirs = by_rtrace(tmp_path, scene + SKY, RUNS, OF_SKY)
    assert_agrees(f"{name}, sky", mine.sky, theirs, within=pane.within, **bound)
    for k, direction in enumerate(mine.directions):
        theirs = by_rtrace(tmp_path, scene + sun(direction), RUNS, f"{OF_SUN} {pane.divisions}")
        incidence = np.degrees(np.arccos(-direction[1]))
        within = pane.grazing if incidence > 70 else pane.within
        words = f"{name}, sun at {incidence:.0f}°"
        assert_agrees(words, mine.suns[:, k], theirs, within=within, **bound)
