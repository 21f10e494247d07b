"""What a designer can turn, as values, and the façades that these values describe.

A map turns a dictionary of `mi.Float` by parameter into the composition of the façade, `share`
(tile, material), and keeps gradients. Overlaps of a strip with the tiles are piecewise linear in
its edges, so the composition has a kink where an edge crosses from one tile into the next. There
the gradient is that of the upper tile; at a bound of a parameter it is the one towards the inside,
which is the only one that an optimiser can follow.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.case.toml import choose
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.transport.facade_basis import BasisYear, Tiles

INWARD = 1e-4
"""How far inside its bounds a parameter is taken for the choice of a tile, of its range."""

Values = Mapping[str, Any]
"""Values of the parameters by key: `mi.Float` of width `count`."""


@dataclass(frozen=True)
class Parameter:
    """A value that may be turned, or several of the same kind.

    Parameters
    ----------
    key : str
    low, high : float
        Bounds; where they are equal, the value is fixed.
    start : float
        Where the first search begins.
    count : int
        How many values: one for each tile, for example.

    Raises
    ------
    InputError
        The bounds are no interval, or the start is not between them.
    """

    key: str
    low: float
    high: float
    start: float
    count: int = 1

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low <= self.high):
            got = f"{self.low:g} to {self.high:g}"
            raise InputError("parameter", self.key, got, "give the lower bound first")
        if not self.low <= self.start <= self.high:
            got = f"start at {self.start:g}"
            remedy = f"start between {self.low:g} and {self.high:g}"
            raise InputError("parameter", self.key, got, remedy)

    @classmethod
    def fixed(cls, key: str, value: float) -> Parameter:
        """Make a parameter that keeps its value."""
        return cls(key, value, value, value)

    @property
    def is_fixed(self) -> bool:
        """Whether the parameter keeps its value."""
        return self.low == self.high

    @property
    def start_fraction(self) -> float:
        """Start between the bounds, 0 … 1."""
        return (self.start - self.low) / (self.high - self.low)


class Map(Protocol):
    """Turns values of parameters into the composition of a façade."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """What may be turned."""
        ...

    def share(self, values: Values) -> Any:
        """Give the composition, mi.TensorXf (tile, material); rows add up to 1."""
        ...


@dataclass(frozen=True)
class Panes:
    """Tiles, and the materials that a design puts there.

    Parameters
    ----------
    tiles : Tiles
    materials : tuple of str
        Columns of a composition.
    clear, film : str
        The one that the shade covers, and the one that it does not.

    Raises
    ------
    InputError
        A material is none of the columns.
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

    @classmethod
    def of(cls, year: BasisYear, clear: str, film: str) -> Panes:
        """Take tiles and materials of a year."""
        return cls(year.tiles, year.materials, clear, film)

    @property
    def count(self) -> int:
        """Tiles."""
        return len(self.tiles.area)

    def composition(self, window: mi.Float, film: mi.Float) -> mi.TensorXf:
        """Composition of the parts (tile,) that are window, and film within it."""
        columns = len(self.materials)
        flat = dr.zeros(mi.Float, self.count * columns)
        row = dr.arange(mi.UInt32, self.count) * columns
        parts = (("wall", 1 - window), (self.clear, window - film), (self.film, film))
        for name, part in parts:
            dr.scatter(flat, part, row + self.materials.index(name))
        return mi.TensorXf(flat, (self.count, columns))

    def between(self, edges: Edges, at: Edges) -> mi.TensorXf:
        """Composition of a window and a film between heights.

        Parameters
        ----------
        edges : Edges
            Heights with gradients [m].
        at : Edges
            The same, moved inward and without gradients: they choose the tiles.
        """
        bottom, top = (mi.Float(self.tiles.bounds[:, i].astype(np.float32)) for i in (2, 3))

        def below(z: mi.Float, chosen: mi.Float) -> mi.Float:
            """Part of each tile that lies below a height."""
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
class Heights:
    """Window by the heights of its edges, over the whole width of the tiles.

    What of the film lies outside the window is wall; where an upper edge is not above its lower
    one, there is none.

    Parameters
    ----------
    panes : Panes
    sill, head, film_bottom, film_top : Parameter
        [m].
    """

    panes: Panes
    sill: Parameter
    head: Parameter
    film_bottom: Parameter
    film_top: Parameter

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """What may be turned."""
        return self.sill, self.head, self.film_bottom, self.film_top

    def share(self, values: Values) -> mi.TensorXf:
        """Give the composition, mi.TensorXf (tile, material)."""
        within = inward(values, self.parameters)
        edges, at = (Edges(*(v[p.key] for p in self.parameters)) for v in (values, within))
        return self.panes.between(edges, at)


@dataclass(frozen=True)
class Window:
    """Window by its ratios, over the whole width of the tiles.

    height = WWR · wall / width, film = DWR · height,
    film's bottom = sill + position · (height − film)

    Parameters
    ----------
    panes : Panes
        Tiles of one width of panes at every height, without gaps from the lowest to the highest.
    wall : float
        Area of the façade [m²].
    sill : Parameter
        [m].
    wwr : Parameter
        Area of all panes over that of the façade; a window that would end above the highest tile
        ends there.
    dwr : Parameter
        Area of the film over that of all panes.
    position : Parameter
        Of the film in the window: 0 at its foot, 1 at its top.
    """

    panes: Panes
    wall: float
    sill: Parameter
    wwr: Parameter
    dwr: Parameter
    position: Parameter

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """What may be turned."""
        return self.sill, self.wwr, self.dwr, self.position

    @cached_property
    def width(self) -> float:
        """Area of all tiles over their height [m]."""
        bounds = self.panes.tiles.bounds
        return float(self.panes.tiles.area.sum() / (bounds[:, 3].max() - bounds[:, 2].min()))

    def share(self, values: Values) -> mi.TensorXf:
        """Give the composition, mi.TensorXf (tile, material)."""
        within = inward(values, self.parameters)
        return self.panes.between(self._edges(values), self._edges(within))

    def _edges(self, values: Values) -> Edges:
        sill, wwr, dwr, position = (values[p.key] for p in self.parameters)
        height = wwr * (self.wall / self.width)
        film = dwr * height
        foot = sill + position * (height - film)
        return Edges(sill, sill + height, foot, foot + film)


@dataclass(frozen=True)
class Strips:
    """Every tile has its own part of window, and its own part of film within it.

    Parameters
    ----------
    panes : Panes
    window, film : Parameter
        One value for each tile, 0 to 1, or one for all.
    """

    panes: Panes
    window: Parameter
    film: Parameter

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """What may be turned."""
        return self.window, self.film

    def share(self, values: Values) -> mi.TensorXf:
        """Give the composition, mi.TensorXf (tile, material)."""
        window = values[self.window.key] + dr.zeros(mi.Float, self.panes.count)
        return self.panes.composition(window, window * values[self.film.key])


@dataclass(frozen=True)
class Factor:
    """A material whose light is multiplied: another transmittance of the shade or the glazing.

    Parameters
    ----------
    material : str
    parameter : Parameter
        Transmittance.
    now : float
        The one that the year was computed with.
    """

    material: str
    parameter: Parameter
    now: float = 1.0


def inward(values: Values, parameters: Sequence[Parameter]) -> dict[str, Any]:
    """Values without gradients, a little inside their bounds."""
    moved = {}
    for p in parameters:
        gap = INWARD * (p.high - p.low)
        moved[p.key] = dr.clip(dr.detach(values[p.key]), p.low + gap, p.high - gap)
    return moved


def starts(parameters: Sequence[Parameter]) -> dict[str, Any]:
    """Values at which all parameters start."""
    return {p.key: dr.full(mi.Float, p.start, p.count) for p in parameters}
