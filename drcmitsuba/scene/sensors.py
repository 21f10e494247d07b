"""Points of a case at which illuminance is computed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import mitsuba as mi
import numpy as np
import xarray as xr

from drcmitsuba.case.case import Case
from drcmitsuba.case.sensors import (
    MOST_GRIDS,
    MOST_SENSORS,
    AnySensors,
    FloorSensors,
    PointSensors,
    Sensors,
    SpaceSensors,
    file_of_points,
)
from drcmitsuba.model.model import Model, ModelShape, SensorGrid
from drcmitsuba.model.notes import MOST_NAMES, Notes
from drcmitsuba.model.space import Space, space_at
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import choose, fits, shortened, unmet
from drcmitsuba.scene.components import inside
from drcmitsuba.scene.geometry import boxes, origin, recentred, rotation
from drcmitsuba.scene.sensors_of_model import (
    NAME_SPACES,
    NEAR,
    above_floors,
    in_spaces,
    listed,
    on_a_surface,
    outside_rooms,
)
from drcmitsuba.scene.spaces import names_by_space, spaces_of

FACES_UP = 1 - 1e-6
"""Least vertical part of the normal of a sensor that faces up [–]."""
MARGIN = 1e-3 - 1e-9
"""Least distance of points from a solid [m]: 1 mm with the rounding of decimals."""
MOSTLY = 0.9
"""Share of a space's sensors outside of rooms from which on the space is outside [–]."""
LIFT = NEAR + 1e-5
"""Height to which points on a surface are lifted [m]: 1 mm with the rounding of rays."""


@dataclass(frozen=True, eq=False)
class PlacedSensors:
    """Sensors where illuminance is computed, with notes on those moved or left out."""

    grids: tuple[SensorGrid, ...]
    notes: tuple[str, ...] = ()
    outside: bool = False
    """Whether they stand before a façade or under the sky, not in rooms."""

    @property
    def points(self) -> np.ndarray:
        """Positions of all sensors [m], shape (sensor, 3)."""
        return np.concatenate([grid.points for grid in self.grids])

    @property
    def normals(self) -> np.ndarray:
        """Unit normals of all sensors, shape (sensor, 3)."""
        return np.concatenate([grid.normals for grid in self.grids])

    def _by_grid(self, values: np.ndarray) -> Iterator[tuple[SensorGrid, np.ndarray]]:
        """Yield grids with their part of values (sensor, …)."""
        ends = np.cumsum([len(grid.points) for grid in self.grids])[:-1]
        return zip(self.grids, np.split(values, ends), strict=True)

    def moved(self, points: np.ndarray, note: str) -> PlacedSensors:
        """Sensors at other positions (sensor, 3) [m]."""
        grids = tuple(replace(grid, points=own) for grid, own in self._by_grid(points))
        return PlacedSensors(grids, (*self.notes, note))

    def only(self, kept: np.ndarray) -> PlacedSensors:
        """Keep some sensors, bool (sensor,)."""
        grids = (
            replace(grid, points=grid.points[own], normals=grid.normals[own])
            for grid, own in self._by_grid(kept)
        )
        return replace(self, grids=tuple(grid for grid in grids if len(grid.points)))

    def without(self, bad: np.ndarray, where: str) -> PlacedSensors:
        """Leave out sensors that are bad, bool (sensor,), with a note on each of their grids."""
        notes = list(self.notes)
        for grid, out in self._by_grid(bad):
            if out.any():
                of = f" of grid {grid.name[:80]!r}" if grid.name else ""
                verb = "lies" if out.sum() == 1 else "lie"
                place = _place(grid.points[int(np.argmax(out))])
                first = f"at {place}" if out.sum() == 1 else f"the first at {place}"
                notes.append(
                    f"sensors: {int(out.sum())} of {len(out)} points{of} {verb} {where}, {first}: "
                    "left out"
                )
        return replace(self.only(~bad), notes=tuple(notes))


def sensor_points(
    case: Case, sensors: PlacedSensors | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Positions [m] and normals of the sensors in the world frame, shape (sensor, 3) each.

    Positions are relative to the case's `geometry.origin`; `sensors` are from `placed_sensors`,
    where they are known.

    Raises
    ------
    InputError
        A sensor lies outside the room; one that the user listed lies inside furniture or within
        1 mm of a surface; or none is left.
    """
    return _in_world(case, placed_sensors(case) if sensors is None else sensors)


def _in_world(case: Case, sensors: PlacedSensors) -> tuple[np.ndarray, np.ndarray]:
    """Positions and normals as of `sensor_points`."""
    turn = rotation(case).T
    return (sensors.points - origin(case)) @ turn, sensors.normals @ turn


def sensor_coordinates(case: Case, sensors: PlacedSensors | None = None) -> xr.Dataset:
    """Coordinates of the sensors, dim (sensor,): where they are and which grid they are of.

    Parameters
    ----------
    sensors : PlacedSensors, optional
        From `placed_sensors`, where they are known.

    Returns
    -------
    xr.Dataset
        `x`, `y`, `z` in the world frame [m]; the normals `nx`, `ny`, `nz` where one does not face
        up; `space` and `grid`, the names of each sensor's space and grid, where there are several.

    Raises
    ------
    InputError
        As `sensor_points`.
    """
    sensors, spaces = placed_sensors(case) if sensors is None else sensors, spaces_of(case)
    points, normals = _in_world(case, sensors)
    at = dict(zip("xyz", (points + origin(case)).T, strict=True))
    if (normals[:, 2] < FACES_UP).any():
        at |= dict(zip(("nx", "ny", "nz"), normals.T, strict=True))
    grids = sensors.grids
    names = np.repeat(np.array([g.name for g in grids], object), [len(g.points) for g in grids])
    if len(spaces) > 1:
        index = space_at(spaces, sensors.points)
        at["space"] = np.array([*(space.name for space in spaces), ""], object)[index]
        names = names_by_space(names, at["space"])
    if len(set(names)) > 1:
        at["grid"] = names
    return xr.Dataset(coords={name: ("sensor", values) for name, values in at.items()})


def placed_sensors(case: Case) -> PlacedSensors:
    """Sensors of a case in the frame of its file [m], of the spaces that it evaluates.

    Points of a grid by rule in or on a solid are left out with a note; points that the user
    listed are refused there. Errors are those of `sensor_points`; no space with sensors has a name
    of `output.spaces`.
    """
    placed, patterns = _in_all_spaces(case), case.output.spaces
    if not patterns:
        return placed
    spaces = spaces_of(case)
    at = space_at(spaces, placed.points)
    names = [spaces[k].name for k in np.unique(at[at >= 0])]
    for pattern in unmet(patterns, names):
        got = f"no space with sensors is called {shortened(pattern)}"
        remedy = choose(pattern, names) if names else NAME_SPACES
        raise InputError(case.source, "output.spaces", got, remedy)
    wanted = [fits(space.name, patterns) for space in spaces]
    return placed.only(np.array([*wanted, False])[at])


def _in_all_spaces(case: Case) -> PlacedSensors:
    """Sensors of all spaces, as `placed_sensors`."""
    is_open = case.model is not None and case.model.leaks == "allow"
    if case.building.layers:
        made = sensors_of_model(
            case.building, case.sensors, case.source, mi.variant(), outside=is_open
        )
    else:
        made = PlacedSensors(_placed(case.building, case.sensors, case.source))
    if not (made.outside or is_open):
        made = _in_spaces(made, case.building.spaces)
    if isinstance(case.sensors, PointSensors):
        refuse_in_solids(case, made.points - origin(case), origin(case))
        return made
    start = origin(case)
    _refuse(*_beyond_walls(case, made.points - start), made.points, case.source)
    held, words = np.zeros(len(made.points), bool), dict[str, None]()
    for bad, where in _in_solids(case, made.points - start):
        held |= bad
        words |= {where: None} if bad.any() else {}
    where = ", ".join(list(words)[:MOST_NAMES])
    if held.all():
        _refuse(held, where, made.points, case.source)
    return made.without(held, where) if held.any() else made


def sensors_of_model(
    model: Model, sensors: AnySensors, source: str, variant: str, outside: bool
) -> PlacedSensors:
    """Sensors of a model, in its own frame [m].

    They are made once for models of one shape and a variant of Mitsuba. Listed points on a surface
    are lifted by 1 mm along their normals, and those of a grid by rule left out there; points
    outside of the rooms are left out unless they shall count (`outside`), or no other ones are
    there. Each has a note.

    Raises
    ------
    InputError
        The sensors are unfit, or one of them stays within 1 mm of a surface; the error names the
        `source`.
    """
    written = file_of_points(sensors)
    return _sensors_of(model.shape, sensors, source, variant, outside, written)


@lru_cache(maxsize=4)
def _sensors_of(
    shape: ModelShape, sensors: AnySensors, source: str, variant: str, outside: bool,
    written: tuple[int, ...],
) -> PlacedSensors:  # fmt: skip
    """Sensors of all models of a shape, see `sensors_of_model`."""
    model = shape.model
    made = PlacedSensors(_placed(model, sensors, source))
    points = made.points
    on = on_a_surface(model, points)
    if isinstance(sensors, PointSensors) and on.any():
        lifted = np.where(on[:, None], points + LIFT * made.normals, points)
        still = on.copy()
        still[on] = on_a_surface(model, lifted[on])
        _refuse(still, "on a surface of the model", points, source)
        many = f"{int(on.sum())} of {len(on)} points lie on a surface"
        first = _place(points[int(np.argmax(on))])
        note = f"sensors: {many}, the first at {first}: lifted by 1 mm along their normals"
        made = made.moved(lifted, note)
    elif on.any():
        if on.all():
            _refuse(on, "on a surface of the model", points, source)
        made = made.without(on, "on a surface of the model")
    if outside:
        return made
    out = outside_rooms(model, made.points)
    if out.any() and model.spaces:
        out |= _under_sky(out, space_at(model.spaces, made.points))
    if out.all():
        first = _place(made.points[0])
        note = f"sensors: all {len(out)} points, the first at {first}, lie outside of rooms: the "
        note += "light that they get there is counted"
        return replace(made, notes=(*made.notes, note), outside=True)
    return made.without(out, "outside of the rooms") if out.any() else made


def _under_sky(out: np.ndarray, space: np.ndarray) -> np.ndarray:
    """Whether sensors lie in a space that is hardly a room, such as a roof, bool (sensor,).

    `out` (sensor,) are those outside of rooms, `space` (sensor,) the index of each one's space.
    """
    places, index = np.unique(space, return_inverse=True)
    share = np.bincount(index, out) / np.bincount(index)
    return np.asarray(((share > MOSTLY) & (places >= 0))[index])


def _in_spaces(made: PlacedSensors, spaces: tuple[Space, ...]) -> PlacedSensors:
    """Leave out sensors that lie in no space, where a model has spaces and any sensor lies in one.

    A space of the model without a sensor gets a note.
    """
    if not spaces:
        return made
    at = space_at(spaces, made.points)
    if (at < 0).all():
        return made
    made = made.without(at < 0, "in no space") if (at < 0).any() else made
    notes = Notes()
    for k in np.setdiff1d(np.arange(len(spaces)), at).tolist():
        notes.add("sensors: there are none in the spaces", spaces[k].name)
    return replace(made, notes=(*made.notes, *notes.sentences()))


def _placed(model: Model, sensors: AnySensors, source: str) -> tuple[SensorGrid, ...]:
    """Grids of the sensors, at most `MOST_GRIDS` with `MOST_SENSORS` points."""
    if isinstance(sensors, Sensors):
        return (_box_grid(sensors),)
    if isinstance(sensors, FloorSensors):
        grids = above_floors(model, sensors, source)
    elif isinstance(sensors, SpaceSensors):
        grids = in_spaces(model, sensors, source)
    else:
        grids = listed(model, sensors, source)
    count = sum(len(grid.points) for grid in grids)
    for got, most in ((f"{count} points", MOST_SENSORS), (f"{len(grids)} grids", MOST_GRIDS)):
        if int(got.split()[0]) > most:
            raise InputError(source, "sensors", got, f"at most {most}")
    return grids


def _box_grid(grid: Sensors) -> SensorGrid:
    """Rectangular grid of points that face up [m]."""
    x = grid.corner[0] + (np.arange(grid.count[0]) + 0.5) * grid.spacing
    y = grid.corner[1] + (np.arange(grid.count[1]) + 0.5) * grid.spacing
    points = np.stack([np.tile(x, len(y)), np.repeat(y, len(x))], axis=-1)
    points = np.column_stack([points, np.full(len(points), grid.corner[2])])
    return SensorGrid("", points, np.tile([0.0, 0.0, 1.0], (len(points), 1)))


def any_outside(case: Case, points: np.ndarray) -> bool:
    """Whether any of some points (point, 3) [m] lies outside of the rooms of a model.

    They are in the frame of the case's file. Points beyond the walls of a room of boxes are refused
    elsewhere.
    """
    if case.room is not None or not case.building.layers:
        return False
    return bool(outside_rooms(case.building, points).any())


def refuse_in_solids(
    case: Case, points: np.ndarray, start: np.ndarray, views: Sequence[str] = ()
) -> None:
    """Refuse points in or on a surface of a room, a piece of furniture or a closed mesh.

    `start` (3,) is the origin of the points in the user's coordinates [m]. Points of `views`, by
    their names, are also refused on a surface of the model, which grids have been.
    """
    at = points + start
    if views and case.building.layers:
        where = "on a surface of the model"
        _refuse(on_a_surface(case.building, at), where, at, case.source, views)
    for bad, where in (_beyond_walls(case, points), *_in_solids(case, points)):
        _refuse(bad, where, at, case.source, views)


def _beyond_walls(case: Case, points: np.ndarray) -> tuple[np.ndarray, str]:
    """Whether points (sensor, 3) [m] lie beyond the walls of a room, bool, in words."""
    where = "in, on or beyond a wall of the room"
    if case.room is None:
        return np.zeros(len(points), bool), where
    beyond = (points <= MARGIN) | (points >= np.array(case.room.size) - MARGIN)
    return np.asarray(beyond.any(axis=1)), where


def _in_solids(case: Case, points: np.ndarray) -> Iterator[tuple[np.ndarray, str]]:
    """Whether points (sensor, 3) [m] lie in each solid, bool (sensor,), and which, in words."""
    centred = recentred(case)
    for piece in centred.furniture:
        for corner, size in boxes(piece):
            near = (points > corner - MARGIN) & (points < corner + size + MARGIN)
            yield near.all(axis=1), f"in or on {piece.name!r}"
    for name, within in inside(centred, points):
        yield within, f"in component {name!r}"


def _refuse(
    bad: np.ndarray, where: str, points: np.ndarray, source: str, views: Sequence[str] = ()
) -> None:
    """Raise InputError with the first of the points (sensor, 3) [m] that are bad."""
    if bad.any():
        i = int(np.argmax(bad))
        more = f" ({int(bad.sum())} in all)" if bad.sum() > 1 else ""
        field, name = ("views", f"view {views[i]!r}") if views else ("sensors", f"sensor {i}")
        raise InputError(
            source, field, f"{name} at {_place(points[i])} lies {where}{more}",
            "move it at least 1 mm off every surface",
        )  # fmt: skip


def _place(point: np.ndarray) -> str:
    """Coordinates (3,) [m] in a message."""
    return f"({', '.join(f'{round(v, 4):.10g}' for v in point)})"
