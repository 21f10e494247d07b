"""The table `[accuracy]` of a case: numbers of samples, and the intervals to reach."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Annotated, NamedTuple

from pydantic import Field, model_validator

from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import Table, shortened

POINTS = 576
"""Number of points that the defaults are made for: the classroom's sensors."""
MOST_TIMES = {
    "paths": 64, "cell_paths": 2, "pane_points": 8, "sensor_sky_rays": 2,
    "mirrored_sun_samples": 32,
}  # fmt: skip
"""Largest factors of samples where points are few: beyond these the error comes from elsewhere."""
SMALLEST_CELL = 1e-3
"""Least size of a cell [m]."""
OF_EXTENT = 5
"""Number of cells across the least extent of small rooms, such as those of a scale model."""
MOST_CELLS = 20_000
"""Largest number of cells of small rooms."""
FEW_COMPONENTS = 4
"""Number of components up to which each has all photons: many light the room together."""
AT_SENSORS = "% at each sensor"
"""Unit of a target for the illuminance of the hours at every sensor, and at every eye."""
OF_GLARE = "point of glare hours"
"""Unit of a target for the share of hours with glare, at every eye."""


class Target(NamedTuple):
    """Largest half width of the 95 % intervals."""

    value: float
    """Half width, in `unit`."""
    unit: str
    """'point' (of sDA and of ASE), '%' (of the mean illuminance), `AT_SENSORS` or `OF_GLARE`."""

    @classmethod
    def parse(cls, text: str) -> Target:
        """Read "1 point", "2 %", "2 % at each sensor" or "0.5 points of glare hours".

        Raises
        ------
        InputError
            It is something else, or not above 0 and at most 100.
        """
        units = rf"points?(?: of glare hours)?|{AT_SENSORS}|%"
        pattern = rf"\s*(\d{{1,3}}(?:\.\d{{1,6}})?)\s*({units})\s*"
        match = re.fullmatch(pattern, text, re.ASCII)
        if match is None or not 0 < float(match[1]) <= 100:
            remedy = 'write "1 point" (of sDA, ASE), "2 %" (of mean E), '
            remedy += f'"2 {AT_SENSORS}" or "1 {OF_GLARE}"'
            raise InputError("accuracy", "target", shortened(text), remedy)
        return cls(float(match[1]), match[2].replace("points", "point"))

    def __str__(self) -> str:
        unit = self.unit if self.value == 1 else self.unit.replace("point", "points")
        return f"{self.value:g} {unit}"


class Accuracy(Table):
    """Samples of each independent replicate, and the intervals to reach with further ones."""

    seed: Annotated[int, Field(ge=0, le=1 << 30)] = 0
    """Seed of all random numbers; the same seed gives the same numbers."""
    replicates: Annotated[int, Field(ge=2, le=64)] = 6
    """Number of independent replicates, whose scatter gives the standard errors."""
    paths: Annotated[int, Field(ge=1, le=1 << 16)] = 128
    """Gather G: number of paths from a sensor."""
    cell_paths: Annotated[int, Field(ge=1, le=1 << 16)] = 32
    """Transfer T: number of rays from a cell to others."""
    cell_size: Annotated[float, Field(ge=SMALLEST_CELL, le=100)] = 0.45
    """Edge of the cubes that cut diffuse surfaces into cells [m]; by default, in a case that is
    read from a file, a fifth of the rooms' least extent where that is below 0.9 m."""
    cell_sky_rays: Annotated[int, Field(ge=1, le=1 << 16)] = 128
    """Deposit D: number of rays from a cell to the sky."""
    sensor_sky_rays: Annotated[int, Field(ge=1, le=1 << 20)] = 2048
    """Deposit D: number of rays from a sensor to the sky."""
    sensor_sun_samples: Annotated[int, Field(ge=1, le=1 << 10)] = 8
    """Deposit D: number of directions from a sensor to a sun that a shadow's edge crosses; other
    suns take an eighth of it, cells one."""
    mirrored_sun_samples: Annotated[int, Field(ge=1, le=1 << 10)] = 1
    """Deposit D: number of directions from a sensor to a sun in a planar mirror; an eighth of
    `sensor_sun_samples` where that is more."""
    pane_points: Annotated[int, Field(ge=1, le=1 << 16)] = 64
    """Deposit D: number of points on the scattering panes for each sensor or cell."""
    film_sky_samples: Annotated[int, Field(ge=1, le=1 << 16)] = 256
    """Deposit D: number of directions to the sky from every outgoing cell of a film's BSDF."""
    photons: Annotated[int, Field(ge=1, le=1 << 22)] = 1024
    """Number of photons from every sun to a component; a patch of Tregenza's sky sends four times
    as many, and its finer patches share them. By default, in a case that is read from a file, more
    than `FEW_COMPONENTS` components have fewer: those of all grow with the root of their number."""
    photon_surfaces: Annotated[int, Field(ge=2, le=10_000)] = 256
    """Largest number of surfaces that a photon meets; a note states the light lost beyond it."""
    sensor_square: Annotated[float, Field(gt=0, le=10)] = 0.3
    """Largest edge of the square around a sensor on which photons are counted [m]."""
    target: str | None = None
    """Half width of the 95 % intervals to reach: "1 point" of sDA and ASE, "2 %" of mean E,
    "2 % at each sensor" of the E of its hours, root mean square weighted by E, or "1 point of
    glare hours", the share of hours at every eye whose DGP is above 0.35, 0.40 and 0.45."""
    time_limit: Annotated[float, Field(gt=0, le=1e6)] = 600.0
    """Time for further samples towards the target [s]; no round begins after it."""

    @model_validator(mode="after")
    def _target_is_readable(self) -> Accuracy:
        _ = self.goal
        return self

    def of_points(self, count: int) -> Accuracy:
        """Accuracy for a number of points: few of them take the time that many would.

        The defaults are made for `POINTS` points, whose errors even out in their sum; a reader of
        three sensors looks at each. Settings that the case states stay as they are.
        """
        times = POINTS / max(1, count)
        if times <= 1:
            return self
        more = {
            name: round(getattr(self, name) * min(times, most))
            for name, most in MOST_TIMES.items()
            if name not in self.model_fields_set
        }
        return self.model_copy(update=more)

    def of_rooms(self, extent: Sequence[float]) -> Accuracy:
        """Accuracy whose cells fit rooms of an extent (3,) [m], unless the case states their size.

        In rooms of less than two cells, five cells stand across the least extent, where these are
        no more than `MOST_CELLS` in all.
        """
        x, y, z = extent
        size = min(extent) / OF_EXTENT
        is_fit = "cell_size" in self.model_fields_set or min(extent) >= 2 * self.cell_size
        if is_fit or size < SMALLEST_CELL or 2 * (x * y + y * z + z * x) > MOST_CELLS * size**2:
            return self
        fit = self.model_copy(update={"cell_size": size})
        fit.model_fields_set.discard("cell_size")  # another room may want another size
        return fit

    def of_components(self, count: int) -> Accuracy:
        """Accuracy with fewer photons for each of many components, unless the case states them."""
        usual = Accuracy.model_fields["photons"].default
        share = math.sqrt(FEW_COMPONENTS / max(FEW_COMPONENTS, count))
        photons = max(1, round(usual * share))
        if "photons" in self.model_fields_set or photons == self.photons:
            return self
        fit = self.model_copy(update={"photons": photons})
        fit.model_fields_set.discard("photons")  # another case may have other components
        return fit

    @property
    def stated(self) -> list[str]:
        """Settings that few points do not raise, since the case states them."""
        return sorted(self.model_fields_set & set(MOST_TIMES))

    @property
    def sampling(self) -> dict[str, int | float]:
        """Settings that one simulation depends on: all but the target."""
        return self.model_dump(exclude={"target", "time_limit"})

    @property
    def goal(self) -> Target | None:
        """The target as value and unit, None without a target."""
        return None if self.target is None else Target.parse(self.target)

    @property
    def sensor_goal(self) -> Target | None:
        """The target of an evaluation, None where there is none or it is one of glare."""
        goal = self.goal
        return None if goal is None or goal.unit == OF_GLARE else goal

    @property
    def eye_goal(self) -> Target | None:
        """The target of a year of glare, None where there is none or it is one of sensors alone."""
        goal = self.goal
        return goal if goal is not None and goal.unit in (AT_SENSORS, OF_GLARE) else None

    def rounds_toward(self, goal: Target | None) -> str:
        """Tell, as the end of a forecast, of the rounds that may follow; empty without a goal."""
        if goal is None:
            return ""
        return f'; then rounds toward "{goal}", until {self.time_limit:g} s are over'
