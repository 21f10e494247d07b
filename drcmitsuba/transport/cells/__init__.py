"""Cells: the small patches of diffuse surface between gather and deposit.

lines
    Where cells end: at furniture and partitions.
cells
    Grid over a scene, and the cells of it that are known.
vertices
    Diffuse vertices of paths, and their store.
points
    Points that stand for cells, drawn from the vertices.
"""
