"""Independent estimates of light on cells and sensors, and of what the sensors gather of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi

from drcmitsuba.runtime.flat_arrays import repeated
from drcmitsuba.runtime.random_streams import Stream, number_in_replicate
from drcmitsuba.transport.cells.points import CellPoints
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.gather.blocks import Met
from drcmitsuba.transport.interreflection.first_bounce import MANY, CellLight
from drcmitsuba.transport.interreflection.solved_cells import Followed, Transfer
from drcmitsuba.transport.light.irradiance import Irradiance
from drcmitsuba.transport.light.lit_cells import LitCells
from drcmitsuba.transport.light.products import PathMatrix, RayMatrix, product
from drcmitsuba.transport.pane_light import FromPanes, Light, by_panes, stacked
from drcmitsuba.transport.photons.light import Landed
from drcmitsuba.transport.rays.openings import Within, repeated_within
from drcmitsuba.transport.rays.straight_suns import Disks, sensor_numbers
from drcmitsuba.transport.rays.sun_clusters import sun_tiles

TOGETHER = 1 << 23
"""Largest number of values of D in one launch, 32 MiB: more take memory and no less time."""


@dataclass
class Replicates:
    """Some independent estimates, in the same launches: their deposits, and D of the cells.

    Rows of arrays are those of one replicate after those of another. Random numbers depend on the
    replicate, not on those beside it.
    """

    numbers: range
    deposits: tuple[Deposit, ...]
    landed: tuple[Landed, ...] = ()
    transfer: Transfer | None = None
    gathering: int | None = None
    """Number of sensors that gather the light of cells; None where it is asked for itself."""
    cells: Irradiance | None = None
    """D of the cells, shape (replicate · cell, bin) each."""
    reached: tuple[LitCells, LitCells] | None = None
    """Cells and bins with light of `cells`."""
    indirect: Irradiance | None = None
    """Light Y that cells have reflected, shape (replicate · cell, bin) each; None where nothing is
    solved on cells or `Transfer.followed` takes its place."""
    panes: tuple[FromPanes, ...] = ()
    """Light that is not part of `cells` and `indirect`, see `join`."""
    light: CellLight | None = None
    """Light of many cells after all bounces, in place of `cells` and `indirect`."""

    @classmethod
    def one(cls, number: int, deposit: Deposit) -> Replicates:
        """A single replicate."""
        return cls(range(number, number + 1), (deposit,))

    def batches(self, rows: int) -> Iterator[Replicates]:
        """Cut into groups of replicates whose D fits in a launch, with `rows` rows in each."""
        bins = max(1, sum(self.deposits[0].bins))
        step = max(1, TOGETHER // max(1, rows * bins))
        for start in range(0, len(self.numbers), step):
            here = slice(start, start + step)
            yield replace(
                self, numbers=self.numbers[here], deposits=self.deposits[here],
                landed=self.landed[here],
            )  # fmt: skip

    def __len__(self) -> int:
        """Count the replicates."""
        return len(self.numbers)

    def meet(self, drawn: CellPoints, keys: mi.UInt32, within: Within = None) -> None:
        """Compute D of the cells [sr] at the points that stand for them, and what they reflect.

        Where parts of panes are fewer than bins, their light stays apart. `drawn` are the points in
        each of these replicates, `within` whether they lie in the room, where they do not say it.
        """
        base, rays = self.deposits[0], self.deposits[0].accuracy.cell_sky_rays
        p, n = drawn.p, drawn.n
        each = [number_in_replicate(keys, r) for r in self.numbers]
        key = (Stream.CELLS,)
        within = within if drawn.within is None else drawn.within
        D = base.straight(p, n, key, rays, numbers=dr.concat(each), within=within)
        rest, parts = by_panes(self.deposits, p, n, key, each, within)
        D = D.plus(stacked(one.on(keys) for one in self.landed)).plus(rest)
        dr.eval(*D)  # a pending sum would keep all of its parts
        self.cells, self.reached = D, None
        self.panes = tuple(FromPanes(K, None, light) for K, light in parts)
        if sum(K.shape[1] for K, _ in parts) >= sum(base.bins):
            self.join()
        if self.transfer is None or self._follows(self._reached_cells()):
            return
        if self._has_many_cells and self.panes:
            self.join()
            self._reached_cells()
        self._reflect()

    def _reached_cells(self) -> list[LitCells]:
        """Find the cells and bins with light, by way of panes and other light."""
        assert self.cells is not None
        of_panes = [LitCells.by(one.cells, len(self)) for one in self.panes]
        sky = LitCells.by(self.cells.sky, len(self))
        sun = LitCells.by(self.cells.sun, len(self), sun_tiles(self.deposits[0].suns))
        self.panes = tuple(
            one._replace(reached=at) for one, at in zip(self.panes, of_panes, strict=True)
        )
        self.reached = sky, sun
        return [*of_panes, sky, sun]

    def _follows(self, every: list[LitCells]) -> bool:
        """Whether sensors gather light of cells by way of cells, instead of cells getting it."""
        if self.transfer is None or self.gathering is None:
            return False
        shining, lit = sum(dr.width(at.shining) for at in every), [dr.width(at.lit) for at in every]
        most = MANY * self.deposits[0].accuracy.paths  # sums over paths cost no more
        return not self.transfer.pays(shining, max(lit), self.gathering, most)

    def _reflect(self) -> None:
        """Compute the light that cells get from cells."""
        assert self.transfer is not None
        assert self.cells is not None
        of, numbers = self.transfer.indirect, self.numbers
        self.panes = tuple(
            one._replace(indirect=of(numbers, one.cells, one.reached)) for one in self.panes
        )
        sky, sun = self.reached or (None, None)
        self.indirect = Irradiance(
            of(numbers, self.cells.sky, sky), of(numbers, self.cells.sun, sun)
        )
        dr.eval(*self.indirect)

    @property
    def _has_many_cells(self) -> bool:
        """Whether cells are so many that sums over paths gather their light after all bounces."""
        if self.transfer is None or self.gathering is None or self.cells is None:
            return False
        return len(self.cells.sky) > MANY * self.deposits[0].accuracy.paths * len(self)

    def join(self) -> None:
        """Add light by way of panes to that of cells, and what cells reflect of it."""
        for K, Y, light, _ in self.panes:
            assert self.cells is not None
            self.cells, self.reached = self.cells.plus(light.through(K, len(self))), None
            if Y is not None and self.indirect is not None:
                self.indirect = self.indirect.plus(light.through(Y, len(self)))
            dr.eval(*self.cells, self.indirect)
        self.panes = ()

    def pack(self) -> None:
        """Join the light of cells where they are so many that sums over paths gather it."""
        if self.indirect is None or not self._has_many_cells:
            return
        assert self.cells is not None
        self.light = CellLight.of(self.cells.plus(self.indirect))
        self.cells, self.indirect = None, None

    def sensors(
        self, p: mi.Float, n: mi.Float, here: slice, sun_samples: int, within: Within,
        disks: Disks | None,
    ) -> tuple[Irradiance, Irradiance]:  # fmt: skip
        """D of sensors (replicate · sensor, bin) [sr]: by straight and mirrored light; by all.

        `disks` are from `Deposit.disks`.
        """
        straight, direct, parts = self.sensors_by_parts(p, n, here, sun_samples, within, disks)
        for K, light in parts:
            direct = direct.plus(light.through(K, len(self)))
        return straight, direct

    def sensors_by_parts(
        self, p: mi.Float, n: mi.Float, here: slice, sun_samples: int, within: Within,
        disks: Disks | None,
    ) -> tuple[Irradiance, Irradiance, list[tuple[mi.TensorXf, Light]]]:  # fmt: skip
        """D as `sensors`, but by parts of panes, and the weights and the light of these parts."""
        base, place = self.deposits[0], sensor_numbers(here)
        straight = base.straight_on_sensors(p, n, place, self.numbers, sun_samples, within, disks)
        numbers = [number_in_replicate(place, r) for r in self.numbers]
        every_p, every_n = (repeated(x, len(self)) for x in (p, n))
        every_within = repeated_within(within, len(self))
        rest, parts = by_panes(
            self.deposits, every_p, every_n, (Stream.SENSORS,), numbers, every_within
        )
        direct = straight.plus(rest)
        if self.landed:
            straight = straight.plus(stacked(one.mirrored(here) for one in self.landed))
            direct = direct.plus(stacked(one.sensors(here) for one in self.landed))
        return straight, direct, parts

    def interreflected(self, met: Met, here: slice) -> Irradiance:
        """G·D, shape (replicate · sensor, bin) [sr], with the paths of each replicate."""
        sensors = here.stop - here.start
        deposit, rows = self.deposits[0], len(self) * sensors
        if (self.cells is None and self.light is None) or len(met) == 0:
            return Irradiance(*(dr.zeros(mi.TensorXf, (rows, n)) for n in deposit.bins))
        if self.light is not None:
            paths = deposit.accuracy.paths
            mine = met.of_replicates(self.numbers, sensors, paths)
            return Irradiance(*self.light.gathered(mine, len(self), paths, deposit.bins))
        assert self.cells is not None
        sent = self._sent(met, here)
        where, indirect = self.reached or (None, None), self.indirect or (None, None)
        C = Irradiance(*map(sent, self.cells, indirect, where))
        for K, Y, light, reached in self.panes:
            C = C.plus(light.through(sent(K, Y, reached), len(self)))
        return C

    def _sent(
        self, met: Met, here: slice
    ) -> Callable[[mi.TensorXf, mi.TensorXf | None, LitCells | None], mi.TensorXf]:
        """Make the function that gathers light of cells and, where it is solved, of blocks."""
        count, sensors = len(self), here.stop - here.start
        if self.transfer is None:
            first = dr.opaque(mi.UInt32, self.numbers.start * sensors)  # a literal: compiled anew
            row = met.row - first
            mine = (met.row >= first) & (row < dr.opaque(mi.UInt32, count * sensors))
            every = RayMatrix(row, met.cell, met.weight, sensors, count, mine)
            return lambda d, _, at: product(every, d, at)
        paths, transfer = self.deposits[0].accuracy.paths, self.transfer
        to_cells = PathMatrix(met.cell, met.weight, paths, sensors, count, self.numbers.start)
        made: list[Followed] = []  # once, where it is needed

        def sent(d: mi.TensorXf, y: mi.TensorXf | None, at: LitCells | None) -> mi.TensorXf:
            if at is not None and not dr.width(at.lit):
                return dr.zeros(mi.TensorXf, (count * sensors, d.shape[1]))
            if y is not None:
                return product(to_cells, d + y)
            if not made:
                made.append(transfer.followed(self.numbers, to_cells, here))
            whole, onward = made[0]
            return product(whole, d, at, onward)

        return sent
