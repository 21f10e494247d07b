"""How light between surfaces is followed: to which depth, on paths or solved on cells."""

from __future__ import annotations

import numpy as np

from drcmitsuba.case.accuracy import AT_SENSORS
from drcmitsuba.case.case import Case
from drcmitsuba.plan import panes
from drcmitsuba.plan.effect import Effect
from drcmitsuba.plan.facts import Facts
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.surfaces import bounds_of_rooms
from drcmitsuba.transport.coefficients import groups_of

NEGLIGIBLE = 1e-3
"""Part of the light in a room that may be lost by cutting paths, where the case has no target."""
FINEST_TARGET = 0.5
"""Half width of the interval of the mean illuminance below which cells are not enough [%]."""
CELLS_OF_SENSOR = 50
"""Number of cells for each sensor above which paths from the sensors cost less."""
FEW_CELLS = 6000
"""Number of cells below which they take seconds, however few the sensors are: paths to suns that
light few cells scatter several times as much."""
CELLS_OF_MODEL = 16_000
"""Number of cells of a model, on the faces of its bounds, times that of groups of rooms that each
solve them, above which paths cost less: a tower of glass took four times as long."""
SHARES = ("%", AT_SENSORS)
"""Units of targets of the illuminance."""
RAY_BYTES = 48
"""Memory of a ray from cell to cell [bytes]."""
MOST_BYTES = 4 << 30
"""Largest memory of all of them [bytes]."""


def interreflection(facts: Facts) -> tuple[Effect, int | None]:
    """Decide on interreflection, and on the largest number of surfaces of a path, None without."""
    case = facts.case
    goal = case.accuracy.goal
    part = 0.1 * goal.value / 100 if goal is not None and goal.unit in SHARES else NEGLIGIBLE
    albedo, name = panes.most_reflecting(case, facts.components, facts.surrounded)
    most = panes.depth(albedo, part)
    quantities = {"largest_albedo": round(albedo, 4), "depth": most}
    if most == 0:
        return Effect(False, "every surface is black", quantities), 0
    reason = f"largest reflectance {albedo:.2f} ({name})"
    if most is None:
        return Effect(True, f"{reason}: to any depth", quantities), None
    reason += (
        f": over {most} surfaces, after which less than {100 * part:.2g} % of the light is left"
    )
    return Effect(True, reason, quantities), most


def solved_cells(facts: Facts, depth: int | None, sensors: int | None = None) -> Effect:
    """Light between surfaces solved on cells, instead of paths that follow all bounces.

    `depth` is that of `interreflection`; `sensors` is their number, by default that of the case.
    """
    case = facts.case
    sensors = len(prepared(case).receivers) if sensors is None else sensors
    a = case.accuracy.of_points(sensors)
    if depth == 0:
        return Effect(False, "every surface is black")
    goal = a.goal
    if goal is not None and goal.unit in SHARES and goal.value < FINEST_TARGET:
        mean = " of the mean" * (goal.unit == "%")
        got = f"the target, {goal}{mean}, is near the bias of cells"
        return Effect(False, f"{got}: on paths", {"target": goal.value})
    extent = extent_of_rooms(case)
    if extent is None:
        return Effect(False, "no room encloses the sensors: on paths")
    x, y, z = extent
    cells = 2 * (x * y + y * z + z * x) / a.cell_size**2
    quantities = {"cells": round(cells), "sensors": sensors}
    if cells > max(FEW_CELLS, CELLS_OF_SENSOR * sensors):
        return Effect(False, f"{sensors} sensors and some {cells:.0f} cells: on paths", quantities)
    if case.room is None and (groups := _groups(case)) * cells > CELLS_OF_MODEL:
        got = f"{groups} groups of rooms would each solve some {cells:.0f} cells of a model"
        return Effect(False, f"{got}: on paths", quantities)
    size = RAY_BYTES * a.replicates * a.cell_paths * cells
    if size > MOST_BYTES:
        got = f"the transfer between some {cells:.0f} cells takes {size / 2**30:.1f} GiB"
        return Effect(False, f"{got}: on paths", quantities)
    reason = f"{sensors} sensors share the light between some {cells:.0f} cells"
    return Effect(True, reason, quantities)


def _groups(case: Case) -> int:
    """Number of groups of rooms whose sensors share light on cells."""
    points, _ = prepared(case).receivers.at()
    return len(groups_of(prepared(case).rooms_of(points), len(points)))


def extent_of_rooms(case: Case) -> np.ndarray | None:
    """Extent of the rooms [m], shape (3,); None without any."""
    if case.room is not None:
        return np.array(case.room.size)
    bounds = bounds_of_rooms(case)
    return None if bounds is None else bounds[1] - bounds[0]
