r"""Glare sources of a searched façade that join, whatever its shares are.

What is bright and seen by elements side by side is one source, as for `sources.contrast_sums`, with
the mean of its luminances and the position index P of its middle:

.. math:: S_J = \frac{A^2}{\Omega \, P^2(F)}, \qquad \Omega = \sum_e w_e \Omega_e, \qquad
          (A, F) = \sum_e w_e f_e (A_e, F_e)

with the shares w of elements e, the factors f of their luminances, and the solid angle Ω, the sum A
of luminance times solid angle and that of directions F of what is bright by each alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.glare_year.seen import Seen, sparse
from drcmitsuba.glare_year.sources import LEAST
from drcmitsuba.picture.position_index import position_index
from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.flat_arrays import flat, flat_indices
from drcmitsuba.transport.elements.mixed_rows import Rows, mixed

csgraph = lazy.module("scipy.sparse.csgraph")


@dataclass(frozen=True)
class JoinedSources:
    """Light of elements that is one source before each view."""

    elements: np.ndarray
    """Elements, int, shape (element,)."""
    light: tuple[Rows, ...]
    """F by axis, A [cd/m² sr] and Ω [sr] of each element, flat (time, view)."""
    frames: mi.Float
    """Unit vectors to the right, up and forward of the views, flat (view, 3, 3)."""
    views: int
    """Number of views."""

    def at(self, entries: mi.UInt32) -> JoinedSources:
        """Those of some time stamps, by their entries (time, view)."""
        light = tuple(tuple(dr.gather(mi.Float, of, entries) for of in rows) for rows in self.light)
        return replace(self, light=light)

    def sums(self, shares: mi.Float, factors: mi.Float) -> mi.Float:
        """S by shares and factors of all elements, flat (time, view); gradients flow through."""
        w, f = (dr.gather(mi.Float, of, flat_indices(self.elements)) for of in (shares, factors))
        *F, A = (mixed(rows, w * f) for rows in self.light[:4])
        omega = mixed(self.light[4], w)
        shines = (omega > LEAST) & (A > 0)
        towards = dr.normalize(dr.select(shines, mi.Vector3f(*F), mi.Vector3f(0, 0, 1)))
        view = dr.arange(mi.UInt32, dr.width(A)) % dr.opaque(mi.UInt32, self.views)
        axes = (dr.gather(mi.Vector3f, self.frames, 3 * view + k) for k in range(3))
        P = position_index(mi.Vector3f(*(dr.dot(axis, towards) for axis in axes)))
        return dr.select(shines, dr.square(A / P) / dr.select(shines, omega, 1), 0)


def joined_sources(
    light: dict[int, np.ndarray], groups: dict[int, np.ndarray], frames: np.ndarray
) -> tuple[JoinedSources, ...]:
    """Join the light of elements (5, time, view) by their groups (view,), −1 where they are unseen.

    `frames` (view, 3, 3) are as of `JoinedSources`.
    """
    axes, out = flat(frames), []
    for group in range(max((int(of.max(initial=-1)) for of in groups.values()), default=-1) + 1):
        mine = [element for element, of in groups.items() if (of == group).any()]
        rows = [light[element] * (groups[element] == group) for element in mine]
        by_quantity = tuple(tuple(flat(row[k]) for row in rows) for k in range(5))
        out.append(JoinedSources(np.array(mine, int), by_quantity, axes, len(frames)))
    return tuple(out)


def groups_of(seen: Seen, elements: Sequence[int]) -> np.ndarray:
    """Groups of elements whose sources join before each view, int, shape (view, element).

    They join where a chain of tiles, each near the next, shows both; −1 where a view shows none.
    """
    tiles = seen.tiles
    of_ray = np.repeat(np.arange(len(tiles)), np.diff(tiles.first))
    shows = np.zeros((len(tiles), len(elements)), bool)
    for e, element in enumerate(elements):
        pixels = np.zeros(len(seen.directions), bool)
        if element in seen.sky:
            pixels |= np.diff(seen.sky[element].indptr) > 0
        pixels[seen.films[seen.by_films == element]] = True
        shows[of_ray[pixels[tiles.pixel]], e] = True
    links = [(each.one, each.two) for each in tiles.links]
    one, two = (np.concatenate(ends) for ends in zip(*links, strict=True))
    out = np.full((len(tiles.forward), len(elements)), -1)
    for view, ahead in enumerate(tiles.ahead):
        shown = shows & ahead[:, None]
        near = shown.any(axis=1)[one] & shown.any(axis=1)[two]
        tile, by = np.nonzero(shown)
        ends = np.append(one[near], tile), np.append(two[near], len(tiles) + by)
        nodes = len(tiles) + len(elements)
        graph = sparse.coo_array((np.ones(len(ends[0]), bool), ends), (nodes, nodes))
        _, label = csgraph.connected_components(graph, directed=False)
        visible = shown.any(axis=0)
        out[view, visible] = np.unique(label[len(tiles) :][visible], return_inverse=True)[1]
    return out
