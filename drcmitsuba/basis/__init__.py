"""Façade basis: coefficients by tile and material, from which any composition is recombined.

facade
    Tiles, the materials that may fill them, and what paths remember of them.
tiling
    How a façade is cut into tiles.
views
    What receivers see through one tile at a time.
basis
    What was computed, and the coefficients of a composition.
compute
    From a room to its basis.
"""
