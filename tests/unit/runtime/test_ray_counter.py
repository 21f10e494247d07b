"""Rays are counted by kind and by purpose, within loops as well."""

import drjit as dr
import mitsuba as mi
import pytest

from drcmitsuba.runtime import backend
from drcmitsuba.runtime.ray_counter import KINDS, RayCounter


@pytest.fixture(autouse=True)
def _variant():
    backend.select()


def test_rays_count_for_their_purpose_and_for_the_whole():
    counter = RayCounter()
    lane = dr.arange(mi.UInt32, 10)
    counter.add("path", lane < 7, 10)
    with counter.purpose("CELLS"):
        counter.add("shadow", lane < 4, 10)
        with counter.purpose("SKY"):
            counter.add("shadow", lane < 3, 10)
        counter.take("photon", 5)
    assert counter.counted() == {"shadow": 7, "path": 7, "pane": 0, "photon": 5}
    rays = counter.by_purpose()
    assert set(rays) == {(), ("CELLS",), ("CELLS", "SKY")}
    assert rays[("CELLS",)] == {**dict.fromkeys(KINDS, 0), "shadow": 4, "photon": 5}
    assert rays[("CELLS", "SKY")]["shadow"] == 3


def test_a_purpose_ends_where_its_work_fails():
    counter = RayCounter()
    with pytest.raises(ZeroDivisionError), counter.purpose("CELLS"):
        raise ZeroDivisionError
    counter.take("photon", 1)
    assert counter.by_purpose()[()]["photon"] == 1
