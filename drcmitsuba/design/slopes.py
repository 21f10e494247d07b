"""Gradients of a design's numbers, computed when they are first asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np


class Graph(NamedTuple):
    """Input x (free,) with its gradients, and numbers that reverse passes follow back to it."""

    x: mi.Float
    outputs: dict[str, mi.Float]


class LaterSlopes:
    """Gradients of one design, shape (free,) each, by the names of the numbers.

    Parameters
    ----------
    graph : Graph
        It is held until the gradients are asked for or `let_go` is called, since it takes memory.
    again : callable
        Function that makes the graph anew.
    """

    def __init__(self, graph: Graph, again: Callable[[], Graph]) -> None:
        self._graph: Graph | None = graph
        self._again = again

    @cached_property
    def of(self) -> dict[str, np.ndarray]:
        """Gradients by name."""
        x, outputs = self._again() if self._graph is None else self._graph
        self.let_go()
        return dict(zip(outputs, gradients(x, [*outputs.values()]), strict=True))

    def let_go(self) -> None:
        """Give back the memory of the graph."""
        self._graph = None


def gradients(x: mi.Float, outputs: Sequence[mi.Float]) -> list[np.ndarray]:
    """Gradients (free,) of several outputs by reverse passes over one graph."""
    of_each = []
    for i, y in enumerate(outputs):
        last = i + 1 == len(outputs)
        if dr.grad_enabled(y):
            dr.backward(y, flags=dr.ADFlag.Default if last else dr.ADFlag.ClearInterior)
        of_each.append(dr.grad(x).numpy().astype(float))
        dr.set_grad(x, 0)
    return of_each
