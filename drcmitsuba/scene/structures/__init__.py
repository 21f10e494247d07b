"""Micro-structures and meshes from files, the geometry of components.

recipe
    `load_recipe`: read and check a recipe (TOML): prism, slots, lamellae or mesh, with or without
    glass.
mesh, solid, polygon
    `read_mesh`: triangles of a PLY or OBJ file; whether they enclose a solid; ends of solids.
structure, block
    `unit_cell`: surfaces of one period of a recipe; whole periods, built into a pane.
"""

from drcmitsuba.scene.structures.mesh import read_mesh
from drcmitsuba.scene.structures.recipe import Recipe, load_recipe
from drcmitsuba.scene.structures.structure import UnitCell, unit_cell

__all__ = ["Recipe", "UnitCell", "load_recipe", "read_mesh", "unit_cell"]
