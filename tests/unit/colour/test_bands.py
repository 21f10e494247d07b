"""Bands: D65 is exact, standard illuminants have CIE S 026's numbers, products are integrals."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from drcmitsuba.colour.bands import (
    ALPHA_OPIC,
    GRID,
    TRISTIMULUS,
    Bands,
    colour,
    d65,
    efficacy,
    responses,
)

SHAPE = colour.SpectralShape(380, 780, 5)
EVERY = (*TRISTIMULUS, *ALPHA_OPIC)
# CIE S 026:2018, table 2: α-opic efficacies of luminous radiation of D65 [mW/lm].
EFFICACIES = {
    "melanopic": 1.3262, "s_cone_opic": 0.8173, "m_cone_opic": 1.4558, "l_cone_opic": 1.6289,
    "rhodopic": 1.4497,
}  # fmt: skip


@pytest.mark.parametrize(("name", "expected"), EFFICACIES.items())
def test_efficacies_of_d65_are_those_of_cie_s_026(name, expected):
    # On a grid of 5 nm instead of 1 nm, which moves the S cones by 1 in 1200.
    assert 1000 * efficacy(name) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("count", [9, 27])
@pytest.mark.parametrize("name", EVERY)
def test_weights_add_up_to_one_so_that_d65_is_exact(count, name):
    assert Bands.of(count).weights(name).sum() == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize(
    ("name", "ratio"), [("A", 0.496), ("D50", 0.847), ("D55", 0.904), ("E", 0.906)]
)
def test_melanopic_ratios_of_standard_illuminants(name, ratio):
    """Melanopic daylight efficacy ratios, as the CIE S 026 toolbox has them, to 3 digits."""
    power = colour.SDS_ILLUMINANTS[name].copy().align(SHAPE).values
    bands = Bands.of(27)
    u = bands.relative(GRID, power[:, None])[:, 0]
    assert bands.weights("melanopic") @ u == pytest.approx(ratio, abs=1e-3)


@pytest.fixture(scope="module")
def patches() -> np.ndarray:
    """Reflectances of the ColorChecker's 24 patches on `GRID`."""
    checker = colour.SDS_COLOURCHECKERS["babel_average"]
    return np.array([patch.copy().align(SHAPE).values for patch in checker.values()])


@pytest.mark.parametrize(("count", "worst", "usual"), [(9, 0.037, 0.006), (27, 0.004, 0.0015)])
def test_products_of_two_colours_and_daylight_are_their_integrals(patches, count, worst, usual):
    bands, errors = Bands.of(count), []
    weights = np.array([bands.weights(name) for name in EVERY])
    exact_weights = np.array([d65() * responses()[name] for name in EVERY])
    exact_weights /= exact_weights.sum(axis=1, keepdims=True)
    for cct in (4100, 5000, 6500, 9000, 15_000, 24_000):
        xy = colour.temperature.CCT_to_xy_CIE_D(cct)
        light = colour.sd_CIE_illuminant_D_series(xy).align(SHAPE).values / d65()
        for first in patches[::2]:
            for second in patches:
                product = light * first * second
                exact = exact_weights @ product
                factors = (bands.sampled(GRID, x) for x in (light, first, second))
                errors.append(weights @ np.prod(list(factors), axis=0) / exact - 1)
    assert np.abs(errors).max() < worst
    assert np.sqrt(np.square(errors).mean(axis=0)).max() < usual


def test_light_of_one_lux_is_one_lux_whatever_its_colour():
    bands = Bands.of(9)
    power = np.stack([GRID**2, np.exp(-(((GRID - 600) / 60) ** 2))], axis=1)
    assert bands.weights("Y") @ bands.relative(GRID, power) == pytest.approx(1)


def test_temperatures_of_chromaticities():
    from drcmitsuba.colour.appearance import temperatures

    xy = np.array([colour.temperature.CCT_to_xy_CIE_D(t) for t in (4500, 6504, 12_000)] + [[0, 0]])
    cct, duv = temperatures(*xy.T)
    assert cct[:3] == pytest.approx([4500, 6504, 12_000], rel=3e-3)
    assert (duv[:3] > 0.001).all()  # phases of daylight lie above the locus
    assert np.isnan([cct[3], duv[3]]).all()


def test_numpy_prints_as_before_once_colour_science_is_imported():
    code = "import numpy as np; from drcmitsuba.colour.bands import d65; d65(); print(np.ones(1))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[1.]\n"
