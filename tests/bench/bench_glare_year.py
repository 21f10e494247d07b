"""Seconds of a year of glare once C and what is seen are known, for one view and for a hundred.

    python -m tests.bench.bench_glare_year

prints seconds of the processor and of the clock, and those of a further façade by opening and fill
in the occupied hours: a hundred and four views from thirteen places, on all cores and on one.
The year has all its daylight hours, 8760 time stamps; a hundred views of it are twelve and a half
places of eight views, of which one is measured. The one view is of the same place and has all its
rays, those behind it as well.
"""

import time
from dataclasses import replace
from itertools import product

import drjit as dr
import numpy as np

from drcmitsuba import load_case
from drcmitsuba.annual.run import Run
from drcmitsuba.case.weather import PeriodTable
from drcmitsuba.glare_year import glare_elements
from drcmitsuba.glare_year.eyes import eyes
from drcmitsuba.glare_year.rule import Rule
from drcmitsuba.glare_year.state import places
from drcmitsuba.plan import plan
from drcmitsuba.runtime import backend
from drcmitsuba.sky.daylight import daylight

EYE = (4.4, 3.0, 1.2)
"""Place of the eyes [m]."""


def main():
    whole = PeriodTable(hours=(0, 24), calendar="LM-83")
    case = load_case("classroom/o1").with_tables(period=whole)
    backend.select()
    light, looking = daylight(case), eyes(case, [EYE])
    run = Run.of(case, plan(case, light).scope)
    (place,) = places(case, "open", light, looking, run, Rule().least)
    times = np.arange(light.sky.sizes["time"])
    lit = int((light.sky["sky"].values > 0).any(axis=1).sum())
    print(f"{len(times)} time stamps, {lit} with daylight")
    eight = _seconds(place, looking, times)
    tiles = replace(place.known.seen.tiles, forward=looking.forward[:1])
    alone = replace(place.known.seen, tiles=tiles, frames=looking.frames[:1])
    known = replace(place.known, seen=alone)
    one = _seconds(replace(place, views=place.views[:1], known=known), looking, times)
    for name, seconds, places_of_it in (
        ("one view", one, 1),
        ("one place of eight views", eight, 1),
        ("a hundred views", eight, 12.5),
    ):
        clock, used = (places_of_it * value for value in seconds)
        print(f"{name}: {clock:.1f} s, {used:.1f} s of the processor")
    _by_element()


def _by_element():
    """Seconds of a further façade of thirteen places of eight views, from light by element."""
    case = load_case("classroom/reference/o1")
    seen = glare_elements(case, [*product((1.5, 3.0, 4.4, 6.0), (2.0, 4.0, 6.0), (1.2,)), EYE])
    views, hours = len(seen.looking), seen.facades.light.sky.sizes["time"]
    fills = (*seen.fills["south"], seen.fills["south"][0])  # the first one compiles kernels
    for cores in (dr.thread_count(), 1):
        dr.set_thread_count(cores)
        for south in fills:
            start, used = time.perf_counter(), time.process_time()
            seen.evaluate({"south": south})
            clock, used = time.perf_counter() - start, time.process_time() - used
            words = f"{clock:.2f} s, {used:.2f} s of the processor"
            print(f"south {south}, {views} views, {hours} hours, threads {cores}: {words}")


def _seconds(place, looking, times):
    """Seconds of the clock and of the processor; the first run compiles kernels."""
    for _ in range(2):
        start, used = time.perf_counter(), time.process_time()
        place.sums(Rule(), times)
        seconds = time.perf_counter() - start, time.process_time() - used
    return seconds


if __name__ == "__main__":
    main()
