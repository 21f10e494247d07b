"""A year whose façade takes many states: how many, and the work of a sum over groups of panes.

E is then a sum over every group in each of its states (`transport.elements`), where fewer states
would be simulated one by one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from drcmitsuba.case.schedule import schedule_of
from drcmitsuba.metrics.facade_states import most_states
from drcmitsuba.plan import Plan
from drcmitsuba.plan.forecast.pilot import Amount, Pilot
from drcmitsuba.scene.geometry import normals
from drcmitsuba.scene.panes_in_state import grouped_panes
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.transport.gather.paths import USUAL

SPARSE = 4.0
"""Time of an entry of a sparse matrix over that of an entry of a full one."""
MOST_LIT = 10
"""Number of groups in the sun at once of which all combinations are counted."""


def states_of_year(plan: Plan) -> int:
    """Number of states that the façade takes in the time stamps of a plan, roughly.

    Of the groups that the sun shines on at once, any may close by the rule, each with or without
    the others; every combination of scheduled states may occur with all of these.
    """
    case = plan.simulated
    groups = prepared(case).groups.states
    schedule = schedule_of(case.groups, groups)
    time = plan.facts.light.sky["time"]
    scheduled = len(np.unique(schedule.indices(time), axis=0))
    by_rule = np.array(groups.closable) & ~schedule.given
    sets: set[tuple[int, ...]] = {()}
    lit = np.unique(_lit(plan) & by_rule, axis=0)
    for row in lit[np.argsort(-lit.sum(axis=1))]:
        members = np.flatnonzero(row).tolist()
        if len(members) > MOST_LIT:
            return min(time.size, scheduled << len(members))
        sets |= {s for n in range(len(members) + 1) for s in combinations(members, n)}
    return min(time.size, scheduled * len(sets))


def is_summed(plan: Plan) -> bool:
    """Whether E of a year is a sum over groups of panes, as far as `states_of_year` tells."""
    groups = prepared(plan.simulated).groups.states
    return plan.scope.shade and len(groups) > 1 and states_of_year(plan) > most_states(groups)


@dataclass(frozen=True)
class GroupSum:
    """Sum over groups of panes in all their states."""

    panes_open: Pilot
    """Pilot with every group in its first state."""
    panes_shut: Pilot
    """Pilot with every group in its last state, for all suns."""
    share_of_suns: np.ndarray
    """Share of the suns that shine on each group, shape (group,)."""
    states: np.ndarray
    """Number of states of each group, int, shape (group,)."""
    stamps: int
    """Number of time stamps."""

    @classmethod
    def of(cls, plan: Plan, panes_open: Pilot, panes_shut: Pilot) -> GroupSum:
        """Sum of a plan, from the pilots of its first and of its last state."""
        states = np.array([len(s) for s in prepared(plan.simulated).groups.states.states])
        lit = _lit(plan)
        share = lit.mean(axis=0) if len(lit) else np.zeros(len(states))
        return cls(panes_open, panes_shut, share, states, plan.facts.hours)

    @property
    def columns(self) -> float:
        """Number of bins of the sky of all elements, and of time stamps, for which paths gather."""
        return self.panes_open.bins[0] * (1 + int(self.states.sum())) + self.stamps

    @property
    def bins(self) -> float:
        """Number of bins of all elements, and of the light that passes no group, together.

        A sun is traced for those groups on which it shines, in the state that its hours take.
        """
        patches, suns = self.panes_open.bins
        elements = 1 + int(self.states.sum())
        return patches * elements + suns * (1 + float(self.share_of_suns.sum()))

    @property
    def numbers(self) -> float:
        """Number of values on sensors and cells that are in memory beside E of all replicates.

        They are the light of a year on the cells, and D of an element.
        """
        pilot = self.panes_open
        return (len(pilot.points) + pilot.cells) * (self.stamps + 2 * sum(pilot.bins))

    @property
    def vertices(self) -> float:
        """Number of vertices of a sensor's paths, as large as that of cells in small rooms."""
        return min(self.panes_open.cells, SPARSE * USUAL * self.panes_open.accuracy.paths)

    def amounts(self) -> Iterator[Amount]:
        """Work of one colour channel, beside that of the open façade.

        The paths are traced once more. Each element needs the straight light of the open façade;
        those of further states also the light that their part of the panes scatters.
        """
        pilot, further = self.panes_open, int((self.states - 1).sum())
        elements = 1 + int(self.states.sum())
        suns = 1 + float(self.share_of_suns.sum())
        for name, unit, amount in pilot.rays():
            if unit == "path":
                yield name, unit, amount
            else:
                yield name, unit, amount * (suns if name == "suns" else elements)
        for name, unit, amount in self.panes_shut.rays():
            if unit not in ("path", "shadow"):
                yield name, unit, amount * further / len(self.states)
        replicates = pilot.accuracy.replicates
        sensors, stamps = len(pilot.points), self.stamps
        yield "interreflection", "product", replicates * sensors * self.columns * self.vertices
        yield "interreflection", "deposit", replicates * pilot.cells * self.bins
        yield "rest", "entry", replicates * sensors * self.bins
        yield "rest", "launch", replicates * pilot.blocks
        yield "films", "film_sun", self.panes_shut.film_values * further / len(self.states)
        yield "rest", "illuminance", replicates * stamps * sensors * len(self.states)


def _lit(plan: Plan) -> np.ndarray:
    """Whether the whole of each sun of a plan stands before each group, bool, (sun, group)."""
    case, light = plan.simulated, plan.facts.light
    shining = light.sky["sun"].values > 0
    suns = light.sun["direction"].transpose("time", "axis").values[shining]
    radius = np.sin(np.radians(case.outside.sun_diameter / 2))
    lit = np.zeros((len(suns), len(prepared(case).groups)), bool)
    for panes in grouped_panes(case, plan.scope):
        outward = -np.unique(np.round(normals(panes.quads), 3), axis=0)
        lit[:, panes.group] |= (suns @ outward.T > radius).any(axis=1)
    return lit
