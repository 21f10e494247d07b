"""Protocols of a kind of measured BSDF: hooks of the plugin, and lobes by cells.

`measured.Measured` is the part common to all kinds. A new kind of file is a subclass with the
methods of `MeasuredHooks`, whose `_lobes_of` returns an object with the methods of `Lobes`;
`tensor_tree.py` and `klems.py` are examples.
"""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np


@runtime_checkable
class Lobes(Protocol):
    """Lobes of a transport mode: one direction is given, the other is looked up or drawn.

    Directions are unit vectors of the file's frame (+z to the room, +y up) that point away from the
    pane. `component` is the number 0 … 3 of `measured.COMPONENTS`; a row stands for a component and
    a cell of the given direction.
    """

    out_even: bool
    """True where f is constant within each outgoing cell."""

    @property
    def out_cells(self) -> int:
        """Number of cells that a hemisphere of outgoing directions is cut into."""

    def out_cell(self, w: Any) -> Any:
        """Number of the cell that holds an outgoing direction, mi.UInt32 below `out_cells`."""

    def out_direction(self, cell: Any, uv: Any) -> Any:
        """Outgoing direction (z ≥ 0), drawn from a cell, uniformly by projected solid angle."""

    def update(self, values: np.ndarray) -> None:
        """Set the values f [1/sr] of the leaves, shape (leaf,)."""

    def row(self, component: Any, given: Any) -> Any:
        """Row of a component and a given direction, mi.UInt32."""

    def albedo(self, row: Any, active: Any) -> Any:
        """Integral of f cos θ over the other direction [1], one per row number."""

    def value(self, leaves: Any, component: Any, given: Any, other: Any, active: Any) -> Any:
        """BSDF f [1/sr] of a pair of directions, from the values of the leaves."""

    def draw(self, row: Any, given: Any, u: Any, uv: Any, active: Any) -> Any:
        """Other direction (z ≥ 0), drawn from a row by uniform random numbers."""

    def density(self, row: Any, given: Any, other: Any, value: Any, active: Any) -> Any:
        """Density of the other direction per projected solid angle [1/sr]."""


@runtime_checkable
class MeasuredHooks(Protocol):
    """Methods by which a subclass of `Measured` reads its kind of file."""

    plugin: str
    """Name of the plugin, for errors."""

    def _check(self, file: Any) -> None:
        """Raise ValueError if the file is of another kind; keep what the other hooks need."""

    def _reversed(self, component: Any) -> tuple[Any, bool]:
        """Component with exchanged directions, and False; or unchanged, and True: swap look-ups."""

    def _reversed_view(self, table: np.ndarray) -> np.ndarray:
        """Straight-through transmittances of the reversed component, shape (incident cell,)."""

    def _lobes_of(self, components: list, swapped: list[bool], fixed: str) -> Lobes:
        """Lobes of four components (None where missing) whose values are the leaves' numbers.

        `swapped` is true for components that are looked up with both directions exchanged; `fixed`
        is the given direction, 'incident' or 'outgoing'.
        """

    def _view_cell(self, light: Any) -> Any:
        """Cell of light's direction in the table of straight transmittances, mi.UInt32."""
