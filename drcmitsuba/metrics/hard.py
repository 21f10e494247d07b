"""Daylight metrics of LM-83 and their monthly twins: illuminance over time and sensors to per cent.

Every function takes any `DataArray` with the dims `time` and `sensor`, in any order, and gives per
cent. In every threshold a tie passes. Temporal and spatial thresholds become whole counts by exact
rational arithmetic before anything is compared, since 0.55 · 100 is 55.00000000000001 in floating
point and would lose a tie.

References
----------
.. [1] IES LM-83-12, "Approved method: IES spatial daylight autonomy (sDA) and annual sunlight
   exposure (ASE)", 2012.
.. [2] C. Bauer, S. Wittkopf, "Annual daylight simulations with EvalDRC", Journal of Facade Design
   and Engineering 3, 2015, equations 1 to 6.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from fractions import Fraction

import numpy as np
import xarray as xr

from drcmitsuba.runtime.errors import InputError

# Values compared at a time: what a comparison makes stays in the cache, and a large grid is never
# copied whole.
BLOCK = 2**18


def sda(illuminance: xr.DataArray, threshold: float = 300.0, fraction: float = 0.5) -> float:
    """Spatial daylight autonomy, the share of sensors with enough daylight for enough hours.

    sDA = Σ_j S(j) / N with S(j) = 1 where s_j ≥ τ·t_y [2]_, equation 1.

    Parameters
    ----------
    illuminance : DataArray (time, sensor)
        Illuminance with the shade applied, at the hours of the evaluation period [lx].
    threshold : float
        Illuminance that counts as reached [lx].
    fraction : float
        τ, fraction of the time stamps at which it has to be reached, 0 to 1.

    Returns
    -------
    float
        sDA [%].

    Raises
    ------
    InputError
        Other dims, no time stamp or sensor, values that are not finite, a threshold out of range.
    """
    E = _values(illuminance, "illuminance")
    return _share(_count(E, threshold) >= autonomous(fraction, len(E)))


def ase(
    direct: xr.DataArray, threshold: float = 1000.0, hours: float = 250.0, step_hours: float = 1.0
) -> float:
    """Annual sunlight exposure, the share of sensors in direct sun for too many hours.

    ASE = Σ_j A(j) / N with A(j) = 1 where a_j ≥ T_y [2]_, equation 2.

    Parameters
    ----------
    direct : DataArray (time, sensor)
        Illuminance by direct sun without shade, at the hours of the evaluation period [lx].
    threshold : float
        Illuminance that counts as exposed [lx].
    hours : float
        T_y, hours of exposure in the year at which a sensor counts [h].
    step_hours : float
        Length of the interval that one time stamp stands for [h].

    Returns
    -------
    float
        ASE [%].

    Raises
    ------
    InputError
        As `sda`.
    """
    a_j = _count(_values(direct, "direct"), threshold)
    return _share(a_j >= exposed(hours, step_hours))


def msda(
    illuminance: xr.DataArray, threshold: float = 300.0, fraction: float = 0.5
) -> xr.DataArray:
    """Monthly spatial daylight autonomy: `sda` with τ relative to the stamps of each month.

    msDA_m = Σ_j S(j, m) / N with S(j, m) = 1 where s_{j,m} ≥ τ·t_m [2]_, equation 3.

    Parameters
    ----------
    illuminance : DataArray (time, sensor)
        As for `sda`. The month of a stamp is that of the coordinate `clock` where there is one,
        else that of `time`.
    threshold, fraction : float
        As for `sda`.

    Returns
    -------
    DataArray (month,)
        msDA [%] of the months 1 to 12, NaN for a month without time stamps.

    Raises
    ------
    InputError
        As `sda`; stamps that are not dates.
    """
    shares = _monthly(
        illuminance, "illuminance", threshold, lambda t_m, t_y: autonomous(fraction, t_m)
    )
    shares.attrs["long_name"] = "monthly spatial daylight autonomy"
    return shares.rename("msDA")


def mse(
    direct: xr.DataArray, threshold: float = 1000.0, hours: float = 250.0, step_hours: float = 1.0
) -> xr.DataArray:
    """Monthly sunlight exposure: `ase` with its hours relative to the stamps of each month.

    MSE_m = Σ_j A(j, m) / N with A(j, m) = 1 where a_{j,m} ≥ T_m [2]_, equation 4. The paper gives
    no number for T_m but says that it is relative to the month's time stamps: T_m = hours·t_m/t_y.

    Parameters
    ----------
    direct : DataArray (time, sensor)
        As for `ase`; months as for `msda`.
    threshold, hours, step_hours : float
        As for `ase`; `hours` are those of the whole of `direct`.

    Returns
    -------
    DataArray (month,)
        MSE [%] of the months 1 to 12, NaN for a month without time stamps.

    Raises
    ------
    InputError
        As `msda`.
    """
    shares = _monthly(
        direct, "direct", threshold, lambda t_m, t_y: exposed(hours, step_hours, t_m, t_y)
    )
    shares.attrs["long_name"] = "monthly sunlight exposure"
    return shares.rename("MSE")


def shade_closed(
    direct: xr.DataArray, threshold: float = 1000.0, area: float = 0.02
) -> xr.DataArray:
    """Time stamps at which the shade is closed: when enough of the sensors lie in direct sun.

    closed(t) where #{j : E_j(t) ≥ threshold} ≥ area·N [2]_, section 2.3.2.

    Parameters
    ----------
    direct : DataArray (time, sensor)
        Illuminance by direct sun without shade [lx].
    threshold : float
        Illuminance that counts as exposed [lx].
    area : float
        Fraction of the sensors that closes the shade, 0 to 1. A tie closes it, so 0 always does.

    Returns
    -------
    DataArray (time,), bool
        True where the shade is closed, with the coordinates of `time` in `direct`.

    Raises
    ------
    InputError
        As `sda`.
    """
    E = _values(direct, "direct")
    least = closing_sensors(area, E.shape[1])
    limit = _not_negative("threshold", threshold)
    count = [np.count_nonzero(block >= limit, axis=1) for block in _blocks(E)]
    closed = direct.isel(sensor=0, drop=True).copy(data=np.concatenate(count) >= least)
    closed.name, closed.attrs = "shade_closed", {"long_name": "shade closed"}
    return closed


def autonomous(fraction: float, stamps: int) -> int:
    """Time stamps, of so many, at which a sensor has to have enough light for sDA or msDA."""
    return math.ceil(_fraction("fraction", fraction) * stamps)


def exposed(hours: float, step_hours: float, stamps: int = 1, of: int = 1) -> int:
    """Time stamps in the sun at which a sensor counts for ASE, or for MSE of `stamps` of `of`."""
    return math.ceil(_stamps(hours, step_hours) * stamps / of)


def closing_sensors(area: float, sensors: int) -> int:
    """Sensors in the sun, of so many, that close the shade."""
    return math.ceil(_fraction("area", area) * sensors)


def months(array: xr.DataArray, name: str = "illuminance") -> np.ndarray:
    """Month 1 to 12 of each time stamp, by the clock that the hours are kept by."""
    key = "clock" if "clock" in array.coords else "time"
    if key not in array.coords or array[key].dims != ("time",) or array[key].dtype.kind != "M":
        raise InputError(name, key, "no dates along time", "give a datetime64 for each time stamp")
    if array[key].isnull().any():
        raise InputError(name, key, "NaT", "give a datetime64 for each time stamp")
    return array[key].dt.month.values


@dataclass(frozen=True)
class Interval:
    """A value and its 95 % confidence interval, all in the unit of the value."""

    value: float
    low: float
    high: float

    def as_dict(self) -> dict[str, float]:
        """Give `{"value", "low", "high"}` as in `metrics.json`."""
        return asdict(self)


def _values(array: xr.DataArray, name: str) -> np.ndarray:
    """Give the values [time, sensor], a view where the array holds them in memory, checked."""
    if not isinstance(array, xr.DataArray):
        raise InputError(name, "type", type(array).__name__, "give an xarray DataArray")
    if set(array.dims) != {"time", "sensor"}:
        dims = ", ".join(map(str, array.dims)) or "none"
        raise InputError(name, "dims", dims, "give an array with exactly the dims time, sensor")
    if array.size == 0:
        raise InputError(name, "size", f"{dict(array.sizes)}", "give a time stamp and a sensor")
    if array.dtype.kind not in "fiu":
        raise InputError(name, "dtype", f"{array.dtype}", "give real numbers [lx]")
    E = array.transpose("time", "sensor").values
    if not all(np.isfinite(block).all() for block in _blocks(E)):
        bad = sum(int((~np.isfinite(block)).sum()) for block in _blocks(E))
        raise InputError(
            name, "values", f"{bad} of {E.size} are NaN or infinite", "give finite illuminances"
        )
    return E


def _blocks(E: np.ndarray) -> Iterator[np.ndarray]:
    """Cut `E[time, sensor]` along time."""
    rows = max(1, BLOCK // E.shape[1])
    return (E[start : start + rows] for start in range(0, len(E), rows))


def _count(E: np.ndarray, threshold: float) -> np.ndarray:
    """Count the time stamps with E ≥ threshold, for each sensor."""
    limit = _not_negative("threshold", threshold)
    count = np.zeros(E.shape[1], dtype=np.int64)
    for block in _blocks(E):
        count += np.count_nonzero(block >= limit, axis=0)
    return count


def _share(passed: np.ndarray) -> float:
    """Share of the sensors that passed [%]."""
    return 100.0 * int(passed.sum()) / len(passed)


def _exact(value: float) -> Fraction:
    """Rational number that the float stands for: 0.55 is 11/20, ten minutes are 1/6 hour."""
    return Fraction(value).limit_denominator(10**9)


def _fraction(name: str, value: float) -> Fraction:
    if not 0 <= value <= 1:
        raise InputError("metrics", name, f"{value}", "give a fraction from 0 to 1")
    return _exact(float(value))


def _stamps(hours: float, step_hours: float) -> Fraction:
    """Give the number of time stamps, not rounded, that make up `hours`."""
    step = _exact(_not_negative("step_hours", step_hours))
    if step == 0:
        raise InputError("metrics", "step_hours", f"{step_hours}", "give hours above 0")
    return _exact(_not_negative("hours", hours)) / step


def _not_negative(name: str, value: float) -> float:
    # A plain float takes the array's type in a comparison, so that 300.3 ties with float32(300.3).
    if not 0 <= value < math.inf:
        raise InputError("metrics", name, f"{value}", "give a finite number, 0 or above")
    return float(value)


def _monthly(
    array: xr.DataArray, name: str, threshold: float, least: Callable[[int, int], int]
) -> xr.DataArray:
    """Share [%] of the sensors that reach, in each month, `least(t_m, t_y)` time stamps."""
    E, month = _values(array, name), months(array, name)
    shares = xr.DataArray(np.full(12, np.nan), {"month": np.arange(1, 13)}, attrs={"units": "%"})
    for m in np.unique(month):
        of_month = E[month == m]
        shares.loc[m] = _share(_count(of_month, threshold) >= least(len(of_month), len(E)))
    return shares
