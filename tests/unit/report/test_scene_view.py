"""Drawings of a scene before it is simulated."""

import time

import numpy as np
import pytest

from drcmitsuba.report.scene_view import outlines
from drcmitsuba.scene.geometry import box

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)


def test_edges_within_a_plane_are_left_out():
    edges = outlines(np.array([SQUARE, SQUARE + [1, 0, 0], SQUARE[::-1] + [0, 1, 0]]))
    assert len(edges) == 8
    assert np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1) == pytest.approx(1)
    lows = {tuple(edge.min(axis=0)) + tuple(edge.max(axis=0)) for edge in edges}
    assert (1, 0, 0, 1, 1, 0) not in lows
    assert (0, 1, 0, 1, 1, 0) not in lows


def test_edges_between_planes_stay():
    assert len(outlines(np.array(box(np.zeros(3), np.ones(3))))) == 24


def test_a_triangle_has_three_edges():
    assert len(outlines(np.array([SQUARE[[0, 1, 2, 2]]]))) == 3


def test_many_polygons_take_no_time():
    many = SQUARE + np.random.default_rng(0).uniform(-50, 50, (200_000, 1, 3))
    start = time.process_time()
    assert len(outlines(many)) == 800_000
    assert time.process_time() - start < 5  # a loop over them took 8
