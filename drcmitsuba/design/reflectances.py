r"""Reflectances of a room's surfaces as design parameters, with gradients.

The façade is fixed, and so is the deposit D, the irradiance of sensors and cells before any diffuse
reflection. Only the light between surfaces depends on the reflectances ρ:

.. math:: E(\rho) = D_s L + G(\rho) \, (D_c L),

with G(ρ) of `room_matrices`, whose rays were traced once, at ρ′. D·L is multiplied out beforehand;
E is then a product of matrices, and Dr.Jit differentiates it exactly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from drcmitsuba.annual.pane_group_of_sun import PaneGroupOfSun
from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN
from drcmitsuba.design.facade_groups import FacadeGroups
from drcmitsuba.design.parameters import Parameter
from drcmitsuba.design.surface_kinds import check_reflectances, reflectances, with_reflectances
from drcmitsuba.design.traced_room import TracedRoom
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Stage, silent
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.schema import positions
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.transport.elements.state_illuminances import Illuminances

BOUNDS = (0.0, 0.95)
"""Least and largest reflectance of a design."""
DARKEST = 0.5
"""Least reflectance ρ′ at which rays are traced: a black surface would send none. Points on cells
are drawn by their importance at ρ′, and blocks of cells are means that it weighs."""


@dataclass(frozen=True)
class Interior:
    """Illuminance of a year as a function of the reflectances in a room.

    Parameters
    ----------
    start : dict of str to float
        Reflectances of the case by kind of surface, see `reflectances`.
    traced : dict of str to float
        Reflectances at which rays were traced.
    months : np.ndarray of int, shape (time,)
        Month of each time stamp, 1 … 12.
    step_hours : float
        Length of a time step [h].
    source : str
        Name of the case in messages.
    states : tuple of TracedRoom
        The room with its shade open and, where something closes, in the other states of `groups`.
    groups : FacadeGroups, optional
        Groups of panes or the one shade, by whose states E is applied: `groups.applied(E)`, and
        with gradients `groups.smooth(E, sharpness)`.

    Notes
    -----
    Frames of façades, panes and shades keep their reflectances. Light between surfaces is always
    solved on cells, to any depth. In the paper's classroom the standard error of a sensor is 0.5 %
    of E in the mean and 1.7 % at most: at the start, with any one surface at 0.95, and with all of
    them at 0.95. All sensors are traced at once.
    """

    start: dict[str, float]
    traced: dict[str, float]
    months: np.ndarray
    step_hours: float
    source: str
    states: tuple[TracedRoom, ...]
    groups: FacadeGroups | None = None

    @classmethod
    def of(cls, case: Case, daylight: Daylight, stage: Stage = silent) -> Interior:
        """Trace a case and its year once.

        An adaptive sun is simulated as the exact sun of each time stamp.

        Raises
        ------
        InputError
            The case is coloured, has no surfaces or too many kinds of them, one name stands for
            two reflectances, or groups of panes take too many states.
        """
        case = case.without_polish()
        case.refuse_overruled("the search for reflectances")
        start = reflectances(case)
        if not start:
            got = "there is no diffuse surface"
            raise InputError(case.source, "room", got, "add a [room]")
        traced = {key: max(value, DARKEST) for key, value in start.items()}
        at = with_reflectances(case, traced)
        groups, of_panes = None, prepared(case).groups.states
        if len(of_panes):
            groups = FacadeGroups.of_case(case, of_panes, daylight.sky["time"])
        states: list[TracedRoom] = []
        for name in (OPEN,) if groups is None else groups.states:
            by = _groups_of_suns(at, daylight) if name == OPEN else ()
            with stage(f"{name} façade") as done:
                states.append(TracedRoom.of(at, name, daylight, traced, done, by))
        months = daylight.sky["clock"].dt.month.values
        return cls(start, traced, months, daylight.step_hours, case.source, tuple(states), groups)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Reflectances as design parameters."""
        low, high = BOUNDS
        return tuple(Parameter(k, low, max(high, v), v) for k, v in self.start.items())

    def _ratios(self, rho: Mapping[str, mi.Float | float]) -> list[mi.Float]:
        check_reflectances(self.source, self.start, rho)
        return [
            mi.Float(rho[key] if key in rho else dr.opaque(mi.Float, self.start[key])) / value
            for key, value in self.traced.items()
        ]

    def illuminance(self, rho: Mapping[str, mi.Float | float]) -> Illuminances:
        """Illuminance at other reflectances, with their gradients.

        Parameters
        ----------
        rho : dict of str to mi.Float
            Reflectances by kind of surface; a missing one keeps the case's value.

        Returns
        -------
        Illuminances
            E (time, sensor) [lx], in all states of `groups`; without a shade, `shaded` is `open`.

        Raises
        ------
        InputError
            A key is unknown, or a value is not in 0 … 1.
        """
        ratios = self._ratios(rho)
        first, *others = (state.illuminance(ratios) for state in self.states)
        closed, *others = others or [first]
        D = self.states[0].deposited
        return Illuminances(first, closed, D.direct, tuple(others), D.by_group)

    def standard_error(self, rho: Mapping[str, mi.Float | float]) -> np.ndarray:
        """Standard error of the mean over time, shade open, (sensor,) [lx].

        Estimated from the replicates, each with its own rays and deposit.
        """
        return self.states[0].standard_error(
            self._ratios({k: dr.detach(v) for k, v in rho.items()})
        )


def _groups_of_suns(case: Case, daylight: Daylight) -> list[np.ndarray]:
    """Masks (sensor, bin) of straight light by each group of panes; none of one group."""
    points, normals = prepared(case).receivers.at()
    by = PaneGroupOfSun.of(case, OPEN, daylight.suns, Run.of(case))
    if by is None:
        return []
    labels = [*map(str, daylight.sky["bin"].values), *daylight.suns.labels]
    group = np.full((len(points), len(labels)), -1)
    group[:, positions([*by.suns.labels], labels)] = by.of_sensors(points, normals)
    return [group == g for g in range(len(prepared(case).groups))]
