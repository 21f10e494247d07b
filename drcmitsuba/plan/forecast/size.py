"""Bytes of an evaluation: its files, and the arrays that it holds at once."""

from __future__ import annotations

import numpy as np
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.groups import OPEN
from drcmitsuba.metrics.facade_states import most_states
from drcmitsuba.plan import Plan
from drcmitsuba.plan.forecast.pilot import Pilot
from drcmitsuba.plan.forecast.summed import is_summed, states_of_year
from drcmitsuba.plan.forecast.work import Work
from drcmitsuba.scene.prepared_case import prepared

FLOAT, DOUBLE = 4, 8
VARIABLES = 10
"""Number of variables of illuminance.nc: five, and their standard errors."""
PARTS = 6
"""Number of parts of C: straight, direct, interreflected, and their standard errors."""
KEPT = 0.93
"""Part of the bytes of numbers other than 0 that zarr's compression keeps; zeros cost nothing."""
LABEL, TEXTS, PICTURES = 45, 15_000, 4 * 48_000 + 118_000
"""Bytes of the labels of a time stamp; of metrics.json and plan.json; of four plans and months."""
BESIDE = 1400 << 20
"""Bytes that kernels and draws take beside large whole arrays, at most: 50 rooms of 25 sensors take
1.8 GiB, 200 rooms 3.3 (`python -m tests.bench.slab`)."""
VERTEX = 40
"""Bytes of one vertex of a path: row, key, tag, weight, position, normal."""
BASE, PHOTONS = 290 << 20, 135 << 20
"""Bytes of the program with libraries, kernels and weather; of the photons of one launch."""
HELD = {
    "vertices": 4.0, "deposit": 1.8, "films": 2.5, "landed": 3.5, "coefficients": 1.6,
    "luminance": 2.0, "illuminance": 1.5, "groups": 1.0, "matrix": 1.0, "years": 1.0,
}  # fmt: skip
"""Number of times that memory holds each array at its peak, with copies and freed memory that is
not returned; fitted to the shipped cases, a coloured one, and one of 5184 sensors."""


def disk(counted: Work) -> dict[str, int]:
    """Number of bytes of the files that an evaluation writes, by name."""
    stamps, channels = counted.plan.facts.hours, counted.channels
    written = [OPEN] if counted.summed is not None else list(counted.pilots)
    coefficients = sum(_numbers(counted.pilots[state]) for state in written)
    files = {
        "illuminance.nc": VARIABLES * FLOAT * counted.entries + LABEL * stamps,
        "coefficients.zarr": KEPT * FLOAT * channels * coefficients,
        "sky.zarr": KEPT * FLOAT * stamps * counted.sky_bins * channels + LABEL * stamps,
        "year.zarr": (KEPT * FLOAT * counted.sky_bins + LABEL) * _year(counted.plan),
        "texts": TEXTS,
    }
    if counted.plan.scope.pictures:
        files["pictures"] = PICTURES
    return {name: round(size) for name, size in files.items()}


def _year(plan: Plan) -> int:
    """Number of time stamps of the year beside the period's; 0 without."""
    return 0 if plan.facts.light.year is None else plan.facts.stamps


def _numbers(pilot: Pilot) -> float:
    """Number of coefficients of a state that are not 0."""
    C, (patches, suns) = pilot.coefficients, pilot.bins
    few = C.sizes["bin"] - patches
    by_bin = np.repeat([1.0, suns / max(1, few)], [patches, few])
    times = {"replicates": pilot.accuracy.replicates / C.sizes["replicate"]}
    pairs = (
        times.get(str(name), 1.0) * ((part != 0).values @ by_bin).sum() for name, part in C.items()
    )
    return float(sum(pairs)) * len(pilot.points) / C.sizes["sensor"]


def memory(counted: Work) -> int:
    """Largest number of bytes that the process holds at once."""
    a, pilots = counted.plan.facts.case.accuracy, counted.pilots.values()
    deposits = [a.replicates * p.cells / p.groups * sum(p.bins) for p in pilots]
    landed = [d for d, p in zip(deposits, pilots, strict=True) if p.scene.followed]
    vertices = [p.vertices / p.blocks for p in pilots]
    films = [(p.films, *p.bins) for p in pilots if p.films is not None]
    tables = [
        patches * int(one.first_sky_rows()[-1]) + suns * sum(mount.rows for mount in one.mounts)
        for one, patches, suns in films
    ]
    whole = len(counted.plan.facts.light.suns.labels) + counted.sky_bins
    sensors = len(counted.pilots[OPEN].points)
    numbers = len(pilots) * counted.channels * sensors * whole
    held = {
        "vertices": VERTEX * max(vertices, default=0),
        "deposit": FLOAT * max(deposits),
        "films": FLOAT * a.replicates * max(tables, default=0),
        "landed": FLOAT * max(landed, default=0),
        "coefficients": FLOAT * numbers * (PARTS + a.replicates),
        "luminance": DOUBLE * numbers * a.replicates * (counted.channels > 1),
        "illuminance": FLOAT * VARIABLES * counted.entries,
    }
    if (groups := counted.summed) is not None:
        held["groups"] = FLOAT * counted.channels * groups.numbers
        held["matrix"] = (FLOAT + DOUBLE) * sensors * groups.vertices
        held["years"] = FLOAT * a.replicates * counted.entries
    most = sum(HELD[name] * size for name, size in held.items())
    return round(BASE + PHOTONS * any(p.scene.followed for p in pilots) + most)


def whole_arrays(plan: Plan) -> float:
    """Number of bytes that the process holds where C of all states and E are kept.

    It is known without a pilot, as a cache needs it.
    """
    case, light = plan.facts.case, plan.facts.light
    sensors, channels = len(prepared(case).receivers), 3 if plan.scope.channels else 1
    patches, suns = len(Patches(case.sky.subdivision)), len(light.suns.labels)
    # Further states share the suns between them, or are summed up over a year.
    most = most_states(prepared(case).groups.states)
    states = min(most, states_of_year(plan)) if plan.scope.shade else 1
    bins = (1 + plan.scope.shade) * suns + states * patches
    pairs = FLOAT * channels * plan.facts.hours * sensors
    C = FLOAT * channels * sensors * bins * (PARTS + case.accuracy.replicates)
    years = case.accuracy.replicates * pairs * is_summed(plan)
    held = {"coefficients": C, "illuminance": VARIABLES * pairs, "years": years}
    arrays = sum(HELD[name] * size for name, size in held.items())
    return BASE + arrays + min(BESIDE, arrays)
