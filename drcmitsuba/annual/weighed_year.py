r"""Illuminance of a façade of known elements: an array of xarray, summed where it is asked for.

.. math:: E_r = \sum_e w_e E_{e,r}

Kernels read the illuminance of every element once. The replicates r of the sum are not kept: to
write them takes as long as all that follows from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.metrics.year_replicates import SummedReplicates, YearReplicates
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.flat_arrays import flat, flat_indices, row_and_column
from drcmitsuba.runtime.pieces import run
from drcmitsuba.transport.elements.known_year import KnownYear
from drcmitsuba.transport.elements.weights import BESIDES

AT_ONCE = 64
"""Number of arrays that one kernel reads."""


@dataclass(frozen=True, eq=False)
class WeighedYear(SummedReplicates):
    """E of a state at all hours of a year by element, by the shares of a façade."""

    year: KnownYear
    """Year whose light that openings send back is the same in all façades."""
    shares: np.ndarray
    """Different shares of the elements, shape (row, element)."""
    row: np.ndarray
    """Row of every time stamp, int, shape (time,)."""

    @classmethod
    def constant(cls, year: KnownYear, shares: np.ndarray) -> WeighedYear:
        """Shares (element,) of all time stamps."""
        return cls(year, shares[None], np.zeros(year.L.shape[0], int))

    @classmethod
    def of_parts(cls, parts: Sequence[WeighedYear], part: np.ndarray) -> WeighedYear:
        """Year that takes each time stamp from one of several parts, int, shape (time,)."""
        starts = np.cumsum([0, *(len(each.shares) for each in parts)])
        row = np.stack([each.row for each in parts])[part, np.arange(len(part))] + starts[part]
        return cls(parts[0].year, np.concatenate([each.shares for each in parts]), row)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of replicates, time stamps and sensors."""
        light = self.year.light
        return light.replicates, len(self.row), len(light.positions)

    def whole(self) -> np.ndarray:
        """E by each replicate [lx], shape (replicate, time, sensor)."""
        return self.year.illuminance(self.shares[self.row])

    def joined(
        self, others: Sequence[YearReplicates], part: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard error by a kernel that reads the elements of all states once."""
        parts = [self, *(other for other in others if isinstance(other, WeighedYear))]
        assert len(parts) == 1 + len(others)
        return WeighedYear.of_parts(parts, part).statistics()

    def statistics(self, hours: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Mean of the replicates and its standard error [lx], (hour, sensor) each.

        `hours` are time stamps, int, shape (hour,); by default all of them.
        """
        backend.select()
        n, times, sensors = self.shape
        hours = None if hours is not None and len(hours) == times else hours
        shape = (times if hours is None else len(hours), sensors)
        if 0 in shape:
            return np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        hour, sensor = row_and_column(dr.arange(mi.UInt32, shape[0] * sensors), sensors)
        pair = None
        if hours is not None:
            hour = dr.gather(mi.UInt32, flat_indices(hours), hour)
            pair = hour * dr.opaque(mi.UInt32, sensors) + sensor
        first, *others = self._summed(hour, pair)
        total, squares = mi.Float(0), mi.Float(0)
        for E in others:  # differences keep the digits, as in `schema.mean_and_error`
            total += E - first
            squares += dr.square(E - first)
        total /= n
        spread = dr.maximum(squares - n * dr.square(total), 0)
        mean, error = first + total, dr.sqrt(spread / (n * (n - 1)))
        dr.eval(mean, error)
        return mean.numpy().reshape(shape), error.numpy().reshape(shape)

    def at(self, time: np.ndarray, sensor: np.ndarray) -> np.ndarray:
        """E by each replicate [lx] of pairs of a time stamp and a sensor, (replicate, pair)."""
        if len(time) == 0:
            return np.zeros((self.shape[0], 0), np.float32)
        backend.select()
        # Pairs of the same hour lie side by side: fewer lines of memory are read.
        order = np.argsort(time.astype(np.min_scalar_type(self.shape[1])), kind="stable")
        hour, column = flat_indices(time[order]), flat_indices(sensor[order])
        every = self._summed(hour, hour * dr.opaque(mi.UInt32, self.shape[2]) + column)
        dr.eval(every)
        out = np.empty((len(every), len(time)), np.float32)
        for row, E in zip(out, every, strict=True):
            row[order] = E.numpy()
        return out

    def of_means(self, weights: np.ndarray, hours: np.ndarray) -> np.ndarray:
        """E by each replicate of means over sensors at some time stamps (hour,) [lx].

        Shape (replicate, hour, mean), by weights (mean, sensor).
        """
        means, at = self.year.of_means(weights), run(hours)
        out = np.zeros((self.shape[0], len(hours), len(weights)), np.float32)
        for number, share in self._lit().items():
            out += share[self.row[at], None] * means[number][:, at]
        return out

    def _lit(self) -> dict[int, np.ndarray]:
        """Shares (row,) of all that gives light in some hours."""
        whole = np.ones(len(self.shares), np.float32)
        shares = self.year.light.pairs.joined(self.shares)
        every = {e: whole if e == BESIDES else shares[:, e] for e in self.year.lit}
        return {e: share for e, share in every.items() if share.any()}

    def _summed(self, hour: mi.UInt32, pair: mi.UInt32 | None) -> list[mi.Float]:
        """E by each replicate of entries of their `hour`: of some pairs, or of all entries."""
        lit, row = self._lit(), mi.UInt32(0)
        if len(self.shares) > 1:
            row = dr.gather(mi.UInt32, flat_indices(self.row), hour)
        weights = {
            e: None if (share == 1).all() else dr.gather(mi.Float, flat(share), row)
            for e, share in lit.items()
        }
        out = []
        for r in range(self.shape[0]):
            E = mi.Float(0)
            for e, weight in weights.items():
                part = self.year.on_device[e][r]
                part = part if pair is None else dr.gather(mi.Float, part, pair)
                E = E + part if weight is None else dr.fma(weight, part, E)
            if len(lit) * self.shape[0] > AT_ONCE:
                dr.eval(E)
            out.append(E)
        return out
