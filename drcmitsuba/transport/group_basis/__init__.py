"""Groups of panes: any states of them, hour by hour, are recombined from light by group and state.

marks, marked_light
    Marks of paths that met panes whose state is left open; the light of such paths.
year
    Elements of every time stamp, and the sums of their light.
elements
    Scenes in which a group of panes in one state lets light in, and their deposits.
trace
    Paths of a case, and the light of every element, one replicate after another.
basis, simulate
    Coefficients of every group in every state, of which any state of the façade is recombined.
illuminance
    A year of known states, of which no coefficients are kept.
"""

from drcmitsuba.transport.group_basis.basis import ElementLight, GroupBasis
from drcmitsuba.transport.group_basis.illuminance import illuminance
from drcmitsuba.transport.group_basis.simulate import compute
from drcmitsuba.transport.group_basis.year import Year

__all__ = ["ElementLight", "GroupBasis", "Year", "compute", "illuminance"]
