"""Hours of a façade's evaluation: illuminance, direct sun and states of the shades."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from drcmitsuba.case.groups import GroupStates
from drcmitsuba.report.document.facade import EvaluatedFacade
from drcmitsuba.report.document.packing import levels, packed
from drcmitsuba.runtime.errors import InputError, on_a_line

MOST_VALUES = 4_000_000
"""Largest number of hourly illuminances; of more, only every other day is shown."""
MOST_GROUPS = 40
"""Largest number of groups of panes whose states are shown."""
MINUTE = np.timedelta64(1, "m")


@dataclass(frozen=True, eq=False)
class Hours:
    """Illuminance of the points in all hours, or in those of every nth day."""

    facade: EvaluatedFacade
    points: np.ndarray
    """Sensors, indices, shape (point,)."""

    @cached_property
    def _clock(self) -> np.ndarray:
        """Clock time of every time stamp."""
        E = self.facade.illuminance
        return np.asarray(E["clock" if "clock" in E.coords else "time"].values, "datetime64[m]")

    def kept(self, days: int) -> np.ndarray:
        """Time stamps of every nth day, indices; sparse enough for their number to be bounded."""
        day = self._clock.astype("datetime64[D]")
        _, number = np.unique(day, return_inverse=True)
        stamps = np.flatnonzero(number % days == 0)
        each = -(-len(stamps) * len(self.points) // MOST_VALUES)
        return stamps[:: max(each, 1)]

    def light(self, stamps: np.ndarray) -> np.ndarray:
        """Illuminance at some time stamps (time, point) [lx]."""
        return np.asarray(self.facade.illuminance["total"].values[np.ix_(stamps, self.points)])

    def to_dict(self, most: int) -> dict[str, Any] | None:
        """Hours for the script, in about `most` characters; None where they cannot fit."""
        first = -(-self.facade.illuminance.sizes["time"] * len(self.points) // MOST_VALUES)
        for k in range(6):
            days = first * 2**k
            if (shown := self._at(self.kept(days), most)) is not None:
                return {**shown, "days": days}
        return None

    def _at(self, stamps: np.ndarray, most: int) -> dict[str, Any] | None:
        threshold = self.facade.case.metrics.ase_threshold
        direct = self.facade.illuminance["direct_sun"].values[np.ix_(stamps, self.points)]
        sun = np.packbits(direct >= threshold, axis=1, bitorder="little")
        rest: dict[str, Any] = {
            "sun": packed(sun),
            "minutes": packed(((self._clock[stamps] - self._first) / MINUTE).astype(int)),
            "first": str(self._first),
            "groups": self._groups(stamps),
        }
        left = most - sum(len(rest[name]["text"]) for name in ("sun", "minutes"))
        light = self.light(stamps)
        scaled = levels(light, left)
        if scaled is None:
            return None
        mean = np.rint(np.minimum(light.mean(axis=1, dtype=float), 1e8) * 10)
        enough = np.count_nonzero(light >= self.facade.case.metrics.sda_threshold, axis=1)
        in_sun = np.count_nonzero(direct >= threshold, axis=1)
        return {
            **rest, "light": scaled.light, "step": scaled.step,
            "mean": packed(mean), "enough": packed(enough), "in_sun": packed(in_sun),
        }  # fmt: skip

    @property
    def _first(self) -> np.datetime64:
        return np.datetime64(self._clock.min().astype("datetime64[D]"), "m")

    def _groups(self, stamps: np.ndarray) -> list[dict[str, Any]]:
        """Names of the groups of panes, of their states, and the state of each at every stamp."""
        E = self.facade.illuminance
        if not E.attrs.get("has_shade", 0):
            return []
        groups = GroupStates.of_attributes(E.attrs)
        state = self._states(groups)
        if state is None:
            return []
        out = []
        for k, (name, states) in enumerate(zip(groups.names, groups.states, strict=True)):
            if k >= MOST_GROUPS or len(states) == 1:
                continue
            last = len(states) - 1
            of_group = np.clip(np.nan_to_num(state[stamps, k]), 0, last)
            names = [on_a_line(each) for each in states]
            out.append({"name": on_a_line(str(name)), "states": names, "state": packed(of_group)})
        return out

    def _states(self, groups: GroupStates) -> np.ndarray | None:
        """Number of the state of every group (time, group); None where E does not tell."""
        E = self.facade.illuminance
        name = "facade_state" if "facade_state" in E.coords else "shade_closed"
        if name not in E.coords:
            return None
        fits = E[name].dims[:1] == ("time",) and E[name].dtype.kind in "biuf"
        states = np.asarray(E[name].values).reshape(E.sizes["time"], -1) if fits else None
        if states is None or states.shape[1] != len(groups):
            got = f"{name} does not tell the states of {len(groups)} groups"
            raise InputError("illuminance", name, got, "evaluate the case again")
        return states.astype(float)
