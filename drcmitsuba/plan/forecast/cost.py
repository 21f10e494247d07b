"""Seconds of units of work on the reference machine, and of a forecast on this one."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from typing import NamedTuple

from drcmitsuba.plan.forecast.machine import Speed
from drcmitsuba.plan.forecast.work import Work


class Unit(NamedTuple):
    """Seconds of one unit of work on the reference machine, and what they scale with.

    `kernel` work is done by all threads, or by a GPU; the rest by NumPy and Python in one thread.
    """

    seconds: float
    kernel: bool = True


UNITS: Mapping[str, Unit] = {
    # Rays: towards sky and suns, of the gather, towards panes that scatter, of photons.
    "shadow": Unit(2.5e-8),
    "path": Unit(6.2e-8),
    "pane": Unit(1.8e-8),
    "photon": Unit(5.4e-8),
    # Shadow rays by clear panes, in addition; lanes that may trace a ray; vertices of paths;
    # photons at their ports.
    "pierced": Unit(4.5e-8),
    "sky_lane": Unit(1.2e-8),
    "sun_lane": Unit(1.25e-8),
    "look": Unit(8e-9),
    "vertex": Unit(1.05e-8),
    "start": Unit(6e-8),
    # Numbers of D, products of G·D, answers of films: to suns, to the sky, and their sums.
    "deposit": Unit(2.4e-9),
    "product": Unit(2.4e-11),
    "film_sun": Unit(1.45e-8),
    "film_sky": Unit(4e-8),
    "film_sum": Unit(1.8e-9),
    # Scenes, blocks of sensors in a replicate, coefficients of a replicate.
    "state": Unit(0.04, kernel=False),
    "launch": Unit(0.05, kernel=False),
    "entry": Unit(4.5e-8, kernel=False),
    # Time stamps × patches, products of C·L, illuminances of replicates and their draws.
    "evaluation": Unit(0.3, kernel=False),
    "luminance": Unit(9e-7, kernel=False),
    "accumulated": Unit(3e-11, kernel=False),
    "illuminance": Unit(2.8e-8, kernel=False),
    "byte": Unit(6e-9, kernel=False),
    "picture": Unit(1.0, kernel=False),
}
"""Fitted by `python -m tests.bench.forecast --fit` to processor seconds, those of kernels halved
for the two threads of the reference."""


def seconds(amounts: Mapping[str, float], speed: Speed) -> dict[str, float]:
    """Seconds of amounts of work by unit."""
    return {
        name: amount * UNITS[name].seconds / (speed.rays if UNITS[name].kernel else speed.host)
        for name, amount in amounts.items()
    }


def by_effect(work: Work, speed: Speed) -> dict[str, float]:
    """Seconds of each effect."""
    out: dict[str, float] = defaultdict(float)
    for (effect, unit), amount in work.amounts.items():
        out[effect] += seconds({unit: amount}, speed)[unit]
    return dict(out)
