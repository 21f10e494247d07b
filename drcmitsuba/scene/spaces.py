"""Spaces of a case: the rooms of its building by name, and the one in which each sensor lies."""

from __future__ import annotations

import numpy as np
import shapely

from drcmitsuba.case.case import Case
from drcmitsuba.case.sensors import FloorSensors
from drcmitsuba.case.spaces import with_tables
from drcmitsuba.case.uses import with_uses
from drcmitsuba.model.space import Space, SpaceFloor
from drcmitsuba.scene.floors_of_model import rooms_of


def spaces_of(case: Case) -> tuple[Space, ...]:
    """Spaces of a case, in the frame of its file.

    They are those of the model and of `[spaces.NAME]`. Where there are none, a box is one space,
    and the rooms above whose floors `[sensors]` asks for grids are one each.
    """
    if case.room is not None:
        return box_and_note(case)[0]
    if case.building.spaces or not isinstance(case.sensors, FloorSensors):
        return case.building.spaces
    rooms = rooms_of(case.building, case.sensors.floors, case.sensors.height, case.source)
    return tuple(Space(r.name, (SpaceFloor(r.height, r.outline),)) for r in rooms)


def box_and_note(case: Case) -> tuple[tuple[Space, ...], str]:
    """Box of a case as its one space, and a note on its use where the case states any.

    Raises
    ------
    InputError
        A use in `[uses]` is not that of the box.
    """
    assert case.room is not None
    x, y, z = case.room.size
    floor = SpaceFloor(0.0, shapely.box(0, 0, x, y))
    box = Space(case.name, (floor,), z, volume=x * y * z)
    if not case.spaces and not case.uses:
        return (box,), ""
    hours = case.period.hours if case.period.timestamps is None else (0, 24)
    return with_uses(with_tables((box,), case.spaces, case.source), case.uses, case.source, hours)


def names_by_space(grids: np.ndarray, spaces: np.ndarray) -> np.ndarray:
    """Names of the sensors' grids, cut at the borders of spaces.

    Parameters
    ----------
    grids, spaces : np.ndarray of str, shape (sensor,)
        Grid and space of every sensor; "" where it has none.

    Returns
    -------
    np.ndarray of str, shape (sensor,)
        A grid in one space keeps its name. Parts of a grid in several have that of their space, and
        in brackets behind it that of the grid, where it has one.
    """
    out = grids.copy()
    for grid in np.unique(grids):
        here = grids == grid
        if len(np.unique(spaces[here])) > 1:
            out[here] = [f"{space} ({grid})" if grid else space for space in spaces[here]]
    return out
