"""Views of a case and of its model: their places, off every surface."""

from __future__ import annotations

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.model.model import View
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.geometry import origin
from drcmitsuba.scene.sensors import refuse_in_solids


def views(case: Case) -> tuple[View, ...]:
    """Views of `[views]`, then those of the model's files.

    Parameters
    ----------
    case : Case
        Case; a variant of Mitsuba is set where it has a model.

    Returns
    -------
    tuple of View
        Views in the coordinates of the case file [m].

    Raises
    ------
    InputError
        A view of `[views]` lies in a wall, furniture or component, on a surface or outside the
        room, or has the name of one of the model.
    """
    own = tuple(table.view(name) for name, table in case.views.items())
    for name in case.views.keys() & {view.name for view in case.building.views}:
        raise InputError(case.source, f"views.{name}", "a view of the model, too", "rename it")
    if own:
        start = origin(case)
        points = np.array([view.position for view in own]) - start
        refuse_in_solids(case, points, start, [view.name for view in own])
    return (*own, *case.building.views)
