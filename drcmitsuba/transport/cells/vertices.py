"""Vertices of gather paths, and the store of a launch that a symbolic loop fills."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi


@dataclass(frozen=True)
class Vertices:
    """Diffuse vertices of gather paths, one entry each; one of weight 0 is none."""

    row: mi.UInt32
    """Row of the path: replicate · sensors + sensor."""
    weight: mi.Float
    """Throughput: contribution to the sensor's illuminance per irradiance on the vertex."""
    key: mi.UInt32
    """Key of the cell."""
    tag: mi.UInt32
    """Number of the vertex, independent of the order of threads."""
    p: mi.Float
    n: mi.Float
    """Position [m] and facing normal, three numbers a vertex."""
    mark: mi.UInt32 | None = None
    """Mark of the path, see `gather.paths.Marks`."""
    within: mi.UInt32 | None = None
    """Number of the room of a model in which the path began; 0 outside, and once it has passed a
    pane."""

    def __len__(self) -> int:
        """Count the vertices."""
        return dr.width(self.weight)


class VertexStore:
    """Vertices of a launch, in the order in which its lanes meet them; up to `capacity` are kept.

    With `once`, the vertex of every lane has the place of its lane. Only `marked` vertices carry
    the mark of their path; `told` ones, the room in which they lie.
    """

    def __init__(self, capacity: int, marked: bool, told: bool, once: bool):
        self._capacity, self._room = capacity, dr.opaque(mi.UInt32, capacity)
        self._lane = dr.arange(mi.UInt32, capacity) if once else None
        self._counter = dr.zeros(mi.UInt32, 1)
        whole = ("row", "key", "tag", "mark") if marked else ("row", "key", "tag")
        self._columns = {name: dr.zeros(mi.UInt32, capacity) for name in whole}
        if told:
            self._columns["within"] = dr.zeros(mi.UInt32, capacity)
        self._columns["weight"] = dr.zeros(mi.Float, capacity)
        # Where a vertex of weight 0 would lie does not matter.
        self._columns |= {name: dr.empty(mi.Float, 3 * capacity) for name in ("p", "n")}
        dr.make_opaque(self._counter, self._columns)  # a loop that is being recorded adds to them

    def add(self, active: mi.Bool, **values: Any) -> None:
        """Add the vertices of the active lanes, by the names of `Vertices`."""
        if self._lane is not None:
            slot, kept = self._lane, active
        else:
            slot = dr.scatter_inc(self._counter, mi.UInt32(0), active)
            kept = active & (slot < self._room)
        for name, column in self._columns.items():
            dr.scatter(column, values[name], slot, kept)

    def vertices(self) -> tuple[Vertices, int]:
        """Vertices that were kept, and how many were met."""
        dr.eval(self._counter, self._columns)
        if self._lane is not None:
            return Vertices(**self._columns), self._capacity
        met = int(self._counter[0])
        kept = {}
        for name, column in self._columns.items():
            size = min(met, self._capacity) * (3 if name in ("p", "n") else 1)
            kept[name] = dr.gather(type(column), column, dr.arange(mi.UInt32, size))
        dr.eval(kept)
        return Vertices(**kept), met
