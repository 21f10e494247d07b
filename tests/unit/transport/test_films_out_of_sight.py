"""Receivers that see no film get nothing by way of films."""

import mitsuba as mi
import numpy as np

from drcmitsuba import load_case
from drcmitsuba.scene import scene
from drcmitsuba.transport.films.films import Films


def test_receivers_that_see_no_film():
    # As a shade in one plane with the film, which faces the room too.
    world = scene.load(load_case("classroom/reference/o3"), "open")
    sun = np.array([[0.0, -0.8, 0.6]])
    films = Films.of(world, 0.9, sun, 0.5)
    counts = []
    for toward in (1.0, -1.0):  # to the rear of the room, and to the film
        p, n = mi.Float(4.4, 4.5, 1.2), mi.Float(0, toward, 0)
        looked = films.looked(p, n, rays=64, seed=3)
        counts.append([len(kind.weight) for kind in looked.kinds])
        parts = looked.of(np.ones(len(films.patches), bool))
        assert [len(kind.weight) for kind in parts.kinds] == counts[-1]
    assert sum(counts[0]) == 0
    assert sum(counts[1]) > 0
