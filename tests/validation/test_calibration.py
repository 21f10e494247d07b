"""Do 95 % intervals hold the truth in 95 % of evaluations? 200 of them, of a room that is known.

Rationale: an interval can be wrong where nothing else is. Only many evaluations with other seeds,
each beside the truth, show whether its width is that of the error.

Method: a room of 3 × 4 × 3 m with a south window and a diffusing shade, 24 sensors, every seventh
working hour of the year (373). The truth is the plain path tracer `coefficient`, which shares with
the program neither cells nor replicates, with 0.5 million (open) and 1.6 million (shaded) paths a
sensor; its own error, an eighth of that of an evaluation, is added to it in the test of single
entries. One evaluation takes 6 replicates of 32 paths. Cells of 0.2 m are so small that what
they smear is below a tenth of the spread of the evaluations (tested).

Metrics move in steps, of one sensor or one hour, and one set of thresholds may lie where nothing
is in doubt, or exactly on a step. So there are six sets; in the last three some sensor of the truth
has exactly as many hours in the sun as ASE asks for.

Expected: single entries are covered in 92 to 98 %; every metric, over the sets, in 92 % or more,
by intervals that are on average at most twice as wide as the 95 % spread of the values and one
sensor's share more.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from types import SimpleNamespace

import mitsuba as mi
import numpy as np
import pytest
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba import metrics
from drcmitsuba.annual import simulation
from drcmitsuba.case.case import Case
from drcmitsuba.case.metrics import Metrics
from drcmitsuba.metrics import accumulate, evaluate_metrics, illuminance, intervals
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.intervals import Rules
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.daylight import Daylight, daylight
from drcmitsuba.sky.sun_models import Suns

pytestmark = pytest.mark.slow
RUNS = 200
CHUNK = 1 << 15
CHUNKS = {"open": 16, "shaded": 48}
SENSORS = 24
ROOM = Case.model_validate(
    {
        "room": {"size": [3, 4, 3], "floor": 0.2, "ceiling": 0.8, "walls": 0.5},
        "facade": {
            "south": {
                "frame": 0.3,
                "strips": [{"bottom": 0.9, "top": 2.7, "material": "glass"}],
            }
        },
        "materials": {
            "glass": {"type": "glazing", "transmittance": 0.65},
            "shade": {"type": "diffuser", "transmittance": 0.1},
        },
        "shading": {"material": "shade"},
        "sensors": {"corner": [0.3, 0.2, 0.8], "count": [4, 6], "spacing": 0.6},
        "accuracy": {
            "replicates": 6, "paths": 32, "cell_size": 0.2, "cell_sky_rays": 32,
            "sensor_sky_rays": 256, "sensor_sun_samples": 4, "pane_points": 16,
        },
    }
)  # fmt: skip


def rules(lux, fraction, sun, hours, shade, area):
    asked = Metrics(sda_threshold=lux, sda_fraction=fraction, ase_threshold=sun, ase_hours=hours)
    return Rules(asked, shade, area, 1.0)


SETS = [
    rules(500, 0.9, 1000, 24, 1000, 0.1),
    rules(700, 0.6, 1000, 85, 1000, 0.3),
    rules(400, 0.8, 2000, 45, 1000, 0.02),
    rules(600, 0.75, 5000, 20, 1000, 0.2),
    rules(300, 0.95, 5000, 41, 3000, 0.5),
    rules(1000, 0.5, 5000, 129, 1000, 0.05),
]
ANNUAL = ("sDA", "ASE", "shade_closed")
MONTHLY = ("msDA", "MSE", "shade_closed_monthly")


def light() -> Daylight:
    whole = daylight(ROOM)
    every = {"time": slice(3, None, 7)}
    return replace(whole, sky=whole.sky.isel(every), sun=whole.sun.isel(every))


def with_thresholds(coefficients: Coefficients, asked: Rules) -> Coefficients:
    shade = {"shade_threshold": asked.shade_threshold, "shade_area": asked.shade_area}
    return coefficients.assign_attrs(has_shade=1, **shade)


def hard(E: xr.Dataset, asked: Rules) -> np.ndarray:
    """Values of the metrics, the three of the year and then twelve months of three."""
    annual, monthly = intervals.values(E, asked)
    return np.concatenate([[annual[m] for m in ANNUAL], *(monthly[m] for m in MONTHLY)])


def ends(numbers: dict) -> np.ndarray:
    """Value, low and high of the metrics, in the order of `hard`: (metric, 3)."""
    rows = [numbers[m] for m in ANNUAL] + [i for m in MONTHLY for i in numbers[m]]
    return np.array([[i[key] for key in ("value", "low", "high")] for i in rows])


@dataclass(frozen=True)
class Truth:
    """Truth as coefficients of both states, with the truth's own replicates."""

    coefficients: Coefficients

    @classmethod
    def of(cls, suns: Suns) -> Truth:
        points, normals = sensor_points(ROOM)
        directions = mi.TensorXf(suns.directions.astype(np.float32))
        sources = {
            "sky": {"type": "tregenza_sky"},
            "suns": {"type": "sun_disks", "directions": directions},
        }
        integrator = mi.load_dict({"type": "coefficient", "suns_per_vertex": 16})
        by_state = {}
        for state, chunks in CHUNKS.items():
            shapes = scene.load(ROOM, state).full.shapes()
            full = {f"shape{i}": shape for i, shape in enumerate(shapes)}
            lit = mi.load_dict({"type": "scene", **full, **sources}, optimize=False)
            parts = np.stack(
                [integrator.sensors(lit, points, normals, CHUNK, i).numpy() for i in range(chunks)]
            )
            # Panes do not mirror here: in the open state what met no diffuse surface is straight.
            straight = parts[:, 0].mean(axis=0)
            by_state[state] = xr.Dataset(
                {
                    "replicates": (("replicate", "sensor", "bin"), parts.sum(axis=1)),
                    "straight": (("sensor", "bin"), straight),
                    "straight_se": (("sensor", "bin"), 0 * straight),
                },
                coords={
                    "bin": np.array([*Patches().labels, *suns.labels], object),
                    **{axis: ("sensor", points[:, i]) for i, axis in enumerate("xyz")},
                },
            )
        # Both with as many replicates: those of the open state are repeated.
        again = np.arange(CHUNKS["shaded"]) % CHUNKS["open"]
        by_state["open"] = by_state["open"].isel(replicate=again)
        return cls(Coefficients(by_state.pop("open"), by_state))


@pytest.fixture(scope="module")
def study():
    """Every evaluation beside the truth."""
    backend.select()
    start = time.perf_counter()
    day = light()
    suns = Suns.of(day.sun, ROOM.outside.sun_diameter)
    truth = Truth.of(suns).coefficients
    true_E = [illuminance.illuminance(with_thresholds(truth, asked), day.sky) for asked in SETS]
    own = {
        state: accumulate.by_source(truth.states[state].isel(replicate=part), day.sky)
        for state, part in (("open", slice(CHUNKS["open"])), ("shaded", slice(None)))
    }
    error = {state: E["total_se"].values for state, E in own.items()}
    seconds, ends_of_all, covered, means = [], [], [], []
    for seed in range(RUNS):
        accuracy = ROOM.accuracy.model_copy(update={"seed": seed})
        case = ROOM.model_copy(update={"accuracy": accuracy})
        parts = {s: simulation.transport(case, s, suns, 0.0) for s in ("open", "shaded")}
        C = Coefficients(parts.pop("open"), parts)
        rows = []
        for i, asked in enumerate(SETS):
            with_rules = with_thresholds(C, asked)
            E = illuminance.illuminance(with_rules, day.sky)
            before = time.perf_counter()
            rays = accuracy.replicates * accuracy.sensor_sun_samples
            draws = intervals.draw(with_rules, day.sky, E, asked, rays=rays, seed=seed)
            seconds.append(time.perf_counter() - before)
            rows.append(ends(evaluate_metrics.summarise(E, asked, draws)))
            if i == 0:
                covered.append(entries_covered(E, true_E[0], error))
                means.append(E["total_open"].values)
        ends_of_all.append(rows)
    return SimpleNamespace(
        truth=np.array([hard(E, asked) for E, asked in zip(true_E, SETS, strict=True)]),
        intervals=np.array(ends_of_all),
        covered=np.array(covered),
        open=np.array(means),
        true_open=true_E[0]["total_open"].values,
        error_open=error["open"],
        draw_seconds=float(np.median(seconds)),
        seconds=time.perf_counter() - start,
    )


def entries_covered(E, truth, error) -> list[float]:
    """Shares of the entries that their intervals cover: of `total_open`, of `total`."""
    shares = []
    shut = truth["shade_closed"].values
    same = E["shade_closed"].values == shut
    for name in ("total_open", "total"):
        own = error["open"]
        if name == "total":
            own = np.where(shut[:, None], error["shaded"], own)
        se = np.hypot(E[f"{name}_se"].values, own)
        off = abs(E[name].values - truth[name].values)
        # Where the shade differs, E is that of another state, which is no matter of its error.
        known = (truth[name].values > 1) & (same[:, None] | (name == "total_open"))
        shares.append(float((off <= E.attrs["interval_factor"] * se)[known].mean()))
    return shares


def test_entries_are_covered(study):
    total_open, total = study.covered.mean(axis=0)
    print(f"total_open {total_open:.4f}, total {total:.4f}; {study.seconds:.0f} s")
    assert 0.92 <= total_open <= 0.98
    assert 0.92 <= total <= 0.98


def test_cells_do_not_smear(study):
    """Mean over the evaluations beside the truth: what is left beyond both errors is the cells'."""
    spread = study.open.std(axis=0, ddof=1)
    off = study.open.mean(axis=0) - study.true_open
    lit = study.true_open > 1
    spread, off, error = spread[lit], off[lit], study.error_open[lit]
    bias = np.median((off**2 - spread**2 / RUNS - error**2) / spread**2)
    own = np.median(error / spread)
    print(f"bias² / spread² {bias:+.4f}; error of the truth / spread {own:.3f}")
    assert bias < 0.01
    assert own < 0.2


GROUPS = {
    name: slice(3 + 12 * (i - 3), 15 + 12 * (i - 3)) if i >= 3 else slice(i, i + 1)
    for i, name in enumerate((*ANNUAL, *MONTHLY))
}


@pytest.mark.parametrize("name", GROUPS)
def test_metrics_are_covered_by_intervals_that_are_not_too_wide(study, name):
    value, low, high = np.moveaxis(study.intervals[:, :, GROUPS[name]], -1, 0)
    truth = study.truth[:, GROUPS[name]]
    slack = 1e-9
    covered = (low - slack <= truth) & (truth <= high + slack)
    width = (high - low).mean()
    spread = np.ptp(np.quantile(value, [0.025, 0.975], axis=0), axis=0).mean()
    by_set = covered.mean(axis=(0, 2))
    print(
        f"{name}: covered {covered.mean():.3f} (sets {by_set.round(2)}), width {width:.2f}, "
        f"spread {spread:.2f}; truth {truth.mean(axis=1).round(1)}; {study.draw_seconds:.3f} s"
    )
    assert covered.mean() >= 0.92
    assert width <= 2 * spread + 100 / SENSORS
    assert ((low <= value) & (value <= high)).all()


def test_the_thresholds_put_the_metrics_where_they_are_in_doubt(study):
    values = study.intervals[..., 0]
    for name, group in GROUPS.items():
        assert (np.ptp(values[:, :, group], axis=0) > 0).any(), name
    assert metrics.closing_sensors(SETS[2].shade_area, SENSORS) == 1
