"""Seconds of a room of boxes, and of the same room as polygons of a model.

    python -m tests.bench.models [--suns 300] [--times 5]

from the repository's root; prints Markdown. The room is the paper's classroom, which
`export --radiance` writes and `[model]` reads, with the effects of its plan. Boxes and polygons are
simulated in turn, after a first run that compiles; the ratio is that of the medians of processor
seconds.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from drcmitsuba.case.case import Case
from drcmitsuba.case.reading import load_case
from drcmitsuba.export.radiance import save_radiance
from drcmitsuba.plan import plan
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.transport.coefficients import compute
from tests.bench.__main__ import machine, table, timed

CASES = ("classroom/existing", "classroom/o2")


def as_model(case: Case, folder: Path) -> Case:
    """The case with the Radiance files that it exports in place of room, façade and furniture."""
    save_radiance(case, folder / "exported", "open")
    (folder / "case.toml").write_text(
        '[model]\nfiles = ["exported/materials.rad", "exported/scene.rad"]\n'
        '[sensors]\npoints = "exported/sensors.pts"\n'
    )
    tables = ("weather", "period", "sky", "sun", "outside", "accuracy")
    model = load_case(folder / "case.toml")
    return model.with_tables(**{name: getattr(case, name) for name in tables})


def simulation(case: Case, suns: int) -> tuple[Callable[[], object], scene.Scene]:
    """Function that computes C for the sky and for `suns` suns of the year, and its scene."""
    light = daylight(case)
    at = np.linspace(0, len(light.suns.labels) - 1, suns).round().astype(int)
    some = light.suns.only(np.array(light.suns.labels)[at])
    world = scene.load(case, effects=plan(case, light).scope)
    return partial(compute, world, *sensor_points(case), some, case.accuracy), world


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--suns", type=int, default=300, help="number of suns")
    parser.add_argument("--times", type=int, default=5, help="number of runs of each")
    options = parser.parse_args()
    print(f"{machine()}; {backend.select()}\n", flush=True)
    rows = []
    for name in CASES:
        case = load_case(name).with_tables(shading=None)
        with tempfile.TemporaryDirectory() as folder:
            both = [simulation(c, options.suns) for c in (case, as_model(case, Path(folder)))]
        rays = []
        for work, world in both:
            work()
            rays.append(world.ray_counter.counted())
        taken = np.array([[timed(work)[1] for work, _ in both] for _ in range(options.times)])
        wall, cpu = np.median(taken, axis=0).T
        ratios = [polygons / boxes for boxes, polygons in (wall, cpu)]
        counts = [f"{rays[i][kind] / 1e6:.1f}" for kind in ("shadow", "path") for i in (0, 1)]
        rows.append([
            name, *(f"{v:.2f}" for v in (*wall, ratios[0], *cpu, ratios[1])), *counts,
        ])  # fmt: skip
    table(
        ["case", "boxes: s", "polygons: s", "ratio", "boxes: CPU s", "polygons: CPU s", "ratio",
         "million shadow rays: boxes", "polygons", "million path rays: boxes", "polygons"],
        rows,
    )  # fmt: skip


if __name__ == "__main__":
    main()
