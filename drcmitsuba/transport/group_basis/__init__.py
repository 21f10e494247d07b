"""Basis of groups of panes: coefficients by group and state, of which any state is recombined.

marks
    Marks of paths that met panes whose state is left open.
basis
    Result of a computation, and the coefficients of any state of the façade.
simulate
    From a case to its basis.
"""

from drcmitsuba.transport.group_basis.basis import ElementLight, GroupBasis
from drcmitsuba.transport.group_basis.simulate import compute

__all__ = ["ElementLight", "GroupBasis", "compute"]
