"""Bytes of an evaluation: of its files, and of the arrays that are held at once."""

from __future__ import annotations

from drcmitsuba.case.sun import Adaptive
from drcmitsuba.plan.forecast.survey import Survey
from drcmitsuba.plan.forecast.work import Counted

FLOAT, DOUBLE = 4, 8
VARIABLES = 10
"""Of illuminance.nc: five, and their standard errors."""
PARTS = 6
"""Straight, direct, interreflected, and their standard errors."""
KEPT = 0.93
"""What zarr's compression leaves of numbers that are not 0; of zeros it leaves nothing."""
LABEL = 45
"""Bytes of a time stamp in all of its labels and coordinates."""
PICTURE, MONTHLY = 48_000, 118_000
"""Bytes of a plan and of the monthly plot."""
PLANS = 4
"""One of points that are too close to call among them."""
TEXTS = 15_000
"""Bytes of metrics.json and plan.json."""
VERTEX = 40
"""Bytes of a vertex of a path: row, key, tag, weight, position, normal."""

BASE = 290 << 20
"""Bytes of the program itself: libraries, kernels, weather."""
PHOTONS = 135 << 20
"""Bytes of the photons of one launch, from their ports on."""
HELD = {
    "vertices": 4.0, "deposit": 1.8, "films": 2.5, "landed": 3.5, "coefficients": 1.6,
    "luminance": 2.0, "illuminance": 1.5,
}  # fmt: skip
"""How often arrays are held where most is held at once, copies and what was freed and not given
back included; fitted to the shipped cases, a coloured one, and one of 5184 sensors."""


def disk(counted: Counted) -> dict[str, int]:
    """Bytes of the files that an evaluation writes, by name."""
    scope, stamps, channels = counted.plan.scope, counted.stamps, counted.channels
    entries = stamps * counted.sensors * channels
    coefficients = sum(_numbers(survey, counted) for survey in counted.surveys.values())
    luminances = stamps * counted.surveys["open"].patches_of_sky * channels
    files = {
        "illuminance.nc": VARIABLES * FLOAT * entries + LABEL * stamps,
        "coefficients.zarr": KEPT * FLOAT * channels * coefficients,
        "sky.zarr": KEPT * FLOAT * luminances + LABEL * stamps,
        "texts": TEXTS,
    }
    if scope.pictures:
        files["pictures"] = PLANS * PICTURE + MONTHLY
    return {name: round(size) for name, size in files.items()}


def _numbers(survey: Survey, counted: Counted) -> float:
    """Coefficients of a state that are not 0."""
    seen, replicates = survey.seen("sensors"), survey.accuracy.replicates
    suns, patches = len(survey.suns.labels), survey.patches
    scattering = survey.pane_patches is not None or survey.films is not None
    straight = seen.suns * suns * survey.suns.straight + seen.patches * patches
    direct = suns + patches if scattering or survey.scene.followed else straight
    around = suns + patches if survey.scope.depth != 0 or scattering else direct
    numbers = 2 * straight + 2 * direct + (2 + replicates) * around
    if isinstance(counted.plan.facts.case.sun, Adaptive):
        numbers += 2 * seen.suns * len(counted.plan.facts.light.suns.labels)
    return counted.sensors * numbers


def memory(counted: Counted) -> int:
    """Bytes that the process holds where it holds most."""
    held = arrays(counted)
    followed = any(survey.scene.followed for survey in counted.surveys.values())
    return round(BASE + PHOTONS * followed + sum(HELD[name] * held[name] for name in HELD))


def arrays(counted: Counted) -> dict[str, float]:
    """Bytes of the largest arrays by name."""
    a, sensors = counted.plan.facts.case.accuracy, counted.sensors
    surveys = counted.surveys.values()
    bins = {state: sum(both) for state, both in counted.bins.items()}
    deposits = [a.replicates * s.cells[2] * bins[state] for state, s in counted.surveys.items()]
    landed = [
        d for d, s in zip(deposits, surveys, strict=True) if s.scene.followed
    ]  # fmt: skip
    whole = len(counted.plan.facts.light.suns.labels) + counted.surveys["open"].patches_of_sky
    numbers = len(counted.surveys) * counted.channels * sensors * whole
    illuminances = VARIABLES * counted.stamps * sensors * counted.channels
    return {
        "vertices": VERTEX * max((_vertices(s) for s in surveys), default=0),
        "deposit": FLOAT * max(deposits, default=0),
        "films": FLOAT * a.replicates * max((_tables(s) for s in surveys), default=0),
        "landed": FLOAT * max(landed, default=0),
        "coefficients": FLOAT * numbers * (PARTS + a.replicates),
        "luminance": DOUBLE * numbers * a.replicates if counted.channels > 1 else 0.0,
        "illuminance": FLOAT * illuminances,
    }  # fmt: skip


def _vertices(survey: Survey) -> float:
    """Vertices that there is room for at once."""
    if survey.scope.depth == 0:
        return 0.0
    a = survey.accuracy
    return a.replicates * survey.block * a.paths * survey.bounces


def _tables(survey: Survey) -> float:
    """Numbers in the tables of films."""
    tables = survey.film_tables
    lit = 0 if survey.films is None else len(survey.films.suns)
    return tables.sun_rows * lit + tables.sky_rows * survey.patches
