"""Sums of very many, very unequal numbers: each against the same sum in double precision.

Single precision drifts where it adds alike numbers again and again: 0.1 a million times is 1 % off.
"""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import xarray as xr

from drcmitsuba.design.room_matrices import Sums
from drcmitsuba.metrics import accumulate, smooth
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.intervals.draw import _means
from drcmitsuba.metrics.intervals.facade_draws import Closures
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene as scenes
from drcmitsuba.transport.films.sums import summed, widened
from drcmitsuba.transport.light import products
from drcmitsuba.transport.light.products import RayMatrix
from drcmitsuba.transport.rays.shadow_rays import sky_deposit

ENOUGH = 1e-5
"""Relative error that is allowed, everywhere: far below any standard error."""
MANY = 3_000_000


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


def flat(values, kind=np.float32):
    array = np.ascontiguousarray(values, kind).ravel()
    return mi.UInt32(array) if kind is np.uint32 else mi.Float(array)


# Deposit and gather


@pytest.mark.parametrize("rays", [1 << 20, MANY])
def test_every_ray_of_a_point_in_one_bin(rays, holds):
    """A point that faces down: all its rays end in the ground, exactly π. Float32: 3e-4 off."""
    D = sky_deposit(
        scenes.build([]), flat([0, 0, 0]), flat([0, 0, -1]), subdivision=1, rays=rays, seed=1
    )
    holds("D of the ground over π − 1", abs(D.numpy()[0, 0] / np.pi - 1), ENOUGH)


@pytest.mark.parametrize("kind", ["alike", "unequal"])
def test_three_million_vertices_in_one_cell(kind, holds):
    """Gather paths of one sensor that all end in one cell, as in a small white box."""
    rng = np.random.default_rng(1)
    weight = np.full(MANY, 0.1 / MANY) if kind == "alike" else 10 ** rng.uniform(-12, -6, MANY)
    weight, D = weight.astype(np.float32), np.array([[0.3, 1e-4, 1.2]], np.float32)
    zeros = dr.zeros(mi.UInt32, MANY)
    product = products.product(RayMatrix(zeros, zeros, flat(weight), 1), mi.TensorXf(D))
    exact = weight.astype(float).sum() * D
    holds("G·D", abs(product.numpy() / exact - 1), ENOUGH)


@pytest.mark.parametrize("cells", [4095, 4096, 4097, 150_000])
def test_many_cells_of_one_sensor(cells, holds):
    """Products with more cells than single precision can sum in one go; and at the steps' ends."""
    rng = np.random.default_rng(2)
    weight = rng.random((2, cells)).astype(np.float32)
    weight[1] = 0.1
    D = rng.random((cells, 5)).astype(np.float32)
    D[:, 3], D[:, 4] = 0, 0.1
    row, cell = np.divmod(np.arange(2 * cells), cells)
    paths = RayMatrix(flat(row, np.uint32), flat(cell, np.uint32), flat(weight), 2)
    product = products.product(paths, mi.TensorXf(D)).numpy()
    exact = weight.astype(float) @ D.astype(float)
    lit = exact > 0
    holds("G·D", abs(product[lit] / exact[lit] - 1), ENOUGH)
    holds("a bin without light", product[~lit], 0)


def test_what_a_receiver_sees_of_films(holds):
    """All directions of a receiver, one after another: 131,072 of the most that a case may ask."""
    n, bins = 1 << 17, 3
    weight, table = np.full(n, 0.1 / n, np.float32), np.array([[1.0, 1e-3, 2e3]], np.float32)
    row = dr.zeros(mi.UInt32, n)
    first, answers = flat([0, n], np.uint32), widened(flat(table), bins)
    D = summed(first, flat(weight), row, answers, None, None, bins).numpy()
    exact = weight.astype(float).sum() * table[0].astype(float)
    holds("D by way of films", abs(D / exact - 1), ENOUGH)


def test_paths_at_other_reflectances(holds):
    """Weights of `Interior`: three million vertices in one place, and the gradient through them."""
    value = np.full(MANY, 0.1, np.float32)
    zeros = dr.zeros(mi.UInt32, MANY)
    factor = mi.Float(0.7)
    dr.enable_grad(factor)
    G = Sums(zeros, zeros, flat(value), 1).weighed(factor)
    dr.backward(G)
    exact = value.astype(float).sum()
    holds("G", abs(G.numpy() / (exact * np.float32(0.7)) - 1), ENOUGH)
    holds("dG/dρ", abs(factor.grad.numpy() / exact - 1), ENOUGH)


# Accumulation


def year(hours, bins, suns, sensors, replicates, seed=0):
    """Coefficients and luminances over eleven decades, as float32 has them, and in double."""
    rng = np.random.default_rng(seed)
    C = 10 ** rng.uniform(-6, 0, (replicates, sensors, bins + suns))
    C[:, :, bins:] *= 1e-5
    C[:, 0] = 0.1  # alike numbers
    L = 10 ** rng.uniform(-2, 4.5, (hours, bins))
    sun = np.where(rng.random(hours) < 0.6, 10 ** rng.uniform(0, np.log10(2e9), hours), 0)
    L[0], sun[1] = 0, 2e9
    C, L, sun = (a.astype(np.float32) for a in (C, L, sun))
    sky = [f"sky_{i}" for i in range(bins)]
    own = np.array([f"sun_{i % suns}" for i in range(hours)], object)
    time = np.datetime64("2015-01-01", "ns") + np.arange(hours) * np.timedelta64(1, "h")
    light = xr.Dataset(
        {"sky": (("time", "bin"), L), "sun": ("time", sun)},
        {"time": time, "bin": np.array(sky, object), "sun_bin": ("time", own)},
    )
    bin_ = np.array([*sky, *(f"sun_{i}" for i in range(suns))], object)
    data = xr.Dataset(
        {"replicates": (("replicate", "sensor", "bin"), C),
         "straight": (("sensor", "bin"), C[0]), "straight_se": (("sensor", "bin"), C[1])},
        {"bin": bin_},
    )  # fmt: skip
    C, L, sun = (a.astype(float) for a in (C, L, sun))
    by_sun = C[:, :, bins + np.arange(hours) % suns].transpose(0, 2, 1) * sun[:, None]
    return data, light, L @ C[:, :, :bins].transpose(0, 2, 1), by_sun


def off(value, exact):
    """Relative distances; 0 where both are 0."""
    value = np.asarray(value, float)
    return np.where(exact == 0, abs(value), abs(value / np.where(exact == 0, 1, exact) - 1))


@pytest.mark.parametrize(
    ("hours", "bins", "suns"), [(8760, 146, 2600), (600, 5186, 300)], ids=["year", "MF 6"]
)
def test_a_year_of_products(hours, bins, suns, holds):
    """8760 hours, 2600 suns, luminances from 0.01 to 2·10⁹ cd/m² in one matrix; the finest sky."""
    C, light, by_sky, by_sun = year(hours, bins, suns, 7, 3)
    E = accumulate.by_source(C, light)
    total = by_sky + by_sun
    n = len(total)
    for name, exact in (("sky", by_sky), ("sun", by_sun), ("total", total)):
        holds(f"E by {name}", off(E[name], exact.mean(axis=0)), ENOUGH)
        error = exact.std(axis=0, ddof=1) / np.sqrt(n)
        # Where replicates are alike to the last digits, the scatter is that of rounding.
        error = np.maximum(error, ENOUGH * exact.mean(axis=0))
        far = abs(E[f"{name}_se"].values - exact.std(axis=0, ddof=1) / np.sqrt(n))
        holds(f"standard error of {name}", far / np.where(error > 0, error, 1), 1e-4)
    some = np.array([0, 3, 6])
    E = accumulate.replicates(C, light, some)
    holds("E of every replicate", off(E, total[:, :, some]), ENOUGH)
    holds("direct sun", off(accumulate.direct_sun(C, light)["direct_sun"], by_sun[0]), ENOUGH)


def test_mean_over_more_sensors_than_single_precision_counts(holds):
    """57,600 sensors with the same coefficients: NumPy adds them one by one, 6e-4 off."""
    sensors = 57_600
    C = xr.Dataset(
        {"replicates": (
            ("state", "replicate", "sensor", "bin"), np.full((1, 2, sensors, 2), 0.1, np.float32)
        )},
        {"bin": np.array(["sky_0", "sun_0"], object), "state": np.array(["open"], object)},
    )  # fmt: skip
    time = np.array(["2015-03-21T10:00", "2015-03-21T11:00"], "datetime64[ns]")
    light = xr.Dataset(
        {"sky": (("time", "bin"), [[1000.0], [0.01]]), "sun": ("time", [0.0, 0.0])},
        {"time": time, "bin": np.array(["sky_0"], object),
         "sun_bin": ("time", np.array(["", ""], object))},
    )  # fmt: skip
    E = _means(Coefficients.of(C), light, Closures.never(2)).mean()
    exact = float(np.float32(0.1)) * 1000.01 / 2
    holds("mean E", abs(E / exact - 1), ENOUGH)


# Smooth twins


@pytest.mark.parametrize("shape", [(8760, 3), (52_560, 2), (3, 57_600)])
def test_twins_of_long_years_and_large_rooms(shape, holds):
    """Counts of hours or of sensors that pass half: 8760 equal steps are 8e-5 off in float32."""
    k, months = 8.0, 1 + np.arange(shape[0]) * 12 // shape[0]
    E, D = np.full(shape, 270.0, np.float32), np.full(shape, 900.0, np.float32)
    rng = np.random.default_rng(1)
    E[:, 1:] *= rng.uniform(0.5, 2, (shape[0], shape[1] - 1)).astype(np.float32)

    def step(x):
        return 1 / (1 + x.astype(float) ** -k)

    inner = step(E / np.float32(300)).astype(np.float32).astype(float)
    need = np.ceil(0.5 * shape[0]) - 0.5
    exact = 100 * step(inner.sum(axis=0) / need).mean()
    holds("sDA", abs(smooth.sda(mi.TensorXf(E), sharpness=k)[0] / exact - 1), 2 * ENOUGH)
    monthly = [
        100 * step(inner[months == m].sum(axis=0) / (np.ceil((months == m).sum() / 2) - 0.5)).mean()
        for m in np.unique(months)
    ]
    months_lit = smooth.msda(mi.TensorXf(E), months, sharpness=k).numpy()
    holds("msDA", abs(months_lit / np.array(monthly) - 1), 2 * ENOUGH)
    inner = step(D / np.float32(1000)).astype(np.float32).astype(float)
    exact = step(inner.sum(axis=1) / (np.ceil(0.02 * shape[1]) - 0.5))
    closed = smooth.shade_closed(mi.TensorXf(D), sharpness=k).numpy()
    holds("shade closed", abs(closed / exact - 1), 2 * ENOUGH)
