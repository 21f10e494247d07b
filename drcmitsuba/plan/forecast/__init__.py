"""What an evaluation will cost: rays, seconds, memory, disk, and the share of every effect.

scout, walks, cells
    How long paths will be, and the cells that they meet.
film_tables, survey, photons, closing
    What else geometry says: who sees the sky, suns and panes; photons; when shades close.
work
    Counts of the work, by effect and unit.
machine, cost
    How fast this machine is; seconds of a unit of work.
size
    Bytes on disk and in memory.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from drcmitsuba.plan import Plan
from drcmitsuba.plan.forecast import cost, machine, size
from drcmitsuba.plan.forecast.machine import REFERENCE, Speed, speed
from drcmitsuba.plan.forecast.work import Counted, Work, count

__all__ = [
    "REFERENCE",
    "Counted",
    "Forecast",
    "Speed",
    "Work",
    "count",
    "forecast",
    "speed",
    "told_plan",
]

REST = "rest"
"""Share of what no effect can be left out of: weather, sky, accumulation, metrics, files."""


@dataclass(frozen=True)
class Forecast:
    """What an evaluation will cost.

    Parameters
    ----------
    seconds : float
        Of all stages, as `seconds` of metrics.json add up; start-up is not in them.
    memory_bytes : int
        Largest that the process will hold.
    disk_bytes : int
    rays : dict of str to int
        By `tally.KINDS`.
    items : dict of str to float
        Work by unit, see `cost.UNITS`.
    files : dict of str to int
        Bytes of files.
    shares : dict of str to float
        Of the seconds, by effect; "rest" is what is left. Of the shaded state, and of the second
        and third colour channel, it is all of their work.
    """

    seconds: float
    memory_bytes: int
    disk_bytes: int
    rays: dict[str, int]
    items: dict[str, float]
    files: dict[str, int]
    shares: dict[str, float]

    def told(self) -> dict[str, Any]:
        """Plain values; the shares are told with the effects, see `told_plan`."""
        told = {k: v for k, v in asdict(self).items() if k != "shares"}
        told["items"] = {name: float(f"{amount:.4g}") for name, amount in self.items.items()}
        return told | {"seconds": round(self.seconds, 3)}

    def __str__(self) -> str:
        return (
            f"{_figure(self.seconds)} s, {_figure(self.memory_bytes / 2**20)} MiB of memory, "
            f"{_figure(self.disk_bytes / 1e6)} MB on disk, "
            f"{_figure(sum(self.rays.values()) / 1e6)} million rays"
        )


def _figure(value: float) -> str:
    """Two figures, and all before the point."""
    return f"{value:.0f}" if value >= 100 else f"{value:.2g}"


def told_plan(
    plan: Plan, expected: Forecast | None = None, coefficients: Mapping[str, Any] | None = None
) -> dict[str, dict[str, Any]]:
    """Plan and forecast as plain values for plan.json, {effect: {"on", "reason", "share", …}}.

    The entry "cost" has the share of what no effect can be left out of, and the forecast.
    `coefficients` are the attributes of C, where it is known.
    """
    told = plan.told(coefficients or {})
    told["cost"] = {"on": True, "reason": "no forecast"}
    if expected is not None:
        for name, effect in told.items():
            effect["share"] = round(expected.shares[REST if name == "cost" else name], 4)
        told["cost"] |= {"reason": f"forecast {expected}", "forecast": expected.told()}
    return told


def forecast(plan: Plan, on: Speed | None = None) -> Forecast:
    """Forecast what the evaluation of a plan costs; nothing is simulated for it.

    Parameters
    ----------
    plan : Plan
    on : Speed, optional
        Of the machine; by default this one's, which is measured once.

    Returns
    -------
    Forecast

    Notes
    -----
    seconds = Σ work × seconds of a unit / speed. Kernels are taken to be compiled and cached, as
    they are after the first evaluation of a kind. Samples that are added toward a target are not in
    it; `time_limit` bounds them.
    """
    counted = count(plan)
    files = size.disk(counted)
    counted.work.add(REST, "byte", sum(files.values()) - files.get("pictures", 0))
    here = machine.speed() if on is None else on
    spent = cost.by_effect(counted.work, here)
    whole = sum(spent.values())
    shares = {name: spent.get(name, 0.0) / whole for name in (*plan.effects, REST)}
    return Forecast(
        seconds=whole,
        memory_bytes=size.memory(counted),
        disk_bytes=sum(files.values()),
        rays=counted.work.rays,
        items=counted.work.by_unit,
        files=files,
        shares=shares,
    )
