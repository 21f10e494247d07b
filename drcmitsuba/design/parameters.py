"""Design parameters: values with bounds and a start, and maps from them to a façade."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import drjit as dr
import numpy as np

from drcmitsuba.runtime.errors import InputError

INWARD = 1e-4
"""Distance from its bounds, as a fraction of the range, at which a parameter selects its tile."""

Values = Mapping[str, Any]
"""Values of the parameters by key, each a `mi.Float` of width `count`."""


@dataclass(frozen=True)
class Parameter:
    """A free value, or several of the same kind.

    Parameters
    ----------
    key : str
    low, high : float
        Bounds; where they are equal, the value is fixed.
    start : float
        Value with which the first search begins.
    count : int
        Number of values, for example one per tile.

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
        """True if the parameter keeps its value."""
        return self.low == self.high

    @property
    def start_fraction(self) -> float:
        """Start as a fraction of the range between the bounds, 0 … 1."""
        return (self.start - self.low) / (self.high - self.low)


class Map(Protocol):
    """Turns values of parameters into the composition of a façade."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the map."""
        ...

    def share(self, values: Values) -> Any:
        """Composition, mi.TensorXf (tile, material); rows add up to 1."""
        ...

    def drawn(self, values: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Values of the parameters as the façade is drawn: what its bounds cut off is left out."""
        ...

    def values_of(self, share: np.ndarray) -> Mapping[str, np.ndarray]:
        """Values of the parameters, (count,) each, of a composition (tile, material)."""
        ...


@dataclass(frozen=True)
class Factor:
    """Materials whose light is scaled by one parameter: another transmittance of glazing or shade.

    `now` has the transmittance by material with which the year was simulated.
    """

    now: Mapping[str, float]
    parameter: Parameter


def inward(values: Values, parameters: Sequence[Parameter]) -> dict[str, Any]:
    """Values without gradients, kept at least `INWARD` inside their bounds."""
    moved = {}
    for p in parameters:
        gap = INWARD * (p.high - p.low)
        moved[p.key] = dr.clip(dr.detach(values[p.key]), p.low + gap, p.high - gap)
    return moved
