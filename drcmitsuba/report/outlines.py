"""Lines of a case in plan: rooms, glazing, furniture and surroundings, world frame [m]."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely

from drcmitsuba.case.case import Case
from drcmitsuba.report.edges import outlines
from drcmitsuba.report.sheets import Sheet
from drcmitsuba.scene.floors_of_model import floor_below, parted
from drcmitsuba.scene.geometry import boxes, origin, rotation
from drcmitsuba.scene.panes_of_model import panes_of_model

MARGIN = 1e-3
"""Heights nearer than this are the same [m]."""

MOST_HULLS = 20_000
"""Largest number of polygons of the context in a plan, the largest first."""


def outlines_in_plan(case: Case, points: np.ndarray, sheet: Sheet) -> dict[str, Any]:
    """Room, glazing, furniture and surroundings around the sensors of a sheet, by kind [m].

    `points` (sensor, 2) are the sensors' x and y [m]. A piece entirely outside the room's walls
    belongs to the surroundings, and so do rooms of a model without sensors. A case without a room
    or a model has no outlines.
    """
    if case.building.layers:
        return _of_model(case, points, sheet)
    if case.room is None:
        return {}
    width, depth, _ = case.room.size
    corners = np.array([[0, 0], [width, 0], [width, depth], [0, depth]], float)
    turn = rotation(case)[:2, :2].T
    at = [("south", "east", "north", "west").index(side) for side in case.glazed]
    glazed = [corners[[i, (i + 1) % 4]] @ turn for i in at]
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    pieces: dict[bool, list[np.ndarray]] = {True: [], False: []}
    for corner, size in (box for piece in case.furniture for box in boxes(piece)):
        low, high = corner[:2], corner[:2] + size[:2]
        is_inside = bool(((low < corners[2]) & (high > 0)).all())
        pieces[is_inside].append((low + unit * size[:2]) @ turn)
    return {
        "room": [corners @ turn], "glazing": glazed,
        "furniture": pieces[True], "surroundings": pieces[False],
    }  # fmt: skip


def _of_model(case: Case, points: np.ndarray, sheet: Sheet) -> dict[str, Any]:
    """Rooms with sensors, outer panes of their storey, other rooms and context in plan [m]."""
    turn, start = rotation(case)[:2, :2].T, origin(case)[:2]

    def turned(line: np.ndarray) -> np.ndarray:
        return np.asarray((line - start) @ turn + start)

    def rings(shape: Any) -> list[np.ndarray]:
        parts = [p for p in shapely.get_parts(shape) if p.geom_type == "Polygon"]
        every = (ring for part in parts for ring in (part.exterior, *part.interiors))
        return [turned(np.array(ring.coords)[:, :2]) for ring in every]

    model = case.building
    floor, height = floor_below(model, sheet.low, sheet.below)
    at = (points - start) @ turn.T + start
    parts = parted(model, floor, sheet.low)
    lit = set(shapely.STRtree(parts).query(shapely.points(at), "intersects")[1])
    rooms = [part for i, part in enumerate(parts) if i in lit]
    others = [part for i, part in enumerate(parts) if i not in lit]
    top = sheet.above  # over the last storey roof lights lie as high as the roof
    if np.isfinite(top):
        top = floor_below(model, top, sheet.high + MARGIN)[1]
    hulls = _hulls([layer.quads for layer in model.layers if layer.role == "context"])
    return {
        "room": [ring for part in rooms for ring in rings(part)],
        "glazing": [turned(edge) for edge in _panes(case, height, top)],
        "surroundings": [ring for shape in (*others, hulls) for ring in rings(shape)],
    }


def _hulls(context: list[np.ndarray]) -> Any:
    """Convex hulls in plan of the largest quads of the context, (quad, 4, 3) [m], as one shape."""
    quads = np.concatenate([np.zeros((0, 4, 3)), *context])[:, :, :2]
    across, down = quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1]
    size = np.abs(across[:, 0] * down[:, 1] - across[:, 1] * down[:, 0])
    largest = quads[np.argsort(-size, kind="stable")[:MOST_HULLS]]
    return shapely.union_all(shapely.convex_hull(shapely.multipoints(largest)))


def _panes(case: Case, low: float, high: float) -> list[np.ndarray]:
    """Outlines (2, 2) of the outer panes in plan that reach between two heights [m].

    A vertical pane is a line; a sloped or level one shows its outline. Level ones come last: a
    section leads away from the first.
    """
    panes = panes_of_model(case.building)
    edges: list[np.ndarray] = []
    level: list[np.ndarray] = []
    for i, layer in enumerate(case.building.layers):
        outside = panes.polygon[(panes.layer == i) & panes.outside]
        quads = panes.quads[i][np.isin(layer.polygon, outside)]
        z = quads[:, :, 2]
        quads = quads[(z.max(axis=1) > low + MARGIN) & (z.min(axis=1) < high - MARGIN)]
        is_level = np.ptp(quads[:, :, 2], axis=1) < MARGIN
        for some, kind in ((quads[~is_level], edges), (quads[is_level], level)):
            if len(some):
                lines = outlines(some)[:, :, :2]
                long = np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1) > MARGIN
                kind += [*np.unique(np.round(lines[long], 4), axis=0)]
    return [*edges, *level]
