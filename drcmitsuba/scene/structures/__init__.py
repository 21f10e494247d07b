"""Micro-structures and meshes from files, the geometry of components.

load_recipe
    Read and check a recipe (TOML): prism, slots, lamellae or mesh, with or without glass.
unit_cell
    Surfaces of one period of a recipe.
read_mesh
    Triangles of a PLY or OBJ file.
"""

from drcmitsuba.scene.structures.mesh import read_mesh
from drcmitsuba.scene.structures.recipe import Recipe, load_recipe
from drcmitsuba.scene.structures.structure import UnitCell, unit_cell

__all__ = ["Recipe", "UnitCell", "load_recipe", "read_mesh", "unit_cell"]
