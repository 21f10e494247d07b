"""Result of a year of which E and C are not kept: metrics of all sensors and of each."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from drcmitsuba.annual.large_year import LargeYear, obstacle
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.saved_result import SavedResult, with_record
from drcmitsuba.blocks.block_folder import BlockFolder
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import VARYING
from drcmitsuba.controls.space_lights import with_electric_light
from drcmitsuba.metrics.illuminance import KEPT
from drcmitsuba.metrics.sensor_counts import CountedYear
from drcmitsuba.metrics.spaces import sensors_by_space
from drcmitsuba.plan import Plan
from drcmitsuba.plan.forecast import Forecast
from drcmitsuba.plan.forecast.size import whole_arrays
from drcmitsuba.runtime import storage
from drcmitsuba.runtime.machine_memory import of_machine
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS, EnabledEffects
from drcmitsuba.sky.daylight import Daylight
from drcmitsuba.sky.luminances import save_luminances

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class LargeResult(SavedResult):
    """Numbers of an evaluation without E and C; shows itself in Jupyter."""

    case: Case
    metrics: dict[str, Any]
    """Content of `metrics.json`."""
    year: CountedYear
    """Counts of all sensors."""
    daylight: Daylight
    """Sky and suns."""
    plan: dict[str, Any]
    """Content of `plan.json`."""
    attributes: dict[str, Any]
    """Attributes that E would have."""
    enabled_effects: EnabledEffects = ALL_EFFECTS

    @cached_property
    def sensors(self) -> xr.Dataset:
        """Metrics of every sensor, as on disk: `CountedYear.by_sensor`."""
        return self.year.by_sensor().assign_attrs(self.attributes)

    @property
    def described(self) -> xr.Dataset:
        """Coordinates and attributes that E would have."""
        sky, at = self.daylight.sky, self.year.counts.drop_dims("month").coords
        kept = {name: sky[name] for name in ("time", "clock")}
        return xr.Dataset(coords={**at, **kept}, attrs=self.attributes)

    def _arrays(self, folder: Path) -> dict[str, Callable[[], None]]:
        return {
            "sensors.nc": lambda: storage.save_netcdf(self.sensors, folder / "sensors.nc"),
            "sky.zarr": lambda: save_luminances(self.daylight, folder / "sky.zarr"),
        }

    def _pictures(self) -> dict[str, Figure]:
        from drcmitsuba.report import figures

        counts = self.year.counts
        sums = counts[["enough", "in_sun"]].sum("month").assign(mean=counts["mean_illuminance"])
        sums = sums.rename(mean="mean_illuminance")
        return figures.pictures_of_sums(self.case, self.described, sums, self.metrics)


def is_large(planned: Plan, memory: int | None) -> bool:
    """Whether E and C are not kept: by the case's choice, or because they do not fit in `memory`.

    `memory` is in bytes; by default it is a share of the machine's.
    """
    case = planned.facts.case
    if case.output.illuminance != "auto":
        return case.output.illuminance == "metrics"
    if obstacle(case):
        return False
    return whole_arrays(planned) > (of_machine() if memory is None else memory)


def evaluated(
    planned: Plan, run: Run, remarks: list[str], expected: Forecast | None
) -> LargeResult:
    """Evaluate a year block by block; InputError where `LargeYear.of` refuses the case."""
    case, light = planned.facts.case, planned.facts.light
    with _stored(run) as run:
        large = LargeYear.of(case, light, run)
        year = large.counted()
    kept = {name: value for name, value in large.attributes.items() if name in KEPT}
    kept |= {"step_hours": light.step_hours}
    planned = planned.summed() if VARYING in year.closures.states else planned
    reason = "E and C are not kept: the case asks for metrics alone"
    if case.output.illuminance == "auto":
        reason = 'E and C are not kept: they do not fit in memory; [output] illuminance = "all"'
    lit = with_electric_light(
        year.numbers(), year.years, sensors_by_space(year.counts), light.sky, light.step_hours
    )
    metrics, effects = with_record(
        planned, lit, year.counts.attrs, run, [*remarks, reason], expected
    )
    return LargeResult(case, metrics, year, light, effects, kept, run.enabled_effects)


@contextmanager
def _stored(run: Run) -> Iterator[Run]:
    """Run with a folder for its blocks, which goes at the end where the run has none."""
    if run.blocks is not None:
        yield run
        return
    with tempfile.TemporaryDirectory(prefix="drcmitsuba_") as folder:
        yield replace(run, blocks=BlockFolder.of_results(Path(folder)))
