"""Openings that rays of an eye meet, in panes whose places are known."""

import numpy as np

from drcmitsuba.glare_year.openings import ELSEWHERE, NO_OPENING, SeenOpenings
from drcmitsuba.runtime import backend
from drcmitsuba.scene.panes_in_state import GroupedPanes
from drcmitsuba.transport.elements.weights import BESIDES


def pane(y):
    """Square of 2 m at a distance along y [m]."""
    corners = [[-1, y, -1], [1, y, -1], [1, y, 1], [-1, y, 1]]
    return np.array([corners], float)


def openings():
    """Openings 0, 2 m away, and 1, both 4 and 4.01 m away, as of double glass."""
    backend.select()
    panes = [
        GroupedPanes(0, pane(2.0), ()),
        GroupedPanes(1, np.concatenate([pane(4.0), pane(4.01)]), ()),
    ]
    return SeenOpenings.of(panes, (0, 2, 5))


def test_rays_note_the_first_opening_and_whether_there_is_another():
    eyes, ahead = np.zeros((5, 3)), np.tile([0.0, 1, 0], (5, 1))
    ahead[4] = [1, 0, 0]  # passes all
    far = np.array([1.0, 2.0, 3.0, np.inf, np.inf])
    none = np.full(5, NO_OPENING)
    opening, again = openings().both(eyes, ahead, far, none)
    assert opening.tolist() == [-1, 0, 0, 0, -1]
    assert again.tolist() == [False, False, False, True, False]
    opening, again = openings().both(eyes + [0, 3, 0], ahead, far, none)
    assert opening.tolist() == [1, 1, 1, 1, -1]
    assert not again.any()  # both panes are of one opening
    before = np.array([0, 1, 0, 1, 1])
    opening, again = openings().both(eyes + [0, 3, 0], ahead, far, before)
    assert opening.tolist() == before.tolist()
    assert again.tolist() == [True, False, True, False, False]


def test_a_trace_shows_the_elements_of_its_fill():
    seen = openings()
    assert seen.fills.tolist() == [2, 3]
    assert seen.elements(0).tolist() == [0, 2, BESIDES]
    assert seen.elements(2).tolist() == [ELSEWHERE, 4, BESIDES]
