"""Micro-structures and other plain geometry from files: what components are made of.

load_recipe
    Read and check a recipe (TOML): prism, slots, lamellae or mesh, with or without glass.
unit_cell
    One period of its surfaces.
read_mesh
    Triangles of a PLY or OBJ file.
"""

from drcmitsuba.scene.structures.mesh import read_mesh
from drcmitsuba.scene.structures.recipe import Recipe, load_recipe
from drcmitsuba.scene.structures.structure import UnitCell, unit_cell

__all__ = ["Recipe", "UnitCell", "load_recipe", "read_mesh", "unit_cell"]
