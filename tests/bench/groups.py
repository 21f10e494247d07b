"""A year of ten groups of windows with twenty states each: python -m tests.bench.groups

Prints the seconds to simulate every group in every state, those of a year whose states are drawn
at random hour by hour, and beside it a direct simulation of some of these hours.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from drcmitsuba.annual import simulation
from drcmitsuba.annual.elements import elements
from drcmitsuba.annual.run import Run
from drcmitsuba.case.case import Case
from drcmitsuba.metrics import accumulate
from drcmitsuba.plan import plan
from drcmitsuba.runtime import backend
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.sky.luminances import sources

GROUPS, STATES = 10, 20
HOURS_AGAIN = 3


def case(sensors: int, replicates: int) -> Case:
    """Room with five windows to the south and five to the east, one above the other."""
    names = [f"glass{i}" for i in range(GROUPS)]
    glass = {"type": "glazing", "transmittance": 0.7, "reflectance": 0.1}
    cloth = {
        f"cloth{k}": {"type": "diffuser", "transmittance": 0.6 / k, "reflectance": 0.02 * k}
        for k in range(1, STATES)
    }

    def strips(which: list[str]) -> dict:
        edges = np.linspace(0.5, 2.9, len(which) + 1).round(3).tolist()
        rows = zip(edges, edges[1:], which, strict=False)
        return {"strips": [{"bottom": b, "top": t, "material": m} for b, t, m in rows]}

    return Case.model_validate(
        {
            "name": "ten groups",
            "site": {"latitude": 46.2, "longitude": 6.1, "timezone": 1},
            "period": {"calendar": "LM-83"},
            "room": {"size": [8.0, 8.0, 3.0], "floor": 0.2, "walls": 0.5, "ceiling": 0.8},
            "facade": {"south": strips(names[:5]), "east": strips(names[5:])},
            "materials": {**dict.fromkeys(names, glass), **cloth},
            "groups": {n: {"panes": [n], "states": list(cloth)} for n in names},
            "sensors": {"corner": [0.5, 0.5, 0.8], "count": [sensors] * 2,
                        "spacing": 7.0 / (sensors - 1)},
            "accuracy": {"replicates": replicates},
        }
    )  # fmt: skip


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sensors", type=int, default=12, help="sensors along each edge")
    parser.add_argument("--replicates", type=int, default=8)
    options = parser.parse_args()
    backend.select()
    room = case(options.sensors, options.replicates)
    light = daylight(room)
    run = Run.of(room, plan(room, light).scope)
    start = time.perf_counter()
    year = elements(room)
    by_element = year.channels[0]
    print(f"{GROUPS} groups x {STATES} states, {len(by_element.positions)} sensors, "
          f"{light.sky.sizes['time']} hours: C in {time.perf_counter() - start:.0f} s, "
          f"{by_element.nbytes / 2**30:.1f} GiB")  # fmt: skip
    states = np.random.default_rng(1).integers(0, STATES, (light.sky.sizes["time"], GROUPS))
    start = time.perf_counter()
    E = year.in_states(states)
    print(f"E of a year of random states: {time.perf_counter() - start:.1f} s")
    sunny = np.flatnonzero(light.sky["sun"].values > 0)
    for hour in sunny[np.linspace(0, len(sunny) - 1, HOURS_AGAIN + 2).astype(int)[1:-1]]:
        at = light.sky.isel(time=[hour])
        state = year.groups.label(states[hour])
        again = replace(run, seed=run.seed + 1)
        C = simulation.transport(room, state, light.suns.only(sources(at)), 46.2, run=again)
        direct = accumulate.by_source(C, at)
        ours, theirs = E["total"].values[hour].mean(), direct["total"].values.mean()
        each = accumulate.replicates(C, at, np.arange(C.sizes["sensor"])).mean(axis=(1, 2))
        error = np.hypot(E["total_se"].values[hour].mean(), each.std(ddof=1) / len(each) ** 0.5)
        print(f"{str(at['time'].values[0])[:16]}: {ours:.1f} lx, direct {theirs:.1f} lx, "
              f"{100 * (ours / theirs - 1):+.2f} ± {100 * error / theirs:.2f} %")  # fmt: skip


if __name__ == "__main__":
    main()
