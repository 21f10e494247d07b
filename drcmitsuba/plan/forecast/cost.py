"""Seconds of each unit of work on the reference machine, and the forecast for this machine."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.sun import Adaptive
from drcmitsuba.plan import Plan
from drcmitsuba.plan.forecast import size
from drcmitsuba.plan.forecast.summed import states_of_year
from drcmitsuba.plan.forecast.work import work
from drcmitsuba.runtime import machine_speed
from drcmitsuba.runtime.machine_speed import Speed
from drcmitsuba.runtime.progress import rough
from drcmitsuba.runtime.ray_counter import KINDS
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.surfaces import bounds_of_rooms
from drcmitsuba.schema import LUMINANCE_WEIGHTS

SHORT = 1 << 28
"""Largest number of coefficients and rays, of sensors and cells, of a short evaluation."""
BOUNCES = 16
"""Number of rays of a path that follows all bounces, in a white room."""
REST = "rest"
"""Share of the work that no effect saves: weather, sky, accumulation, metrics, files."""
KERNELS: Mapping[str, float] = {
    # Rays: towards sky and suns, of the gather, towards panes that scatter, of photons.
    "shadow": 8.2e-8,
    "path": 1.4e-7,
    "pane": 3.8e-8,
    "photon": 1.4e-7,
    # Numbers of D, products of G·D, answers of films to suns, and the sums of answers.
    "deposit": 4.8e-9,
    "product": 3.8e-11,
    "film_sun": 2.1e-8,
    "film_sum": 3.9e-9,
}
"""Seconds of a unit of work in kernels."""
HOST: Mapping[str, float] = {
    # Blocks of sensors in a replicate, coefficients of a replicate, evaluations.
    "launch": 0.073,
    "entry": 8.4e-8,
    "evaluation": 0.8,
    # Illuminances of replicates; bytes of files; pictures.
    "illuminance": 8e-8,
    "byte": 1.6e-8,
    "picture": 2.0,
}
"""Seconds of a unit of work in NumPy and Python.

Both are seconds on the reference machine, fitted to the stages of the 15 shipped cases; refit them
with `python -m tests.bench.forecast --fit`."""


@dataclass(frozen=True)
class Forecast:
    """Forecast of the cost of an evaluation."""

    seconds: float
    """Sum of the `seconds` of all stages in metrics.json, without start-up."""
    memory_bytes: int
    """Largest number of bytes that the process holds."""
    disk_bytes: int
    """Number of bytes of all files."""
    rays: dict[str, int]
    """Number of rays by kind, see `ray_counter.KINDS`."""
    items: dict[str, float]
    """Amount of work by unit, see `KERNELS` and `HOST`."""
    files: dict[str, int]
    """Number of bytes by file."""
    shares: dict[str, float]
    """Shares of the seconds by effect [–]; "rest" is the share that no effect saves. All work for
    the closed shade is "shaded_state", all work for the second and third channel "colour"."""
    summed_states: int = 0
    """Number of states of the façade, roughly, where they are so many that E is a sum over groups
    of panes; else 0."""

    def beside(self, effects: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
        """Entries of plan.json: the effects with their shares, and "cost" with the forecast."""
        values = {name: value for name, value in asdict(self).items() if name != "shares"}
        values["items"] = {name: float(f"{amount:.4g}") for name, amount in self.items.items()}
        values["seconds"] = round(self.seconds, 3)
        shares = {name: round(share, 4) for name, share in self.shares.items()}
        cost = {"on": True, "reason": f"forecast {self}", "share": shares[REST], "forecast": values}
        entries = {n: {**e, "share": shares[n]} for n, e in effects.items()} | {"cost": cost}
        if self.summed_states:
            many = f"; about {self.summed_states} states of the façade"
            entries["shaded_state"]["reason"] += f"{many}: E is a sum over groups of panes"
        return entries

    def __str__(self) -> str:
        return (
            f"{rough(self.seconds)} s, {rough(self.memory_bytes / 2**20)} MiB of memory, "
            f"{rough(self.disk_bytes / 1e6)} MB on disk, "
            f"{rough(sum(self.rays.values()) / 1e6)} million rays"
        )


def is_short(plan: Plan) -> bool:
    """Whether an evaluation takes only a few times as long as the pilot of its forecast.

    It has few coefficients and rays of sensors and cells, counted in all replicates, channels and
    states, and no photons, and its samples are drawn once. Furniture may double the cells of walls.
    """
    case, scope = plan.simulated, plan.scope
    sensors = len(prepared(case).receivers)
    a = case.accuracy.of_points(sensors)
    photons = plan.effects["components"].on or plan.effects["pane_to_pane"].on
    once = a.sensor_goal is None and not isinstance(case.sun, Adaptive)
    if photons or not once or len(prepared(case).groups.states) > 1:
        return False
    near = bounds_of_rooms(case)
    if case.room is None and near is None:
        return False
    x, y, z = case.room.size if near is None else near[1] - near[0]  # type: ignore[union-attr]
    cells = 2 * 2 * (x * y + y * z + z * x) / a.cell_size**2
    bins = len(Patches(case.sky.subdivision))
    bins += int(scope.enabled_suns(plan.facts.light.suns).sum())
    of_path = 1 if scope.solved_cells else BOUNCES
    of_sensor = bins + of_path * a.paths + a.sensor_sky_rays + a.pane_points
    of_cell = bins + a.cell_paths + a.cell_sky_rays + a.pane_points
    sums = a.replicates * (1 + scope.shade) * (len(LUMINANCE_WEIGHTS) if scope.channels else 1)
    return bool(sums * (sensors * of_sensor + cells * of_cell) <= SHORT)


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
    here = machine_speed.speed() if on is None else on
    counted = work(plan)
    files = size.disk(counted)
    counted.add([(REST, "byte", sum(files.values()) - files.get("pictures", 0))])
    items = counted.by_unit
    each = {name: value / here.rays for name, value in KERNELS.items()}
    each |= {name: value / here.host for name, value in HOST.items()}
    seconds: Counter[str] = Counter()
    for (effect, unit), amount in counted.amounts.items():
        seconds[effect] += amount * each[unit]  # type: ignore[assignment]
    whole = sum(seconds.values())
    return Forecast(
        seconds=whole,
        memory_bytes=size.memory(counted),
        disk_bytes=sum(files.values()),
        rays={kind: round(items[kind]) for kind in KINDS},
        items=dict(items),
        files=files,
        shares={name: seconds[name] / whole for name in (*plan.effects, REST)},
        summed_states=states_of_year(plan) if counted.summed is not None else 0,
    )
