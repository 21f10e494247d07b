"""A room of smooth plastic against `rtrace`: most of what grazing incidence adds goes deep.

Rationale: Radiance mirrors m + (1 − m) F(θ) at smooth surfaces of a specularity of 1.8 % and more.
A room whose surfaces mirror no more at grazing incidence than straight on is 1 % too dark, and one
that scatters what F adds is 0.6 % too bright.

Method: E of nine points under a uniform sky, the sums of C of the sky; eight seeds here, twelve
runs of `rtrace`. Expected: agreement within both errors (some 0.15 %).
"""

from __future__ import annotations

import pytest

from tests import skips
from tests.validation.lit_room import SKY, assert_agrees, by_rtrace, room, simulated

pytestmark = [
    pytest.mark.slow,
    skips.RADIANCE.mark,
]


def test_a_room_of_smooth_plastic(tmp_path):
    scene = room("void glass pane 0 0 3 .96 .96 .96", specularity=0.03)
    mine = simulated(tmp_path, scene, ("2015-06-21T12:30",), seeds=8).sky
    theirs = by_rtrace(tmp_path, scene + SKY, 12, "-ab 12 -ad 3000 -lr -14 -lw 2e-6")
    assert_agrees("sky", mine, theirs, within=0, among=1, noise=2e-3)
