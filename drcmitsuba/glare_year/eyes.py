"""Eyes of a year of glare: places, and the directions that are looked at from each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from drcmitsuba.case.case import Case
from drcmitsuba.picture.view import PictureView, of_model
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.geometry import given_points, origin, rotation
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.sensors import refuse_in_solids

COMPASS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")
"""Names of the eight directions round a point, from the north of the case's frame clockwise."""
MOST_VIEWS = 1000
"""Largest number of views."""
KINDS = "vhaes"
"""Letters of views that have a direction at every point: neither parallel nor cylindrical ones."""


@dataclass(frozen=True, eq=False)
class Eyes:
    """Eyes of a case, in the world frame."""

    names: tuple[str, ...]
    """Name of every view."""
    positions: np.ndarray
    """Places of the eyes in the coordinates of the case file [m], shape (view, 3)."""
    points: np.ndarray
    """Places of the eyes in the traced frame [m], shape (view, 3)."""
    frames: np.ndarray
    """Unit vectors to the right, up and forward, shape (view, 3, 3)."""

    def __len__(self) -> int:
        """Count the views."""
        return len(self.names)

    def take(self, views: np.ndarray) -> Eyes:
        """Some of the eyes, by their indices (view,)."""
        names = tuple(self.names[i] for i in views)
        return Eyes(names, self.positions[views], self.points[views], self.frames[views])

    @property
    def forward(self) -> np.ndarray:
        """Unit vectors along the lines of sight, shape (view, 3)."""
        return self.frames[:, 2]

    def by_place(self) -> list[np.ndarray]:
        """Indices of the views at each place: they share what is seen from there."""
        _, place = np.unique(np.round(self.points, 6), axis=0, return_inverse=True)
        return [np.flatnonzero(place.ravel() == i) for i in range(place.max() + 1)]


def eyes(case: Case, points: ArrayLike | None = None) -> Eyes:
    """Eyes of a case: its views, or eight round each of some points.

    Parameters
    ----------
    case : Case
        Case; a variant of Mitsuba is set where it has a model.
    points : array_like, shape (point, 3), optional
        Places of eyes in the coordinates of the case file [m]; from each, eight views look
        horizontally to N, NE, E … of the case's frame. By default the views of the case.

    Returns
    -------
    Eyes

    Raises
    ------
    InputError
        There is no view, or too many; a point lies in or on a solid or outside the room; a view is
        parallel or cylindrical.
    """
    if points is None:
        names, shown = _of_case(case)
    else:
        names, shown = _round(case, points)
    if len(names) > MOST_VIEWS:
        raise InputError(case.source, "views", f"{len(names)} views", f"at most {MOST_VIEWS}")
    turn = rotation(case).T
    positions = np.array([view.position for view in shown], float)
    frames = np.stack([view.frame for view in shown]) @ turn
    return Eyes(names, positions, (positions - origin(case)) @ turn, frames)


def _of_case(case: Case) -> tuple[tuple[str, ...], list[PictureView]]:
    """Views of the case and of its model."""
    every = prepared(case).views
    if not every:
        remedy = "add a table [views.NAME], or name points to look round from: --around x,y,z"
        raise InputError(case.source, "views", "no view", remedy)
    for view in every:
        if view.kind not in KINDS:
            got = f"{view.name!r} is parallel or cylindrical"
            raise InputError(case.source, "views", got, "give the view of an eye, as -vta")
    return tuple(view.name for view in every), [of_model(view) for view in every]


def _round(case: Case, points: ArrayLike) -> tuple[tuple[str, ...], list[PictureView]]:
    """Eight horizontal views round each point."""
    places = given_points(points, case.source)
    if 8 * len(places) > MOST_VIEWS:
        got = f"{len(places)} points of eight views"
        raise InputError(case.source, "points", got, f"at most {MOST_VIEWS // 8}")
    names = [f"point {i}" for i in range(1, len(places) + 1)]
    refuse_in_solids(case, places - origin(case), origin(case), names)
    compass = np.radians(45.0 * np.arange(8))
    directions = np.stack([np.sin(compass), np.cos(compass), np.zeros(8)], axis=1)
    every, shown = list[str](), list[PictureView]()
    for name, place in zip(names, places, strict=True):
        for towards, direction in zip(COMPASS, directions, strict=True):
            every.append(f"{name} {towards}" if len(places) > 1 else towards)
            shown.append(PictureView("equidistant", _vector(direction), position=_vector(place)))
    return tuple(every), shown


def _vector(values: Sequence[float] | np.ndarray) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z
