r"""Glare sources of a searched façade that join, whatever its shares are.

Bright sky and films that elements show side by side are one source, as for `sources.contrast_sums`,
with the mean of its luminances and the position index P of its middle:

.. math:: S_J = \frac{A^2}{\Omega \, P^2(F)}, \qquad \Omega = \sum_e w_e \Omega_e, \qquad
          (A, F) = \sum_e w_e f_e (A_e, F_e)

with the shares w of elements e, the factors f of their luminances, and the solid angle Ω, the sum A
of luminance times solid angle and that of directions F of what is bright by each alone. Elements
join by way of those that have a share: windows with wall between them do not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.glare_year.seen import Seen
from drcmitsuba.glare_year.sources import LEAST
from drcmitsuba.glare_year.tiles import EyeTiles
from drcmitsuba.picture.position_index import position_index
from drcmitsuba.runtime import lazy
from drcmitsuba.runtime.flat_arrays import flat_indices
from drcmitsuba.transport.elements.mixed_rows import Rows, mixed

sparse = lazy.module("scipy.sparse")
csgraph = lazy.module("scipy.sparse.csgraph")

SHOWN = 0.01
"""Share of its opening from which on an element joins those beside it."""


@dataclass(frozen=True)
class JoinedSources:
    """Light of elements before one view, of which that side by side is one source."""

    view: int
    frame: np.ndarray
    """Unit vectors to the right, up and forward of the view, shape (3, 3)."""
    elements: np.ndarray
    """Elements, int, shape (element,)."""
    near: np.ndarray
    """Whether two elements show what is side by side, bool, shape (element, element)."""
    light: tuple[Rows, ...]
    """F by axis, A [cd/m² sr] and Ω [sr] of each element, flat (time,)."""

    def at(self, hours: mi.UInt32) -> JoinedSources:
        """Those of some time stamps."""
        light = tuple(tuple(dr.gather(mi.Float, of, hours) for of in rows) for rows in self.light)
        return replace(self, light=light)

    def sums(self, shares: mi.Float, factors: mi.Float) -> mi.Float:
        """S [cd²/m⁴ sr] by shares and factors of all elements, flat (time,); with gradients."""
        w, f = (dr.gather(mi.Float, of, flat_indices(self.elements)) for of in (shares, factors))
        S = mi.Float(0)
        for source in self._sources(dr.detach(w).numpy()):
            own = (dr.gather(mi.Float, of, flat_indices(source)) for of in (w, w * f))
            S += self._sum(source, *own)
        return S

    def _sources(self, shares: np.ndarray) -> Iterator[np.ndarray]:
        """Yield the places of the elements of each source."""
        shown = np.flatnonzero(shares > SHOWN)
        graph = sparse.csr_array(self.near[np.ix_(shown, shown)])
        count, source = csgraph.connected_components(graph, directed=False)
        for k in range(count):
            yield shown[source == k]

    def _sum(self, source: np.ndarray, weights: mi.Float, lit: mi.Float) -> mi.Float:
        """S of a source [cd²/m⁴ sr], by the shares of its elements alone and with factors."""
        *F, A, omega = (
            mixed(tuple(rows[e] for e in source), weights if k == 4 else lit)
            for k, rows in enumerate(self.light)
        )
        shines = (omega > LEAST) & (A > 0)
        towards = dr.normalize(dr.select(shines, mi.Vector3f(*F), mi.Vector3f(0, 0, 1)))
        axes = (mi.Vector3f(*map(float, axis)) for axis in self.frame)
        P = position_index(mi.Vector3f(*(dr.dot(axis, towards) for axis in axes)))
        return dr.select(shines, dr.square(A / P) / dr.select(shines, omega, 1), 0)


def near_elements(seen: Seen, tiles: EyeTiles, elements: Sequence[int]) -> np.ndarray:
    """Whether elements show what is side by side before each view, bool (view, element, element).

    It is False of an element with itself where a view shows nothing by it. `tiles` are those of
    what is seen, with the opening angle of a source.
    """
    of_ray = np.repeat(np.arange(len(tiles)), np.diff(tiles.first))
    shows = np.zeros((len(tiles), len(elements)), np.float32)
    for e, element in enumerate(elements):
        pixels = np.zeros(len(seen.directions), bool)
        if element in seen.sky:
            pixels |= np.diff(seen.sky[element].indptr) > 0
        pixels[seen.films[seen.by_films == element]] = True
        shows[of_ray[pixels[tiles.pixel]], e] = 1
    one, two = (
        np.concatenate([np.arange(len(tiles)), *(getattr(links, end) for links in tiles.links)])
        for end in ("one", "two")
    )
    out = np.zeros((len(tiles.forward), len(elements), len(elements)), bool)
    for view, ahead in enumerate(tiles.ahead):
        shown = sparse.csr_array(shows * ahead[:, None])
        pairs = (shown[one].T @ shown[two]).toarray() > 0
        out[view] = pairs | pairs.T
    return out
