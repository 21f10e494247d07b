"""Drawings of a scene before it is simulated."""

import sys

import numpy as np
import pytest

from drcmitsuba.report.edges import outlines
from drcmitsuba.report.scene_view import GROUPS, KINDS, MOST_ROWS, DrawnSurfaces, scene_view
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


def test_no_loop_goes_over_the_polygons():
    """Python calls as many functions for three polygons as for thousands."""

    def calls(count):
        some = SQUARE + np.random.default_rng(0).uniform(-50, 50, (count, 1, 3))
        events = []
        sys.setprofile(lambda frame, event, called: events.append(event))
        try:
            edges = outlines(some)
        finally:
            sys.setprofile(None)
        assert len(edges) == 4 * count
        return len(events)

    assert calls(3000) == calls(3) > 0


def legend_of(drawn, names=()):
    """Lines of text of both legends, and the colour of each line's mark."""
    figure = scene_view(drawn, np.zeros((1, 3)), names=names)
    return {
        text.get_text(): (mark.get_color(), mark.get_linestyle())
        for legend in figure.legends
        for text, mark in zip(legend.get_texts(), legend.get_lines(), strict=True)
    }


def test_groups_of_panes_have_colours_of_their_own():
    drawn = [DrawnSurfaces("surface", SQUARE[None]), DrawnSurfaces("pane", SQUARE[None] + 3)]
    alone = legend_of(drawn, ["glass: 1 m²"])
    assert alone["panes"] == (KINDS["pane"]["color"], "-")
    grouped = legend_of(
        [*drawn, *(DrawnSurfaces("pane", SQUARE[None] + i, f"{i}") for i in range(8))]
    )
    assert grouped["panes of no group"] == alone["panes"]
    assert "panes" not in grouped
    looks = [grouped[f"{i}"] for i in range(8)]
    assert len({*looks, alone["panes"]}) == 9
    assert [colour for colour, _ in looks[:6]] == list(GROUPS)


def test_a_legend_is_not_longer_than_its_place():
    drawn = [DrawnSurfaces("pane", SQUARE[None] + i, f"group {i}") for i in range(100)]
    texts = list(legend_of(drawn, ["glass " * 50]))
    assert len(texts) == 1 + MOST_ROWS
    assert texts[-1] == "… and 92 more"
    assert max(map(len, legend_of(drawn[:1], ["glass " * 50]))) < 60
