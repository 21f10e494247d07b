"""Plans of a façade's evaluation: points, outlines and what is counted at each point."""

from __future__ import annotations

from typing import Any

import numpy as np

from drcmitsuba import metrics
from drcmitsuba.metrics.grids import sensors_by_grid
from drcmitsuba.report.document.facade import EvaluatedFacade
from drcmitsuba.report.document.labels import labels
from drcmitsuba.report.document.packing import Packed, packed
from drcmitsuba.report.outlines import outlines_in_plan
from drcmitsuba.report.sheets import MOST_SHEETS, Sheet, sheets
from drcmitsuba.report.tiles import SensorTiles, spacing
from drcmitsuba.runtime.errors import on_a_line

MOST_POINTS = 20_000
"""Largest number of points in the plans; of more, every other one is shown."""
MOST_CORNERS = 40_000
"""Largest number of corners of all outlines of a report."""
KINDS = ("room", "glazing", "furniture", "surroundings")
"""Outlines in the order in which they are kept where there are too many."""
PER_METRE = 1000
"""Coordinates are in millimetres."""
FARTHEST = 1e6
"""Largest distance of a point from the first one, in x and in y [m]."""
PER_LUX = 10
"""Mean illuminances are in tenths of a lux."""
PER_UNIT = 10_000
"""Probabilities are in hundredths of a per cent."""


def shown_points(facade: EvaluatedFacade, most: int = MOST_POINTS) -> np.ndarray:
    """Sensors that the plans show, as indices, int, shape (point,)."""
    sensors = facade.illuminance.sizes["sensor"]
    return np.arange(0, sensors, -(-sensors // most))


def plans(
    facade: EvaluatedFacade, shown: np.ndarray, corners: int = MOST_CORNERS
) -> dict[str, Any]:
    """Points, sheets and counts of a façade for the script.

    Parameters
    ----------
    facade : Facade
    shown : np.ndarray of int, shape (point,)
        Sensors to show, from `shown_points`.
    corners : int
        Largest number of corners of its outlines.
    """
    E = facade.illuminance
    x, y = (_near(E[axis].values.astype(float)) for axis in "xy")
    at = np.column_stack([x, y])
    every = sheets(E)[:MOST_SHEETS]
    number = np.full(len(x), len(every))
    for k, sheet in enumerate(every):
        number[sheet.sensors] = k
    grids = sensors_by_grid(E)
    of_grid = np.zeros(len(x), int)
    for k, sensors in enumerate(grids.values()):
        of_grid[sensors] = k
    return {
        "sensor": packed(shown),
        "x": _millimetres(x[shown]),
        "y": _millimetres(y[shown]),
        "sheet": packed(number[shown]),
        "grid": packed(of_grid[shown]),
        "grids": [on_a_line(name) for name in grids],
        "tiles": _millimetres((_tiles(x, y, grids) - at[:, None])[shown].reshape(len(shown), 8).T),
        "sheets": [_sheet(facade, sheet, at, corners // len(every)) for sheet in every],
        **_counts(facade, shown),
    }


def _near(metres: np.ndarray) -> np.ndarray:
    """Coordinates, none farther than `FARTHEST` from the first."""
    return np.clip(metres, metres[0] - FARTHEST, metres[0] + FARTHEST)


def _millimetres(metres: np.ndarray) -> Packed:
    return packed(np.rint(metres * PER_METRE))


def _tiles(x: np.ndarray, y: np.ndarray, grids: dict[str, np.ndarray]) -> np.ndarray:
    """Corners of the tile of every sensor [m], shape (sensor, 4, 2); diamonds outside of grids."""
    out = np.empty((len(x), 4, 2))
    for sensors in (grids or {"": np.arange(len(x))}).values():
        at = x[sensors], y[sensors]
        tiles = SensorTiles.of(*at)
        if tiles is None:
            half = 0.35 * spacing(*np.unique(np.round(np.column_stack(at), 6), axis=0).T)
            around = half * np.array([[-1, 0], [0, -1], [1, 0], [0, 1]])
            out[sensors] = np.column_stack(at)[:, None] + around
            continue
        for k, (row, column) in enumerate(((0, 0), (0, 1), (1, 1), (1, 0))):
            out[sensors, k] = tiles.corners[tiles.row + row, tiles.column + column]
    return out


def _sheet(facade: EvaluatedFacade, sheet: Sheet, at: np.ndarray, corners: int) -> dict[str, Any]:
    """Name of a sheet, and its outlines x, y, x, y, … [mm] with at most so many corners."""
    lines = outlines_in_plan(facade.case, at[sheet.sensors], sheet)
    heights = f"{sheet.low:.2f} m"
    if sheet.high > sheet.low + 0.005:
        heights = f"{sheet.low:.2f} … {sheet.high:.2f} m"
    name = labels()["sheet_up" if sheet.faces_up else "sheet_other"].format(heights=heights)
    kept: dict[str, list[list[int]]] = {kind: [] for kind in KINDS}
    for kind in KINDS:
        for line in lines.get(kind, ()):
            corners -= len(line)
            if corners < 0:
                break
            millimetres = np.rint(line[:, :2] * PER_METRE)
            kept[kind].append(millimetres.astype(int).ravel().tolist())
    return {"name": name, "outlines": kept}


def _counts(facade: EvaluatedFacade, shown: np.ndarray) -> dict[str, Any]:
    """Mean illuminance, time stamps above the thresholds, and probabilities to count, by point."""
    E, t = facade.illuminance, facade.case.metrics
    stamps = E.sizes["time"]
    drawn = slice(None) if len(shown) == E.sizes["sensor"] else shown  # a selection copies E
    total, direct = (E[name].values[:, drawn] for name in ("total", "direct_sun"))
    enough = np.count_nonzero(total >= t.sda_threshold, axis=0)
    in_sun = np.count_nonzero(direct >= t.ase_threshold, axis=0)
    needed = metrics.autonomy_stamps(t.sda_fraction, stamps)
    allowed = metrics.exposure_stamps(t.ase_hours, facade.step_hours)
    mean = np.minimum(total.mean(axis=0, dtype=float), 1e8)
    passing = {"sDA": enough >= needed, "ASE": in_sun >= allowed}
    return {
        "mean": packed(np.rint(mean * PER_LUX)),
        "enough": packed(enough),
        "in_sun": packed(in_sun),
        "probability": {
            metric: packed(_probability(facade, metric, passes, shown))
            for metric, passes in passing.items()
        },
        "stamps": stamps,
        "step_hours": facade.step_hours,
        "needed": int(needed),
        "allowed": int(allowed),
        "sda_threshold": t.sda_threshold,
        "ase_threshold": t.ase_threshold,
    }


def _probability(
    facade: EvaluatedFacade, metric: str, passes: np.ndarray, shown: np.ndarray
) -> np.ndarray:  # fmt: skip
    """Probability that each point counts for a metric, in parts of PER_UNIT."""
    share = np.zeros(facade.illuminance.sizes["sensor"])
    share[shown] = passes
    for point in facade.numbers.get("undecided", []):
        if point["metric"] == metric:
            share[point["sensor"]] = point["probability"]
    return np.asarray(np.rint(PER_UNIT * share[shown]))
