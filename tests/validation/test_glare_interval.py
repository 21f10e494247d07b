"""Scatter of DGP over seeds against the standard error that one run gives.

Rationale: the error of DGP holds the noise of E_v and of bright surfaces. It leaves out that of a
film's glow and of the sun's disk, and that noise joins or parts sources.

Method: an office with a prism film, 96 hours of a year, three views, ten seeds. Hours in which part
of the sun's disk is seen count, too.

Expected: the scatter over all hours and views is that of the error, in the mean of the squares to
within what ten seeds show: hours share their noise, so that they are worth some tens of numbers.
"""

import numpy as np
import pytest

import drcmitsuba
from tests.unit.glare_year.glare_room import case_in
from tests.unit.glare_year.test_glare_of_films import FILM, PRISM

SEEDS = 10
DAYS = [f"{month:02d}-{day}" for month in range(1, 13) for day in ("04", "18")]
TIMES = [f"{day}T{hour:02d}:30" for day in DAYS for hour in (9, 11, 13, 15)]


@pytest.mark.slow
@pytest.mark.parametrize("material", ["glass", "film"])
def test_dgp_scatters_over_seeds_as_its_error_says(material, tmp_path):
    more = FILM.format(file=PRISM) if material == "film" else ""
    case = case_in(tmp_path, material=material, more=more, times=TIMES)
    runs = []
    for seed in range(SEEDS):
        accuracy = case.accuracy.model_copy(update={"seed": seed, "replicates": 8, "paths": 128})
        runs.append(drcmitsuba.glare(case.with_tables(accuracy=accuracy)).hours.sel(state="open"))
    dgp = np.stack([hours["dgp"].values for hours in runs]).astype(float)
    told = np.stack([hours["dgp_se"].values for hours in runs]).astype(float)
    lit = (dgp.mean(axis=0) > 0.2) & (dgp.max(axis=0) < 1)  # DGP ends at 1
    scatter = np.sqrt(dgp.var(axis=0, ddof=1)[lit].mean())
    error = np.sqrt((told**2).mean(axis=0)[lit].mean())
    ratios = np.sqrt(dgp.var(axis=0, ddof=1)[lit] / (told**2).mean(axis=0)[lit])
    print(f"{material}: {lit.sum()} hours and views, scatter {scatter:.5f}, error {error:.5f},")
    print(f"quartiles of the ratio {np.quantile(ratios, (0.25, 0.5, 0.75, 0.99)).round(2)}")
    assert scatter == pytest.approx(error, rel=0.25)
    assert 0.7 < np.median(ratios) < 1.3
