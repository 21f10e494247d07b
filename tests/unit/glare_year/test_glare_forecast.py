"""Forecast of a year of glare: what it counts, and its order of magnitude."""

from contextlib import contextmanager

import pytest

import drcmitsuba
from drcmitsuba.glare_year import forecast
from drcmitsuba.glare_year.eyes import eyes
from drcmitsuba.plan import plan
from drcmitsuba.runtime import backend, machine_speed
from drcmitsuba.sky.daylight import daylight
from tests.unit.glare_year.glare_room import case_in


@pytest.fixture
def counted(tmp_path, monkeypatch):
    """Seconds for some changes of the accuracy, on the reference machine."""
    backend.select()
    monkeypatch.setattr(machine_speed, "speed", lambda: machine_speed.Speed())
    case = case_in(tmp_path)
    light = daylight(case)
    looking, scope = eyes(case), plan(case, light).scope

    def seconds(states=("open",), **accuracy):
        changed = case.with_tables(accuracy=case.accuracy.model_copy(update=accuracy))
        return forecast.seconds(changed, list(states), light, looking, scope) - forecast.LEAST

    return seconds


def test_states_and_replicates_multiply_the_time(counted):
    once = counted(replicates=4)
    assert counted(replicates=8) == pytest.approx(2 * once)
    assert counted(states=("open", "open"), replicates=4) == pytest.approx(2 * once)


def test_the_command_is_told_before_it_works(tmp_path):
    told = []

    @contextmanager
    def stage(name):
        told.append(name)
        yield lambda share: None

    drcmitsuba.glare(case_in(tmp_path), stage=stage, told=told.append)
    (seconds,) = (item for item in told if not isinstance(item, str))
    assert 0 < seconds < 60
    assert told[: told.index(seconds)] == ["sky"]
    assert len(told) > 2
