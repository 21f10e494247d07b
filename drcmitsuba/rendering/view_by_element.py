r"""A view whose façade is open to choice: of any fills of its openings, a picture is a sum.

fills ─ rays of the eye, of the surfaces to sky and panes ─► slots, each with its element
inner ─ rays of the surfaces, and T between cells ─────────► weights, each with a mark
state ─ `in_state`: slots of its elements, weights times the shares of their marks
      ─ D on cells and panes, sun, photons, in the scene of the state ─► `TracedView`

An element is an opening with one of its fills. What depends on the eye is traced once. Light
between surfaces is that of the state, however often it meets openings. So is all light that falls
on cells and panes, which takes no ray of the eye. What the eye, or a surface that it sees, has
beyond a second opening is seen with the fill of the number that the first one has.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import mitsuba as mi
import numpy as np

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.picture.view import PictureView
from drcmitsuba.rendering.chosen_paths import ChosenPaths
from drcmitsuba.rendering.facade_scenes import FacadeScenes, Indices
from drcmitsuba.rendering.glow import GlowTable
from drcmitsuba.rendering.pixel_paths import PixelPaths, Sampling
from drcmitsuba.rendering.surface_light import SurfaceLight
from drcmitsuba.rendering.traced_view import TracedView
from drcmitsuba.rendering.view_glow import GlowLayout, ViewGlow
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.scene.scene import Scene
from drcmitsuba.transport.cells.points import CellPoints
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.elements.marks import share_of
from drcmitsuba.transport.elements.weights import chosen
from drcmitsuba.transport.interreflection.solved_cells import Transfer

MOST_STATES = 4
"""Largest number of states whose light on the surfaces stays in memory."""


@dataclass(frozen=True, eq=False)
class ViewCells:
    """Cells of a view, for all states of its façade."""

    keys: mi.UInt32
    """Key of every cell."""
    drawn: CellPoints
    """Points that stand for the cells in every replicate."""
    transfer: Transfer | None
    """Light between cells, with marks; None where paths follow all bounces."""
    again: float = 0.0
    """Sum of the weights of what rays of the eye see beyond two openings, over their number [–]."""

    @classmethod
    def none(cls, replicates: int) -> ViewCells:
        """Begin without cells."""
        return cls(mi.UInt32(), CellPoints.none(replicates), None)


@dataclass(frozen=True, eq=False)
class ViewByElement:
    """Light paths of a whole picture, by element."""

    scenes: FacadeScenes
    view: PictureView
    """View in the frame in which the scenes are traced."""
    rows: int
    columns: int
    sampling: Sampling
    accuracy: Accuracy
    subdivision: int
    """Reinhart's factor MF of the sky."""
    diameter: float
    """Angle across the sun [deg]."""
    cells: ViewCells
    tiles: Callable[[], Iterator[PixelPaths]]
    """Gives the light paths of all pixels, some at a time."""
    _states: dict[Indices, TracedView] = field(default_factory=dict, init=False, repr=False)
    """Views in the states that were asked for last."""

    @cached_property
    def glows(self) -> tuple[GlowTable, ...]:
        """Tables of the panes' radiance in the scene of every fill."""
        return tuple(GlowTable.of(base) for base in map(self._by_sky, self.scenes.fills))

    @property
    def nbytes(self) -> int:
        """Size of the light paths [bytes], at most."""
        each = self.sampling.nbytes(self.scenes.looks, len(self.scenes.fills))
        return each * self.rows * self.columns

    def in_state(self, indices: Indices = ()) -> TracedView:
        """View with one fill in each opening, an index; the only one where nothing changes."""
        indices = () if self.scenes.openings is None else indices
        if indices not in self._states:
            while len(self._states) >= MOST_STATES:
                del self._states[next(iter(self._states))]
            self._states[indices] = self._in_state(indices)
        return self._states[indices]

    def _by_sky(self, world: Scene) -> Deposit:
        """Deposit of a scene by the sky alone."""
        no_suns = np.zeros((0, 3))
        return Deposit.of(world, no_suns, self.diameter, self.subdivision, self.accuracy)

    def _in_state(self, indices: Indices) -> TracedView:
        openings, cells, tiles = self.scenes.openings, self.cells, self.tiles
        base = self._by_sky(self.scenes.load(indices))
        glow = ViewGlow(GlowTable.of(base))
        transfer = cells.transfer
        if openings is not None:
            *first, count = openings.starts
            shares = chosen(np.array(first), np.array(indices), count)
            paths = ChosenPaths.of(self.scenes, base.scene, shares, self.sampling)
            layout = GlowLayout.of(self.glows, glow.table, openings, paths.by_fill)
            glow = replace(glow, layout=layout)
            tiles = partial(_chosen, tiles, paths)
            if transfer is not None:
                of_marks = flat(np.append(1, shares))
                transfer = transfer.weighed(lambda mark: share_of(mark, of_marks))
        light = SurfaceLight.of(base, cells.keys, cells.drawn, transfer)
        return TracedView(
            base.scene, self.view, self.rows, self.columns, self.sampling, light, glow, tiles
        )


def _chosen(tiles: Callable[[], Iterator[PixelPaths]], choice: ChosenPaths) -> Iterator[PixelPaths]:
    """Light paths of a state, some pixels at a time."""
    return map(choice.in_state, tiles())
