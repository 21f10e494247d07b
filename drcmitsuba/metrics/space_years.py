"""Daylight of a year for the tasks of spaces, and how far the errors of E move what follows.

A metric θ of E is evaluated for the mean Ē of n replicates and for n illuminances

    Ē + (E_r − Ē) / √n,

which lie as far from Ē as Ē lies from the truth. The standard deviation of their θ is the standard
error of θ(Ē), exactly where θ is linear, and their mean lies as far from θ(Ē) as errors of single
sensors and hours bend a count: the interval holds θ(Ē) with and without this bias. The same r
stands for all sensors, hours and spaces, so that sums over spaces know how the errors go together.
Where E has no replicates, θ is evaluated for E with all errors down, and with all errors up.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from drcmitsuba.metrics import accumulate
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.confidence import Interval
from drcmitsuba.metrics.facade_states import FacadeStates
from drcmitsuba.metrics.intervals import Rules, t_factor
from drcmitsuba.metrics.space_tasks import at_target, in_use
from drcmitsuba.metrics.spaces import SensorsOfSpace
from drcmitsuba.metrics.thresholds import stamps_passed
from drcmitsuba.runtime.pieces import pieces, run
from drcmitsuba.runtime.threads import in_threads
from drcmitsuba.schema import luminance

ENTRIES = 1 << 20
"""Number of entries of E whose replicates are held at once."""


@dataclass(frozen=True)
class SpaceYears:
    """Daylight of spaces in variants of E, the first of which is its mean."""

    autonomy: np.ndarray
    """Daylight autonomy at the targets of spaces in their hours, by floor area [%], shape
    (variant, space)."""
    daylight: np.ndarray
    """Mean illuminance of spaces by floor area [lx], shape (variant, time, space)."""
    interval: Callable[[np.ndarray], Interval]
    """Interval of a metric from its values in all variants (variant,)."""

    @classmethod
    def of(
        cls, coefficients: Coefficients, sky: xr.Dataset, illuminance: xr.Dataset,
        taken: FacadeStates, spaces: Sequence[SensorsOfSpace], rules: Rules,
    ) -> SpaceYears:  # fmt: skip
        """Daylight of spaces from C of all states and E of the same C, sky and states `taken`.

        `spaces` are from `sensors_by_space`, or from `of_block`: what those sensors add is counted.
        """
        C = coefficients.by_luminance()
        count, stamps = C.open.sizes["replicate"], sky.sizes["time"]
        states = [
            (C.states[state], np.flatnonzero(taken.index == i))
            for i, state in enumerate(taken.states)
            if (taken.index == i).any()
        ]
        daylight = np.zeros((count + 1, stamps, len(spaces)), np.float32)
        shares = np.zeros((len(spaces), C.open.sizes["sensor"]), np.float32)
        for row, space in zip(shares, spaces, strict=True):
            row[space.sensors] = space.shares
        for of_state, hours in states if len(spaces) else ():
            at = sky.isel(time=hours)
            daylight[:, hours] = moved(accumulate.of_means(of_state, at, shares))
        autonomy = _autonomy(states, sky, illuminance, spaces, rules)
        return cls(autonomy, daylight, interval_of_moved)

    @classmethod
    def of_errors(
        cls, illuminance: xr.Dataset, spaces: Sequence[SensorsOfSpace], rules: Rules
    ) -> SpaceYears:
        """Daylight of spaces from E alone, with all its errors down, and with all of them up."""
        at = at_target(illuminance, spaces, rules)
        E = luminance(illuminance["total"]).transpose("time", "sensor").values
        off = np.zeros(1)
        if "total_se" in illuminance:
            error = luminance(illuminance["total_se"]).transpose("time", "sensor").values
            off = float(illuminance.attrs.get("interval_factor", 1.96)) * error
        autonomy, daylight = np.zeros((3, len(spaces))), np.zeros((3, len(E), len(spaces)))
        for row, (name, sign) in enumerate((("DA", 0), ("DA_low", -1), ("DA_high", 1))):
            lux = E + sign * off
            for k, space in enumerate(spaces):
                autonomy[row, k] = at[name].values[space.sensors] @ space.shares
                daylight[row, :, k] = lux[:, space.sensors] @ space.shares
        return cls(autonomy, np.maximum(daylight, 0), _ends)

    @classmethod
    def dark(cls, replicates: int, stamps: int, spaces: int) -> SpaceYears:
        """Daylight of spaces to which blocks of sensors are added."""
        daylight = np.zeros((replicates + 1, stamps, spaces), np.float32)
        return cls(np.zeros((replicates + 1, spaces)), daylight, interval_of_moved)

    def add(self, block: SpaceYears, places: Sequence[int]) -> None:
        """Add, in place, what the sensors of a block give to its spaces, by their places here."""
        self.autonomy[:, places] += block.autonomy
        self.daylight[..., places] += block.daylight


def of_block(
    spaces: Sequence[SensorsOfSpace], here: slice
) -> tuple[list[int], list[SensorsOfSpace]]:
    """Places of the spaces in a block, and these with its sensors, counted from its first."""
    places, out = [], []
    for k, space in enumerate(spaces):
        inside = (space.sensors >= here.start) & (space.sensors < here.stop)
        if inside.any():
            places.append(k)
            sensors = space.sensors[inside] - here.start
            out.append(replace(space, sensors=sensors, shares=space.shares[inside]))
    return places, out


def moved(E: np.ndarray) -> np.ndarray:
    """Mean of replicates (replicate, …), then it moved by the error of each: (variant, …)."""
    mean = E.mean(axis=0)
    return np.concatenate([mean[None], mean + (E - mean) / np.sqrt(len(E))])


def interval_of_moved(values: np.ndarray) -> Interval:
    """95 % interval from a metric of `moved` (variant,), which it always holds."""
    half = t_factor(len(values) - 1) * float(values[1:].std(ddof=1))
    value, mean = float(values[0]), float(values[1:].mean())
    ends = value, 2 * value - mean
    return Interval(value, min(ends) - half, max(ends) + half)


def _ends(values: np.ndarray) -> Interval:
    """Interval from a metric of E, of E with all errors down, and with all errors up."""
    return Interval(float(values[0]), float(values.min()), float(values.max()))


def _autonomy(
    states: Sequence[tuple[xr.Dataset, np.ndarray]], sky: xr.Dataset, illuminance: xr.Dataset,
    spaces: Sequence[SensorsOfSpace], rules: Rules,
) -> np.ndarray:  # fmt: skip
    """Autonomy of spaces (variant, space) [%]; entries far from their target are alike in all."""
    E, error = (
        luminance(illuminance[name]).transpose("time", "sensor").values
        for name in ("total", "total_se")
    )
    count, sensors = states[0][0].sizes["replicate"], E.shape[1]
    limit, weight = np.full(sensors, np.inf, np.float32), np.zeros(sensors)
    space_of, wanted = np.zeros(sensors, int), np.zeros((len(E), len(spaces)), bool)
    for k, space in enumerate(spaces):
        wanted[:, k] = in_use(space, illuminance, rules.step_hours)
        limit[space.sensors] = space.target or rules.metrics.sda_threshold
        weight[space.sensors] = 100 * space.shares / wanted[:, k].sum()
        space_of[space.sensors] = k
    every, parts = wanted.all(), pieces(*E.shape) if len(spaces) else []
    enough = np.zeros((max(1, len(parts)), sensors), np.int32)
    # No |E_r − Ē| / √n is larger than √(n − 1) standard errors.
    beyond, doubtful = np.float32(1.001 * np.sqrt(count - 1)), np.empty(E.shape, bool)

    def of_part(part: int) -> None:
        here = parts[part]
        above = E[here] - limit
        passed, own = above >= 0, doubtful[here]
        np.less_equal(np.abs(above, out=above), beyond * error[here], out=own)
        if not every:
            of_sensor = wanted[here, space_of]
            passed &= of_sensor
            own &= of_sensor
        enough[part] = stamps_passed(passed)

    in_threads(of_part, range(len(parts)))
    out = np.tile(np.bincount(space_of, weight * enough.sum(axis=0), len(spaces)), (count + 1, 1))
    for C, hours in states if len(spaces) else ():
        row, sensor = np.divmod(np.flatnonzero(doubtful[run(hours)]), sensors)
        at = sky.isel(time=hours)
        for start in range(0, len(row), ENTRIES):
            some, time = sensor[start : start + ENTRIES], row[start : start + ENTRIES]
            lux = moved(accumulate.replicates_at(C, at, time, some))[1:]
            passed, of_sensor = E[hours[time], some] >= limit[some], weight[some]
            for variant, more in zip(out[1:], lux >= limit[some], strict=True):
                changed = np.flatnonzero(more != passed)
                change = np.where(more[changed], of_sensor[changed], -of_sensor[changed])
                variant += np.bincount(space_of[some[changed]], change, len(spaces))
    return out
