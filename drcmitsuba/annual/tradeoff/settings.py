"""List of settings: one changed at a time from the default, and a few combinations.

`coarser` gives tensor trees fewer levels: the resolution of a film's file is a setting as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from drcmitsuba_plugins.bsdf_file import BsdfFile
from drcmitsuba_plugins.tensor import TensorTree

from drcmitsuba.bsdf import writer
from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.reading import fitted
from drcmitsuba.case.sensors import Sensors
from drcmitsuba.case.sun import Adaptive, Daysim, FivePhase, Sun, ThreePhase, TrueSun
from drcmitsuba.model.materials import BsdfMaterial
from drcmitsuba.scene.materials import film

RAYS = (
    "paths", "cell_paths", "cell_sky_rays", "sensor_sky_rays", "sensor_sun_samples",
    "pane_points", "film_sky_samples", "photons",
)  # fmt: skip
"""Numbers of samples in [accuracy] that share one factor."""

LONGEST = 120.0
"""Seconds that the case's own target may take beyond the first round."""

SUN_MODELS: tuple[tuple[Sun, int], ...] = (
    (Adaptive(model="adaptive"), 1),
    (ThreePhase(model="three_phase"), 1),
    (Daysim(model="daysim"), 1),
    (FivePhase(model="five_phase"), 1),
    (ThreePhase(model="three_phase"), 2),
    (ThreePhase(model="three_phase"), 4),
)
"""Sun models beside `true_sun`, each with a subdivision of the sky."""


@dataclass(frozen=True)
class Setting:
    """One way to evaluate a case.

    Parameters
    ----------
    name : str
        Short name, for table and picture.
    varied : str
        Varied quantity: "default", "yours", "samples", "cell size", "film", "sun model", "sky",
        "interreflection", "sensor spacing" or "combination".
    """

    name: str
    varied: str
    case: Case


def times_samples(accuracy: Accuracy, factor: float) -> Accuracy:
    """Multiply all ray counts, within the bounds of a case file."""
    bounds = Accuracy.model_json_schema()["properties"]
    counts = {
        name: min(max(round(getattr(accuracy, name) * factor), 1), bounds[name]["maximum"])
        for name in RAYS
    }
    return accuracy.model_copy(update=counts)


def spaced(case: Case, factor: int) -> Case:
    """Set the sensors `factor` times as far apart; the grid keeps its extent.

    A count that `factor` does not divide is rounded up, and the points move inward accordingly.
    Sensors that are no rectangular grid stay.
    """
    grid = case.sensors
    if not isinstance(grid, Sensors):
        return case
    count = tuple(-(-n // factor) for n in grid.count)
    spacing = grid.spacing * factor
    x, y = (
        start - (wide * spacing - n * grid.spacing) / 2
        for start, wide, n in zip(grid.corner[:2], count, grid.count, strict=True)
    )
    changed = {"count": count, "spacing": spacing, "corner": (x, y, grid.corner[2])}
    return case.with_tables(sensors=grid.model_copy(update=changed))


def default(case: Case) -> Case:
    """The case with the program's own settings."""
    sky = case.sky.model_copy(update={"subdivision": 1})
    accuracy = fitted(Accuracy(seed=case.accuracy.seed), case)
    return case.with_tables(accuracy=accuracy, sky=sky, sun=TrueSun())


def other_interreflection(case: Case, solved_cells: bool) -> Setting:
    """Evaluate a case by the other way to follow light between surfaces."""
    name = "bounces on paths" if solved_cells else "solved cells"
    effects = case.effects.model_copy(update={"solved_cells": "off" if solved_cells else "all"})
    return Setting(name, "interreflection", case.with_tables(effects=effects))


def design(case: Case, folder: Path, *, solved_cells: bool) -> list[Setting]:
    """List the settings to evaluate, the most instructive first.

    Parameters
    ----------
    case : Case
    folder : Path
        Folder for the files of coarser films, which must outlive the settings.
    solved_cells : bool
        Whether the plan solves the light between surfaces on cells; one setting does otherwise.

    Returns
    -------
    list of Setting
        Default setting, then the case's own where it differs, then all others.
    """
    base = default(case)

    def changed(accuracy: Accuracy = base.accuracy, sky: int = 1, sun: Sun = base.sun) -> Case:
        fine = base.sky.model_copy(update={"subdivision": sky})
        return base.with_tables(accuracy=accuracy, sky=fine, sun=sun)

    def samples(factor: float) -> Accuracy:
        return times_samples(base.accuracy, factor)

    def cells(size: float, accuracy: Accuracy = base.accuracy) -> Accuracy:
        return accuracy.model_copy(update={"cell_size": size})

    adaptive = SUN_MODELS[0][0]
    own = (case.accuracy, case.sky, case.sun) == (base.accuracy, base.sky, base.sun)
    settings = [Setting("default, yours" if own else "default", "default", base)]
    if not own:
        limit = min(case.accuracy.time_limit, LONGEST)
        accuracy = case.accuracy.model_copy(update={"time_limit": limit})
        settings.append(Setting("yours", "yours", case.with_tables(accuracy=accuracy)))
    settings += [
        Setting("samples × 1/4", "samples", changed(samples(1 / 4))),
        other_interreflection(base, solved_cells),
        Setting("cells 0.9 m", "cell size", changed(cells(0.9))),
        Setting("samples × 2", "samples", changed(samples(2))),
        Setting("sky MF 2", "sky", changed(sky=2)),
    ]
    if trees(case):
        settings += [
            Setting(f"film −{n} level{'s' * (n > 1)}", "film", with_coarser_films(base, n, folder))
            for n in (1, 2)
        ]
    for sun, sky in SUN_MODELS:
        name = sun.model.replace("_", "-") + (f", MF {sky}" if sky > 1 else "")
        settings.append(Setting(name, "sun model", changed(sky=sky, sun=sun)))
    fast, fine = cells(0.9, samples(1 / 4)), cells(0.3, samples(2))
    settings += [
        Setting("spacing × 2", "sensor spacing", spaced(base, 2)),
        Setting("samples × 1/2", "samples", changed(samples(1 / 2))),
        Setting("cells 0.3 m", "cell size", changed(cells(0.3))),
        Setting("samples × 1/8", "samples", changed(samples(1 / 8))),
        Setting("samples × 1/4, 0.9 m", "combination", changed(fast)),
        Setting("samples × 1/4, adaptive", "combination", changed(samples(1 / 4), sun=adaptive)),
        Setting("sky MF 4", "sky", changed(sky=4)),
        Setting("samples × 2, 0.3 m, MF 4", "combination", changed(fine, 4)),
        Setting("spacing × 3", "sensor spacing", spaced(base, 3)),
        Setting("samples × 4", "samples", changed(samples(4))),
        Setting("cells 0.15 m", "cell size", changed(cells(0.15))),
        Setting("sky MF 6", "sky", changed(sky=6)),
    ]
    return [s for s in settings if s.varied != "sensor spacing" or s.case.sensors != base.sensors]


def coarser(tree: TensorTree, levels: int) -> TensorTree:
    """Cut the finest levels off a tree, not the root: a cell gets the mean [1/sr] of its leaves."""
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
    """Replace every tensor tree of a case by one with `levels` fewer levels, in `folder`."""
    materials = dict(case.materials)
    for name, file in trees(case).items():
        components = {
            key: coarser(c, levels)
            for key, c in file.components.items()
            if isinstance(c, TensorTree)
        }
        path = folder / f"{len(list(folder.iterdir()))}.xml"
        writer.save(replace(file, components=components), path)
        material = materials[name]
        assert isinstance(material, BsdfMaterial)
        materials[name] = material.model_copy(update={"file": path})
    return case.with_tables(materials=materials)
