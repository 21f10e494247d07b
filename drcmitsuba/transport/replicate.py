"""One independent estimate of light on cells and sensors, and of what the sensors gather of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.random_streams import Stream
from drcmitsuba.transport.cell_points import Drawn
from drcmitsuba.transport.deposit import Deposit, Irradiance
from drcmitsuba.transport.first_bounce import MANY, CellLight
from drcmitsuba.transport.gather_blocks import Met, product
from drcmitsuba.transport.photons import Landed
from drcmitsuba.transport.solved_cells import Transfer
from drcmitsuba.transport.straight_suns import sensor_numbers


class FromFaces(NamedTuple):
    """Light that the faces of evenly scattering panes send, per irradiance on a face."""

    cells: mi.TensorXf
    """To cells, before any diffuse reflection, shape (cell, face)."""
    indirect: mi.TensorXf | None
    """To blocks of cells by light that cells have reflected, shape (block, face)."""


@dataclass
class Replicate:
    """One independent estimate: its deposit, and D of the cells."""

    number: int
    deposit: Deposit
    landed: Landed | None = None
    cells: Irradiance | None = None
    transfer: Transfer | None = None
    indirect: Irradiance | None = None
    faces: FromFaces | None = None
    """Light that is not part of `cells` and `indirect`, see `join`."""
    light: CellLight | None = None
    """Light of many cells after all bounces, in place of `cells` and `indirect`."""

    def meet(self, drawn: Drawn, keys: mi.UInt32) -> None:
        """Compute D of the cells [sr] at the points that stand for them, and what they reflect.

        Where the faces of evenly scattering panes are fewer than bins, their light stays apart.
        """
        p, n, key = drawn.p, drawn.n, (Stream.CELLS, self.number)
        rays, panes = self.deposit.accuracy.cell_sky_rays, self.deposit.faces
        straight = self.deposit.straight(p, n, key, rays, numbers=keys, within=drawn.within)
        D = straight.plus(self.deposit.by_films(p, n, key, keys))
        self.cells = D if self.landed is None else D.plus(self.landed.on(keys))
        dr.eval(*self.cells)  # a pending sum would keep all of its parts for every replicate
        if self.transfer is not None:
            self.indirect = Irradiance(*self.transfer.indirect(self.number, *self.cells))
            dr.eval(*self.indirect)
        if panes is not None:
            K, X = self.deposit.transfer(p, n, key, keys), None
            if self.transfer is not None:
                [X] = self.transfer.indirect(self.number, K)
            self.faces = FromFaces(K, X)
            if K.shape[1] >= sum(self.deposit.bins):
                self.join()

    def join(self) -> None:
        """Add light by way of the panes' faces to that of cells."""
        E = self.deposit.faces
        if self.faces is None or E is None or self.cells is None:
            return
        K, X = self.faces
        self.cells = self.cells.plus(Irradiance(*(K @ part for part in E)))
        dr.eval(*self.cells)
        if X is not None and self.indirect is not None:
            self.indirect = self.indirect.plus(Irradiance(*(X @ part for part in E)))
            dr.eval(*self.indirect)
        self.faces = None

    def pack(self) -> None:
        """Join the light of cells where they are so many that sums over paths gather it."""
        if self.transfer is None or self.cells is None or self.indirect is None:
            return
        if len(self.cells.sky) > MANY * self.deposit.accuracy.paths:
            self.join()
            self.light = CellLight.of(self.cells, self.indirect, self.transfer.blocks.of)
            self.cells = self.indirect = None

    def sensors(
        self, p: mi.Float, n: mi.Float, here: slice, sun_samples: int, within: mi.Bool | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """D of sensors (sensor, bin) [sr]: by straight and mirrored light; by all light."""
        key, sky_rays = (Stream.SENSORS, self.number), self.deposit.accuracy.sensor_sky_rays
        numbers = sensor_numbers(here)
        straight = self.deposit.straight(p, n, key, sky_rays, sun_samples, numbers, within)
        direct = straight.plus(self.deposit.scattered(p, n, key, numbers))
        D, D_straight = direct.numpy(), straight.numpy()
        if self.landed is None:
            return D_straight, D
        return D_straight + self.landed.mirrored[here], D + self.landed.sensors[here]

    def interreflected(self, met: Met, sensors: int) -> np.ndarray:
        """G·D, shape (sensor, bin) [sr], with the paths of this replicate."""
        bins = sum(self.deposit.bins)
        if (self.cells is None and self.light is None) or len(met) == 0:
            return np.zeros((sensors, bins), np.float32)
        if self.light is not None:
            paths = self.deposit.accuracy.paths
            _, cell, weight, _ = met.of_replicate(self.number, sensors, paths)
            return self.light.gathered(cell, weight, paths)
        assert self.cells is not None
        sent = self._sent(met, sensors)
        further = Irradiance(None, None) if self.indirect is None else self.indirect
        C = Irradiance(*(sent(d, x) for d, x in zip(self.cells, further, strict=True)))
        if self.faces is not None and self.deposit.faces is not None:
            K = sent(*self.faces)
            C = C.plus(Irradiance(*(K @ part for part in self.deposit.faces)))
        return C.numpy()

    def _sent(
        self, met: Met, sensors: int
    ) -> Callable[[mi.TensorXf, mi.TensorXf | None], mi.TensorXf]:
        """Make the function that gathers light of cells and, where it is solved, of blocks."""
        if self.transfer is None:
            first = dr.opaque(mi.UInt32, self.number * sensors)  # a literal: compiled for each
            row = met.row - first
            mine = (met.row >= first) & (row < dr.opaque(mi.UInt32, sensors))
            return lambda d, _: product(row, met.cell, met.weight, mine, sensors, d)
        paths, blocks = self.deposit.accuracy.paths, self.transfer.blocks.of
        row, cell, weight, _ = met.of_replicate(self.number, sensors, paths)
        block, seen = dr.gather(mi.UInt32, blocks, cell), weight > 0
        return lambda d, x: (
            product(row, cell, weight, seen, sensors, d)
            + product(row, block, weight, seen, sensors, x)
        )
