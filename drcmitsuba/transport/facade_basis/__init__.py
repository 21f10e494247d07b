"""Façade basis: coefficients by tile and material, from which any composition is recombined.

facade
    Tiles, the materials that may fill them, and the marks of paths that met them.
tiling
    How a façade is cut into tiles.
views
    Irradiance of receivers by way of one tile at a time.
basis
    Result of a computation, and the coefficients of a composition.
simulate
    From a room to its basis.
year
    A basis under a sky: illuminance by any composition, with gradients.
"""

from drcmitsuba.transport.facade_basis.basis import Basis
from drcmitsuba.transport.facade_basis.facade import Palette, Tiles
from drcmitsuba.transport.facade_basis.simulate import MOST_BYTES, compute, memory
from drcmitsuba.transport.facade_basis.tiling import Wall, of_grid, of_variants, side_of
from drcmitsuba.transport.facade_basis.year import BasisYear

__all__ = [
    "MOST_BYTES",
    "Basis",
    "BasisYear",
    "Palette",
    "Tiles",
    "Wall",
    "compute",
    "memory",
    "of_grid",
    "of_variants",
    "side_of",
]
