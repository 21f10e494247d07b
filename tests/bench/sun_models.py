"""One sunny hour in O3, with clear glass below a prism film, by an exact sun and by sun models.

    python -m tests.bench.sun_models OUT.png [--weather FILE] [--time 2015-03-21T08:00]

from the repository's root; without a weather file in the package's default year.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.reading import load_case
from drcmitsuba.case.sun import Adaptive, Daysim, FivePhase, ThreePhase, TrueSun
from drcmitsuba.case.weather import PeriodTable
from drcmitsuba.metrics import accumulate
from drcmitsuba.report import plots
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky import daylight
from drcmitsuba.sky.luminances import sources
from drcmitsuba.transport.coefficients import compute
from drcmitsuba.transport.sun_interpolation import meshed, with_straight

CASE = "classroom/reference/o3"
HOUR = "2015-03-21T08:00"
MODELS = {
    kind.model_fields["model"].annotation.__args__[0]: kind
    for kind in (TrueSun, ThreePhase, FivePhase, Daysim, Adaptive)
}
SAMPLES: dict[str, Any] = {
    "replicates": 16, "paths": 128, "pane_points": 128, "film_sky_samples": 128,
}  # fmt: skip
SHOWN = {
    "true_sun": "exact sun,\n0.5° across",
    "three_phase": "three-phase, MF 1:\nspread over four patches",
    "five_phase": "moved to the nearest\npatch of MF 6",
}


def light_of(case: Case, model: str, hour: str) -> daylight.Daylight:
    """Sky and sun of one hour by a sun model; the others of its month are left out."""
    month = int(hour[5:7])
    changed = case.model_copy(
        update={
            "sun": MODELS[model](model=model),
            "period": PeriodTable(months=(month,), calendar="LM-83", hours=(0, 24)),
        }
    )
    of_month = daylight.daylight(changed)
    sky = of_month.sky.sel(time=[np.datetime64(hour)])
    suns = of_month.suns.only(sources(sky))
    return daylight.Daylight(sky, of_month.sun, suns, of_month.step_hours, of_month.source)


def illuminance(case: Case, model: str, hour: str, accuracy: Accuracy) -> xr.Dataset:
    """E of one hour by a sun model: `sky`, `sun`, `total` and `…_se`, dims (time, sensor) [lx]."""
    light = light_of(case, model, hour)
    world, (points, normals) = scene.load(case), sensor_points(case)
    if model == "adaptive":
        kind = Adaptive(model="adaptive")
        C = meshed(
            world, points, normals, light.suns.diameter, accuracy,
            latitude=light.sky.attrs["latitude"], tolerance=kind.tolerance, finest=kind.finest,
        )  # fmt: skip
        C = with_straight(C, world, points, normals, light.suns, accuracy)
    else:
        C = compute(world, points, normals, light.suns, accuracy)
    E = accumulate.by_source(C, light.sky)
    return E.assign_coords({axis: ("sensor", points[:, i]) for i, axis in enumerate("xyz")})


def picture(case: Case, hour: str, accuracy: Accuracy) -> Figure:
    """Plans of E side by side, with one scale, for an exact sun and two models."""
    plans = {model: illuminance(case, model, hour, accuracy).total[0] for model in SHOWN}
    values = np.stack([plan.values for plan in plans.values()])
    norm = LogNorm(*np.percentile(values, [0, 100]))
    width, depth, _ = case.room.size
    room = np.array([[0, 0], [width, 0], [width, depth], [0, depth], [0, 0]])
    figure = Figure(figsize=(6, 2.7))
    when = np.datetime64(hour).item()
    span = f"{when.day} {when:%B}, {when.hour} to {when.hour + 1} h"
    title = f"Illuminance at desk height, {span} [lx]"
    figure.text(0.02, 0.975, title, fontsize=9, weight="bold", va="top")
    for i, (model, plan) in enumerate(plans.items()):
        ax = figure.add_axes((0.02 + 0.295 * i, 0.09, 0.28, 0.28 * 6 / 2.7 * depth / width))
        grid = plan.values.reshape(case.sensors.count[::-1])
        x, y = (np.unique(plan[axis].values.round(6)) for axis in "xy")
        shown: Any = ax.pcolormesh(x, y, grid, cmap="viridis", norm=norm, rasterized=True)
        ax.plot(*room.T, **{**plots.LINES["room"], "linewidth": 1.2})
        ax.plot([0, width], [0, 0], **{**plots.LINES["glazing"], "linewidth": 3})
        ax.set(xlim=(-0.15, width + 0.15), ylim=(-0.15, depth + 0.15))
        ax.set_aspect("equal")
        ax.axis("off")
        ax.set_title(SHOWN[model], fontsize=8, loc="left", x=0.02, pad=3)
        text = f"mean {plan.values.mean():.0f}, {plan.values.min():.0f} to {plan.values.max():.0f}"
        ax.text(0.02, -0.02, text, fontsize=8, transform=ax.transAxes, va="top")
    bar = figure.add_axes((0.912, 0.11, 0.018, 0.62))
    figure.colorbar(shown, cax=bar)
    ticks = [t for t in (200, 500, 1000, 2000, 5000, 10_000, 20_000) if norm.vmin < t < norm.vmax]
    bar.set_yticks(ticks, [f"{t:g}" for t in ticks], fontsize=8)
    bar.minorticks_off()
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path)
    parser.add_argument("--weather", type=Path)
    parser.add_argument("--time", default=HOUR)
    given = parser.parse_args()
    backend.select()
    case = load_case(CASE).with_weather(given.weather)
    plots.save(picture(case, given.time, Accuracy(**SAMPLES)), given.file)


if __name__ == "__main__":
    main()
