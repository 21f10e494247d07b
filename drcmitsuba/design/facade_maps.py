"""Maps from parameters to façades: a window by its ratios, or single tiles.

A map turns a dictionary of `mi.Float` by parameter into the composition of the façade, `share`
(tile, material), and keeps gradients. The overlap of a strip with a tile is piecewise linear in the
strip's edges, so the composition has a kink where an edge crosses from one tile into the next.
There the gradient is that of the upper tile; at a bound of a parameter it is the gradient towards
the inside of the range, the only one that an optimiser can follow.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.design.facade_tiles import Tiles
from drcmitsuba.design.parameters import Parameter, Values, inward
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import choose

THIN = 1e-6
"""Height that counts as none [m]."""


@dataclass(frozen=True)
class Panes:
    """Tiles, and the `materials`, columns of a composition, that a design puts into them.

    The shade covers the `clear` material, and does not cover the `film`.

    Raises
    ------
    InputError
        `clear` or `film` is not in `materials`.
    """

    tiles: Tiles
    materials: tuple[str, ...]
    clear: str
    film: str

    def __post_init__(self) -> None:
        for key, name in (("clear", self.clear), ("film", self.film), ("wall", "wall")):
            if name not in self.materials:
                remedy = choose(name, list(self.materials))
                raise InputError("design", key, f"no material {name!r} in the year", remedy)

    @property
    def count(self) -> int:
        """Number of tiles."""
        return len(self.tiles.area)

    def composition(self, window: mi.Float, film: mi.Float) -> mi.TensorXf:
        """Composition (tile, material) from shares (tile,) of window, and of film within it."""
        columns = len(self.materials)
        flat = dr.zeros(mi.Float, self.count * columns)
        row = dr.arange(mi.UInt32, self.count) * columns
        shares = (("wall", 1 - window), (self.clear, window - film), (self.film, film))
        for name, share in shares:
            dr.scatter(flat, share, row + self.materials.index(name))
        return mi.TensorXf(flat, (self.count, columns))

    def between(self, edges: Edges, at: Edges) -> mi.TensorXf:
        """Composition (tile, material) of a façade with a window and a film between heights [m].

        Film outside the window counts as wall; where an upper edge is not above its lower one,
        there is no window or no film. `at` are the heights moved inward, without gradients: they
        select the tiles.
        """
        bottom, top = (mi.Float(self.tiles.bounds[:, i].astype(np.float32)) for i in (2, 3))

        def below(z: mi.Float, chosen: mi.Float) -> mi.Float:
            """Fraction of each tile's height below z, shape (tile,)."""
            inside = (chosen >= bottom) & (chosen < top)
            return dr.select(inside, (z - bottom) / (top - bottom), mi.Float(chosen >= top))

        def overlap(lower: Any, upper: Any, low: Any, high: Any) -> mi.Float:
            return dr.select(low < high, below(upper, high) - below(lower, low), 0)

        window = overlap(edges.sill, edges.head, at.sill, at.head)
        upper = dr.select(at.film_top < at.head, edges.film_top, edges.head)
        lower = dr.select(at.film_bottom > at.sill, edges.film_bottom, edges.sill)
        low, high = dr.maximum(at.film_bottom, at.sill), dr.minimum(at.film_top, at.head)
        return self.composition(window, overlap(lower, upper, low, high))


class Edges(NamedTuple):
    """Heights of a window and of the film in it, `mi.Float` [m]."""

    sill: Any
    head: Any
    film_bottom: Any
    film_top: Any


@dataclass(frozen=True)
class Window:
    """Window given by its ratios, over the whole width of the tiles.

    height = WWR · wall / width, film = DWR · height,
    film's bottom = sill + position · (height − film)

    Parameters
    ----------
    panes : Panes
        Tiles of one width of panes at every height, without gaps from the lowest to the highest.
    wall : float
        Area of the façade [m²].
    sill : Parameter
        Height of the window's foot [m].
    wwr : Parameter
        Area of all panes over the façade's area; a window ends no higher than the highest tile.
    dwr : Parameter
        Area of the film over the area of all panes.
    position : Parameter
        Position of the film in the window: 0 at its foot, 1 at its top.
    """

    panes: Panes
    wall: float
    sill: Parameter
    wwr: Parameter
    dwr: Parameter
    position: Parameter

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the map."""
        return self.sill, self.wwr, self.dwr, self.position

    def share(self, values: Values) -> mi.TensorXf:
        """Give the composition, mi.TensorXf (tile, material)."""
        within = inward(values, self.parameters)
        return self.panes.between(self._edges(values), self._edges(within))

    def values_of(self, share: np.ndarray) -> dict[str, np.ndarray]:
        """Values of the parameters, (1,) each, of a composition (tile, material) of whole tiles.

        Another composition than this map's has the same areas of window and film. A film of no
        height, or as high as its window, has the position 1.
        """
        bottom, area = self.panes.tiles.bounds[:, 2], self.panes.tiles.area
        glazed = 1 - share[:, self.panes.materials.index("wall")]
        film = share[:, self.panes.materials.index(self.panes.film)]
        height, of_film = float(glazed @ area) / self._width, float(film @ area) / self._width
        sill = float(bottom[glazed > 0].min(initial=self.sill.high))
        foot = float(bottom[film > 0].min(initial=np.inf))
        play = height - of_film
        values = {
            self.sill.key: sill,
            self.wwr.key: height * self._width / self.wall,
            self.dwr.key: of_film / height if height > 0 else self.dwr.low,
            self.position.key: (foot - sill) / play if of_film > 0 and play > THIN else 1.0,
        }
        return {key: np.array([value]) for key, value in values.items()}

    def drawn(self, values: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Values of the window as it is drawn, which ends at the highest tile."""
        ends = self._edges(values)
        sill, top, foot, head = np.minimum(np.stack(ends), self.panes.tiles.bounds[:, 3].max())
        height, film = top - sill, head - foot
        play = height - film
        return values | {
            self.wwr.key: height * self._width / self.wall,
            self.dwr.key: np.divide(film, height, out=np.zeros_like(film), where=height > THIN),
            self.position.key: np.divide(
                foot - sill, play, out=np.ones_like(play), where=(play > THIN) & (film > THIN)
            ),
        }

    @property
    def _width(self) -> float:
        """Width of the panes at every height [m]."""
        bounds = self.panes.tiles.bounds
        return float(self.panes.tiles.area.sum() / (bounds[:, 3].max() - bounds[:, 2].min()))

    def _edges(self, values: Values) -> Edges:
        sill, wwr, dwr, position = (values[p.key] for p in self.parameters)
        height = wwr * (self.wall / self._width)
        film = dwr * height
        foot = sill + position * (height - film)
        return Edges(sill, sill + height, foot, foot + film)


@dataclass(frozen=True)
class Strips:
    """Every tile with its own share of window, 0 to 1, and of film in it; or one share for all."""

    panes: Panes
    window: Parameter
    film: Parameter
    whole: int = 0
    """Number of tiles, the last ones, that are window as a whole, whose parameter is of the others
    alone."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the map."""
        return self.window, self.film

    def drawn(self, values: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Values as they are drawn: those that are given."""
        return values

    def share(self, values: Values) -> mi.TensorXf:
        """Give the composition, mi.TensorXf (tile, material)."""
        window = values[self.window.key] + dr.zeros(mi.Float, self.panes.count - self.whole)
        window = dr.concat((window, dr.ones(mi.Float, self.whole))) if self.whole else window
        return self.panes.composition(window, window * values[self.film.key])

    def values_of(self, share: np.ndarray) -> dict[str, np.ndarray]:
        """Values of the parameters by tile of a composition (tile, material)."""
        window = 1 - share[:, self.panes.materials.index("wall")]
        film = share[:, self.panes.materials.index(self.panes.film)]
        part = np.divide(film, window, out=np.zeros_like(film), where=window > 0)
        return {self.window.key: window[: self.panes.count - self.whole], self.film.key: part}
