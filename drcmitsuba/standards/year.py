"""E at the hours that a standard counts, and its draws."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import xarray as xr

from drcmitsuba.case.groups import VARYING
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.facade_states import FacadeStates
from drcmitsuba.metrics.grids import sensors_by_grid
from drcmitsuba.metrics.intervals.autonomy import State, draw_autonomy, multipliers
from drcmitsuba.metrics.intervals.bootstrap_counts import BootstrapCounts, Needed
from drcmitsuba.metrics.intervals.facade_draws import Closures
from drcmitsuba.metrics.intervals.rules import DRAWS
from drcmitsuba.metrics.intervals.year_draws import YearDraws, open_state
from drcmitsuba.metrics.sensor_areas import ALIKE, area_shares, spacings
from drcmitsuba.metrics.spaces import sensors_by_space
from drcmitsuba.schema import luminance
from drcmitsuba.standards.evidence import Evidence

OF_LIGHT = {"total": "total", "open": "total_open", "direct_sun": "direct_sun"}
"""Variable of E of each light."""


@dataclass(frozen=True)
class StandardYear:
    """E at the hours of a standard."""

    evidence: Evidence
    at: np.ndarray
    """Time stamps that count, indices."""
    _lasting: dict[tuple[str, int], np.ndarray] = field(default_factory=dict, repr=False)

    @cached_property
    def illuminance(self) -> xr.Dataset:
        """E at these hours, by luminance [lx]."""
        E = self.evidence.illuminance
        E = E if len(self.at) == E.sizes["time"] else E.isel(time=self.at)
        used = [n + suffix for n in OF_LIGHT.values() for suffix in ("", "_se")]
        by_luminance = {name: luminance(E[name]) for name in used}
        groups = {"sun_group": E["sun_group"]} if "sun_group" in E else {}
        return xr.Dataset({**by_luminance, **groups}, attrs=E.attrs)

    @property
    def step_hours(self) -> float:
        """Length of the interval of a time stamp [h]."""
        return float(self.illuminance.attrs.get("step_hours", 1.0))

    @cached_property
    def spaces(self) -> dict[str, np.ndarray]:
        """Sensors of every space, or of every grid where no spaces are told; "" without both."""
        every = np.arange(self.illuminance.sizes["sensor"])
        grids = sensors_by_grid(self.illuminance) or {"": every}
        told = sensors_by_space(self.illuminance) if len(grids) > 1 else ()
        return {space.name: space.sensors for space in told} or grids

    @cached_property
    def space(self) -> np.ndarray:
        """Index of every sensor's space, −1 where it lies in none, shape (sensor,)."""
        out = np.full(self.illuminance.sizes["sensor"], -1)
        for i, sensors in enumerate(self.spaces.values()):
            out[sensors] = i
        return out

    @cached_property
    def area(self) -> np.ndarray:
        """Floor area that every sensor stands for, shape (sensor,), in any unit.

        A space's floor is shared by its sensors as `area_shares` says; the floor is that which the
        evaluation tells, else the squares of the spacings of its grids. All are 1 where they hardly
        differ; sensors in no space stand for none.
        """
        E, sets = self.illuminance, list(self.spaces.values())
        floors = np.array([space.floor_area for space in sensors_by_space(E)])
        if len(floors) != len(sets) or not (floors > 0).all():
            apart = np.array([*spacings(E).values()]) if len(sets) > 1 else np.ones(1)
            sizes = np.array([len(sensors) for sensors in sets])
            floors = sizes * (apart**2 if np.isfinite(apart).all() else 1.0)
        out = np.zeros(E.sizes["sensor"])
        shares = area_shares(E, sets)
        for floor, sensors, own in zip(floors, sets, shares, strict=True):
            out[sensors] = floor * own
        told = out[self.space >= 0]
        return out if told.max() > ALIKE**2 * told.min() else (self.space >= 0).astype(float)

    @cached_property
    def space_areas(self) -> np.ndarray:
        """Floor area of every space in the unit of `area`, shape (space,)."""
        return self._by_space(self.area)

    def share(self, passed: np.ndarray) -> tuple[float, np.ndarray]:
        """Share of the floor whose sensors passed (sensor,): of all, and of each space [%]."""
        held = self._by_space(self.area * passed)
        by_space = 100.0 * held / self.space_areas
        return 100.0 * float(held.sum()) / float(self.space_areas.sum()), by_space

    def _by_space(self, areas: np.ndarray) -> np.ndarray:
        """Sums of areas (sensor,), 0 in no space, by space."""
        return np.bincount(np.maximum(self.space, 0), areas, len(self.spaces))

    def mean(self, values: np.ndarray, space: int) -> np.ndarray:
        """Mean over a space's floor of values (time, sensor), shape (time,)."""
        here = self.space == space
        own = values[:, here]
        if np.ptp(self.area[here]) == 0:
            return np.asarray(own.mean(axis=1, dtype=float))
        return np.asarray(np.average(own, axis=1, weights=self.area[here]))

    @property
    def has_shade(self) -> bool:
        """Whether a shade may close."""
        return bool(self.illuminance.attrs.get("has_shade", 1))

    @cached_property
    def varies(self) -> bool:
        """Whether the façade takes more states than C holds, so that E alone knows them."""
        C = self.evidence.coefficients
        if C is None or VARYING in C.others or not self.has_shade:
            return False
        return VARYING in FacadeStates.of(C.attrs, self.illuminance).states

    @cached_property
    def replicates(self) -> tuple[Coefficients, xr.Dataset] | None:
        """C, and the sky of these hours; None where there are none."""
        C, sky = self.evidence.coefficients, self.evidence.sky
        if C is None or sky is None:
            return None
        return C, sky if len(self.at) == sky.sizes["time"] else sky.isel(time=self.at)

    def lasting(self, light: str, stamps: int) -> np.ndarray:
        """Illuminance that each point has in so many time stamps, shape (sensor,) [lx]."""
        key = light, stamps
        if key not in self._lasting:
            E = np.ascontiguousarray(self.illuminance[OF_LIGHT[light]].values.T)
            self._lasting[key] = np.partition(E, E.shape[1] - stamps, axis=1)[:, -stamps]
        return self._lasting[key]

    @cached_property
    def parts(self) -> tuple[np.ndarray, np.ndarray]:
        """Sensors of a space that stand for the same area: the part of each sensor, (sensor,), and
        the space of each part, (part,), indices.
        """
        pairs = np.stack([self.space, self.area])
        of_part, part = np.unique(pairs, axis=1, return_inverse=True)
        return np.asarray(part).ravel(), of_part[0].astype(np.int64)

    def drawn_shares(self, tally: BootstrapCounts) -> tuple[np.ndarray, np.ndarray]:
        """Share of the floor whose sensors pass in every draw [%]: (draw,), and (space, draw)."""
        part, space = self.parts
        area = np.bincount(part, self.area)
        held = np.zeros((len(self.spaces), DRAWS))
        np.add.at(held, space, area[:, None] * [tally.shares(i)[0] for i in range(len(area))])
        whole = self.space_areas
        return held.sum(axis=0) / whole.sum(), held / whole[:, None]

    def can_draw(self, light: str) -> bool:
        """Whether there are replicates of a light."""
        return self.replicates is not None and (light == "open" or not self.varies)

    def tally(self, light: str, threshold: float, required: int) -> BootstrapCounts:
        """Count, in every draw, the sensors that reach a threshold at `required` time stamps.

        They are counted by `parts`. The threshold of `direct_sun` is that of LM-83.
        """
        needed = Needed.of_period(len(self.at), required, self.parts[0])
        if light == "direct_sun":
            return self._in_use.exposure(threshold, needed)
        if light == "total":
            return self._in_use.autonomy(threshold, needed)
        C, _ = self.replicates or _none()
        states, shut = [self.open_state], Closures.never(len(self.at))
        drawn = multipliers(C.open.sizes["replicate"], self.evidence.drawing["seed"])
        return draw_autonomy(states, shut, threshold, needed, drawn)

    @cached_property
    def _in_use(self) -> YearDraws:
        """Draws with the shade in use."""
        C, sky = self.replicates or _none()
        E, seed = dict(self.illuminance.data_vars), self.evidence.drawing["seed"]
        sun, shut = self.evidence.sun.at(self.at), self.evidence.closures.at(self.at)
        return YearDraws.of(C, sky, E, sun, shut, seed)

    @cached_property
    def open_state(self) -> State:
        """E with the shade open, whose replicates can be drawn."""
        C, sky = self.replicates or _none()
        return open_state(C, sky, dict(self.illuminance.data_vars))


def _none() -> tuple[Coefficients, xr.Dataset]:
    raise AssertionError("no replicates")
