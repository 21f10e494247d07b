r"""Light between the surfaces of a room as a function of their reflectances.

Every ray ends on a surface that reflects diffusely, and a reflectance ρ is a factor of all rays
that end on its surface. With the matrices of `transport.interreflection.solved_cells`, traced at
ρ′,

.. math:: G(\rho) = G_1 + G_1 P \, (1 - W T P)^{-1} \, W T, \qquad
          G_1 = \sum_k \frac{\rho_k}{\rho'_k} G_1^k, \quad T = \sum_k \frac{\rho_k}{\rho'_k} T^k,

k the kinds of surfaces. Nothing is traced again, and the adjoint of G takes the inverse transposed.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.runtime.flat_arrays import flat, row_and_column
from drcmitsuba.transport.gather.blocks import Met
from drcmitsuba.transport.interreflection.cell_rays import sum_of_bounces
from drcmitsuba.transport.interreflection.solved_cells import Transfer
from drcmitsuba.transport.light.products import by_replicate


@dataclass(frozen=True)
class Sums:
    """Weights (entry,) of rays at the traced reflectances, each with the mark of its ray.

    Each `value` is added to its `place`, 0 … size − 1.
    """

    place: mi.UInt32
    mark: mi.UInt32
    value: mi.Float
    size: int

    @classmethod
    def of(cls, place: mi.UInt32, mark: mi.UInt32, value: mi.Float, size: int) -> Sums:
        """Entries sorted by place, so that sums are faster."""
        order = dr.argsort(place)
        place, mark = (dr.gather(mi.UInt32, x, order) for x in (place, mark))
        value = dr.gather(mi.Float, value, order)
        dr.eval(place, mark, value)
        return cls(place, mark, value, size)

    def weighed(self, factor: mi.Float) -> mi.Float:
        """Sum of the entries of every place, each times the factor of its mark; shape (size,)."""
        out = dr.zeros(mi.Float64, self.size)
        # The factor's gradient is a sum of this kind, too.
        value = self.value * dr.gather(mi.Float64, mi.Float64(factor), self.mark)
        dr.scatter_add(out, value, self.place)
        return mi.Float(out)


class AllBounces(dr.CustomOp):
    """M = 1 + t + t² + … of square matrices t, and its derivatives: dM = M·dt·M."""

    def eval(self, t: mi.Float, size: int) -> mi.Float:
        """M of matrices t, one after another in flat arrays; `size` is the number of rows."""
        self.total = np.stack([sum_of_bounces(one) for one in self._matrices(t, size)])
        return flat(self.total)

    def _matrices(self, values: mi.Float, size: int) -> np.ndarray:
        return values.numpy().reshape(-1, size, size)

    def _slope(self, change: mi.Float, M: np.ndarray) -> mi.Float:
        return flat(M @ self._matrices(change, M.shape[-1]) @ M)

    def forward(self) -> None:
        """Take the change of t to that of M."""
        self.set_grad_out(self._slope(self.grad_in("t"), self.total))

    def backward(self) -> None:
        """Take the gradient by M to that by t."""
        self.set_grad_in("t", self._slope(self.grad_out(), self.total.swapaxes(1, 2)))

    def name(self) -> str:
        """Name of the operation in graphs."""
        return "all bounces"


@dataclass(frozen=True)
class RoomMatrices:
    """G₁ and T, of one or of several replicates; rows are those of one after those of another.

    Columns are cells, or a single one for light on the cells that is multiplied out.
    """

    replicates: int
    blocks: int
    columns: int
    of_sensors: Sums
    """G₁ [sensor, column]."""
    of_sensors_by_block: Sums
    """G₁·P [sensor, block]."""
    of_blocks: Sums
    """W·T [block, column]."""
    between_blocks: Sums
    """W·T·P [block, block]."""

    @classmethod
    def of(cls, met: Met, transfer: Transfer, sensors: int, cells: int) -> RoomMatrices:
        """Matrices by the rays of all replicates together."""
        row = met.row % dr.opaque(mi.UInt32, sensors)
        weight = met.weight / dr.opaque(mi.Float, len(transfer.bounces))
        every = Met(row, met.cell, weight, met.mark)
        return cls._of(every, transfer, sensors, cells, 1, None)

    @classmethod
    def of_replicates(
        cls, met: Met, transfer: Transfer, sensors: int, light: np.ndarray
    ) -> RoomMatrices:
        """Matrices of each replicate, times its `light` on the cells, shape (replicate, cell)."""
        return cls._of(met, transfer, sensors, light.shape[1], len(light), flat(light))

    @classmethod
    def _of(
        cls, met: Met, transfer: Transfer, sensors: int, cells: int, replicates: int,
        light: mi.Float | None,
    ) -> RoomMatrices:  # fmt: skip
        """Matrices of rays from sensors and from cells."""
        blocks, columns = transfer.blocks, cells if light is None else 1
        source, cell, weight = (dr.concat(c) for c in zip(*transfer.bounces, strict=True))
        mark = dr.concat(transfer.marks)
        ray = dr.arange(mi.UInt32, dr.width(source))
        replicate, _ = row_and_column(ray, dr.width(source) // len(transfer.bounces))
        row = dr.gather(mi.UInt32, blocks.of, source)
        if replicates > 1:
            row += replicate * dr.opaque(mi.UInt32, blocks.count)
        weight = weight * dr.gather(mi.Float, blocks.share, source)
        weight /= dr.opaque(mi.Float, len(transfer.bounces) // replicates)

        def sums(
            row: mi.UInt32, cell: mi.UInt32, weight: mi.Float, mark: mi.UInt32, rows: int
        ) -> tuple[Sums, Sums]:
            """Sums by column, and sums by block."""
            block, count = dr.gather(mi.UInt32, blocks.of, cell), dr.opaque(mi.UInt32, blocks.count)
            by_block = Sums.of(row * count + block, mark, weight, rows * blocks.count)
            if light is None:
                place = row * dr.opaque(mi.UInt32, columns) + cell
                return Sums.of(place, mark, weight, rows * columns), by_block
            of_replicate, _ = row_and_column(row, rows // replicates)
            at = of_replicate * dr.opaque(mi.UInt32, cells) + cell
            weight = weight * dr.gather(mi.Float, light, at)
            return Sums.of(row, mark, weight, rows), by_block

        of_sensors = sums(met.row, met.cell, met.weight, met.mark, replicates * sensors)
        of_blocks = sums(row, cell, weight, mark, replicates * blocks.count)
        return cls(replicates, blocks.count, columns, *of_sensors, *of_blocks)

    def gathered(self, factor: mi.Float) -> mi.TensorXf:
        """G(ρ), shape (replicate · sensor, column).

        `factor` has the ratio ρ/ρ′ of every mark: 1 for mark 0, and those of the kinds.
        """

        def matrix(sums: Sums, columns: int) -> mi.TensorXf:
            return mi.TensorXf(sums.weighed(factor), (sums.size // columns, columns))

        t = self.between_blocks.weighed(factor)
        M = dr.custom(AllBounces, t, self.blocks)
        M = mi.TensorXf(M, (self.replicates * self.blocks, self.blocks))
        X = by_replicate(M, matrix(self.of_blocks, self.columns), self.replicates)
        further = by_replicate(matrix(self.of_sensors_by_block, self.blocks), X, self.replicates)
        return matrix(self.of_sensors, self.columns) + further
