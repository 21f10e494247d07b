"""Evidence from which a verdict follows: E of a year with its coefficients and its sky."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import xarray as xr

from drcmitsuba.case.case import Case
from drcmitsuba.case.metrics import Metrics
from drcmitsuba.case.reading import case_of_settings
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.evaluate_metrics import drawing, rules_of, settings_of
from drcmitsuba.metrics.illuminance import illuminance as accumulated
from drcmitsuba.metrics.intervals import Closures, Rules
from drcmitsuba.metrics.intervals.sun import SunDraws, draw_sun
from drcmitsuba.metrics.intervals.year_draws import closures_of
from drcmitsuba.metrics.stored_arrays import loaded, open_dataset
from drcmitsuba.metrics.stored_arrays import sky as stored_sky
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.provenance import METHOD
from drcmitsuba.schema import by_luminance
from drcmitsuba.sky.daylight import Daylight

OF_E = ("total", "total_open", "direct_sun")
"""Illuminances that standards ask for; each has its standard error."""
MOST_BYTES = 8 << 30
"""Largest size of E of a year [bytes]: 35,000 sensors at 8,760 hours."""
STAMPS = 1024
"""Number of further hours whose E is computed at once."""
OF_C = (
    "replicates", "straight", "straight_se", "pane_group", "sun_straight", "sun_straight_se",
    "mesh_error",
)  # fmt: skip
"""Coefficients from which the draws are made."""


class Evaluated(Protocol):
    """Result of an evaluation in memory, as `annual.result.Result` is."""

    @property
    def case(self) -> Case:
        """Case that was evaluated."""

    @property
    def illuminance(self) -> xr.Dataset:
        """E[time, sensor] [lx]."""

    @property
    def by_state(self) -> Coefficients:
        """C of all states of the façade [sr]."""

    @property
    def daylight(self) -> Daylight:
        """Sky and suns."""


@dataclass(frozen=True)
class Evidence:
    """Illuminance of an evaluation, and what tells how sure it is.

    Examples
    --------
    >>> import drcmitsuba
    >>> result = drcmitsuba.evaluate("office.toml")
    >>> evidence = drcmitsuba.standards.Evidence.of_result(result)
    >>> evidence.illuminance["total"].dims
    ('time', 'sensor')
    """

    illuminance: xr.Dataset
    """E with `total`, `total_open`, `direct_sun` and their standard errors [lx]."""
    coefficients: Coefficients | None
    """C with its replicates [sr]; without them no probability can be stated."""
    sky: xr.Dataset | None
    """Luminances of the sky [cd/m²]; without them, neither probability nor daylight hours."""
    drawing: dict[str, Any]
    """Arguments of the draws, from `evaluate_metrics.drawing`."""
    source: str
    """Folder or case that the evidence comes from."""
    year: xr.Dataset | None = None
    """Luminances of the sky at all hours of the year [cd/m²], for whose suns C stands, too; None
    where E has them, or they were not simulated."""

    @cached_property
    def of_year(self) -> Evidence:
        """Evidence of all hours of the year; itself where there are no further hours.

        E of the further hours follows from C, some hours at a time. Where E of a year would take
        more than `MOST_BYTES`, the further hours are left out.
        """
        own, year = self.illuminance, self.year
        if year is None or self.coefficients is None:
            return self
        every = [*(name + suffix for name in OF_E for suffix in ("", "_se")), "sun_group"]
        if 4 * len(every) * year.sizes["time"] * own.sizes["sensor"] > MOST_BYTES:
            return self
        own = own[[name for name in every if name in own]]
        known = np.isin(year["time"].values, own["time"].values)
        further, E = np.flatnonzero(~known), _without_values(own, year.sizes["time"])
        _put(own, np.flatnonzero(known), E)
        for start in range(0, len(further), STAMPS):
            hours = further[start : start + STAMPS]
            _put(accumulated(self.coefficients, year.isel(time=hours)), hours, E)
        coords = {name: E[name] for name in own.coords}
        joined = xr.Dataset({name: E[name] for name in own.data_vars}, coords, own.attrs)
        return replace(self, illuminance=joined, sky=year, year=None)

    @cached_property
    def _rules(self) -> Rules:
        """Rules of the evaluation, to which its own draws were made."""
        return rules_of(self.illuminance.attrs, self.source, {})

    @cached_property
    def _direct(self) -> xr.Dataset:
        """Direct sun by luminance [lx]."""
        names = ("direct_sun", "direct_sun_se", "sun_group")
        return by_luminance(self.illuminance[[n for n in names if n in self.illuminance]])

    @cached_property
    def _sun(self) -> SunDraws:
        """Draws of the direct sun, the same as those of the evaluation."""
        return self._sun_to(self._rules.metrics.ase_threshold)

    def _sun_to(self, threshold: float) -> SunDraws:
        mean, error = (self._direct[f"direct_sun{suffix}"].values for suffix in ("", "_se"))
        limits = threshold, self._rules.shade_threshold
        return draw_sun(mean, error, limits, self.drawing["rays"], self.drawing["seed"])

    @cached_property
    def sun(self) -> SunDraws:
        """Draws of the direct sun at all time stamps, to the threshold of LM-83."""
        wanted = Metrics().ase_threshold
        return self._sun if self._rules.metrics.ase_threshold == wanted else self._sun_to(wanted)

    @cached_property
    def closures(self) -> Closures:
        """Draws of the façade's states at all time stamps, the same as those of the evaluation.

        A state of an hour that the evaluation did not draw has no coefficients.
        """
        E = self.illuminance
        if not E.attrs.get("has_shade", 1):
            return Closures.never(E.sizes["time"])
        return closures_of(self._direct, self._sun, self._rules)

    @classmethod
    def of_result(cls, result: Evaluated) -> Evidence:
        """Take the arrays of a result in memory."""
        light, case = result.daylight, result.case
        year = None if light.year is None else light.year.sky
        E, C = result.illuminance, result.by_state
        return cls(E, C, light.sky, drawing(case), case.source, year)

    @classmethod
    def of_folder(cls, folder: str | Path) -> Evidence:
        """Read the files of `evaluate -o FOLDER`; C and L may be missing.

        Raises
        ------
        InputError
            No illuminance, files that are damaged, of another method or of different evaluations.
        """
        folder = Path(folder)
        path = folder / "illuminance.nc"
        if not path.exists():
            raise InputError(folder, "results", *_without_illuminance(folder))
        E = open_dataset(path, *(n + s for n in OF_E for s in ("", "_se")), "time", *"xyz")
        unused = [n for n in E.data_vars if str(n).removesuffix("_se") not in (*OF_E, "sun_group")]
        E = loaded(path, E.drop_vars(unused))  # coordinates stay, the states of groups among them
        C = _coefficients(folder / "coefficients.zarr", E)
        _check_method(path, {**({} if C is None else C.attrs), **E.attrs})
        sky = _sky(folder / "sky.zarr", E)
        year = None if sky is None else _year(folder / "year.zarr", sky)
        settings = settings_of(E.attrs, path, rules_of(E.attrs, path, {}).metrics)
        arguments: dict[str, Any] = {"rays": None, "seed": 0}
        if any(key in Case.model_fields for key in settings):
            arguments = drawing(case_of_settings(settings, path))
        return cls(E, C, sky, arguments, str(folder), year)


def _without_values(data: xr.Dataset, hours: int) -> dict[Hashable, xr.Variable]:
    """Variables for so many hours; those that change by the hour have no values yet."""
    out: dict[Hashable, xr.Variable] = {}
    for name, v in data.variables.items():
        shape = [hours if dim == "time" else size for dim, size in v.sizes.items()]
        values = np.empty(shape, v.dtype) if "time" in v.dims else v.values
        out[name] = xr.Variable(v.dims, values, v.attrs)
    return out


def _put(data: xr.Dataset, hours: np.ndarray, out: dict[Hashable, xr.Variable]) -> None:
    """Put values into their hours (time,); joined and sorted by xarray, they are copied thrice."""
    for name, v in out.items():
        if "time" in v.dims:
            at = tuple(hours if dim == "time" else slice(None) for dim in v.dims)
            v.values[at] = data.variables[name].transpose(*v.dims).values


def _check_method(path: Path, attributes: dict[Any, Any]) -> None:
    """Refuse results of another method: the same settings would give other numbers.

    Version 0.1.0 named the method in C alone.
    """
    theirs = attributes.get("method", "unknown")
    if str(theirs) != str(METHOD):
        got = f"{theirs}, of version {attributes.get('version', 'unknown')}, not {METHOD}"
        raise InputError(path, "method", got, "evaluate the case again")


def _coefficients(path: Path, E: xr.Dataset) -> Coefficients | None:
    """C of the same evaluation as E; None where there is none."""
    if not path.exists():
        return None
    C = open_dataset(path, "replicates", "straight", "straight_se", "state", "bin", *"xyz")
    C = loaded(path, C[[name for name in OF_C if name in C]])
    ours, theirs = (str(data.attrs.get("settings")) for data in (C, E))
    if ours != theirs or C.sizes["sensor"] != E.sizes["sensor"]:
        got = "they are of another evaluation than illuminance.nc"
        raise InputError(path, "settings", got, "evaluate the case again")
    return Coefficients.of(C)


def _sky(path: Path, E: xr.Dataset) -> xr.Dataset | None:
    """Sky of the same hours as E; None where there is none."""
    if not path.exists():
        return None
    sky = stored_sky(path)
    if sky.sizes["time"] != E.sizes["time"] or (sky["time"].values != E["time"].values).any():
        got = "other time stamps than those of illuminance.nc"
        raise InputError(path, "time", got, "evaluate the case again")
    return sky


def _year(path: Path, sky: xr.Dataset) -> xr.Dataset | None:
    """Sky of all hours of the year, of which `sky` has some; None where there is none."""
    if not path.exists():
        return None
    names = ("sky", "sun", "sun_bin", "sun_direction", "clock", "bin")
    year = loaded(path, open_dataset(path, *names))
    own = np.isin(year["time"].values, sky["time"].values)
    if own.sum() != sky.sizes["time"] or (year["sun"].values[own] != sky["sun"].values).any():
        got = "it is of another evaluation than sky.zarr"
        raise InputError(path, "time, sun", got, "evaluate the case again")
    return year


def _without_illuminance(folder: Path) -> tuple[str, str]:
    """Why a folder has no E, and what to do."""
    if (folder / "sensors.nc").exists():
        got = "E was not kept, only its metrics"
        return got, 'evaluate with illuminance = "all" in [output]'
    other = next((n for n in ("glare.json", "plan.json") if (folder / n).exists()), "")
    got = f"{other}, but no illuminance.nc" if other else "no illuminance.nc"
    return got, "give a folder of drcmitsuba evaluate -o"
