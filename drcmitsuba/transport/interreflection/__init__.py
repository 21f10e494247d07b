"""Interreflection H = D + T·H: light between surfaces, solved on cells.

cell_rays
    Rays from cells to other cells, and the importance of every cell for the sensors.
solved_cells
    T between cells, and H.
interior
    Paths and T, the same in all states of a façade that look alike from within.
first_bounce
    G₁·H where cells are many.
"""
