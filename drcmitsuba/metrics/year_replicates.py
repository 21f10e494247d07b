"""Illuminance of a state of the façade by each replicate: held, or summed where it is asked for."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.lib.mixins import NDArrayOperatorsMixin

from drcmitsuba.runtime.pieces import pieces, run
from drcmitsuba.runtime.threads import in_threads
from drcmitsuba.schema import mean_and_error


class YearReplicates(ABC):
    """E by each replicate at some hours (replicate, hour, sensor) [lx]."""

    @property
    @abstractmethod
    def shape(self) -> tuple[int, int, int]:
        """Numbers of replicates, hours and sensors."""

    @abstractmethod
    def statistics(self, hours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard error at some hours, indices: (chosen, sensor) each [lx]."""

    @abstractmethod
    def at(self, hour: np.ndarray, sensor: np.ndarray) -> np.ndarray:
        """E of pairs of an hour and a sensor, indices: (replicate, pair) [lx]."""

    @abstractmethod
    def of_means(self, weights: np.ndarray, hours: np.ndarray) -> np.ndarray:
        """E of means over sensors by weights (mean, sensor): (replicate, chosen, mean) [lx]."""


@dataclass(frozen=True, eq=False)
class HeldReplicates(YearReplicates):
    """E that is in memory."""

    E: np.ndarray

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of replicates, hours and sensors."""
        replicates, hours, sensors = self.E.shape
        return replicates, hours, sensors

    def statistics(self, hours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard error, by pieces that stay in the cache."""
        shape = (len(hours), self.shape[2])
        mean, error = np.empty(shape, self.E.dtype), np.empty(shape, self.E.dtype)

        def some(here: slice) -> None:
            mean[here], error[here] = mean_and_error(self.E[:, run(hours[here])])

        in_threads(some, pieces(*shape))
        return mean, error

    def at(self, hour: np.ndarray, sensor: np.ndarray) -> np.ndarray:
        """E of pairs, taken by the threads."""
        pair = hour * self.shape[2] + sensor
        out = np.empty((len(self.E), len(pair)), self.E.dtype)
        in_threads(lambda r: np.take(self.E[r], pair, out=out[r], mode="clip"), range(len(out)))
        return out

    def of_means(self, weights: np.ndarray, hours: np.ndarray) -> np.ndarray:
        """Products with the weights, in their precision; replicate by replicate, to save memory."""
        return np.stack([each[run(hours)] @ weights.T for each in self.E])


class SummedReplicates(NDArrayOperatorsMixin, YearReplicates):
    """E that is summed where it is asked for: an array of xarray without numbers in memory.

    All states of a façade are such arrays of the same hours. Any other use makes the numbers.
    """

    dtype, ndim = np.dtype(np.float32), 3

    @abstractmethod
    def joined(
        self, others: Sequence[YearReplicates], part: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard error, each hour by this state or one of the others (hour,) [lx]."""

    @abstractmethod
    def whole(self) -> np.ndarray:
        """All numbers."""

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self.whole(), dtype)

    def __getitem__(self, key: Any) -> Any:
        return self.whole()[key]

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> Any:
        return function(*map(_numbers, args), **kwargs)

    def __array_ufunc__(self, ufunc: Any, method: str, *args: Any, **kwargs: Any) -> Any:
        return getattr(ufunc, method)(*map(_numbers, args), **kwargs)


def _numbers(argument: Any) -> Any:
    """Argument of a function of NumPy, whose numbers are made where they were not."""
    return argument.whole() if isinstance(argument, SummedReplicates) else argument


def replicates_of(coefficients: xr.Dataset) -> YearReplicates:
    """Known `illuminance` (replicate, time, sensor) [lx] of a state."""
    E = coefficients["illuminance"].transpose("replicate", "time", "sensor").data
    return E if isinstance(E, YearReplicates) else HeldReplicates(np.asarray(E))
