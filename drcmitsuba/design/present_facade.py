"""The façade of a case as it is, as a composition of the tiles of a search."""

from __future__ import annotations

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.facade import Facade
from drcmitsuba.design.facade_tiles import Tiles
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Side
from drcmitsuba.scene.facade_rectangles import fill_at

APART = 1e-3
"""Least distance of two edges of tiles [m]."""


def heights(
    case: Case, side: Side, panes: tuple[str, str], rows: np.ndarray, segments: int
) -> np.ndarray:
    """Edges of the search's rows and of the façade's strips, from the bottom up [m].

    With the strips' edges among them every tile is of one material as the façade is.

    Parameters
    ----------
    panes : tuple of str
        Clear material and film of the search.
    rows : np.ndarray, shape (row + 1,)
        Edges of its rows [m].
    segments : int
        Number of its tiles side by side.

    Raises
    ------
    InputError
        A pane reaches beyond the band of the search, is none of its two materials, or ends within
        a tile.
    """
    facade, low, high = case.facade.get(side, Facade()), rows[0], rows[-1]
    source, (clear, film) = case.source, panes
    for strip in facade.strips:
        where = f"facade.{side}.strips, {strip.bottom:g} to {strip.top:g} m"
        if strip.material not in ("wall", *panes):
            got = f"{strip.material}, the search knows {clear} and {film} only"
            raise InputError(source, where, got, "name them in [design], or replace the strip")
        outside = strip.bottom < low - APART or strip.top > high + APART
        if strip.material != "wall" and outside:
            got = f"beyond the band from {low:g} to {high:g} m"
            raise InputError(source, where, got, "give [design] a band that holds it")
    in_parts = any(strip.segments is not None for strip in facade.strips)
    if in_parts and segments % facade.segments:
        got = f"{segments} tiles side by side, the façade has {facade.segments} segments"
        remedy = f"give a multiple of {facade.segments}"
        raise InputError(source, "design.segments", got, remedy)
    of_strips = np.array([edge for s in facade.strips for edge in (s.bottom, s.top)])
    distance = np.abs(of_strips[:, None] - rows).min(axis=1)
    new = of_strips[(distance > APART) & (of_strips > low) & (of_strips < high)]
    return np.unique(np.concatenate([rows, new]).round(6))


def composition(
    case: Case, side: Side, tiles: Tiles, materials: tuple[str, ...], points: int = 1
) -> np.ndarray:
    """Composition as the façade is, shape (tile, material), by so many points squared in each tile.

    One in the middle is enough for tiles between `heights`. What is none of the materials counts as
    wall, the first one.
    """
    assert case.room is not None
    facade, length = case.facade.get(side, Facade()), case.room.wall(side)[0]
    left, right, bottom, top = tiles.bounds.T[..., None, None]
    part = (np.arange(points) + 0.5) / points
    x, z = left + part * (right - left), bottom + part[:, None] * (top - bottom)
    x, z = np.broadcast_arrays(x, z)
    names = fill_at(facade, length, x.ravel(), z.ravel()).reshape(len(left), -1, 1)
    share = (names == np.array(materials)).mean(axis=1)
    share[:, 0] += 1 - share.sum(axis=1)
    return np.asarray(share)
