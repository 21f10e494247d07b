"""Counts of sensors that pass in every draw, against counting them one by one."""

import numpy as np
import pytest

from drcmitsuba.metrics.intervals import bootstrap_counts
from drcmitsuba.metrics.intervals.bootstrap_counts import BootstrapCounts, Needed
from drcmitsuba.metrics.intervals.rules import DRAWS

STAMPS, SENSORS, GRIDS = 700, 9, 2


def year(seed, month):
    """Entries that pass for certain, those in doubt, and their draws (time, sensor, draw)."""
    rng = np.random.default_rng(seed)
    doubtful = rng.random((STAMPS, SENSORS)) < np.linspace(0, 0.9, SENSORS)
    sure = (rng.random((STAMPS, SENSORS)) < 0.45) & ~doubtful
    shared = rng.random((STAMPS, 1, DRAWS)) < np.linspace(0.2, 0.7, DRAWS)
    passed = doubtful[..., None] & (shared ^ (rng.random((STAMPS, SENSORS, 1)) < 0.2))
    stamps = np.bincount(month, minlength=12)
    needed = Needed(
        month, np.ceil(0.5 * stamps).astype(int), STAMPS // 2, np.arange(SENSORS) % GRIDS
    )
    return sure, doubtful, passed, needed


MONTHS = {
    "a year": np.sort(np.arange(STAMPS) % 12),
    "over the turn of the year": np.roll(np.sort(np.arange(STAMPS) % 12), 100),
    "one long month": np.zeros(STAMPS, int),
    "some months": np.sort(np.arange(STAMPS) % 3) + 4,
}


@pytest.mark.parametrize(
    ("held", "together"), [(1, 1), (900, 50), (1 << 20, 50), (1 << 20, 1 << 12)]
)
@pytest.mark.parametrize("name", MONTHS)
def test_counts_are_those_of_every_draw_by_itself(monkeypatch, name, held, together):
    monkeypatch.setattr(bootstrap_counts, "HELD", held)
    monkeypatch.setattr(bootstrap_counts, "TOGETHER", together)
    month = MONTHS[name]
    sure, doubtful, passed, needed = year(5, month)
    tally = BootstrapCounts(needed, needed.count(sure), needed.count(doubtful))
    for time, sensor in tally.wanted(doubtful):
        blocks = [*tally.blocks(sensor)]
        assert [0, *(b.stop for b in blocks)] == [*(b.start for b in blocks), len(sensor)]
        for here in blocks:
            drawn = passed[time[here], sensor[here]]
            tally.add(tally.counted(sensor[here], time[here], drawn))
    every = sure[..., None] | passed
    of_month = np.stack([every[month == m].sum(axis=0) for m in range(12)], axis=1)
    passes = of_month >= needed.monthly[:, None]
    year_passes = every.sum(axis=0) >= needed.yearly
    for g in range(GRIDS):
        mine = needed.grid == g
        of_year, by_month = tally.shares(g)
        np.testing.assert_allclose(of_year, 100 * year_passes[mine].mean(axis=0))
        some = ~needed.empty
        np.testing.assert_allclose(by_month[some], 100 * passes[mine].mean(axis=0)[some])
        assert np.isnan(by_month[~some]).all()
    np.testing.assert_allclose(tally.passing, year_passes.mean(axis=1))
    doubt = (tally.passing > 0.025) & (tally.passing < 0.975)
    q = passed.mean(axis=2)
    np.testing.assert_array_equal(
        tally.hours, ((q > 0.025) & (q < 0.975) & doubtful)[:, doubt].sum(axis=1)
    )
    assert doubt.any()


def test_nothing_is_drawn_where_nothing_is_in_doubt():
    sure, _, _, needed = year(6, MONTHS["a year"])
    none = np.zeros_like(sure)
    tally = BootstrapCounts(needed, needed.count(sure), needed.count(none))
    for time, sensor in tally.wanted(none):
        assert len(time) == 0
        assert [*tally.blocks(sensor)] == []
    of_year, _ = tally.shares()
    assert set(of_year) == {100 * (sure.sum(axis=0) >= needed.yearly).mean()}
