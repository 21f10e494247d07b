"""Smooth twins: they tend to the metrics as sharpness grows, and their gradients are right.

The twins are written out again in NumPy and double precision; central differences of that are
exact to 1e-6, so single precision of the twins is all that the tolerances leave room for.
"""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import xarray as xr

from drcmitsuba import metrics
from drcmitsuba.metrics import smooth
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError

TIME, SENSORS = 240, 400
HOURS, AREA = 20.0, 0.05
"""Sunny hours and share of the room by which some sensors and hours pass, some do not."""


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


def dated(values):
    days = np.array("2001-01-01", "datetime64[D]") + np.arange(len(values)) * 365 // len(values)
    return xr.DataArray(values, dims=("time", "sensor"), coords={"time": days.astype("M8[ns]")})


def room(seed=1):
    """Random illuminance and direct sun; no value is nearer to its threshold than 1e-4."""
    rng = np.random.default_rng(seed)
    E = rng.uniform(100, 900, SENSORS) * rng.lognormal(0, 0.5, (TIME, SENSORS))
    sunny = rng.random((TIME, SENSORS)) < rng.uniform(0, 0.3, (TIME, 1)) * rng.random(SENSORS)
    D = np.where(sunny, rng.lognormal(7, 1, (TIME, SENSORS)), 0)
    for values, threshold in ((E, 300.0), (D, 1000.0)):
        near = np.abs(values / threshold - 1) < 1e-4
        values[near] = 1.001 * threshold
    return dated(E.astype(np.float32)), dated(D.astype(np.float32))


def hard(E, D):
    return {
        "sda": metrics.sda(E),
        "ase": metrics.ase(D, hours=HOURS),
        "msda": metrics.msda(E).values,
        "mse": metrics.mse(D, hours=HOURS).values,
        "shade_closed": 100 * metrics.shade_closed(D, area=AREA).values,
    }


def twins(E, D, months, k):
    """Give all twins of tensors, in the units of `hard`."""
    return {
        "sda": smooth.sda(E, sharpness=k),
        "ase": smooth.ase(D, hours=HOURS, sharpness=k),
        "msda": smooth.msda(E, months, sharpness=k),
        "mse": smooth.mse(D, months, hours=HOURS, sharpness=k),
        "shade_closed": 100 * smooth.shade_closed(D, area=AREA, sharpness=k),
    }


NAMES = ["sda", "ase", "msda", "mse", "shade_closed"]


def numbers(value):
    return np.asarray(value.numpy(), float).ravel()


def test_at_high_sharpness_every_twin_is_its_metric():
    E, D = room()
    soft = twins(mi.TensorXf(E.values), mi.TensorXf(D.values), metrics.months(E), 1 << 17)
    for name, value in hard(E, D).items():
        assert np.ptp(np.append(value, [0, 100])) == 100 or 1 < np.mean(value) < 99
        np.testing.assert_allclose(numbers(soft[name]), np.atleast_1d(value), atol=1e-3)


@pytest.mark.parametrize(
    ("which", "threshold", "share"),
    [("sDA", 300.0, 0.5), ("ASE", 1000.0, 1 / 12), ("shade", 1000.0, AREA)],
)
def test_the_error_of_one_decision_falls_as_one_over_the_sharpness(which, threshold, share):
    """Counts within n ± n/k are wrong: half as many at 2k.

    Sums over sensors gain by errors that cancel, so this looks at single decisions: those of hours
    by the shade, and those of sensors, which are its decisions with time and sensors swapped. The
    slopes of the mean error over k in logarithms were −1.12, −1.01 and −1.05.
    """
    sharpness = (8, 16, 32, 64)
    error = np.zeros(len(sharpness))
    for seed in range(8):
        E, D = room(seed)
        decides = {"sDA": E.values.T, "ASE": D.values.T, "shade": D.values}[which]
        exact = metrics.shade_closed(dated(decides), threshold, share).values
        for i, k in enumerate(sharpness):
            soft = smooth.shade_closed(mi.TensorXf(decides), threshold, share, sharpness=k)
            error[i] += np.abs(soft.numpy() - exact).mean() / 8
    slope = np.polyfit(np.log(sharpness), np.log(error), 1)[0]
    assert -1.15 < slope < -0.85
    assert error[-1] < 0.05


def test_away_from_ties_the_error_falls_exponentially():
    """Illuminances 20 % off the threshold, counts 20 % off theirs: error < 2·100·1.2⁻ᵏ."""
    rng = np.random.default_rng(3)
    passing = np.arange(SENSORS) % 2 == 0
    reached = np.where(passing, 150, 90)  # of 240 hours, 120 are asked for
    above = rng.permuted(np.arange(TIME)[:, None] < reached, axis=0)
    E = mi.TensorXf(np.where(above, 360.0, 250.0).astype(np.float32))
    errors = [abs(smooth.sda(E, sharpness=k)[0] - 50.0) for k in (16, 32, 64)]
    for error, k in zip(errors, (16, 32, 64), strict=True):
        assert error < 200 * 1.2**-k + 1e-4


def step(x, k):
    with np.errstate(divide="ignore", over="ignore"):
        return 1 / (1 + np.power(x, -float(k)))


def in_double(name, E, D, months, k):
    """Sum over all values of a twin, written out again."""
    inner = step(E / 300, k) if name in ("sda", "msda") else step(D / 1000, k)
    if name == "shade_closed":
        need = int(np.ceil(AREA * SENSORS)) - 0.5
        return 100 * step(inner.sum(axis=1) / need, k).sum()
    total = 0.0
    for m in [None] if name in ("sda", "ase") else np.unique(months):
        rows = inner if m is None else inner[months == m]
        count = rows.sum(axis=0)
        year = 0.5 * len(rows) if name in ("sda", "msda") else HOURS * len(rows) / TIME
        total += 100 * step(count / (np.ceil(year - 1e-9) - 0.5), k).mean()
    return total


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("k", [4, 12, 40])
def test_values_and_gradients_are_those_of_the_formula(name, k):
    E, D = room()
    months = metrics.months(E)
    e, d = mi.TensorXf(E.values), mi.TensorXf(D.values)
    dr.enable_grad(e, d)
    value = dr.sum(twins(e, d, months, k)[name])
    dr.backward(value)
    E, D = E.values.astype(float), D.values.astype(float)
    assert numbers(value)[0] == pytest.approx(in_double(name, E, D, months, k), rel=2e-5)
    gradient = [dr.grad(t).numpy().astype(float) for t in (e, d)]
    rng = np.random.default_rng(4)
    directions = [rng.standard_normal(E.shape) * 1e-5 for _ in range(2)]
    for i, v in enumerate([(1, 0), (0, 1)]):
        move = [1 + s * w for s, w in zip(v, directions, strict=True)]
        back = [1 - s * w for s, w in zip(v, directions, strict=True)]
        slope = in_double(name, E * move[0], D * move[1], months, k) - in_double(
            name, E * back[0], D * back[1], months, k
        )
        along = 2 * (gradient[i] * directions[i] * (E, D)[i]).sum()
        assert along == pytest.approx(slope, rel=2e-3, abs=1e-9)


@pytest.mark.parametrize("fill", [0.0, 300.0, 1000.0, 1e-30, 1e30, np.inf, -1.0])
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("k", [1, 32, 1e6])
def test_ties_zeros_and_infinities_have_finite_values_and_gradients(fill, name, k):
    months = np.repeat([1, 7], 12)
    E = mi.TensorXf(np.full((24, 60), fill, np.float32))
    dr.enable_grad(E)
    value = twins(E, E, months, k)[name]
    assert np.isfinite(numbers(value)).all()
    assert ((numbers(value) >= 0) & (numbers(value) <= 100)).all()
    dr.backward(dr.sum(value))
    assert np.isfinite(dr.grad(E).numpy()).all()


def test_at_the_threshold_the_step_is_one_half_with_slope_k_over_4():
    x = mi.TensorXf([300.0, 0.0, 1e9])
    dr.enable_grad(x)
    y = smooth.step(x, 300.0, 12)
    np.testing.assert_allclose(y.numpy(), [0.5, 0, 1], atol=1e-7)
    dr.backward(dr.sum(y))
    np.testing.assert_allclose(dr.grad(x).numpy(), [12 / 4 / 300, 0, 0], rtol=1e-5, atol=1e-20)


def test_hours_without_sun_expose_and_close_nothing():
    dark = mi.TensorXf(np.zeros((5000, 600), np.float32))
    assert float(smooth.ase(dark, sharpness=1)[0]) < 1e-6
    assert numbers(smooth.shade_closed(dark, sharpness=1)).max() < 1e-6


def test_what_asks_for_nothing_is_always_reached_as_in_the_metrics():
    E = mi.TensorXf(np.zeros((24, 60), np.float32))
    months = np.repeat([1, 7], 12)
    assert float(smooth.sda(E, 0.0, 0.5, sharpness=1e5)[0]) == pytest.approx(100)
    assert float(smooth.sda(E, 300.0, 0.0, sharpness=8)[0]) == 100
    np.testing.assert_allclose(smooth.msda(E, months, 300.0, 0.0, sharpness=8).numpy(), 100)
    assert numbers(smooth.shade_closed(E, area=0.0, sharpness=8)).min() == 1


def test_only_months_with_time_stamps_are_given_in_any_order_of_the_stamps():
    E, _ = room()
    keep = np.isin(metrics.months(E), [3, 6, 12])
    E = E[keep]
    order = np.random.default_rng(5).permutation(len(E))
    sorted_ = smooth.msda(mi.TensorXf(E.values), metrics.months(E), sharpness=20)
    mixed = smooth.msda(mi.TensorXf(E.values[order]), metrics.months(E)[order], sharpness=20)
    assert sorted_.shape == (3,)
    np.testing.assert_allclose(mixed.numpy(), sorted_.numpy(), rtol=1e-5)


def test_the_blend_is_open_or_shaded_at_its_ends():
    rng = np.random.default_rng(6)
    open_, shaded = rng.uniform(0, 2000, (2, 3, 4)).astype(np.float32)
    blend = smooth.applied(*map(mi.TensorXf, (open_, shaded, [0.0, 1.0, 0.25]))).numpy()
    np.testing.assert_allclose(blend[0], open_[0])
    np.testing.assert_allclose(blend[1], shaded[1], rtol=1e-6)
    np.testing.assert_allclose(blend[2], 0.75 * open_[2] + 0.25 * shaded[2], rtol=1e-6)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda E: smooth.sda(E, sharpness=0.5), "sharpness: 0.5"),
        (lambda E: smooth.sda(E, sharpness=float("nan")), "sharpness: nan"),
        (lambda E: smooth.sda(E, -1.0, sharpness=8), "threshold: -1.0"),
        (lambda E: smooth.ase(E[0], sharpness=8), "shape: "),
        (lambda E: smooth.msda(E, np.ones(3), sharpness=8), "months: shape"),
        (lambda E: smooth.shade_closed(E, area=1.5, sharpness=8), "area: 1.5"),
    ],
)
def test_what_is_out_of_range_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call(mi.TensorXf(np.ones((4, 2), np.float32)))
