"""Tensor trees with fewer levels: what the resolution of a film's file is worth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from drcmitsuba_plugins.bsdf_file import BsdfFile
from drcmitsuba_plugins.tensor import TensorTree

from drcmitsuba.bsdf import xml
from drcmitsuba.case.case import Case
from drcmitsuba.case.materials import BsdfMaterial
from drcmitsuba.scene.materials import film


def coarser(tree: TensorTree, levels: int) -> TensorTree:
    """Cut the finest levels off a tree: a cell takes the mean of the leaves within it.

    Parameters
    ----------
    tree : TensorTree
    levels : int
        Levels that are cut off; the root stays.

    Returns
    -------
    TensorTree
        With the same mean over all pairs of directions.
    """
    cut = min(levels, tree.depth)
    depth = tree.depth - cut
    cell, first = np.unique(tree.start >> tree.rank * cut, return_index=True)
    level = np.minimum(tree.level[first], depth)
    # Share of its cell that a leaf fills; larger leaves are cells of their own.
    share = 2.0 ** (-tree.rank * np.maximum(tree.level - depth, 0))
    return TensorTree(tree.rank, depth, cell, level, np.add.reduceat(tree.value * share, first))


def trees(case: Case) -> dict[str, BsdfFile]:
    """The films of a case whose resolution can be changed: grey tensor trees, by material."""
    used = {strip.material for facade in case.facade.values() for strip in facade.strips}
    if case.shading is not None:
        used.add(case.shading.material)
    measured = {
        name: film(m.file).file
        for name, m in case.materials.items()
        if name in used and isinstance(m, BsdfMaterial)
    }
    return {n: f for n, f in measured.items() if f.kind.startswith("Tensor") and not f.colour}


def with_coarser_films(case: Case, levels: int, folder: Path) -> Case:
    """Give every tensor tree of a case `levels` fewer levels; the files go to `folder`."""
    materials = dict(case.materials)
    for name, file in trees(case).items():
        components = {
            key: coarser(c, levels)
            for key, c in file.components.items()
            if isinstance(c, TensorTree)
        }
        path = folder / f"{len(list(folder.iterdir()))}.xml"
        xml.save(replace(file, components=components), path)
        material = materials[name]
        assert isinstance(material, BsdfMaterial)
        materials[name] = material.model_copy(update={"file": path})
    return case.model_copy(update={"materials": materials})
