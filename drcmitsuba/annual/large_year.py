"""A year of any number of sensors in little memory: metrics without whole arrays C and E.

open state   ─ block by block ─► direct sun ─► sensors in the sun by hour and grid, summed
sums         ─ closures_from ──► state of the façade at every hour, and in every draw
other states ─ block by block ─► their blocks, for the suns of hours that may close
all blocks   ─ C · L ──────────► E of a block ─► sensor_counts and draws, summed
sums         ─ CountedYear ────► metrics with intervals; of each sensor its mean E and hours

C is read from the blocks that the run keeps; no array holds hours × sensors of more than a block.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from drcmitsuba import metrics
from drcmitsuba.annual.attributes import attributes
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.sensor_stream import aligned, sensor_stream
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, SHADED, State
from drcmitsuba.case.sun import Adaptive
from drcmitsuba.metrics import illuminance
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.evaluate_metrics import drawing, rules
from drcmitsuba.metrics.facade_states import FacadeStates
from drcmitsuba.metrics.grids import grid_of_sensors, sensors_by_grid
from drcmitsuba.metrics.intervals import Rules
from drcmitsuba.metrics.intervals.draw import BlockDraws, draw_block
from drcmitsuba.metrics.intervals.facade_draws import (
    Closures,
    SunlitSensors,
    closures_from,
    sunlit_sensors,
)
from drcmitsuba.metrics.intervals.sun import SunDraws, draw_sun
from drcmitsuba.metrics.sensor_counts import CountedYear, sensor_counts
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress, part
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.sensors import sensor_coordinates
from drcmitsuba.schema import luminance
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.luminances import sources
from drcmitsuba.sky.sun_models import Suns


def obstacle(case: Case) -> str:
    """Reason why a case's year is not summed block by block; empty where it can be."""
    if isinstance(case.sun, Adaptive):
        return "an adaptive sun"
    if case.accuracy.target is not None:
        return "a target"
    if len(PaneGroups.of(case)) > 1 or case.groups:
        return "groups of panes"
    return ""


@dataclass(frozen=True)
class LargeYear:
    """Sums of a year over blocks of sensors."""

    case: Case
    daylight: Daylight
    run: Run
    sensors: xr.Dataset
    """Coordinates (sensor,)."""
    attributes: dict[str, Any]
    """Attributes of C."""
    grid: np.ndarray = field(init=False)
    """Number of every sensor's grid, shape (sensor,)."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "grid", grid_of_sensors(self.sensors))

    @classmethod
    def of(cls, case: Case, daylight: Daylight, run: Run) -> LargeYear:
        """Year of a case as it is simulated.

        Raises
        ------
        InputError
            The case has an adaptive sun, a target or groups of panes.
        """
        if reason := obstacle(case):
            remedy = 'give illuminance = "all", or leave it out'
            got = f"the metrics alone beside {reason}"
            raise InputError(case.source, "output.illuminance", got, remedy)
        effects = run.enabled_effects
        simulated = case if effects.shade else case.with_tables(shading=None, groups={})
        marked = attributes(case, daylight, effects)
        return cls(simulated, daylight, run, sensor_coordinates(case).coords.to_dataset(), marked)

    @property
    def rules(self) -> Rules:
        """Thresholds of the metrics and of the shade."""
        return rules(self.case, self.daylight.step_hours, self.attributes)

    def counted(self) -> CountedYear:
        """Trace all blocks and count."""
        with self.run.timed("open façade") as done:
            shut = self._closures(done)
        taken = dict(zip(shut.states[1:], shut.possible[1:], strict=True))
        if self.attributes["has_shade"] and self.run.enabled_effects.every_shade:
            taken[SHADED] = np.ones(len(shut.state), bool)
        suns = {OPEN: self.daylight.suns}
        for state, hours in taken.items():
            suns[state] = self.daylight.suns
            if not self.run.shares_blocks:
                some = sources(self.daylight.sky.isel(time=hours))
                suns[state] = self.daylight.suns.only(some)
        if taken:
            with self.run.timed("shaded façade") as done:
                for i, state in enumerate(taken):
                    share = part(done, i / len(taken), (i + 1) / len(taken))
                    for _ in sensor_stream(self.case, state, suns[state], self.run, share):
                        pass
        with self.run.timed("accumulation and metrics") as done:
            return self._counted(suns, shut, done)

    def _closures(self, progress: Progress) -> Closures:
        """Trace the open state; the state of the façade follows from its direct sun."""
        rule, sizes = self.rules.shade, np.bincount(self.grid)
        sunlit: SunlitSensors | None = None
        for here, C in sensor_stream(self.case, OPEN, self.daylight.suns, self.run, progress):
            if not self.attributes["has_shade"]:
                continue
            direct, sun = self._direct(Coefficients(C.assign_attrs(self.attributes)), here)
            mean = luminance(direct["direct_sun"]).values
            block = sunlit_sensors(mean, None, self.grid[here], sun, rule, len(sizes))
            sunlit = block if sunlit is None else sunlit.plus(block)
            sunlit = sunlit.without_certain(rule.required(sizes))
        if sunlit is None:
            return Closures.never(self.daylight.sky.sizes["time"])
        return closures_from(sunlit, sizes, self.daylight.sky["time"], rule)

    def _direct(self, C: Coefficients, here: slice) -> tuple[xr.Dataset, SunDraws]:
        """Direct sun [lx] on a block of sensors, and its draws."""
        direct, t = illuminance.direct_sun(C, self.daylight.sky), self.rules.metrics
        mean, error = (luminance(direct[n]).values for n in ("direct_sun", "direct_sun_se"))
        limits = t.ase_threshold, self.rules.shade_threshold
        return direct, draw_sun(mean, error, limits, **drawing(self.case), first=here.start)

    def _counted(self, suns: dict[State, Suns], shut: Closures, progress: Progress) -> CountedYear:
        """Count E of each block of sensors."""
        sky, closed = self.daylight.sky, (shut.state > 0).astype(int)[:, None]
        taken, seed = FacadeStates(shut.states, shut.state, closed), drawing(self.case)["seed"]
        counts: list[xr.Dataset] = []
        draws: BlockDraws | None = None
        streams = [sensor_stream(self.case, state, suns[state], self.run) for state in suns]
        for here, (is_open, *others) in aligned(streams):
            is_open = is_open.assign_attrs(self.attributes)
            C = Coefficients(is_open, dict(zip([*suns][1:], others, strict=True)))
            direct, sun = self._direct(C, here)
            E = illuminance.illuminance(C, sky, direct, taken)
            drawn = draw_block(C, sky, E, self.rules, sun, shut, self.grid[here], seed)
            draws = drawn if draws is None else draws.plus(drawn)
            counts.append(sensor_counts(E, self.rules))
            progress(here.stop / len(self.grid))
        assert draws is not None
        month, names = metrics.months(sky["sky"], "sky"), list(sensors_by_grid(self.sensors))
        alike: dict[str, Any] = {"data_vars": "minimal", "coords": "minimal", "compat": "override"}
        every = xr.concat(counts, "sensor", **alike)
        every = every.assign_coords(self.sensors.coords).assign_attrs(counts[0].attrs)
        return CountedYear(every, month, self.rules, draws.draws(shut, month - 1, names), shut)
