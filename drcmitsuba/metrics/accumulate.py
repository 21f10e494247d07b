"""Coefficients × luminances = illuminance: E[time, sensor] = Σ_bin C[sensor, bin] · L[time, bin].

The sun of a time stamp is one bin, or a few bins that stand for it: the sun's part of the sum is a
sparse product, the sky's a dense one. Every replicate of C gives its own E; their scatter is the
standard error of E, as the entries of C share samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from drcmitsuba.metrics.bin_luminances import (
    SAME_SUBDIVISION,
    own_suns,
    positions_of,
    sun_luminances,
)
from drcmitsuba.metrics.source_sums import source_sums, sums_at
from drcmitsuba.metrics.year_replicates import SummedReplicates, replicates_of
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.pieces import pieces
from drcmitsuba.runtime.threads import in_threads
from drcmitsuba.schema import describe

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

LINEAR = ("replicates", "sun_straight", "sun_straight_se")
"""Variables of C that are linear in the sensors."""


def _refuse_gaps(lost: np.ndarray, sky: xr.Dataset) -> None:
    """Refuse time stamps without numbers, which are not 0 in `lost` (time,).

    The shaded state has coefficients only for the hours in which it closes.
    """
    gaps = np.flatnonzero(lost)
    if len(gaps):
        first = np.datetime_as_string(sky["time"].values[gaps[0]], unit="m")
        raise InputError(
            "coefficients", "bin", f"no numbers for {len(gaps)} time stamps, {first} the first",
            "compute coefficients with this weather and state",
        )  # fmt: skip


def _dataset(sky: xr.Dataset, arrays: dict[str, np.ndarray]) -> xr.Dataset:
    """Arrays (time, sensor) with the time stamps of a sky."""
    every = sky.coords.items()
    coords = {k: v.variable for k, v in every if v.dims == ("time",) and k != "sun_bin"}
    return xr.Dataset({name: (("time", "sensor"), a) for name, a in arrays.items()}, coords)


def _by_suns(suns: csr_matrix, C: np.ndarray, is_lit: np.ndarray) -> np.ndarray:
    """Illuminance (time, sensor) by suns (time, bin), of coefficients (sensor, bin).

    `is_lit` tells the bins that give any light, bool, shape (bin,): straight light comes from few.
    """
    bins = np.diff(suns.indptr)
    if (bins > 1).any():
        return np.asarray(suns @ C.T)
    E = np.zeros((len(bins), len(C)), np.result_type(suns, C))
    kept = np.flatnonzero(is_lit[suns.indices])
    shines, of_hour, L = np.flatnonzero(bins)[kept], suns.indices[kept], suns.data[kept, None]

    def some(here: slice) -> None:  # takes half as long as a product
        E[shines[here]] = C.T[of_hour[here]] * L[here]

    in_threads(some, pieces(len(shines), len(C)))
    return E


def direct_sun(coefficients: xr.Dataset, sky: xr.Dataset) -> xr.Dataset:
    """Illuminance by direct sun, for ASE and the shade.

    Parameters
    ----------
    coefficients : xr.Dataset
        C of the open state: `straight`, `straight_se` (sensor, bin) [sr].
    sky : xr.Dataset
        `Daylight.sky`: `sun` [cd/m²], `sun_bin`, `sun_direction` and the blend of the sun's bins.

    Returns
    -------
    xr.Dataset
        `direct_sun` and `direct_sun_se`, dims (time, sensor) [lx].
    """
    if "sun_straight" in coefficients:
        coefficients, sky = own_suns(coefficients, sky)
    suns = sun_luminances(coefficients, sky)
    out = {}
    for name in ("straight", "straight_se"):
        C = coefficients[name].values
        whole = C.sum(axis=0)  # of numbers that are not below 0
        _refuse_gaps(suns @ np.isnan(whole), sky)
        out[name.replace("straight", "direct_sun")] = _by_suns(suns, C, whole != 0)
    return describe(_dataset(sky, out))


def sun_group(coefficients: xr.Dataset, sky: xr.Dataset) -> xr.DataArray:
    """Group of panes through which the direct sun comes, (time, sensor); −1 in hours without it.

    A sensor without direct sun takes the group through which most sensors get it: a part of the sun
    that no ray has found comes through it, too. −1 marks sun that comes through no group.

    Parameters
    ----------
    coefficients, sky : xr.Dataset
        As for `direct_sun`; C holds `pane_group`.
    """
    if "sun_straight" in coefficients:
        groups = coefficients["pane_group"].rename(sun="bin")
        coefficients, sky = own_suns(coefficients, sky)
        coefficients = coefficients.assign(pane_group=groups)
    suns, straight = sun_luminances(coefficients, sky), coefficients["straight"].values
    group = coefficients["pane_group"].values
    shape = (sky.sizes["time"], straight.shape[0])
    most, nearest = np.zeros(shape, np.float32), np.full(shape, -1, np.int16)
    of_hour, best = np.full(shape[0], -1, np.int16), np.zeros(shape[0])
    for g in np.flatnonzero(np.bincount(group[group >= 0].astype(int))):
        E = suns @ np.where(group == g, straight, 0).T
        larger = most < E
        most[larger], nearest[larger] = E[larger], g
        whole = E.sum(axis=1)
        of_hour[whole > best] = g
        best = np.maximum(best, whole)
    dark = (nearest < 0) & (suns @ straight.T == 0)
    groups = np.where(dark, of_hour[:, None], nearest).astype(np.float32)
    return _dataset(sky, {"group": groups})["group"].rename(None)


def by_source(
    coefficients: xr.Dataset, sky: xr.Dataset, direct: xr.Dataset | None = None
) -> xr.Dataset:
    """Illuminance E = C·L by the sky with the ground, by the sun, and in total.

    Parameters
    ----------
    coefficients : xr.Dataset
        C of one state: `replicates` (replicate, sensor, bin) [sr]; or known `illuminance`
        (replicate, time, sensor) [lx], of which the result has the total only.
    sky : xr.Dataset
        `Daylight.sky`: `sky` (time, bin) [cd/m²], `sun` (time) [cd/m²], `sun_bin` (time).
    direct : xr.Dataset, optional
        Direct sun from `direct_sun` of the same coefficients and sky; computed by default.

    Returns
    -------
    xr.Dataset
        `sky`, `sun`, `total` and `…_se`, dims (time, sensor) [lx].

    Raises
    ------
    InputError
        A bin of the sky has no coefficients, or they are NaN.
    """
    if "illuminance" in coefficients:
        mean, error = replicates_of(coefficients).statistics(_hours_of(coefficients, sky))
        return _dataset(sky, {"total": mean, "total_se": error})
    patches = positions_of(coefficients, sky["bin"].values, SAME_SUBDIVISION)
    suns = sun_luminances(coefficients, sky)
    L = sky["sky"].values.astype(np.float32)
    out = source_sums(coefficients["replicates"].values, patches, L, suns)
    _refuse_gaps(np.isnan(out["total"].sum(axis=1)), sky)  # a third of the time of each
    if "sun_straight" in coefficients:
        straight = direct_sun(coefficients, sky) if direct is None else direct
        _add_straight(out, coefficients, sky, straight)
    return _dataset(sky, out)


def _hours_of(coefficients: xr.Dataset, sky: xr.Dataset) -> np.ndarray:
    """Places of the sky's time stamps in known illuminance, int, shape (time,)."""
    known = coefficients["time"].values
    at = np.searchsorted(known, sky["time"].values)
    at = np.minimum(at, len(known) - 1)
    if (known[at] != sky["time"].values).any():
        got = "no illuminance for some time stamps of the sky"
        raise InputError("coefficients", "time", got, "evaluate the case with this sky")
    return at


def _add_straight(
    out: dict[str, np.ndarray], coefficients: xr.Dataset, sky: xr.Dataset, straight: xr.Dataset
) -> None:
    """Add the direct sun of every time stamp to the scattered light of the mesh of suns.

    The errors of the direct sun and of interpolation in the mesh are independent of the replicates.
    """
    between = np.outer(sky["sun"].values, coefficients["mesh_error"].values).astype(np.float32)
    variance = straight["direct_sun_se"].values ** 2 + between**2
    for name in ("sun", "total"):
        out[name] += straight["direct_sun"].values
        out[f"{name}_se"] = np.sqrt(out[f"{name}_se"] ** 2 + variance)


def replicates(coefficients: xr.Dataset, sky: xr.Dataset, sensors: np.ndarray) -> np.ndarray:
    """Total illuminance E at some sensors, by each replicate of C.

    Arguments and errors are those of `by_source`; `sensors` are indices.

    Returns
    -------
    np.ndarray, shape (replicate, time, sensor)
        E [lx].
    """
    if "illuminance" in coefficients:
        known = coefficients["illuminance"].transpose("replicate", "time", "sensor").values
        return known[np.ix_(np.arange(len(known)), _hours_of(coefficients, sky), sensors)]
    patches = positions_of(coefficients, sky["bin"].values, SAME_SUBDIVISION)
    suns, L = sun_luminances(coefficients, sky), sky["sky"].values.astype(np.float32)
    by_bin = [c[sensors].T for c in coefficients["replicates"].values]
    total = np.stack([L @ c[patches] + suns @ c for c in by_bin])
    if "sun_straight" in coefficients:
        total += direct_sun(coefficients.isel(sensor=sensors), sky)["direct_sun"].values
    return total


def of_means(coefficients: xr.Dataset, sky: xr.Dataset, weights: np.ndarray) -> np.ndarray:
    """Total illuminance E of means over sensors, by each replicate of C.

    Arguments and errors are those of `by_source`, and `weights` (mean, sensor) those of the
    sensors.

    Returns
    -------
    np.ndarray, shape (replicate, time, mean)
        E [lx].
    """
    if "illuminance" in coefficients:
        hours = _hours_of(coefficients, sky)
        return replicates_of(coefficients).of_means(weights, hours)
    return replicates(_of_means(coefficients, weights), sky, np.arange(len(weights)))


def _of_means(C: xr.Dataset, weights: np.ndarray) -> xr.Dataset:
    """C of means over sensors, each of which stands for a sensor."""
    arrays = {}
    for name in (name for name in LINEAR if name in C):
        last = [dim for dim in C[name].dims if dim not in ("replicate", "sensor")]
        array = C[name].transpose(..., "sensor", *last)
        arrays[name] = (array.dims, weights @ array.values)
    kept = {name: c for name, c in C.coords.items() if "sensor" not in c.dims}
    return xr.Dataset(arrays, kept, C.attrs)


def replicates_at(
    coefficients: xr.Dataset, sky: xr.Dataset, time: np.ndarray, sensor: np.ndarray
) -> np.ndarray:
    """Total illuminance E at some pairs of a time stamp and a sensor, by each replicate of C.

    Arguments and errors are those of `by_source`; `time` and `sensor` (pair,) are indices.

    Returns
    -------
    np.ndarray, shape (replicate, pair)
        E [lx].
    """
    if "illuminance" in coefficients:
        return replicates_of(coefficients).at(_hours_of(coefficients, sky)[time], sensor)
    patches = positions_of(coefficients, sky["bin"].values, SAME_SUBDIVISION)
    suns, L = sun_luminances(coefficients, sky), sky["sky"].values.astype(np.float32)
    total = sums_at(coefficients["replicates"].values, patches, L, suns, time, sensor)
    if "sun_straight" in coefficients:
        total += direct_sun(coefficients, sky)["direct_sun"].values[time, sensor]
    return total


def illuminance(
    is_open: xr.Dataset, others: Sequence[xr.Dataset | None], sky: xr.Dataset, state: np.ndarray,
    direct: xr.Dataset | None = None,
) -> xr.Dataset:  # fmt: skip
    """Illuminance E of the period, each time stamp with its state of the façade.

    Parameters
    ----------
    is_open : xr.Dataset
        C of the open state [sr].
    others : sequence of xr.Dataset
        C of the other states [sr]; None for one without coefficients.
    sky, direct : xr.Dataset
        As for `by_source` of the open state.
    state : np.ndarray of int, shape (time,)
        State of every time stamp: 0 for the open one, then those of `others`.

    Returns
    -------
    xr.Dataset
        `total`, `total_open`, `sky_open`, `sun_open`, `direct_sun` and `…_se`, dims (time, sensor)
        [lx]; the sensors' coordinates of C and `shade_closed`. Known illuminance of the open state,
        which may be that of its own hours alone, gives `total` and `direct_sun` only.

    Raises
    ------
    InputError
        Coefficients are missing for a bin, or for the state of a time stamp.
    """
    direct = direct_sun(is_open, sky) if direct is None else direct
    states = [is_open, *others]
    if missing := np.isin(state, [i for i, each in enumerate(states) if each is None]).sum():
        raise InputError(
            "coefficients", "state", f"a state is missing; {missing} time stamps take it",
            "compute the coefficients of this state, or evaluate the case",
        )  # fmt: skip
    if "illuminance" in is_open:
        total = dict(zip(("total", "total_se"), _of_states(states, sky, state), strict=True))
        out = direct.assign({name: (("time", "sensor"), E) for name, E in total.items()})
    else:
        parts = by_source(is_open, sky, direct)
        names = ("total", "sky", "sun")
        whole = {f"{n}_open{end}": parts[n + end].variable for n in names for end in ("", "_se")}
        whole |= {name: parts[name].variable.copy() for name in ("total", "total_se")}
        out = direct.assign(whole)
        _put_in(out["total"].values, out["total_se"].values, [None, *others], sky, state)
    at = {name: c for name, c in is_open.coords.items() if c.dims == ("sensor",)}
    out = out.assign_coords(at)
    out = out.assign_coords(shade_closed=("time", state > 0))
    return describe(out)


def _of_states(
    states: Sequence[xr.Dataset | None], sky: xr.Dataset, state: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard error of known E, each time stamp with its state, (time, sensor) [lx]."""
    number, part = np.unique(state, return_inverse=True)
    some = [each for i in number.tolist() if (each := states[i]) is not None]
    first, *others = [replicates_of(each) for each in some]
    summed = all(isinstance(each, SummedReplicates) for each in others)
    if (
        summed and isinstance(first, SummedReplicates)
        and len(_hours_of(some[0], sky)) == first.shape[1]
    ):  # fmt: skip
        return first.joined(others, part)
    shape = (len(state), first.shape[2])
    mean, error = np.empty(shape, np.float32), np.empty(shape, np.float32)
    _put_in(mean, error, states, sky, state)
    return mean, error


def _put_in(
    mean: np.ndarray, error: np.ndarray, states: Sequence[xr.Dataset | None], sky: xr.Dataset,
    state: np.ndarray,
) -> None:  # fmt: skip
    """Fill in E (time, sensor) of the time stamps in each of some states."""
    for i, each in enumerate(states):
        here = np.flatnonzero(state == i)
        if each is not None and len(here):
            E = by_source(each, sky.isel(time=here))
            mean[here], error[here] = E["total"].values, E["total_se"].values
