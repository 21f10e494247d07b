"""Bytes of an evaluation: its files, and the arrays that it holds at once."""

from __future__ import annotations

from drcmitsuba.case.sun import Adaptive
from drcmitsuba.plan.forecast.pilot import Pilot
from drcmitsuba.plan.forecast.work import Counted

FLOAT, DOUBLE = 4, 8
VARIABLES = 10
"""Number of variables of illuminance.nc: five, and their standard errors."""
PARTS = 6
"""Number of parts of C: straight, direct, interreflected, and their standard errors."""
KEPT = 0.93
"""Part of the bytes of numbers other than 0 that zarr's compression keeps; zeros cost nothing."""
LABEL = 45
"""Bytes of all labels and coordinates of a time stamp."""
PICTURES = 4 * 48_000 + 118_000
"""Bytes of the four plans, and of the months."""
TEXTS = 15_000
"""Bytes of metrics.json and plan.json."""
VERTEX = 40
"""Bytes of one vertex of a path: row, key, tag, weight, position, normal."""
BASE = 290 << 20
"""Bytes of the program: libraries, kernels, weather."""
PHOTONS = 135 << 20
"""Bytes of the photons of one launch, from their ports on."""
HELD = {
    "vertices": 4.0, "deposit": 1.8, "films": 2.5, "landed": 3.5, "coefficients": 1.6,
    "luminance": 2.0, "illuminance": 1.5,
}  # fmt: skip
"""Number of times that memory holds each array at its peak, with copies and freed memory that is
not returned; fitted to the shipped cases, a coloured one, and one of 5184 sensors."""


def disk(counted: Counted) -> dict[str, int]:
    """Number of bytes of the files that an evaluation writes, by name."""
    stamps, channels = counted.plan.facts.hours, counted.channels
    coefficients = sum(_numbers(pilot, counted) for pilot in counted.pilots.values())
    files = {
        "illuminance.nc": VARIABLES * FLOAT * counted.entries + LABEL * stamps,
        "coefficients.zarr": KEPT * FLOAT * channels * coefficients,
        "sky.zarr": KEPT * FLOAT * stamps * counted.sky_bins * channels + LABEL * stamps,
        "texts": TEXTS,
    }
    if counted.plan.scope.pictures:
        files["pictures"] = PICTURES
    return {name: round(size) for name, size in files.items()}


def _numbers(pilot: Pilot, counted: Counted) -> float:
    """Number of coefficients of a state that are not 0."""
    (patches, suns), (of_sky, of_sun, _) = pilot.bins, pilot.seen
    straight = of_sun * suns * pilot.suns.straight + of_sky * patches
    direct = suns + patches if pilot.scatters else straight
    around = suns + patches if pilot.scene.effects.depth != 0 else direct
    numbers = 2 * straight + 2 * direct + (2 + pilot.accuracy.replicates) * around
    if isinstance(counted.plan.facts.case.sun, Adaptive):
        numbers += 2 * of_sun * len(counted.plan.facts.light.suns.labels)
    return len(pilot.points) * numbers


def memory(counted: Counted) -> int:
    """Largest number of bytes that the process holds at once."""
    a, pilots = counted.plan.facts.case.accuracy, counted.pilots.values()
    deposits = [a.replicates * p.cells * sum(p.bins) for p in pilots]
    landed = [d for d, p in zip(deposits, pilots, strict=True) if p.scene.followed]
    vertices = [a.replicates * p.block * a.paths * p.paths.bounces for p in pilots if p.paths.rays]
    tables = [p.film_rows[0] * p.bins[0] + p.film_rows[1] * p.bins[1] for p in pilots]
    whole = len(counted.plan.facts.light.suns.labels) + counted.sky_bins
    sensors = len(counted.pilots["open"].points)
    numbers = len(pilots) * counted.channels * sensors * whole
    held = {
        "vertices": VERTEX * max(vertices, default=0),
        "deposit": FLOAT * max(deposits),
        "films": FLOAT * a.replicates * max(tables),
        "landed": FLOAT * max(landed, default=0),
        "coefficients": FLOAT * numbers * (PARTS + a.replicates),
        "luminance": DOUBLE * numbers * a.replicates * (counted.channels > 1),
        "illuminance": FLOAT * VARIABLES * counted.entries,
    }
    most = sum(HELD[name] * size for name, size in held.items())
    return round(BASE + PHOTONS * any(p.scene.followed for p in pilots) + most)
