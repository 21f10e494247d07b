"""Façade basis: coefficients by tile and material, from which any composition is recombined.

facade
    Tiles, the materials that may fill them, and what paths remember of them.
tiling
    How a façade is cut into tiles.
views
    What receivers see through one tile at a time.
basis
    What was computed, and the coefficients of a composition.
simulate
    From a room to its basis.
year
    A basis under a sky: illuminance by any composition, with gradients.
"""

from drcmitsuba.transport.facade_basis.basis import Basis
from drcmitsuba.transport.facade_basis.facade import Palette, Tiles
from drcmitsuba.transport.facade_basis.simulate import compute
from drcmitsuba.transport.facade_basis.tiling import Wall, of_grid, of_variants, side_of
from drcmitsuba.transport.facade_basis.year import BasisYear

__all__ = [
    "Basis",
    "BasisYear",
    "Palette",
    "Tiles",
    "Wall",
    "compute",
    "of_grid",
    "of_variants",
    "side_of",
]
