"""Standing parts of figures: what many figures have in common is drawn once.

Axes with their ticks and labels, and legends, take most of the time of a plan of few sensors.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from contextlib import contextmanager
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

_ONE_AT_A_TIME = Lock()


class Standing(NamedTuple):
    """Parts of a figure that stand below all others, and what they follow from."""

    source: Hashable
    """All that decides how they look: parts of equal sources look alike at one resolution."""
    artists: tuple[Artist, ...]
    """In the order in which they are drawn."""
    below: Standing | None = None
    """Parts that stand below these."""

    @property
    def layers(self) -> tuple[Standing, ...]:
        """These parts and all below them, the lowest first."""
        return (*(() if self.below is None else self.below.layers), self)


class SheetFigure(Figure):
    """Figure that tells its standing parts."""

    standing = Standing(None, ())

    def stands(self, source: Hashable, *artists: Artist) -> None:
        """State the standing parts, besides the paper of the figure and of its axes."""
        paper = (self.patch, *(ax.patch for ax in self.axes))
        self.standing = Standing(source, (*paper, *artists))

    def also_stands(self, source: Hashable, *artists: Artist) -> None:
        """State further standing parts, which lie above the others."""
        below = self.standing
        self.standing = Standing((below.source, source), artists, below)


class DrawnParts:
    """Pixels of standing parts that were drawn before."""

    def __init__(self) -> None:
        self._known: dict[Hashable, Any] = {}

    def pixels(self, figure: Figure, dpi: int) -> np.ndarray:
        """Draw a figure: red, green, blue and opacity, uint8, shape (row, column, 4)."""
        before, canvas = figure.dpi, figure.canvas
        try:
            figure.dpi = dpi
            renderer: Any = FigureCanvasAgg(figure).get_renderer()
            with _letters_unhinted():
                self._draw(figure, renderer)
        finally:
            figure.dpi = before
            figure.set_canvas(canvas)
        return np.asarray(renderer.buffer_rgba())

    def _draw(self, figure: Figure, renderer: Any) -> None:
        """Draw a figure, the standing parts first where it has such."""
        if not isinstance(figure, SheetFigure):
            figure.draw(renderer)
            return
        layers = figure.standing.layers
        known = [k for k, layer in enumerate(layers) if self._key(figure, layer) in self._known]
        for layer in layers[known[-1] if known else 0 :]:
            self._begin(figure, layer, renderer)
        with _hidden([artist for layer in layers for artist in layer.artists]):
            figure.draw(renderer)

    def _begin(self, figure: SheetFigure, layer: Standing, renderer: Any) -> None:
        """Draw a layer of standing parts upon those below it, or put the pixels of all in place."""
        key = self._key(figure, layer)
        if key in self._known:
            renderer.restore_region(self._known[key])
            return
        for ax in figure.axes:
            ax.apply_aspect()
        for artist in layer.artists:
            artist.draw(renderer)
        self._known[key] = renderer.copy_from_bbox(figure.bbox)

    def _key(self, figure: Figure, layer: Standing) -> Hashable:
        """All that decides the pixels of a layer and those below it."""
        return layer.source, figure.dpi


@contextmanager
def _letters_unhinted() -> Iterator[None]:
    """Draw letters by their outlines alone: at the files' resolution they look the same.

    Hinting takes a third of the time of text. Matplotlib has one setting for all threads, so that
    figures are drawn one after the other.
    """
    with _ONE_AT_A_TIME, rc_context({"text.hinting": "no_hinting"}):
        yield


@contextmanager
def _hidden(artists: Sequence[Artist]) -> Iterator[None]:
    """Hide artists while the block runs."""
    seen = [artist for artist in artists if artist.get_visible()]
    for artist in seen:
        artist.set_visible(False)
    try:
        yield
    finally:
        for artist in seen:
            artist.set_visible(True)
