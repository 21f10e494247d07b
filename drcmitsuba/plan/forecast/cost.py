"""Seconds of each unit of work on the reference machine, and the forecast for this machine."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

from drcmitsuba.plan import Plan
from drcmitsuba.plan.forecast import machine, size
from drcmitsuba.plan.forecast.machine import Speed
from drcmitsuba.plan.forecast.work import count

REST = "rest"
"""Share of the work that no effect saves: weather, sky, accumulation, metrics, files."""


class Unit(NamedTuple):
    """Seconds of one unit of work on the reference machine, in kernels or in NumPy and Python."""

    seconds: float
    kernel: bool = True


UNITS: Mapping[str, Unit] = {
    # Rays: towards sky and suns, of the gather, towards panes that scatter, of photons.
    "shadow": Unit(2.5e-8),
    "path": Unit(7.2e-8),
    "pane": Unit(1.8e-8),
    "photon": Unit(5.4e-8),
    # Shadow rays by clear panes, in addition; lanes that may trace a ray; photons at their ports.
    "pierced": Unit(4.5e-8),
    "sky_lane": Unit(1.2e-8),
    "sun_lane": Unit(1.25e-8),
    "look": Unit(8e-9),
    "start": Unit(6e-8),
    # Numbers of D, products of G·D, answers of films: to suns, to the sky, and their sums.
    "deposit": Unit(2.4e-9),
    "product": Unit(2.4e-11),
    "film_sun": Unit(1.45e-8),
    "film_sky": Unit(4e-8),
    "film_sum": Unit(1.8e-9),
    # Scenes, blocks of sensors in a replicate, coefficients of a replicate.
    "state": Unit(0.04, kernel=False),
    "launch": Unit(0.05, kernel=False),
    "entry": Unit(4.5e-8, kernel=False),
    # Time stamps × patches, products of C·L, illuminances of replicates and their draws.
    "evaluation": Unit(0.3, kernel=False),
    "luminance": Unit(9e-7, kernel=False),
    "accumulated": Unit(3e-11, kernel=False),
    "illuminance": Unit(2.8e-8, kernel=False),
    "byte": Unit(6e-9, kernel=False),
    "picture": Unit(1.0, kernel=False),
}
"""Units of work, fitted by `python -m tests.bench.forecast --fit` to processor seconds; those of
kernels are halved for the two threads of the reference machine."""


@dataclass(frozen=True)
class Forecast:
    """Forecast of the cost of an evaluation.

    Parameters
    ----------
    seconds : float
        Sum of the `seconds` of all stages in metrics.json, without start-up.
    memory_bytes : int
        Largest number of bytes that the process holds.
    disk_bytes : int
        Number of bytes of all files.
    rays : dict of str to int
        Number of rays by kind, see `ray_counter.KINDS`.
    items : dict of str to float
        Amount of work by unit, see `UNITS`.
    files : dict of str to int
        Number of bytes by file.
    shares : dict of str to float
        Shares of the seconds by effect [–]; "rest" is the share that no effect saves. All work for
        the closed shade is "shaded_state", all work for the second and third channel "colour".
    """

    seconds: float
    memory_bytes: int
    disk_bytes: int
    rays: dict[str, int]
    items: dict[str, float]
    files: dict[str, int]
    shares: dict[str, float]

    def to_dict(self) -> dict[str, Any]:
        """Plain values without the shares, which plan.json has beside the effects."""
        values = {name: value for name, value in asdict(self).items() if name != "shares"}
        items = {name: float(f"{amount:.4g}") for name, amount in self.items.items()}
        return values | {"items": items, "seconds": round(self.seconds, 3)}

    def __str__(self) -> str:
        return (
            f"{_figure(self.seconds)} s, {_figure(self.memory_bytes / 2**20)} MiB of memory, "
            f"{_figure(self.disk_bytes / 1e6)} MB on disk, "
            f"{_figure(sum(self.rays.values()) / 1e6)} million rays"
        )


def _figure(value: float) -> str:
    """Write a number with two significant digits, or as a whole number."""
    return f"{value:.0f}" if value >= 100 else f"{value:.2g}"


def to_dict(
    plan: Plan, expected: Forecast | None = None, coefficients: Mapping[str, Any] | None = None
) -> dict[str, dict[str, Any]]:
    """Plan and forecast as plain values for plan.json, {effect: {"on", "reason", "share", …}}.

    Parameters
    ----------
    plan : Plan
    expected : Forecast, optional
    coefficients : mapping, optional
        Attributes of C, where it is known.

    Returns
    -------
    dict
        Entries by effect; the entry "cost" has the share of "rest", and the forecast.
    """
    entries = plan.to_dict(coefficients or {})
    entries["cost"] = {"on": True, "reason": "no forecast"}
    if expected is not None:
        for name, entry in entries.items():
            entry["share"] = round(expected.shares[REST if name == "cost" else name], 4)
        entries["cost"] |= {"reason": f"forecast {expected}", "forecast": expected.to_dict()}
    return entries


def forecast(plan: Plan, on: Speed | None = None) -> Forecast:
    """Forecast what the evaluation of a plan costs, from a pilot of it.

    Parameters
    ----------
    plan : Plan
    on : Speed, optional
        Speed of the machine; by default the speed of this machine, measured once.

    Returns
    -------
    Forecast

    Notes
    -----
    seconds = Σ amount of work × seconds of its unit / speed. The forecast assumes that kernels are
    compiled and cached, as they are after the first evaluation of a kind. It leaves out the samples
    that adaptive sampling adds toward a target; `time_limit` bounds these.
    """
    here = machine.speed() if on is None else on
    counted = count(plan)
    files = size.disk(counted)
    counted.work.add([(REST, "byte", sum(files.values()) - files.get("pictures", 0))])
    seconds: dict[str, float] = defaultdict(float)
    for (effect, unit), amount in counted.work.amounts.items():
        each, kernel = UNITS[unit]
        seconds[effect] += amount * each / (here.rays if kernel else here.host)
    whole = sum(seconds.values())
    return Forecast(
        seconds=whole,
        memory_bytes=size.memory(counted),
        disk_bytes=sum(files.values()),
        rays=counted.work.rays,
        items=counted.work.by_unit,
        files=files,
        shares={name: seconds[name] / whole for name in (*plan.effects, REST)},
    )
