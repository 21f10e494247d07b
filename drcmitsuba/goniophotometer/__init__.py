"""Goniophotometer: from a micro-structure to a tensor-tree BSDF of variable resolution.

load_recipe
    Read and check a recipe (TOML): prism, slots, lamellae or mesh, with or without glass.
trace
    Light through one period of a structure that is repeated without end.
exposure
    `measure`: trace a recipe and merge the cells, a `BsdfFile`; `expose`: only trace it, all cells
    with their standard errors.
save
    Write the XML file.
"""

from drcmitsuba.bsdf.writer import save
from drcmitsuba.goniophotometer.exposure import Exposure, expose, measure
from drcmitsuba.scene.structures.recipe import Recipe, load_recipe

__all__ = ["Exposure", "Recipe", "expose", "load_recipe", "measure", "save"]
