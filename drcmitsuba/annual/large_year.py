"""A year of any number of sensors in little memory: metrics without whole arrays C and E.

open state   ─ block by block ─► direct sun ─► sensors in the sun by hour and grid, summed
sums         ─ closures_from ──► state of the façade at every hour, and in every draw
other states ─ block by block ─► their blocks, for the suns of hours that may close
all blocks   ─ C · L ──────────► E of a block ─► sensor_counts and draws, summed
sums         ─ CountedYear ────► metrics with intervals; of each sensor its mean E and hours

C is read from the blocks that the run keeps; no array holds hours × sensors of more than a block.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import drjit as dr
import numpy as np
import xarray as xr

from drcmitsuba import metrics
from drcmitsuba.annual.attributes import attributes
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.sensor_stream import Stream, aligned, sensor_stream
from drcmitsuba.annual.summed_year import years_of_states
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, VARYING, State
from drcmitsuba.metrics import illuminance
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.evaluate_metrics import drawing, rules
from drcmitsuba.metrics.facade_states import FacadeStates, sun_group
from drcmitsuba.metrics.grids import grid_of_sensors, sensors_by_grid
from drcmitsuba.metrics.intervals import Rules
from drcmitsuba.metrics.intervals.draw import BlockDraws, draw_block
from drcmitsuba.metrics.intervals.facade_draws import (
    Closures,
    closures_from,
    sunlit_sensors,
)
from drcmitsuba.metrics.intervals.sun import SunDraws, draw_sun
from drcmitsuba.metrics.sensor_counts import CountedYear, sensor_counts
from drcmitsuba.metrics.space_years import SpaceYears, of_block
from drcmitsuba.metrics.spaces import sensors_by_space
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.progress import Progress, part
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.schema import luminance
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.luminances import sources
from drcmitsuba.sky.sun_models import Suns

RECORD = ("photons", "photons_smear", "mesh_suns", "mesh_miss")
"""Attributes of C that its blocks have; of several meshes the finest and the worst counts."""


def obstacle(case: Case) -> str:
    """Reason why a case's year is not summed block by block; empty where it can be."""
    return "" if case.accuracy.sensor_goal is None else "a target"


@dataclass(frozen=True)
class LargeYear:
    """Sums of a year over blocks of sensors."""

    case: Case
    daylight: Daylight
    run: Run
    sensors: xr.Dataset
    """Coordinates (sensor,), with the attribute `spaces`."""
    attributes: dict[str, Any]
    """Attributes of C."""

    @cached_property
    def grid(self) -> np.ndarray:
        """Number of every sensor's grid, shape (sensor,)."""
        return grid_of_sensors(self.sensors)

    @classmethod
    def of(cls, case: Case, daylight: Daylight, run: Run) -> LargeYear:
        """Year of a case as it is simulated.

        Raises
        ------
        InputError
            The case has a target.
        """
        if reason := obstacle(case):
            remedy = 'give illuminance = "all", or leave it out'
            got = f"the metrics alone beside {reason}"
            raise InputError(case.source, "output.illuminance", got, remedy)
        effects = run.enabled_effects
        simulated = case if effects.shade else case.with_tables(shading=None, groups={})
        marked = attributes(case, daylight, effects)
        at = prepared(case).receivers.coordinates.coords.to_dataset()
        at = at.assign_attrs(spaces=marked["spaces"])
        return cls(simulated, daylight, run, at, marked)

    @property
    def rules(self) -> Rules:
        """Thresholds of the metrics and of the shade."""
        return rules(self.case, self.daylight.step_hours, self.attributes)

    def counted(self) -> CountedYear:
        """Trace all blocks and count."""
        with self.run.timed("open façade") as done:
            shut, taken = self._closures(done)
        dr.flush_malloc_cache()
        suns = {OPEN: self.daylight.suns, **self._suns(shut)}
        others = [state for state in suns if state != OPEN]
        if others:
            with self.run.timed("shaded façade") as done:
                for i, state in enumerate(others):
                    share = part(done, i / len(others), (i + 1) / len(others))
                    for _ in self._stream(state, suns[state], taken, share):
                        pass
            dr.flush_malloc_cache()
        with self.run.timed("accumulation and metrics") as done:
            return self._counted(suns, shut, taken, done)

    def _closures(self, progress: Progress) -> tuple[Closures, FacadeStates]:
        """Trace the open state; the state of the façade follows from its direct sun."""
        rule, sizes = self.rules.shade, np.bincount(self.grid)
        sky, sunlit = self.daylight.sky, None
        for here, C in self._stream(OPEN, self.daylight.suns, None, progress):
            if not self.attributes["has_shade"]:
                continue
            direct, sun = self._direct(Coefficients(C.assign_attrs(self.attributes)), here)
            mean = luminance(direct["direct_sun"]).values
            group = sun_group(direct) if "sun_group" in direct else None
            block = sunlit_sensors(mean, group, self.grid[here], sun, rule, len(sizes))
            sunlit = block if sunlit is None else sunlit.plus(block)
            sunlit = sunlit.without_certain(rule.required(sizes))
        if sunlit is None:
            stamps = sky.sizes["time"]
            never = np.zeros(stamps, int), np.zeros((stamps, 0), int)
            return Closures.never(stamps), FacadeStates((OPEN,), *never)
        shut = closures_from(sunlit, sizes, sky["time"], rule)
        of_group = rule.indices(rule.closed(sunlit.count, sizes), sky["time"])
        return shut, FacadeStates(shut.states, shut.state, of_group)

    def _suns(self, shut: Closures) -> dict[State, Suns]:
        """Suns of every further state, those of the hours in which the façade may take it."""
        taken = dict(zip(shut.states[1:], shut.possible[1:], strict=True))
        groups = self.rules.groups
        every = self.attributes["has_shade"] and self.run.enabled_effects.every_shade
        if every and VARYING not in taken:
            taken[groups.label(groups.last)] = np.ones(len(shut.state), bool)
        if self.run.shares_blocks:  # any weather and rule may ask for any sun
            return dict.fromkeys(taken, self.daylight.suns)
        sky = self.daylight.sky
        some = {state: sources(sky.isel(time=hours)) for state, hours in taken.items()}
        return {state: self.daylight.suns.only(labels) for state, labels in some.items()}

    def _stream(
        self, state: State, suns: Suns, taken: FacadeStates | None,
        progress: Progress = lambda share: None,
    ) -> Stream:  # fmt: skip
        """Blocks of a state; of the state `VARYING` those of a year of the states `taken`."""
        if state == VARYING and taken is not None:
            of_group = taken.of_group
            return years_of_states(self.case, self.daylight, of_group, self.run, progress)
        latitude = self.daylight.sky.attrs["latitude"]
        return sensor_stream(self.case, state, suns, latitude, self.run, progress)

    def _direct(self, C: Coefficients, here: slice) -> tuple[xr.Dataset, SunDraws]:
        """Direct sun [lx] on a block of sensors, and its draws."""
        direct, t = illuminance.direct_sun(C, self.daylight.sky), self.rules.metrics
        mean, error = (luminance(direct[n]).values for n in ("direct_sun", "direct_sun_se"))
        limits = t.ase_threshold, self.rules.shade_threshold
        return direct, draw_sun(mean, error, limits, **drawing(self.case), first=here.start)

    def _counted(
        self, suns: Mapping[State, Suns], shut: Closures, taken: FacadeStates, progress: Progress
    ) -> CountedYear:
        """Count E of each block of sensors."""
        sky, seed = self.daylight.sky, drawing(self.case)["seed"]
        counts: list[xr.Dataset] = []
        spaces = sensors_by_space(self.sensors)
        draws: BlockDraws | None = None
        years: SpaceYears | None = None
        record: dict[str, Any] = {}
        streams = [self._stream(state, some, taken) for state, some in suns.items()]
        for here, (is_open, *others) in aligned(streams):
            is_open = is_open.assign_attrs(self.attributes)
            C = Coefficients(is_open, dict(zip([*suns][1:], others, strict=True)))
            direct, sun = self._direct(C, here)
            E = illuminance.illuminance(C, sky, direct, taken)
            drawn = draw_block(C, sky, E, self.rules, sun, shut, self.grid[here], seed)
            draws = drawn if draws is None else draws.plus(drawn)
            counts.append(sensor_counts(E, self.rules))
            if years is None:
                count = is_open.sizes["replicate"], sky.sizes["time"], len(spaces)
                years = SpaceYears.dark(*count)
            places, some = of_block(spaces, here)
            years.add(SpaceYears.of(C, sky, E, taken, some, self.rules), places)
            its = {name: is_open.attrs[name] for name in RECORD if name in is_open.attrs}
            record = {name: max(record.get(name, value), value) for name, value in its.items()}
            progress(here.stop / len(self.grid))
        assert draws is not None
        assert years is not None
        month, names = metrics.months(sky["sky"], "sky"), list(sensors_by_grid(self.sensors))
        alike: dict[str, Any] = {"data_vars": "minimal", "coords": "minimal", "compat": "override"}
        every = xr.concat(counts, "sensor", **alike)
        record["spaces"] = self.attributes["spaces"]
        every = every.assign_coords(self.sensors.coords).assign_attrs(record)
        return CountedYear(
            every, month, self.rules, draws.draws(shut, month - 1, names), shut, taken.of_group,
            years,
        )  # fmt: skip
