"""`tensor_tree`: BSDF of a file with tensor trees of rank 4, or 3 for isotropic materials."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
from drcmitsuba_plugins.isotropic import IsotropicLobes, TurnedLobes
from drcmitsuba_plugins.lobes import SquareLobes, square_code
from drcmitsuba_plugins.measured import Measured
from drcmitsuba_plugins.sampling import clamped_index


class TensorTreeBsdf(Measured):
    """Tensor trees; the parameters are those of `measured.Measured`."""

    plugin = "tensor_tree"

    def _check(self, file):
        if not file.kind.startswith("TensorTree"):
            raise ValueError(f"a file of kind {file.kind}; use the plugin klems")
        self.rank = int(file.kind[-1])

    def _reversed(self, tree):
        return (tree, True) if self.rank == 3 else (tree.reversed(), False)

    def _reversed_view(self, table):
        # A turn by 180° maps a cell's code to its complement.
        return table if self.rank == 3 else table[::-1]

    def _lobes_of(self, trees, swapped, fixed):
        if self.rank == 3:
            outward = fixed == "outgoing"
            turned = [t is not None and s != outward for t, s in zip(trees, swapped, strict=True)]
            return TurnedLobes(trees, turned) if any(turned) else IsotropicLobes(trees)
        return SquareLobes(trees, fixed)

    def _view_cell(self, light):
        if self.rank == 4:
            return square_code(-light.xy, (self.view_cells.bit_length() - 1) // 2)
        s0 = 0.5 - 0.5 * dr.norm(light.xy)
        return clamped_index(s0 * self.view_cells, max(self.view_cells // 2, 1))


mi.register_bsdf("tensor_tree", TensorTreeBsdf)
