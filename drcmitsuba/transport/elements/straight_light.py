"""Light that comes straight, of the few pairs of a bin and a sensor that see each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from drcmitsuba.schema import mean_and_error


class Entries(NamedTuple):
    """Light of different pairs in one result."""

    result: int
    places: np.ndarray
    """Places of the pairs in a flat array (own bin, sensor), int, shape (entry,)."""
    C: np.ndarray
    """Their light [sr], shape (entry,)."""


@dataclass(frozen=True, eq=False)
class StraightLight:
    """C by straight light of an opening with one fill; all other pairs have none."""

    shape: tuple[int, int]
    """Numbers of own bins and of sensors."""
    places: np.ndarray
    """Places of the pairs in a flat array (own bin, sensor), rising, int, shape (pair,)."""
    C: np.ndarray
    """C of the pairs [sr], shape (replicate, pair)."""

    @classmethod
    def of(
        cls, entries: Sequence[Entries], replicates: int, shape: tuple[int, int]
    ) -> StraightLight:
        """Add up entries of so many replicates."""
        seen = np.zeros(shape[0] * shape[1], bool)
        for each in entries:
            seen[each.places] = True
        places = np.flatnonzero(seen)
        C = np.zeros((replicates, len(places)), np.float32)
        if len(places):
            pair = np.cumsum(seen, dtype=np.int32) - 1
            for each in entries:
                C[each.result, pair[each.places]] += each.C
        return cls(shape, places, C)

    @cached_property
    def pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Own bin and sensor of the pairs, int, shape (pair,) each."""
        own, sensor = np.divmod(self.places, self.shape[1])
        return own.astype(np.int32), sensor.astype(np.int32)

    @cached_property
    def statistics(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard error of C of the pairs [sr], shape (pair,) each."""
        return mean_and_error(self.C)

    def dense(self) -> np.ndarray:
        """C of all pairs [sr], shape (replicate, own bin, sensor)."""
        out = np.zeros((len(self.C), self.shape[0] * self.shape[1]), np.float32)
        out[:, self.places] = self.C
        return out.reshape(len(self.C), *self.shape)
