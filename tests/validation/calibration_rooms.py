"""Do intervals of single sensors hold in rooms of many kinds, also in their darkest quarter?

    python -m tests.validation.calibration_rooms [--rooms a,b] [--seeds 30]

from the repository's root, with the test extras installed; writes the table of coverage to
`docs/validation/calibration.md`.

Rationale: sums may be right where single places are not, and an interval can be wrong where nothing
else is. Light that is blurred between a dark place and its bright neighbour shows in the dark one.

Method: rooms with a grid of sensors, the sky of 145 patches (its sum) and thirty suns of 0.533° of
March, June and December, with the default samples of a case. Interreflected light of every seed is
compared with the plain path tracer `coefficient`, which shares neither cells nor replicates with
the program. Sensors are sorted into quarters by brightness. An interval is the mean of six
replicates ± 2.57 of their standard error; the path tracer's own error is added to it. Suns that
give a sensor less than a thousandth of what the brightest pair gets are left out.
"""

from __future__ import annotations

import argparse
import datetime
import math
import platform
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mitsuba as mi
import numpy as np
from scipy.stats import t as student

from drcmitsuba.case.case import Case
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport import coefficients
from tests.model_rooms import l_room

PAGE = Path(__file__).parents[2] / "docs" / "validation" / "calibration.md"
DIAMETER = 0.533
SPP, CHUNKS = 2048, 16
"""Paths of a sensor in each of the chunks of the path tracer."""
FAINT = 1e-3
GLASS = {"glass": {"type": "glazing", "transmittance": 0.65}}
STRIP = {"bottom": 0.9, "top": 2.7, "material": "glass"}
SKY, SUNS = slice(1, 146), slice(146, None)


def suns() -> Suns:
    """Ten suns each of an equinox and both solstices at 46° north, around noon."""
    latitude, out = math.radians(46.2), []
    for declination, longest in ((0.0, 60.0), (23.4, 45.0), (-23.4, 45.0)):
        d, hour = math.radians(declination), np.radians(np.linspace(-longest, longest, 10))
        east = -math.cos(d) * np.sin(hour)
        north = math.cos(latitude) * math.sin(d) - math.sin(latitude) * math.cos(d) * np.cos(hour)
        up = math.sin(latitude) * math.sin(d) + math.cos(latitude) * math.cos(d) * np.cos(hour)
        out.append(np.stack([east, north, up], axis=1))
    directions = np.concatenate(out)
    return Suns(tuple(f"sun_{i}" for i in range(len(directions))), directions, DIAMETER)


def box(size, sensors, strips=(STRIP,), furniture=(), **room) -> Case:
    """Case of a room with a façade to the south; sensors are its height and its spacing [m]."""
    height, spacing = sensors
    count = [int((length - 0.4) // spacing) for length in size[:2]]
    surfaces = {"size": size, "floor": 0.2, "ceiling": 0.8, "walls": 0.5} | room
    return Case.model_validate(
        {
            "room": surfaces,
            "facade": {"south": {"strips": list(strips)}},
            "materials": GLASS,
            "furniture": list(furniture),
            "sensors": {"corner": [0.2, 0.2, height], "count": count, "spacing": spacing},
        }
    )


def many(corner, size, count, step, reflectance=0.4):
    """Table of equal bodies."""
    return {
        "corner": corner, "size": size, "count": count, "step": step, "reflectance": reflectance,
    }  # fmt: skip


ROOMS: dict[str, Callable[[], Case]] = {
    "empty": lambda: box([8.0, 8.0, 3.0], (0.8, 0.7)),
    "furnished": lambda: box(
        [8.0, 8.0, 3.0],
        (0.35, 0.6),
        furniture=[
            many([0.6, 0.7, 0.72], [1.4, 0.7, 0.02], [4, 5], [1.9, 1.45], 0.5),
            many([0.6, 1.42, 0.0], [1.4, 0.04, 1.3], [4, 5], [1.9, 1.45]),
            many([2.02, 0.7, 0.0], [0.04, 0.7, 0.72], [4, 5], [1.9, 1.45]),
        ],
    ),
    "shelves": lambda: box(
        [8.0, 8.0, 3.0],
        (0.8, 0.6),
        furniture=[many([1.0, 1.2, 0.0], [6.0, 0.35, 2.0], [1, 5], [7.0, 1.3])],
    ),
    "corridor": lambda: box([2.0, 16.0, 3.0], (0.8, 0.5)),
    "atrium": lambda: box(
        [10.0, 10.0, 9.0], (0.8, 0.9), strips=[{"bottom": 0.5, "top": 8.5, "material": "glass"}]
    ),
    "deep": lambda: box([5.0, 14.0, 3.0], (0.8, 0.7)),
    "white": lambda: box([5.0, 6.0, 2.8], (0.8, 0.6), floor=0.8, walls=0.9, ceiling=0.9),
    "slats": lambda: box(
        [5.0, 6.0, 3.0],
        (0.8, 0.6),
        furniture=[
            many([0.3, 0.08, 1.0], [4.4, 0.08, 0.005], [1, 1], [5.0, 1.0])
            | {"corner": [0.3, 0.08, 1.0 + 0.12 * i]}
            for i in range(14)
        ],
    ),
    "roof light and partition": lambda: l_room(
        sensors={"floors": ["floor"], "height": 0.8, "spacing": 0.6}
    ),
}
"""Rooms by their kind."""


@dataclass(frozen=True)
class Coverage:
    """How intervals of a source's light hold in a quarter of the sensors."""

    source: str
    quarter: int
    bias: float
    """Mean of the light of all seeds over the truth, less 1."""
    bias_error: float
    covered: float
    """Share of entries whose interval holds the truth."""
    stated: float
    """Median standard error over the truth."""


def truth(case: Case) -> np.ndarray:
    """Interreflected light by the path tracer [sr], shape (chunk, sensor, bin)."""
    points, normals = sensor_points(case)
    sources = {
        "sky": {"type": "tregenza_sky"},
        "suns": {
            "type": "sun_disks", "diameter": DIAMETER,
            "directions": mi.TensorXf(suns().directions.astype(np.float32)),
        },
    }  # fmt: skip
    shapes = {f"shape{i}": s for i, s in enumerate(scene.load(case).full.shapes())}
    lit = mi.load_dict({"type": "scene", **shapes, **sources}, optimize=False)
    integrator = mi.load_dict({"type": "coefficient", "suns_per_vertex": 30})
    return np.stack([integrator.sensors(lit, points, normals, SPP, i).numpy()[1]
                     for i in range(CHUNKS)])  # fmt: skip


def evaluated(case: Case, seeds: int) -> np.ndarray:
    """Interreflected light [sr] of every seed, shape (seed, replicate, sensor, bin)."""
    points, normals = sensor_points(case)
    world = scene.load(case, effects=EnabledEffects(solved_cells=True, pane_to_pane=False))
    out = []
    for seed in range(seeds):
        accuracy = case.accuracy.of_points(len(points)).model_copy(update={"seed": seed})
        C = coefficients.compute(world, points, normals, suns(), accuracy)
        out.append(C["replicates"].values - C["direct"].values)
    return np.array(out)


def coverage(case: Case, seeds: int) -> list[Coverage]:
    """Coverage by source and quarter of brightness, the darkest first."""
    theirs, ours = truth(case), evaluated(case, seeds)
    rows = []
    for source, bins in (("sky", SKY), ("suns", SUNS)):
        a, b = ours[..., bins], theirs[..., bins]
        if source == "sky":
            a, b = (x.sum(axis=-1, keepdims=True) for x in (a, b))
        order = np.argsort(b.mean(axis=0).sum(axis=1))
        for quarter, some in enumerate(np.array_split(order, 4)):
            rows.append(_quarter(source, quarter + 1, a[:, :, some], b[:, some]))
    return rows


def _quarter(source: str, quarter: int, ours: np.ndarray, theirs: np.ndarray) -> Coverage:
    mean, error = theirs.mean(axis=0), theirs.std(axis=0, ddof=1) / np.sqrt(len(theirs))
    replicates = ours.shape[1]
    value = ours.mean(axis=1)
    stated = ours.std(axis=1, ddof=1) / np.sqrt(replicates)
    factor = student.isf(0.025, replicates - 1)
    held = np.abs(value - mean) <= factor * np.hypot(stated, error)
    lit = mean > FAINT * mean.max()
    sums, whole = value.sum(axis=(1, 2)), theirs.sum(axis=(1, 2))
    noise = np.hypot(sums.std(ddof=1) / np.sqrt(len(sums)), whole.std(ddof=1) / np.sqrt(len(whole)))
    return Coverage(
        source, quarter, float(sums.mean() / whole.mean() - 1), float(noise / whole.mean()),
        float(held[:, lit].mean()), float(np.median((stated / mean)[:, lit])),
    )  # fmt: skip


def table(rooms: dict[str, list[Coverage]], seeds: int) -> str:
    """Page with the coverage of all rooms."""
    today = datetime.date.today().isoformat()
    about = f"""\
Intervals of interreflected light against the path tracer `coefficient`, {seeds} seeds a room, on
{today} ({platform.machine()}, variant `{mi.variant()}`), by quarters of the sensors from the
darkest. An entry is the sky's sum, or one of thirty suns, at one sensor.
`python -m tests.validation.calibration_rooms` writes this page, and says what is compared."""
    heads = "| room | light | | darkest | second | third | brightest |"
    lines = ["# Calibration of single sensors", "", about, "", heads, "|---" * 7 + "|"]
    for name, rows in rooms.items():
        for source in ("sky", "suns"):
            mine = [row for row in rows if row.source == source]
            held = " | ".join(f"{row.covered:.1%}" for row in mine)
            bias = " | ".join(f"{row.bias:+.1%} ± {row.bias_error:.1%}" for row in mine)
            stated = " | ".join(f"{row.stated:.1%}" for row in mine)
            lines += [f"| {name} | {source} | held | {held} |", f"| | | bias | {bias} |"]
            lines.append(f"| | | stated error | {stated} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rooms", default=",".join(ROOMS))
    parser.add_argument("--seeds", type=int, default=30)
    asked = parser.parse_args()
    backend.select()
    rooms = {}
    for name in asked.rooms.split(","):
        rooms[name] = coverage(ROOMS[name](), asked.seeds)
        print(table({name: rooms[name]}, asked.seeds), flush=True)
    PAGE.write_text(table(rooms, asked.seeds), encoding="utf-8")


if __name__ == "__main__":
    main()
