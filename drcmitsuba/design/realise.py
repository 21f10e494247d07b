"""Realisation of a composition of tiles as a case that can be built and simulated."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.facade import THINNEST, Facade, Strip
from drcmitsuba.design.facade_tiles import Tiles
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Side
from drcmitsuba.scene.pane_groups import group_of

MOST_SEGMENTS = 200
LEAST_PANE = 2 * THINNEST
"""Least height of a piece without a frame [m]."""
LEAST_PART = 1e-3
"""Smallest share of a tile that does not count as 0."""
ALIGNED = 0.01
"""Largest distance of a tile's edge from a segment's edge [m]."""

Piece = tuple[float, float, str]
"""Bottom, top [m] and material."""


def realise(
    case: Case, side: Side, tiles: Tiles, share: np.ndarray, materials: Sequence[str], film: str
) -> Case:
    """Cut the tiles of a façade into strips of one material each; the rest of the façade is wall.

    In a tile of several `materials`, each takes its `share`, shape (tile, material), of the height;
    less than 0.1 % counts as 0. Clear panes lie below the film, unless the tile below has more film
    than the tile above. Wall lies at the upper edge, at the lower edge if the tile below has more
    wall than the tile above, or half of it at each edge between walls. A piece too low for a pane
    with its frame goes to the tile's other pieces. Touching panes of one material become one. Every
    pane has the façade's frame around it, so that cut tiles have less glass than the composition
    says. Groups without a pane are left out.

    Raises
    ------
    InputError
        The tiles are narrower than the segments and no number of segments fits.
    """
    assert case.room is not None
    old = case.facade.get(side, Facade())
    segments, columns = _columns(tiles, case.room.wall(side)[0], old)
    segments_of: dict[Piece, list[int]] = {}
    least = old.frame + LEAST_PANE
    for i, column in enumerate(columns):
        for piece in pieces_of(tiles, np.asarray(share), column, list(materials), film, least):
            segments_of.setdefault(piece, []).append(i)
    strips = tuple(
        Strip(
            bottom=bottom, top=top, material=material,
            segments=None if len(inside) == segments else tuple(inside),
        )
        for (bottom, top, material), inside in sorted(segments_of.items())
    )  # fmt: skip
    facade = old.model_copy(update={"segments": segments, "strips": strips})
    return _with_groups_of_panes(case.with_facade(side, facade))


def _with_groups_of_panes(case: Case) -> Case:
    """Case with those of its groups that have a pane; without any of them, no shade closes."""
    strips = ((s.material, side) for side, f in case.facade.items() for s in f.strips)
    numbers = {group[0] for name, side in strips if (group := group_of(case, name, side))}
    groups = {name: group for i, (name, group) in enumerate(case.groups.items()) if i in numbers}
    shading = None if case.groups and not groups else case.shading
    return case.with_tables(groups=groups, shading=shading)


def _columns(tiles: Tiles, length: float, facade: Facade) -> tuple[int, list[np.ndarray]]:
    """Number of segments, and for each the tiles in it from the bottom up."""
    left, right, bottom, _ = tiles.bounds.T
    for count in range(facade.segments, MOST_SEGMENTS + 1, facade.segments):
        centre = (np.arange(count) + 0.5) * length / count
        inside = (left < centre[:, None]) & (centre[:, None] < right)
        # Tiles may be as wide as their segments or as the panes within the segments' frames.
        spare = inside.sum(axis=0) * length / count - (right - left)
        if ((spare > -ALIGNED) & (spare < facade.frame + ALIGNED)).all():
            rows = [np.flatnonzero(row) for row in inside]
            return count, [row[np.argsort(bottom[row])] for row in rows]
    got = f"tiles of {(right - left).min():.3g} m in a façade of {length:g} m"
    raise InputError("design", "tiles", got, f"let them end between {facade.segments} segments")


def pieces_of(
    tiles: Tiles, share: np.ndarray, column: np.ndarray, materials: list[str], film: str,
    least: float,
) -> list[Piece]:  # fmt: skip
    """Panes of one column of tiles from the bottom up; the gaps between them are wall.

    No pane is lower than the `least` height [m]; other arguments are those of `realise`.
    """
    cut = cut_tiles(tiles, share, column, materials, film, least)
    joined: list[Piece] = []
    for bottom, top, name in (piece for pieces in cut for piece in pieces):
        if joined and joined[-1][2] == name and abs(joined[-1][1] - bottom) < THINNEST:
            joined[-1] = joined[-1][0], top, name
        else:
            joined.append((bottom, top, name))
    return [piece for piece in joined if piece[2] != "wall"]


def cut_tiles(
    tiles: Tiles, share: np.ndarray, column: np.ndarray, materials: list[str], film: str,
    least: float,
) -> Iterator[list[Piece]]:  # fmt: skip
    """Yield the pieces of every tile of a column, walls among them; arguments as `pieces_of`."""
    none = np.zeros(len(materials))
    none[materials.index("wall")] = 1.0
    stack = [none, *share[column], none]
    for i, tile in enumerate(column):
        low, high = map(float, tiles.bounds[tile, 2:])
        parts = _parts(stack[i + 1], stack[i], stack[i + 2], materials, film)
        yield _heights(parts, low, high, least)


def _parts(
    own: np.ndarray, below: np.ndarray, above: np.ndarray, materials: list[str], film: str
) -> list[tuple[str, float]]:
    """Materials and shares of a tile from the bottom up, in an order that suits its neighbours.

    `own`, `below` and `above` are shares of the tile and of its neighbours, shape (material,).
    """
    f, w = materials.index(film), materials.index("wall")
    others = [i for i in range(len(materials)) if i not in (f, w)]
    panes = [f, *others] if below[f] > above[f] else [*others, f]
    inside = [(materials[i], float(own[i])) for i in panes]
    wall = float(own[w])
    if min(below[w], above[w]) > 1 - LEAST_PART:  # alone in its wall
        return [("wall", wall / 2), *inside, ("wall", wall / 2)]
    return [("wall", wall), *inside] if below[w] > above[w] else [*inside, ("wall", wall)]


def _heights(parts: list[tuple[str, float]], low: float, high: float, least: float) -> list[Piece]:
    """Cut a tile into pieces, none of them too low for a pane."""
    height = high - low
    kept = [
        (name, part) for name, part in parts if part * height >= max(least, LEAST_PART * height)
    ]
    kept = kept or [max(parts, key=lambda p: p[1])]
    total = sum(part for _, part in kept)
    edges = low + height * np.cumsum([0.0, *(part / total for _, part in kept)])
    edges[-1] = high
    return [
        (round(float(a), 6), round(float(b), 6), name)
        for (a, b), (name, _) in zip(pairwise(edges), kept, strict=True)
    ]
