"""Illuminance of a period in every state of a façade, as searches rate it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import drjit as dr
import mitsuba as mi


class Illuminances(NamedTuple):
    """Illuminance of a period, tensors (time, sensor) [lx]."""

    open: mi.TensorXf
    shaded: mi.TensorXf
    """E with the shade open, and with the shade before all that it covers."""
    direct: mi.TensorXf
    """E by straight sun, the shade open."""
    others: tuple[mi.TensorXf, ...] = ()
    """E in further states of the façade, whose groups of panes close one by one."""
    by_group: tuple[mi.TensorXf, ...] = ()
    """E by straight sun that comes by each group of panes, where there are several."""

    @property
    def states(self) -> tuple[mi.TensorXf, ...]:
        """E in all states: open, with everything closed, and the others."""
        return (self.open, self.shaded, *self.others)

    def scaled(self, factor: float) -> Illuminances:
        """Illuminance times a factor."""
        return self if factor == 1 else self._each(lambda E: E * factor)

    def plus(self, other: Illuminances) -> Illuminances:
        """Illuminance and that of another channel."""
        more = iter((*other.states, other.direct, *other.by_group))
        return self._each(lambda E: E + next(more))

    def _each(self, change: Callable[[mi.TensorXf], mi.TensorXf]) -> Illuminances:
        """Change every tensor: states first, then direct sun."""
        is_open, shaded, *others = map(change, self.states)
        direct, *by_group = map(change, (self.direct, *self.by_group))
        return Illuminances(is_open, shaded, direct, tuple(others), tuple(by_group))


def evaluated(states: Sequence[mi.TensorXf], straight: Sequence[mi.TensorXf]) -> Illuminances:
    """Illuminance of states, and by straight sun: all of it, then that by each group of panes.

    It is computed here: else each metric would compute it again.
    """
    dr.eval(states, straight)
    (E, *others), (direct, *by_group) = states, straight
    shaded = others.pop(0) if others else E
    return Illuminances(E, shaded, direct, tuple(others), tuple(by_group))


def weighed(parts: Iterable[tuple[float, Illuminances]]) -> Illuminances:
    """Sum of illuminances times their weights, as of colour channels in luminance."""
    (weight, first), *others = parts
    E = first.scaled(weight)
    for weight, other in others:
        E = E.plus(other.scaled(weight))
    return E
