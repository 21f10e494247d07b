"""Openings that rays of an eye meet, in panes whose places are known."""

import mitsuba as mi
import numpy as np

from drcmitsuba.eye.openings import ELSEWHERE, NO_OPENING, SeenOpenings
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


def noted(p, far, before):
    """First opening of rays to the north, of the last one to the east, and if there is another."""
    ahead = np.tile([0.0, 1, 0], (5, 1))
    ahead[4] = [1, 0, 0]  # passes all
    ray = mi.Ray3f(mi.Point3f(*p.T), mi.Vector3f(*ahead.T))
    first, again = openings().noted(
        ray, mi.Float(far), mi.Int32(before), mi.Bool([False] * 5), mi.Bool([True] * 5)
    )
    return first.numpy().tolist(), again.numpy().tolist()


def test_rays_note_the_first_opening_and_whether_there_is_another():
    eyes = np.zeros((5, 3))
    far = np.array([1.0, 2.0, 3.0, np.inf, np.inf])
    none = np.full(5, NO_OPENING)
    opening, again = noted(eyes, far, none)
    assert opening == [-1, 0, 0, 0, -1]
    assert again == [False, False, False, True, False]
    opening, again = noted(eyes + [0, 3, 0], far, none)
    assert opening == [1, 1, 1, 1, -1]
    assert not any(again)  # both panes are of one opening
    before = [0, 1, 0, 1, 1]
    opening, again = noted(eyes + [0, 3, 0], far, np.array(before))
    assert opening == before
    assert again == [True, False, True, False, False]


def test_a_trace_shows_the_elements_of_its_fill():
    seen = openings()
    assert seen.fills.tolist() == [2, 3]
    assert seen.elements(0).tolist() == [0, 2, BESIDES]
    assert seen.elements(2).tolist() == [ELSEWHERE, 4, BESIDES]
