"""Error against the number of samples, and the bias of cells against their size.

Rationale: accuracy is bought with samples, so the error must fall as theory has it, n^-½ or faster,
for every ray count together, down to what the cells cost; and that must fall with their size.

Method: a small furnished room, once with one window and once with the prism film above glass.

*Samples.* All ray counts are scaled from ⅛ to 8. The error is measured twice: by the scatter of
runs with independent seeds, and against the unbiased plugin `coefficient`, whose own variance is
subtracted. It is the RMS over the sensors and bins of the sky, or of five suns, over their mean.

*Cells.* Each replicate stands a cell's D on one point, drawn from the vertices that fell into it by
their weights. So given all vertices v with their weights w, the expected value of G·D is
Σ w D̄(cell of v) with the weighted mean D̄, where the unbiased estimate is Σ w D(v): their
difference on the same paths is the bias, almost without noise, for every cell size. D̄ is from other
vertices than w, so that they share no errors. That
this is the bias of `compute`, too, is tested against the plugin with cells of 1.2 m. The order is
that of regular cells, by four grids a quarter of a cell apart, so that it does not hang on how
edges of light and cells happen to lie. The cells of `compute` end at furniture, however large they
may be elsewhere, so their bias has no order; it must be the smaller one over all sizes.

Expected: slopes of log error over log n of −½ or steeper (evenly spread samples beat −½). Bias:
where G and D vary smoothly, or only one of them jumps, its covariance within a cell falls by h² on
the whole (a cell on an edge loses h³, and there are 1/h of them); where both jump in one place (at
the edge of a desk, which cuts the sun and the view), h² each and 1/h cells leave h. So the order
lies between 1 and 2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.random_streams import Stream, launch_seed, number_in_replicate
from drcmitsuba.scene import scene
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.cells.cells import CellGrid
from drcmitsuba.transport.cells.vertices import Vertices
from drcmitsuba.transport.coefficients import compute
from drcmitsuba.transport.deposit import Deposit
from drcmitsuba.transport.films.films import Films
from drcmitsuba.transport.gather.paths import gather
from tests.validation.test_films import PRISM, towards

BINS = len(Patches())
DIRECTIONS = np.array(
    [towards(25, 170), towards(40, 200), towards(55, 150), towards(15, 215), towards(62, 185)]
)
SUNS = Suns(tuple(f"sun_{i}" for i in range(len(DIRECTIONS))), DIRECTIONS)
Fit = tuple[float, float]
PARTS = {"sky": slice(0, BINS), "suns": slice(BINS, None)}


@pytest.fixture(autouse=True, scope="module")
def _backend():
    backend.select()


def furnished(film: bool) -> Case:
    """Room of 4 × 5 × 3 m with four desks and a cupboard, 12 sensors."""
    window = {"frame": 0.4, "strips": [{"bottom": 0.9, "top": 2.4, "material": "glass"}]}
    strips = [
        {"bottom": 0.9, "top": 1.8, "material": "glass"},
        {"bottom": 1.8, "top": 2.7, "material": "film"},
    ]
    materials: dict = {"glass": {"type": "glazing", "transmittance": 0.7}}
    if film:
        materials["film"] = {"type": "bsdf", "file": str(PRISM)}
    return Case.model_validate(
        {
            "room": {"size": [4, 5, 3], "floor": 0.2, "ceiling": 0.8, "walls": 0.5},
            "facade": {"south": {"strips": strips} if film else window},
            "materials": materials,
            "furniture": [
                {
                    "name": "desk", "corner": [0.6, 1.0, 0.7], "size": [1.4, 0.7, 0.04],
                    "count": [2, 2], "step": [1.7, 2.0],
                },
                {
                    "name": "cupboard", "corner": [3.3, 3.9, 0], "size": [0.6, 1, 1.6],
                    "reflectance": 0.6,
                },
            ],
            "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 4], "spacing": 1.0},
        }
    )  # fmt: skip


def plain(case: Case, spp: int, rounds: int, *, sky: bool = True) -> np.ndarray:
    """Rounds of the plugin `coefficient`, shape (round, 2: direct and other, sensor, bin)."""
    loaded = scene.load(case)
    shapes = {f"shape{i}": s for i, s in enumerate(loaded.full.shapes())}
    directions = mi.TensorXf(DIRECTIONS.astype(np.float32))
    sources: dict = {"suns": {"type": "sun_disks", "directions": directions}}
    if sky:
        sources["sky"] = {"type": "tregenza_sky"}
    world = mi.load_dict({"type": "scene", **shapes, **sources}, optimize=False)
    plugin = mi.load_dict({"type": "coefficient"})
    points = sensor_points(case)
    return np.stack([plugin.sensors(world, *points, spp, 500 + k).numpy() for k in range(rounds)])


def slope(n: list[float], error: list[float], share: list[float] | None = None) -> Fit:
    """Least-squares slope of log error over log n, and its standard error.

    The latter is from the scatter about the line, and no less than what `share`, the relative
    errors of the errors, make of it.
    """
    x, y = np.log(n), np.log(error)
    x = x - x.mean()
    fitted = float((x @ y) / (x @ x))
    rest = y - y.mean() - fitted * x
    scatter = np.sqrt(rest @ rest / (len(x) - 2) / (x @ x))
    propagated = np.sqrt((x**2) @ np.square(share)) / (x @ x) if share else 0.0
    return fitted, float(max(scatter, propagated))


# Samples

BASE = {
    "paths": 64, "cell_sky_rays": 64, "sensor_sky_rays": 1024, "sensor_sun_samples": 8,
    "pane_points": 64, "film_sky_samples": 128,
}  # fmt: skip
SCALES = [1 / 8, 1 / 4, 1 / 2, 1, 2, 4, 8]
SEEDS, REPLICATES = 32, 2


def root_mean(square: np.ndarray) -> float:
    return float(np.sqrt(np.maximum(square.mean(), 0)))


def replicates_to_seeds(runs: list[np.ndarray]) -> Fit:
    """Error that replicates tell over the one that seeds show, geometric mean over all scales.

    `runs` are of one scale each, shape (seed, replicate, sensor, bin). The standard error is the
    jackknife's over seeds, since the entries of one go together.
    """
    by_replicates = np.array([(C.var(axis=1, ddof=1) / C.shape[1]).mean(axis=(1, 2)) for C in runs])
    means = [C.mean(axis=1) for C in runs]

    def ratio(kept: np.ndarray) -> float:
        shown = [m[kept].var(axis=0, ddof=1).mean() for m in means]
        return float(np.exp(np.mean(np.log(by_replicates[:, kept].mean(axis=1) / shown)) / 2))

    n = len(means[0])
    left_out = [ratio(np.delete(np.arange(n), k)) for k in range(n)]
    return ratio(np.arange(n)), float(np.sqrt((n - 1) * np.var(left_out)))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "cell_size"), [("clear", 0.1), ("film", 0.3)])
def test_error_falls_with_the_samples(name, cell_size):
    """All ray counts × ⅛ … 8: slope −0.45 or steeper, by seeds and against the plain path tracer.

    Beside it stands the error that the replicates themselves tell. Against the path tracer only
    errors above twice the bias count, which is found as the covariance of the differences that
    two halves of the runs with most samples leave.
    """
    case = furnished(name == "film")
    loaded, (points, normals) = scene.load(case), sensor_points(case)
    reference = plain(case, 1 << 16, 16).sum(axis=1)
    exact, own = reference.mean(axis=0), reference.var(axis=0, ddof=1) / len(reference)
    by_scale = {}
    for scale in SCALES:
        counts = {key: max(1, round(value * scale)) for key, value in BASE.items()}
        by_scale[scale] = np.stack(
            [
                compute(
                    loaded,
                    points,
                    normals,
                    SUNS,
                    Accuracy(replicates=REPLICATES, cell_size=cell_size, seed=seed, **counts),
                )["replicates"].values
                for seed in range(SEEDS)
            ]
        )  # fmt: skip  (seed, replicate, sensor, bin)
    for part, bins in PARTS.items():
        mean = exact[:, bins].mean()
        by_seeds, by_replicates, apart = [], [], []
        for C in by_scale.values():
            runs = C.mean(axis=1)[..., bins]
            by_seeds.append(root_mean(runs.var(axis=0, ddof=1)) / mean)
            by_replicates.append(root_mean(C[..., bins].var(axis=1, ddof=1) / REPLICATES) / mean)
            apart.append(root_mean((runs - exact[:, bins]) ** 2 - own[:, bins]) / mean)
        finest = by_scale[SCALES[-1]].mean(axis=1)[..., bins]
        ours = [finest[k::2].mean(axis=0) - reference[k::2].mean(axis=0)[:, bins] for k in (0, 1)]
        bias = root_mean(ours[0] * ours[1]) / mean
        kept = [i for i, error in enumerate(apart) if error > 2 * bias]
        assert len(kept) >= 4
        slopes = {
            "seeds": slope(SCALES, by_seeds),
            "plain": slope([SCALES[i] for i in kept], [apart[i] for i in kept]),
        }
        print(
            f"\n{name}, {part}, cells of {cell_size} m: slope by seeds "
            "{:.2f} ± {:.2f}, against the plain tracer {:.2f} ± {:.2f}; ".format(
                *slopes["seeds"], *slopes["plain"]
            )
            + f"its own error {root_mean(own[:, bins]) / mean:.2%}, halves' covariance {bias:.2%}"
        )
        print("| samples × | " + " | ".join(f"{s:g}" for s in SCALES) + " |")
        for label, values in (
            ("by seeds", by_seeds),
            ("by replicates", by_replicates),
            ("against", apart),
        ):
            print(f"| {label} | " + " | ".join(f"{100 * v:.3g} %" for v in values) + " |")
        for value, _ in slopes.values():
            assert value <= -0.45
        # What the replicates tell is what the seeds show, taken over all scales.
        ratio, error = replicates_to_seeds([C[..., bins] for C in by_scale.values()])
        print(f"by replicates over by seeds: {ratio:.3f} ± {error:.3f}")
        assert error < 0.15  # else it would tell nothing
        assert abs(ratio - 1) < 4 * error


# Cells

SIZES = {
    "clear": [0.15, 0.2, 0.3, 0.45, 0.6, 0.85, 1.2],
    "film": [0.3, 0.45, 0.6, 0.85, 1.2, 1.7],  # its light is even, and noisier
}
SHIFTS = (0.0, 0.25, 0.5, 0.75)


def grids(loaded: scene.Scene, size: float) -> list[CellGrid]:
    """Grid of `compute`, then regular ones whose corners are a quarter of a cell apart."""
    of_compute = CellGrid.of(loaded, size)
    out = [of_compute]
    for shift in SHIFTS:
        x, y, z = np.array(of_compute.low) - shift * size
        nx, ny, nz = np.ceil((loaded.bounds[1] - (x, y, z)) / size).astype(int) + 1
        out.append(CellGrid((x, y, z), (int(nx), int(ny), int(nz)), size))
    return out


def deposit(case: Case, accuracy: Accuracy) -> Callable[[Vertices, int], np.ndarray]:
    """D (vertex, sun) at vertices, as `compute` finds it for cells, with a seed of its own."""
    loaded = scene.load(case)
    films = Films.of(loaded, 2 * accuracy.cell_size, DIRECTIONS, SUNS.diameter)
    base = Deposit(loaded, DIRECTIONS, SUNS.diameter, None, accuracy, None, films)

    def at(vertices: Vertices, seed: int) -> np.ndarray:
        lit, p, n, key = base.lit(seed), vertices.p, vertices.n, (Stream.CELLS,)
        numbers = number_in_replicate(dr.arange(mi.UInt32, len(vertices)), seed)
        light = lit.straight(p, n, key, 1, numbers=numbers)
        return light.plus(lit.scattered(p, n, key, numbers)).sun.numpy()

    return at


def mean_of_cells(
    keys: np.ndarray, values: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Keys of cells, each once, and the weighted mean (cell, sun) of the values in them."""
    each, cell = np.unique(keys, return_inverse=True)
    sums = [np.bincount(cell.ravel(), weight * column) for column in values.T]
    return each, np.stack(sums, axis=1) / np.bincount(cell.ravel(), weight)[:, None]


def bias_of_cells(case: Case, sizes: list[float], paths: int, rounds: int) -> np.ndarray:
    """Bias of C by cells of `grids`, shape (size, grid, round, sensor, sun); last, unbiased C."""
    loaded, (points, normals) = scene.load(case), sensor_points(case)
    D = deposit(case, Accuracy(pane_points=32))
    out = np.zeros((len(sizes) + 1, 1 + len(SHIFTS), rounds, len(points), len(DIRECTIONS)))

    of_sizes = {
        (i, k): grid for i, size in enumerate(sizes) for k, grid in enumerate(grids(loaded, size))
    }

    def traced(number: int) -> tuple[Vertices, np.ndarray]:
        seed = launch_seed(7, Stream.ROUNDS, number)
        vertices = gather(
            loaded, points, normals, replicates=1, paths=paths,
            grid=CellGrid.of(loaded, 1.0), seed=seed,
        )  # fmt: skip
        return vertices, D(vertices, number)

    before, d_before = traced(rounds)
    for r in range(rounds):
        vertices, d = traced(r)
        row, weight = vertices.row.numpy(), vertices.weight.numpy().astype(float)

        def per_sensor(values: np.ndarray, row=row, weight=weight) -> np.ndarray:
            each = [np.bincount(row, weight * v, minlength=len(points)) for v in values.T]
            return np.stack(each, axis=1)

        out[-1, :, r] = per_sensor(d)
        for (i, k), grid in of_sizes.items():
            here, there = (
                grid.key(dr.unravel(mi.Point3f, v.p), dr.unravel(mi.Normal3f, v.n)).numpy()
                for v in (vertices, before)
            )
            cells, mean = mean_of_cells(there, d_before, before.weight.numpy().astype(float))
            at = np.minimum(np.searchsorted(cells, here), len(cells) - 1)
            met = cells[at] == here  # a few cells in corners are met in one round only
            out[i, k, r] = per_sensor(np.where(met[:, None], mean[at] - d, 0))
        before, d_before = vertices, d
    return out


def size_of(bias: np.ndarray) -> tuple[float, float]:
    """RMS of the bias (grid, round, …) without what noise adds, and its standard error.

    The square is a mean of products of two rounds each, which share no errors; its error is by
    jackknife.
    """

    def square(rounds: np.ndarray) -> float:
        n, total = rounds.shape[1], rounds.sum(axis=1)
        return float((total**2 - (rounds**2).sum(axis=1)).mean() / (n * (n - 1)))

    n = bias.shape[1]
    left = np.array([square(np.delete(bias, i, axis=1)) for i in range(n)])
    error = np.sqrt((n - 1) / n * ((left - left.mean()) ** 2).sum())
    whole = max(square(bias), 0.0)
    return np.sqrt(whole), np.sqrt(whole + error) - np.sqrt(whole)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "paths", "rounds", "least"), [("clear", 1 << 13, 8, 1.4), ("film", 1 << 12, 24, 1.0)]
)
def test_bias_of_cells_falls_by_an_order_between_one_and_two(name, paths, rounds, least):
    """Suns, interreflected light (with the film's): RMS bias over sensors and suns, over the mean.

    Sizes whose bias stands out of its noise by four errors count for the order.
    """
    biases = bias_of_cells(furnished(name == "film"), SIZES[name], paths, rounds)
    mean = biases[-1].mean()
    rows, own = [], []
    for size, bias in zip(SIZES[name], biases, strict=False):
        rows.append((size, *np.array(size_of(bias[1:])) / mean))
        own.append(np.array(size_of(bias[:1])) / mean)
        of_round = bias[0].mean(axis=(1, 2)) / mean
        noise = of_round.std(ddof=1) / np.sqrt(rounds)
        print(
            "| {} | {} m | {:.2%} ± {:.2%}".format(name, *rows[-1])
            + " | with the grid of compute {:.2%} ± {:.2%}, ".format(*own[-1])
            + f"sum {of_round.mean():+.2%} ± {noise:.2%} |"
        )
    clear = [(size, bias, error / bias) for size, bias, error in rows if bias > 4 * error]
    assert len(clear) >= 3
    order, error = slope(*map(list, zip(*clear, strict=True)))
    print(f"{name}: order {order:.2f} ± {error:.2f} from {clear[0][0]} to {clear[-1][0]} m")
    assert least < order < 2.3
    values = [bias for _, bias, _ in clear]
    assert values == sorted(values)
    regular, cut = (root_mean(np.array([row[-2] for row in table]) ** 2) for table in (rows, own))
    print(f"{name}: over all sizes {regular:.2%}, with the grids of compute {cut:.2%}")
    assert cut < regular


@pytest.mark.slow
def test_bias_is_that_of_compute(same):
    """Cells of 1.2 m, replicates of `compute` against the plain path tracer and the bias."""
    case = furnished(False)
    loaded, (points, normals) = scene.load(case), sensor_points(case)
    of_round = bias_of_cells(case, [1.2], 1 << 13, 8)[0, 0]
    bias = of_round.mean(axis=0)
    theirs = plain(case, 1 << 15, 24, sky=False)[:, 1]
    hidden = replace(SUNS, straight=False)
    mine = []
    for seed in range(8):
        accuracy = Accuracy(replicates=64, paths=256, cell_size=1.2, seed=seed)
        C = compute(loaded, points, normals, hidden, accuracy, subdivision=None)
        mine.append(C["replicates"].values)
    mine = np.concatenate(mine)
    apart = mine.mean(axis=0) - theirs.mean(axis=0)
    noise = mine.var(axis=0, ddof=1) / len(mine) + theirs.var(axis=0, ddof=1) / len(theirs)
    noise += of_round.var(axis=0, ddof=1) / len(of_round)
    # Sensors share cells, so errors of entries go together: the error is by whole replicates.
    weight = bias / noise / (bias**2 / noise).sum()
    of_mine, of_theirs = ((values * weight).sum(axis=(1, 2)) for values in (mine, theirs))
    share = of_mine.mean() - of_theirs.mean()
    error = np.sqrt(sum(x.var(ddof=1) / len(x) for x in (of_mine, of_theirs)))
    print(
        f"difference over bias {share:.3f} ± {error:.3f}; mean z² of 60 entries "
        f"{np.mean(apart**2 / noise):.2f}, less the bias {np.mean((apart - bias) ** 2 / noise):.2f}"
    )
    assert share == pytest.approx(1, abs=3 * error)
    assert error < 0.12
    same(mine, other=theirs + bias, within=0.02)
