"""Rounds of a picture: their mean and its error, and when they end."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.picture.picture import Picture
from drcmitsuba.rendering import rounds
from drcmitsuba.rendering.rendering import Rendering
from drcmitsuba.rendering.rounds import MANY, Mean, PictureTarget, toward
from drcmitsuba.runtime import time_limit
from drcmitsuba.runtime.errors import InputError

NOON, EVENING = np.datetime64("2015-03-20T12:00", "ns"), np.datetime64("2015-03-20T18:00", "ns")
SHAPE = (2, 3)


def rendering(L, error, disk=0.0, time=NOON):
    rgb = np.full((*SHAPE, 3), L + disk, np.float32)
    errors, disks = (np.full(SHAPE, value, np.float32) for value in (error, disk))
    return Rendering(Picture(rgb), errors, disks, 3, "case", "desk", "open", time)


def test_the_half_width_is_that_of_all_but_the_disk():
    shown = rendering(200.0, 4.0, disk=1e6)
    # Student's factor of three degrees of freedom is 3.1824; the error is 2 % of the luminance.
    assert shown.half_width == pytest.approx(2 * 3.1824, rel=1e-3)
    assert rendering(0.0, 0.0).half_width == 0


def test_the_half_width_weighs_pixels_by_their_luminance():
    shown, dark = rendering(300.0, 3.0), np.zeros(SHAPE, bool)
    dark[:, 1:] = True
    rgb = np.where(dark[..., None], 0, shown.picture.rgb)
    half = replace(shown, picture=Picture(rgb), error=np.where(dark, 0, shown.error))
    assert half.half_width == pytest.approx(shown.half_width, rel=1e-6)


@pytest.mark.parametrize("count", [2, MANY - 1, MANY, 12])
def test_rounds_are_averaged_as_independent_ones(count):
    rng = np.random.default_rng(2)
    each = [rendering(L, e) for L, e in rng.uniform(1, 9, (count, 2))]
    mean = Mean(each[0])
    for more in each[1:]:
        mean = mean.added(more)
    assert mean.rounds == count
    rgb = np.stack([one.picture.rgb for one in each])
    np.testing.assert_allclose(mean.shown.picture.rgb, rgb.mean(axis=0), rtol=1e-5)
    if count < MANY:
        expected = np.sqrt(np.sum([one.error**2 for one in each], 0)) / count
        assert mean.shown.freedom == 3 * count
    else:
        expected = rgb[..., 0].std(axis=0, ddof=1) / np.sqrt(count)
        assert mean.shown.freedom == count - 1
    np.testing.assert_allclose(mean.shown.error, expected, rtol=1e-4)


class Made:
    """View whose rounds take 10 s on a clock of its own; pictures of the evening are sure."""

    def __init__(self, monkeypatch):
        self.clock, self.begun, self.seeds = 0.0, [], []
        self.case = SimpleNamespace(accuracy=Accuracy())
        self.channels = (SimpleNamespace(rows=SHAPE[0], columns=SHAPE[1]),)
        monkeypatch.setattr(time_limit.time, "perf_counter", lambda: self.clock)

    def again(self, seed, folder):
        self.begun.append(self.clock)
        self.seeds.append(seed)
        self.clock += 10
        return self

    def at(self, instant, source, state):
        return rendering(100.0, 1.0 if instant == NOON else 0.1, time=instant)


def pictures(view, percent, seconds, instants=(NOON, EVENING)):
    shown = [(instant, "open") for instant in instants]
    return list(toward(PictureTarget(percent, seconds), view, shown, "all", None))


def test_rounds_end_where_every_picture_has_the_target(monkeypatch):
    view = Made(monkeypatch)
    noon, evening = pictures(view, 1.2, 1000)
    # Two rounds: 2.447 · 0.71 = 1.73 %; three: 1.31 %; four: 1.09 %.
    assert view.begun == [0, 10, 20]
    assert len(set(view.seeds)) == 3
    assert (noon.freedom, evening.freedom) == (12, 3)
    assert noon.half_width == pytest.approx(2.1788 / 2, rel=1e-3)
    assert noon.notes == (
        "03-20 12:00: luminance of a pixel ±1.09 % after 4 rounds, wanted ±1.2 %",
    )
    assert "after 1 round, wanted" in evening.notes[0]


def test_no_round_begins_after_the_time_limit(monkeypatch):
    view = Made(monkeypatch)
    noon, _ = pictures(view, 0.5, 15)
    assert view.begun == [0, 10]
    assert noon.notes[0].endswith("after 3 rounds, wanted ±0.5 %; the limit of 15 s is over")


def test_pictures_that_do_not_fit_together_share_the_time(monkeypatch):
    monkeypatch.setattr(rounds, "TOGETHER", 1)
    view = Made(monkeypatch)
    shown = pictures(view, 0.5, 30, (NOON, NOON))
    assert view.begun == [0, 10, 20, 30]
    assert [one.freedom for one in shown] == [9, 9]


@pytest.mark.parametrize("text", ["2", "1 point", "2 % at each sensor", "0 %"])
def test_other_targets_are_refused(text):
    with pytest.raises(InputError, match=f'picture: target: .{text}.; write "2 %"'):
        PictureTarget.parse(text, 60)


def test_a_time_of_none_is_refused():
    with pytest.raises(InputError, match="time limit: 0 s; give more than 0 s"):
        PictureTarget.parse("2 %", 0)
