"""`klems`: BSDF of a file with matrices over Klems' patches."""

from __future__ import annotations

import mitsuba as mi
from drcmitsuba_plugins.lobes import KlemsLobes
from drcmitsuba_plugins.measured import Measured


class Klems(Measured):
    """Klems matrices; the parameters are those of `measured.Measured`."""

    plugin = "klems"

    def _check(self, file):
        if file.kind != "Klems":
            raise ValueError(f"a file of kind {file.kind}; use the plugin tensor_tree")
        bases = {b.name for m in file.components.values() for b in (m.incident, m.outgoing)}
        if len(bases) > 1:
            raise ValueError(f"several bases ({', '.join(sorted(bases))}); give data over one")
        self.basis = next(iter(file.components.values())).incident

    def _reversed(self, matrix):
        return matrix.reversed(), False

    def _reversed_view(self, table):
        return table[self.basis.opposite]

    def _lobes_of(self, matrices, swapped, fixed):
        return KlemsLobes(matrices, fixed)

    def _view_cell(self, light):
        return self._make(mi.TransportMode.Radiance).patch(-light.xy)


mi.register_bsdf("klems", Klems)
